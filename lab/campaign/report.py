"""`holdfast campaign` in the terminal: progress, tables, the envelope, pictures, one dive replayed."""

import argparse
import os
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from companion.config import Config, load_config
from holdfast import how_to_install
from lab.batch.vehicle import ENGAGED_S, Rows
from lab.campaign.campaign import (
    DURATION_S,
    ENVELOPE,
    VEHICLES,
    CampaignRow,
    batches,
    case,
    configured,
    dive,
    link,
    plant,
    run,
    scenario,
)
from lab.campaign.file import CampaignFile
from lab.campaign.plots import Trace, draw_replay, draw_worst, replay_command
from lab.loop import dive as full_loop
from lab.pool import worker_pool
from lab.tables import write_json, write_table

DIVE_MIN = (DURATION_S - ENGAGED_S) / 60.0
WORST = 3
CONNECT_S = 5.0
RANK = {"lost": 2, "strays": 1, "held": 0}


def main(arguments: argparse.Namespace) -> int:
    """Run what was asked for. Exit status 1: a dive inside the envelope did not hold; 2: cannot continue."""
    console = Console()
    config = load_config(overrides=arguments.set)
    if arguments.replay is not None:
        return _replay(console, config, arguments.replay, arguments.out)
    file = CampaignFile(arguments.out, config)
    numbers = range(arguments.first, arguments.first + arguments.dives)
    there = {row.case.number for row in file.rows}
    missing = [number for number in numbers if number not in there]
    if len(missing) < len(numbers):
        console.print(f"{arguments.out}: {len(numbers) - len(missing)} of these dives are there already")
    speed = _dive(console, file, config, missing, arguments)
    rows = [row for row in file.rows if row.case.number in numbers]
    with console.status("diving the worst again, for the picture"):
        worst = {
            within: _worst([row for row in rows if row.case.inside is within]) for within in (True, False)
        }
        traced = _traced(config, [row.case.number for found in worst.values() for row in found])
        shown = [[traced[row.case.number] for row in worst[within]] for within in (True, False)]
        draw_worst(arguments.out / "worst.png", rows, *shown)
    summary = _summary(rows, speed)
    console.print(_table(rows))
    console.print("[bold]The envelope[/bold], inside which every dive must hold:")
    for line in ENVELOPE:
        console.print(f"  · {line}", highlight=False)
    _tell(console, rows, worst, arguments.out)
    if speed:
        console.print(
            f"{speed['dives']} dives in {speed['wall_s']:.0f} s, workers: {speed['workers']}; "
            f"{speed['dives_per_core_s']:.1f} dives, {speed['dive_minutes_per_core_s']:.1f} dive-minutes "
            f"per core-second; {speed['dive_minutes_per_s']:.1f} dive-minutes a second in all"
        )
    records = [row.record() for row in sorted(rows, key=_number)]
    write_json(arguments.out / "campaign.json", summary)
    if arguments.json:
        write_json(arguments.json, summary | {"each": records})
    if arguments.table:
        write_table(arguments.table, records)
    return 1 if summary["inside"]["not_held"] else 0


