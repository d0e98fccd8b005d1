"""What the command lines of all packages have in common: the parser, and where a refused key was written."""

import argparse
import re
import textwrap
from collections.abc import Sequence
from pathlib import Path

from holdfast import files


def command_parser(command: str, description: str, examples: str) -> argparse.ArgumentParser:
    """Make the parser of a command; its help ends with `examples`, as they stand."""
    return argparse.ArgumentParser(
        prog=f"holdfast {command}",
        description=textwrap.fill(description, 100),
        epilog=examples,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )


def located(file: Path, overrides: Sequence[str], said: str) -> str:
    """Return what is wrong with where it stands: in a `--set KEY=VALUE`, or in the file and on which line.

    `said` begins with its key, or with that of the table it makes unusable.
    """
    refused = re.split(r"[\s:\[]", said, maxsplit=1)[0]
    for override in reversed(overrides):
        key = override.partition("=")[0].strip()
        if f"{refused}.".startswith(f"{key}.") or key.startswith(f"{refused}."):
            return f"--set {override}: {said}"
    line = files.line_of(file, re.split(r"[\s:]", said, maxsplit=1)[0])
    return f"{file}: {said}{f' (line {line})' if line else ''}"


def address(text: str) -> tuple[str, int]:
    """Return host and port of an argument such as 127.0.0.1:8600."""
    host, _, port = text.rpartition(":")
    if not host or not port.isdigit() or int(port) > 65535:
        raise argparse.ArgumentTypeError(f"'{text}' is not HOST:PORT, such as 127.0.0.1:8600")
    return host.strip("[]"), int(port)


def position(text: str) -> tuple[float, float]:
    """Return latitude and longitude, degrees, of an argument such as 47.40,8.55."""
    try:
        latitude, longitude = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not LAT,LON, such as 47.40,8.55") from None
    if not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0):
        raise argparse.ArgumentTypeError(f"'{text}': want degrees within ±90,±180")
    return latitude, longitude
