"""Options that several commands of the lab have. Imports nothing heavy before one is used."""

import argparse
from pathlib import Path


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Add `--set KEY=VALUE`, which may be repeated."""
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="override a key of the companion's configuration",
    )


def add_out(parser: argparse.ArgumentParser, default: str) -> None:
    """Add `--out DIR`."""
    parser.add_argument(
        "--out",
        type=Path,
        default=Path(default),
        metavar="DIR",
        help="folder for rows and pictures; default %(default)s",
    )


def add_count(parser: argparse.ArgumentParser, option: str, default: int, what: str, least: int = 1) -> None:
    """Add an option whose value is a whole number of `least` (0 or 1) or more."""
    kind = positive if least else not_negative
    parser.add_argument(option, type=kind, default=default, metavar="N", help=f"{what}; default %(default)s")


def add_bench(parser: argparse.ArgumentParser, rows: str = "", scenarios: str = "") -> None:
    """Add what the benches share; `rows` and `scenarios` name examples, or are empty for a bench without."""
    parser.add_argument(
        "--seeds", type=positive, metavar="N", help="number of vehicles; default 60, with --firmware 4"
    )
    if rows:
        parser.add_argument("--rows", nargs="+", metavar="ROW", help=f"run only these rows, such as: {rows}")
    if scenarios:
        parser.add_argument("--scenarios", nargs="+", metavar="NAME", help=f"run only these: {scenarios}")
    add_settings(parser)
    add_firmware(parser)
    add_out(parser, "out/bench")


def seeds_of(arguments: argparse.Namespace) -> int:
    """Return the number of vehicles of a bench."""
    seeds: int = arguments.seeds or (60 if arguments.firmware is None else 4)
    return seeds


def add_firmware(parser: argparse.ArgumentParser) -> None:
    """Add `--firmware [PATH]`."""
    parser.add_argument(
        "--firmware",
        nargs="?",
        const="",
        metavar="PATH",
        help="use the real ArduSub (built for SITL); without PATH the program that HOLDFAST_ARDUSUB names. "
        "Default: our simulator",
    )


def find_firmware(arguments: argparse.Namespace) -> None:
    """Put the program's path, or None, into `arguments.firmware`. Raises FirmwareError, a RefusedError."""
    if getattr(arguments, "firmware", None) is not None:
        from lab.loop.firmware import program

        arguments.firmware = program(arguments.firmware)


def json_file(text: str) -> Path:
    """Read the path of `--json`, and make its folder: hours later it would be too late to refuse it."""
    path = Path(text)
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


def positive(text: str) -> int:
    """Read a whole number above zero."""
    return _whole(text, 1)


def not_negative(text: str) -> int:
    """Read a whole number, zero or above."""
    return _whole(text, 0)


def _whole(text: str, least: int) -> int:
    try:
        number = int(text)
    except ValueError:
        number = least - 1
    if number < least:
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number of {least} or more")
    return number