def _dive(
    console: Console,
    file: CampaignFile,
    config: Config,
    numbers: Sequence[int],
    arguments: argparse.Namespace,
) -> dict[str, float]:
    """Dive what is missing; return how fast it went, or nothing if nothing was missing."""
    if not numbers:
        return {}
    began_s, cpu_s = time.monotonic(), 0.0
    columns = (
        TextColumn("diving"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with (
        workforce(arguments.scheduler, arguments.workers) as (executor, workers),
        Progress(*columns, console=console) as progress,
    ):
        task = progress.add_task("diving", total=len(numbers))
        for batch in run(executor, workers, config, numbers):
            file.append(batch.rows)
            cpu_s += batch.cpu_s
            progress.advance(task, len(batch.rows))
    wall_s = time.monotonic() - began_s
    return {
        "dives": len(numbers),
        "workers": workers,
        "wall_s": round(wall_s, 2),
        "core_s": round(cpu_s, 2),
        "dives_per_core_s": round(len(numbers) / cpu_s, 2),
        "dive_minutes_per_core_s": round(len(numbers) * DIVE_MIN / cpu_s, 2),
        "dive_minutes_per_s": round(len(numbers) * DIVE_MIN / wall_s, 2),
    }


@contextmanager
def workforce(scheduler: str | None, workers: int | None) -> Iterator[tuple[Executor, int]]:
    """Give an executor and how many dive at once: this machine's cores, or an existing Dask cluster's."""
    if scheduler is None:
        count = workers or os.cpu_count() or 1
        with worker_pool(count, start="spawn") as pool:
            yield pool, count
        return
    if find_spec("distributed") is None:
        raise SystemExit(f"holdfast campaign --scheduler: install the extra: {how_to_install('cluster')}")
    from distributed import Client

    connect: Any = Client  # it carries no types that mypy --strict accepts
    try:
        client = connect(scheduler, timeout=CONNECT_S)
    except OSError as error:
        raise SystemExit(f"holdfast campaign: no Dask scheduler answers at {scheduler}: {error}") from error
    with client:
        client.wait_for_workers(1, timeout=30)
        with client.get_executor(pure=False) as executor:
            yield executor, sum(client.nthreads().values())


def _number(row: CampaignRow) -> int:
    return row.case.number


def _worst(rows: Sequence[CampaignRow]) -> list[CampaignRow]:
    def badness(row: CampaignRow) -> tuple[int, float]:
        return RANK[row.outcome], row.figures["depth_rms_mm"]

    return sorted(rows, key=badness, reverse=True)[:WORST]


def _traced(config: Config, numbers: Sequence[int]) -> dict[int, tuple[CampaignRow, Trace]]:
    """Dive these again and keep their traces."""
    found: dict[int, tuple[CampaignRow, Trace]] = {}
    for part in batches(numbers):
        traces: list[Rows] = []
        for row, trace in zip(dive(config, part, traces).rows, traces, strict=True):
            found[row.case.number] = (row, (trace[:, 0], trace[:, 1], trace[:, 2]))
    return found


def _replay(console: Console, config: Config, number: int, folder: Path) -> int:
    """Dive one number again, as the batch does and through the full loop; tell and draw both."""
    one = case(number)
    row, trace = _traced(config, [number])[number]
    full = full_loop.dive(scenario(one), configured(config, one.vehicle), plant(one), link(one))
    folder.mkdir(parents=True, exist_ok=True)
    picture = folder / f"replay-{number}.png"
    draw_replay(picture, one, trace, full)
    table = Table(title=str(one))
    for title in ("figure", "batch", "full loop"):
        table.add_column(title, justify="left" if title == "figure" else "right")
    figures = full.figures()
    for key, value in row.figures.items():
        table.add_row(key, f"{value:.3f}", f"{figures[key]:.3f}" if key in figures else "")
    table.add_row("outcome", row.outcome, "steered to the end" if full.active[-1] else "gave up")
    console.print(table)
    console.print(f"{'inside' if one.inside else 'outside'} the envelope; {picture}")
    return 0


def _summary(rows: Sequence[CampaignRow], speed: dict[str, float]) -> dict[str, Any]:
    inside = [row for row in rows if row.case.inside]
    outside = [row for row in rows if not row.case.inside]
    return {
        "dives": len(rows),
        "envelope": ENVELOPE,
        "inside": _counts(inside),
        "outside": _counts(outside),
        "by": [{"vehicle": v, "dead": d, **_counts(of_it)} for v, d, of_it in _groups(rows)],
        "speed": speed,
    }


def _counts(rows: Sequence[CampaignRow]) -> dict[str, Any]:
    outcomes = Counter(row.outcome for row in rows)
    held = [row.figures["depth_rms_mm"] for row in rows if row.outcome == "held"]
    return {
        "dives": len(rows),
        **{outcome: outcomes[outcome] for outcome in RANK},
        "not_held": len(rows) - outcomes["held"],
        "held_depth_rms_mm_median": round(float(np.median(held)), 2) if held else None,
        "held_depth_rms_mm_p99": round(float(np.quantile(held, 0.99)), 2) if held else None,
    }


def _groups(rows: Sequence[CampaignRow]) -> Iterator[tuple[str, str, list[CampaignRow]]]:
    for vehicle in VEHICLES:
        for dead in ("none", "horizontal", "vertical"):
            of_it = [row for row in rows if row.case.vehicle == vehicle and _dead(row) == dead]
            if of_it:
                yield vehicle, dead, of_it


def _dead(row: CampaignRow) -> str:
    return "vertical" if row.case.dead_vertical else "horizontal" if row.case.dead else "none"


def _table(rows: Sequence[CampaignRow]) -> Table:
    table = Table(title=f"{len(rows)} dives of {DURATION_S - ENGAGED_S:.0f} s, from engaging on")
    for title in ("vehicle", "dead thruster", "dives", "held", "strays", "lost", "median RMS mm", "99 % mm"):
        table.add_column(title, justify="left" if title in ("vehicle", "dead thruster") else "right")
    groups = [*_groups(rows)]
    groups += [("inside", "", [row for row in rows if row.case.inside])]
    groups += [("outside", "", [row for row in rows if not row.case.inside])]
    for vehicle, dead, of_it in groups:
        counts = _counts(of_it)
        cells = (counts[key] for key in ("dives", "held", "strays", "lost"))
        figures = (counts["held_depth_rms_mm_median"], counts["held_depth_rms_mm_p99"])
        table.add_row(vehicle, dead, *map(str, cells), *("" if x is None else f"{x:.1f}" for x in figures))
    return table


def _tell(
    console: Console, rows: Sequence[CampaignRow], worst: dict[bool, list[CampaignRow]], folder: Path
) -> None:
    failed = [row for row in rows if row.case.inside and row.outcome != "held"]
    console.print(
        f"[red]{len(failed)} dives inside it did not hold[/red]" if failed else "All dives inside it held."
    )
    console.print("No supervisor dives along in a batch: what it does with a lost vehicle, --replay shows.")
    for within, found in worst.items():
        if not found:
            continue
        console.print(f"Worst {'inside' if within else 'outside'}:")
        for row in found:
            figures = row.figures
            console.print(
                f"  {row.case}: {row.outcome}, depth RMS {figures['depth_rms_mm']:.1f} mm, "
                f"tilt {figures['tilt_deg']:.0f}°  ·  {replay_command(row.case.number)}",
                highlight=False,
                soft_wrap=True,
            )
    console.print(f"Rows in {folder / 'dives.csv'}, pictures in {folder / 'worst.png'}")
