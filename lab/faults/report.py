"""`holdfast faults`: dive, count, say what was promised and not kept."""

import json
import os
import sys
from collections import Counter, defaultdict
from concurrent.futures import as_completed
from math import isfinite
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from holdfast.arguments import command_parser
from lab.faults import soak, thrusters
from lab.faults.faults import AFTER_S, FAULTS, VARIANTS, FaultRow, case, described, dive_group, groups
from lab.options import add_firmware, find_firmware, json_file, not_negative, positive
from lab.pool import worker_pool

EXAMPLES = """\
examples:
  holdfast faults --dives 102             a quick look
  holdfast faults --first 417 --dives 1   one dive again
  holdfast faults --firmware --dives 50   against the real ArduSub
  holdfast faults --thrusters --dives 5   five dives with each failure of each motor, on both frames
  holdfast faults --hours 24              a day of faults; the same command continues it

Exit status: 0 every dive kept every promise, 1 one did not.
"""


def main(argv: list[str]) -> int:
    """Exit status 1 if a promise was broken."""
    parser = command_parser(
        "faults",
        "Injects a fault into every simulated dive (in bytes, telemetry, autopilot, process or vehicle), in "
        "every state, in virtual time, and checks the promises of the supervisor in every tick. The number "
        "of a dive is its seed.",
        EXAMPLES,
    )
    parser.add_argument("--dives", type=positive, default=2000, metavar="N", help="default %(default)s")
    parser.add_argument(
        "--first", type=not_negative, default=0, metavar="ID", help="number of the first dive; default 0"
    )
    parser.add_argument("--workers", type=positive, metavar="N", help="processes; default: the cores")
    parser.add_argument("--json", type=json_file, metavar="FILE", help="write each dive's result to FILE")
    parser.add_argument(
        "--thrusters",
        action="store_true",
        help="let each motor die, keep 40 %% of its thrust, or stick instead, in waves and current, N dives "
        "each, and measure depth, heading and tilt; exit status 1 if a motor was wrongly found dead",
    )
    parser.add_argument(
        "--hours",
        type=positive,
        metavar="N",
        help="simulate N hours instead, in which one fault follows the other and the operator engages again, "
        "and measure the memory; an hour takes about five minutes of one core",
    )
    parser.add_argument(
        "--out",
        type=json_file,
        default=Path("out/soak.jsonl"),
        metavar="FILE",
        help="a row for each of these hours; default %(default)s",
    )
    add_firmware(parser)
    arguments = parser.parse_args(argv)
    if not find_firmware("faults", arguments):
        return 2
    firmware: Path | None = arguments.firmware
    console = Console()
    numbers = range(arguments.first, arguments.first + arguments.dives)
    workers = arguments.workers or os.cpu_count() or 1
    if arguments.hours:
        return soak.main(console, arguments.hours, workers, arguments.out)
    if arguments.thrusters:
        return thrusters.main(console, numbers, workers, firmware)
    rows = dived(console, numbers, workers, firmware)
    console.print(_table(rows))
    states = Counter(row.state for row in rows)
    console.print("Begun in " + ", ".join(f"{state} {count}" for state, count in states.most_common()))
    bad = [row for row in rows if row.broken]
    for row in bad:
        one = case(row.number, firmware=firmware is not None)
        console.print(f"[red]{row.broken}[/red]: {VARIANTS[one.variant][0]}, {described(one)}")
    console.print(
        f"{len(rows)} dives of {AFTER_S:g} s after the state was reached; {len(bad)} broke a promise."
    )
    if arguments.json:
        arguments.json.write_text(json.dumps([row._asdict() for row in rows], indent=1), encoding="utf-8")
    return 1 if bad else 0


def dived(console: Console, numbers: range, workers: int, firmware: Path | None = None) -> list[FaultRow]:
    """Return what became of these dives, a process for each group of them."""
    rows: list[FaultRow] = []
    columns = (TextColumn("diving"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with (
        worker_pool(workers, start="spawn") as pool,
        Progress(*columns, console=console, disable=not sys.stderr.isatty()) as progress,
    ):
        task = progress.add_task("diving", total=len(numbers))
        jobs = [pool.submit(dive_group, group, firmware) for group in groups(numbers)]
        for future in as_completed(jobs):
            rows += future.result()
            progress.advance(task, len(future.result()))
    return sorted(rows)


def _table(rows: list[FaultRow]) -> Table:
    by_kind: dict[str, list[FaultRow]] = defaultdict(list)
    for row in rows:
        for kind in row.kinds:
            by_kind[kind].append(row)
    table = Table(title=f"{len(rows)} dives by what broke in them, alone or among others")
    for title in (
        "fault",
        "dives",
        "held on",
        "let go",
        "neutral after s, median",
        "worst",
        "promises broken",
    ):
        table.add_column(title, justify="left" if title == "fault" else "right")
    for kind in FAULTS:
        of_it = by_kind[kind]
        if not of_it:
            continue
        active = [row for row in of_it if row.state == "ACTIVE"]
        alone = sorted(row.neutral_s for row in active if row.kinds == (kind,) and isfinite(row.neutral_s))
        held = sum(row.ended == "ACTIVE" for row in active)
        times = (f"{alone[len(alone) // 2]:.2f}", f"{alone[-1]:.2f}") if alone else ("", "")
        broken = sum(bool(row.broken) for row in of_it)
        table.add_row(kind, *map(str, (len(of_it), held, len(active) - held)), *times, str(broken))
    return table
