"""`holdfast identify`: what it does with tables of samples, be they a manoeuvre's or logs'."""

import argparse
import datetime
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from companion.config import VehicleFile, load_vehicle, vehicle_file, vehicle_text
from companion.identify import fit
from companion.identify.model import MOVED, Track, parameters, score
from companion.identify.sample_table import NoDiveError, Table
from companion.records import AXES
from holdfast import RefusedError, files, how_to_install
from holdfast.child import bounded
from holdfast.command_line import command_parser
from lab.identify.readers import read

QUALITY: Final = "1 - R² of the change of velocity"
EXAMPLES: Final = """\
examples:
  holdfast identify --from dive1.BIN dive2.BIN           writes vehicle.toml and vehicle.png
  holdfast identify --from dive.tlog --vehicle bluerov2  what the log does not tell is that preset's
  holdfast identify --test other.BIN --vehicle vehicle.toml
  holdfast identify --test other.csv --vehicle heavy --json

Logs: dataflash .BIN, .tlog, MCAP of Holdfast or BlueOS, and CSV: docs/identify.md, also for ROS bags.
"""


def main(argv: list[str]) -> int:
    """Run the command on logs."""
    parser = command_parser(
        "identify",
        "Finds the vehicle that explains logs of dives, manual ones too: nothing moves. Or tests a vehicle's "
        f"file on logs: {QUALITY} over 1 and 2 s, 1 being that it stays as it is.",
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
    said = "with --from; default: %(default)s"
    parser.add_argument("--out", type=Path, default=Path("vehicle.toml"), metavar="FILE", help=said)
    arguments = parser.parse_args(["--help"] if {"-h", "--help"} & {*argv} else argv)
    base = load_vehicle(vehicle_file(Path("--vehicle"), arguments.vehicle, Path()))
    if arguments.test:
        return test(arguments, base)
    files.refuse_existing(arguments.out)
    return conclude(tables_of(arguments.sources, base), base, arguments.out)


def test(arguments: argparse.Namespace, vehicle: VehicleFile) -> int:
    """Score a vehicle on logs."""
    tables = tables_of(arguments.test, vehicle)
    tracks = [Track(table, vehicle.vehicle.frame) for table in tables]
    scores = {track.table.name: score([track], [track.settled(parameters(vehicle))]) for track in tracks}
    if arguments.json:
        sys.stdout.write(json.dumps(scores) + "\n")
        return 0
    rows: list[tuple[str, ...]] = [("log", "ahead", *AXES, "windows")]
    for name, by_horizon in scores.items():
        for horizon, row in by_horizon.items():
            shares = ("-" if row[axis] is None else f"{row[axis]:.3f}" for axis in AXES)
            rows.append((name, f"{horizon} s", *shares, str(row["windows"])))
    lines = [*(line for track in tracks for line in held(track)), f"{QUALITY}:"]
    lines += [f"{name:40}{ahead:>6}{''.join(f'{cell:>9}' for cell in cells)}" for name, ahead, *cells in rows]
    lines += [f"-: not measured, or moved by less than {MOVED:g} m/s (rad/s)"] * any(
        "-" in row for row in rows
    )
    sys.stdout.write("\n".join(lines) + "\n")
    return 0


def tables_of(logs: list[str], vehicle: VehicleFile) -> list[Table]:
    """Read logs. Raises RefusedError for one that tells nothing, OSError."""
    return [bounded(read, [Path(log)], Path(log), vehicle.vehicle.frame) for log in logs]


def conclude(
    tables: Sequence[Table], base: VehicleFile, out: Path, excited: Sequence[int] | None = None
) -> int:
    """Fit a vehicle to tables, say what was found, and write it to `out`, with a picture beside.

    `excited` are the axes that a manoeuvre moved, None for logs. Raises RefusedError where nothing moved.
    """
    tracks = [Track(table, base.vehicle.frame) for table in tables]
    try:
        found = fit.fit(tracks, base, excited)
    except NoDiveError as error:
        raise RefusedError(f"{', '.join(table.name for table in tables)}: {error}") from error
    vehicle, notes = fit.vehicle(found, base)
    lines = [*(line for track in tracks for line in held(track)), *fit.reported(found, base)]
    if not any(map(found.taken, range(len(AXES)))):
        sys.stdout.write("\n".join([*lines, "no inertia is known well enough: nothing was written"]) + "\n")
        return 1
    thetas = [track.settled(parameters(vehicle)) for track in tracks]
    for horizon, row in score(tracks, thetas).items():
        quality = ", ".join(f"{axis} {row[axis]:.3f}" for axis in AXES if row[axis] is not None)
        lines.append(f"{QUALITY} over {horizon} s, on these data: {quality}")
    today = datetime.datetime.now(datetime.UTC).date()
    about = [
        f"Identified by `holdfast identify` on {today.isoformat()}. sd: standard deviation.",
        "What was not identified is as it was before. config/vehicles/custom.toml explains every key.",
        *lines,
    ]
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(vehicle_text(vehicle, about, notes), encoding="utf-8")
    lines.append(f"written: {out}; use it with holdfast run --vehicle {out}")
    try:
        from lab.identify import fit_picture
    except ImportError:
        lines.append(f"no picture: matplotlib is missing; {how_to_install('lab')}")
    else:
        fit_picture.draw(tracks, thetas).savefig(out.with_suffix(".png"))
        lines.append(f"written: {out.with_suffix('.png')}")
    sys.stdout.write("\n".join(lines) + "\n")
    return 0


def held(track: Track) -> list[str]:
    """Say what a table can tell: how long it is, what was measured, which axes moved, what is left out."""
    table, left_out = track.table, track.left_out()
    length_s = float(table.t_s[-1] - table.t_s[0])
    measured = [
        words
        for words, columns in (("speed over ground", (0, 1)), ("vertical speed", (2,)), ("turn rate", (5,)))
        if np.isfinite(table.velocity[:, columns]).mean() > 0.1
    ]
    shares = zip(AXES, np.mean(np.abs(table.commands[:, :4]) > 0.08, axis=0), strict=True)
    steered = [f"{axis} {share:.0%}" for axis, share in shares if share > 0.005]
    name = Path(table.name).name
    return [
        f"{name}: {length_s:.0f} s; measured: {', '.join(measured) or 'attitude alone'}; "
        f"steered: {', '.join(steered) or 'nothing'} of the time",
        *(f"{name}: {note}" for note in (*table.notes, *([left_out] if left_out else []))),
    ]
