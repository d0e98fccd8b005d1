"""`holdfast identify --from` and `--test`: a vehicle's file from logs, and a score of one on logs."""

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from rich import box
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table as Printed

from companion.config import VehicleFile, load_vehicle, vehicle_file
from companion.identify.model import HORIZONS_S, Track, parameters, score
from companion.identify.samples import Table
from companion.records import AXES
from holdfast import RefusedError, files
from holdfast.arguments import command_parser
from holdfast.gate import bounded
from lab.identify.outcome import conclude, held
from lab.identify.readers import read

SHOWN_BYTES: Final = 4 << 20
"""Progress is shown for logs that are larger together."""
EXAMPLES = """\
examples:
  holdfast identify --from dive1.BIN dive2.BIN           writes vehicle.toml and vehicle.png
  holdfast identify --from dive.tlog --vehicle bluerov2  what the log does not tell is that preset's
  holdfast identify --test other.BIN --vehicle vehicle.toml
  holdfast identify --test other.csv --vehicle heavy --json

Logs: dataflash .BIN, .tlog, MCAP of Holdfast or BlueOS, and CSV: docs/identify.md, also for ROS bags.
"""


def main(argv: list[str]) -> int:
    """Run the command."""
    parser = command_parser(
        "identify",
        "Finds the vehicle that explains logs of dives, manual ones too: nothing moves. Or tests a vehicle's "
        "file on logs: 1 - R² of the change of velocity over 1 and 2 s, 1 being that it stays as it is.",
        EXAMPLES,
    )
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--from", dest="sources", nargs="+", metavar="FILE", help="fit a vehicle to these logs")
    what.add_argument("--test", nargs="+", metavar="FILE", help="test --vehicle on these logs")
    parser.add_argument(
        "--vehicle",
        default="heavy",
        metavar="NAME|FILE",
        help="to test; with --from what the logs do not tell; default %(default)s",
    )
    parser.add_argument("--json", action="store_true", help="with --test: the scores as JSON")
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("vehicle.toml"),
        metavar="FILE",
        help="with --from; default: %(default)s",
    )
    arguments = parser.parse_args(["--help"] if {"-h", "--help"} & {*argv} else argv)
    base = load_vehicle(vehicle_file(Path("--vehicle"), arguments.vehicle, Path()))
    if arguments.test:
        return test(arguments, base)
    files.refuse_existing(arguments.out)
    tables = tables_of(arguments.sources, base)
    with shown("fitting", everything=sys.stderr.isatty()) as progress:
        return conclude(tables, base, arguments.out, progress=progress)


def test(arguments: argparse.Namespace, vehicle: VehicleFile) -> int:
    """Score a vehicle on logs."""
    theta = parameters(vehicle)
    scores = {}
    tables = tables_of(arguments.test, vehicle)
    for table in tables:
        track = Track(table, vehicle.vehicle.frame)
        scores[table.name] = {f"{horizon_s:g}": score([track], theta, horizon_s) for horizon_s in HORIZONS_S}
    if arguments.json:
        sys.stdout.write(json.dumps(scores) + "\n")
        return 0
    sys.stdout.write("\n".join(line for table in tables for line in held(table)) + "\n")
    printed = Printed(box=box.SIMPLE_HEAD, pad_edge=False, title="1 - R² of the change of velocity")
    for column in ("log", "ahead", *AXES, "windows"):
        printed.add_column(column, justify="left" if column == "log" else "right")
    for name, by_horizon in scores.items():
        for horizon, row in by_horizon.items():
            cells = ("-" if row[axis] is None else f"{row[axis]:.3f}" for axis in AXES)
            printed.add_row(name, f"{horizon} s", *cells, str(row["windows"]))
    Console(width=None if sys.stdout.isatty() else 120).print(printed)
    return 0


def tables_of(files: list[str], vehicle: VehicleFile) -> list[Table]:
    """Read logs, and show how far it is; raise RefusedError for one that tells nothing, OSError."""
    size = sum(Path(file).stat().st_size for file in files)
    tables = []
    with shown("reading", everything=size > SHOWN_BYTES) as progress:
        for number, file in enumerate(files):

            def part(share: float, number: int = number) -> None:
                progress((number + share) / len(files))

            try:
                tables.append(bounded(read, [Path(file)], Path(file), vehicle.vehicle.frame, progress=part))
            except ValueError as error:
                text = " ".join(str(error).split())
                raise RefusedError(text if text.startswith(file) else f"{file}: {text}") from error
    return tables


@contextmanager
def shown(what: str, *, everything: bool) -> Iterator[Callable[[float], None]]:
    """Give a function that shows a share of 1 as progress on stderr."""
    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TimeRemainingColumn(),
        console=Console(file=sys.stderr),
        transient=True,
        disable=not everything or not sys.stderr.isatty(),
    )
    said = 0

    def show(share: float) -> None:
        nonlocal said
        bar.update(task, completed=share)
        if everything and not sys.stderr.isatty() and 4.0 * share >= said + 1:
            said = int(4.0 * share)
            sys.stderr.write(f"{what}: {share:.0%}\n")

    with bar:
        task = bar.add_task(what, total=1.0)
        yield show
