"""`holdfast identify --from` and `--test`: a vehicle's file from logs, and a score of one on logs."""

import argparse
import datetime
import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from rich import box
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from companion.config import VehicleFile, load_vehicle, vehicle_file, vehicle_text
from companion.records import AXES
from holdfast import RefusedError
from holdfast.arguments import command_parser
from lab.logs import dive_fit, picture
from lab.logs.dive_log import LogError, reported
from lab.logs.model import HORIZONS_S, Track, parameters, score
from lab.logs.readers import read

SHOWN_BYTES: Final = 4 << 20
"""Progress is shown for logs that are larger together."""
EXAMPLES = """\
examples:
  holdfast identify --from dive1.BIN dive2.BIN           writes vehicle.toml and vehicle.png
  holdfast identify --from dive.tlog --vehicle bluerov2  what the log does not tell is that preset's
  holdfast identify --test other.BIN --vehicle vehicle.toml
  holdfast identify --test other.csv --vehicle heavy --json

Logs: dataflash .BIN, .tlog, MCAP of Holdfast or BlueOS, ROS bags (with the extra `rosbag`), and CSV:
docs/identify.md.
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
    return test(arguments, base) if arguments.test else identify(arguments, base)


def test(arguments: argparse.Namespace, vehicle: VehicleFile) -> int:
    """Score a vehicle on logs."""
    tracks = tracks_of(arguments.test, vehicle)
    theta = parameters(vehicle)
    scores = {
        track.log.name: {f"{horizon_s:g}": score([track], theta, horizon_s) for horizon_s in HORIZONS_S}
        for track in tracks
    }
    if arguments.json:
        sys.stdout.write(json.dumps(scores) + "\n")
        return 0
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, title="1 - R² of the change of velocity")
    for column in ("log", "ahead", *AXES, "windows"):
        table.add_column(column, justify="left" if column == "log" else "right")
    for name, by_horizon in scores.items():
        for horizon, row in by_horizon.items():
            cells = ("-" if row[axis] is None else f"{row[axis]:.3f}" for axis in AXES)
            table.add_row(name, f"{horizon} s", *cells, str(row["windows"]))
    Console(width=None if sys.stdout.isatty() else 120).print(table)
    return 0


def identify(arguments: argparse.Namespace, base: VehicleFile) -> int:
    """Fit a vehicle to logs, and write it."""
    if arguments.out.exists():
        raise RefusedError(f"{arguments.out} is there already; remove it or choose another --out")
    tracks = tracks_of(arguments.sources, base)
    try:
        with shown("fitting", everything=sys.stderr.isatty()) as progress:
            found = dive_fit.fit(tracks, base, progress)
    except LogError as error:
        raise RefusedError(f"{', '.join(arguments.sources)}: {error}") from error
    vehicle, notes = dive_fit.vehicle(found, base)
    lines = [line for track in tracks for line in reported(track.log)] + [*dive_fit.said(found)]
    if not any(map(found.known, range(len(AXES)))):
        sys.stdout.write("\n".join([*lines, "no inertia is known well enough: nothing was written"]) + "\n")
        return 1
    theta = parameters(vehicle)
    for horizon_s in HORIZONS_S:
        row = score(tracks, theta, horizon_s)
        quality = ", ".join(f"{axis} {row[axis]:.3f}" for axis in AXES if row[axis] is not None)
        lines.append(f"1 - R² of the change of velocity over {horizon_s:g} s, on these logs: {quality}")
    today = datetime.datetime.now(datetime.UTC).date()
    about = [
        f"Identified from logs by `holdfast identify --from` on {today.isoformat()}. sd: standard deviation.",
        f"What no log told is that of {arguments.vehicle}. config/vehicles/custom.toml explains every key.",
        *lines,
    ]
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_text(vehicle_text(vehicle, about, notes), encoding="utf-8")
    image = arguments.out.with_suffix(".png")
    picture.draw(tracks, theta).savefig(image)
    sys.stdout.write("\n".join([*lines, f"written: {arguments.out} and {image}"]) + "\n")
    sys.stdout.write(f"use it with holdfast run --vehicle {arguments.out}\n")
    return 0


def tracks_of(files: list[str], vehicle: VehicleFile) -> list[Track]:
    """Read logs, and show how far it is; raise RefusedError for one that tells nothing, OSError."""
    sizes = [_size(Path(file)) for file in files]
    tracks = []
    with shown("reading", everything=sum(sizes) > SHOWN_BYTES) as progress:
        for file, size, before in zip(files, sizes, (sum(sizes[:i]) for i in range(len(sizes))), strict=True):

            def part(share: float, size: int = size, before: int = before) -> None:
                progress((before + share * size) / max(sum(sizes), 1))

            try:
                log = read(Path(file), vehicle.vehicle.frame, part)
            except ValueError as error:
                text = " ".join(str(error).split())
                raise RefusedError(text if text.startswith(file) else f"{file}: {text}") from error
            tracks.append(Track(log, vehicle.vehicle.frame))
    return tracks


def _size(path: Path) -> int:
    if path.is_dir():
        return sum(file.stat().st_size for file in path.iterdir())
    return path.stat().st_size


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
