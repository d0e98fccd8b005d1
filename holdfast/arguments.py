"""What the command lines of all packages have in common: the parser, and where a refused key was written."""

import argparse
import re
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

DESCRIBE = "--_parser"
"""What a command is called with, alone, by whoever wants its parser and not its work."""
FILES = "FILE", "DIR", "PATH", "WHEEL"
"""Metavariables that a shell completes to the names of files."""


A = TypeVar("A", bound=argparse.Action)


class DescribedError(Exception):
    """Ends a command that was called with `DESCRIBE`."""

    def __init__(self, parser: argparse.ArgumentParser) -> None:
        super().__init__(parser.prog)
        self.parser = parser


class CommandParser(argparse.ArgumentParser):
    """A parser that also tells a shell what it takes."""

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse; raise DescribedError for `DESCRIBE`."""
        if args == [DESCRIBE]:
            raise DescribedError(self)
        return super().parse_known_args(args, namespace)

    def _add_action(self, action: A) -> A:
        if any(name in str(action.metavar) for name in FILES):
            action.complete = "file"  # type: ignore[attr-defined]  # shtab looks for it
        return super()._add_action(action)


def command_parser(command: str, description: str, examples: str) -> CommandParser:
    """Make the parser of a command; its help ends with `examples`, as they stand."""
    return CommandParser(
        prog=f"holdfast {command}",
        description=textwrap.fill(description, 100),
        epilog=examples,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )


def source_of(file: Path, overrides: Sequence[str], said: str) -> str:
    """Return where a refused value stands: in a `--set KEY=VALUE`, or in the file.

    `said` begins with its key, or with that of the table it makes unusable.
    """
    refused = re.split(r"[\s:\[]", said, maxsplit=1)[0]
    for override in reversed(overrides):
        key = override.partition("=")[0].strip()
        if f"{refused}.".startswith(f"{key}.") or key.startswith(f"{refused}."):
            return f"--set {override}"
    return str(file)


def position(text: str) -> tuple[float, float]:
    """Return latitude and longitude, degrees, of an argument such as 47.40,8.55."""
    try:
        latitude, longitude = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not LAT,LON, such as 47.40,8.55") from None
    if not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0):
        raise argparse.ArgumentTypeError(f"'{text}': want degrees within ±90,±180")
    return latitude, longitude
