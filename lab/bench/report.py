"""`holdfast bench` in the terminal: progress while it dives, then tables, plots, and the same as JSON."""

import argparse
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Any

from rich import box
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from companion.config import ConfigError, load_config
from lab.bench import position_report
from lab.bench.ablation import AblationResult
from lab.bench.ablation_report import as_records as ablation_records
from lab.bench.ablation_report import report
from lab.bench.bench import (
    CONFIDENCE,
    FIRST_SEED,
    FLOOR,
    LINKS,
    SCENARIOS,
    Run,
    Summary,
    as_records,
    count,
    dived,
    measure,
    measure_both,
    summaries,
)
from lab.bench.firmware_report import Pair, pairs, side_by_side
from lab.bench.firmware_report import as_records as pair_records
from lab.bench.floor import CHATTER_N
from lab.bench.grid import SUBSETS
from lab.bench.grid_report import as_records as grid_records
from lab.bench.grid_report import report as report_grid
from lab.bench.network_report import as_records as network_records
from lab.bench.network_report import report as report_network
from lab.bench.plot import draw
from lab.bench.process import Bound, latency, process, virtual
from lab.bench.rows import DEFAULT, ROWS, rows, selected
from lab.bench.subscribers import ROUNDS, NoReaderError, subscriber_bounds
from lab.loop.firmware import FirmwareError
from lab.tables import write_json, write_table
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import SimConfig
from sim_bridge.config import load_config as load_plant

TITLES = {row.name: row.title for row in ROWS} | {FLOOR: "LQG floor"}
"""Of the shipped rows; others are called what they are called."""

COLUMNS = (
    ("depth_peak_mm", "peak\nmm", ".1f"),
    ("recovery_s", "recov.\ns", ".1f"),
    ("thrust_rms_n", "thrust\nN", ".1f"),
    ("chatter_n", "chatter\nN/tick", ".2f"),
)
BESIDE = ("alt_hold_stock", "alt_hold", DEFAULT)
"""What `bench firmware` dives when no row is named."""


def run(arguments: argparse.Namespace) -> int:
    """Run what was asked for; the exit status is 1 if a bound was not held, or the firmware stopped."""
    try:
        return _run(arguments)
    except FirmwareError as error:
        sys.stderr.write(f"holdfast bench: {error}\n")
        return 1


def _run(arguments: argparse.Namespace) -> int:
    console = Console()
    if arguments.what == "fleet":
        from lab.bench.fleet import fleet

        return fleet(arguments.vehicles, console)
    if arguments.what == "soak":
        from lab.bench.soak import soak

        return soak(arguments.minutes, console)
    plant = load_plant(DEFAULT_CONFIG)
    if arguments.what == "position":
        return _position(console, plant, arguments)
    try:
        config = load_config(overrides=arguments.set)
        every = BESIDE if arguments.what == "firmware" else [row.name for row in rows(config)]
        chosen = selected(arguments.rows or every, config)
        scenarios = arguments.scenarios or SCENARIOS
        if unknown := set(scenarios).difference(SCENARIOS):
            raise ValueError(f"no such scenario: {min(unknown)}; there are {', '.join(SCENARIOS)}")
        if unknown := set(arguments.cells).difference(SUBSETS):
            raise ValueError(f"no such cells: {min(unknown)}; there are {', '.join(SUBSETS)}")
    except (ConfigError, ValueError) as error:
        sys.stderr.write(f"holdfast bench: {error}\n")
        return 2
    if arguments.what == "grid":
        cells = report_grid(
            console, arguments.cells, config, plant, FIRST_SEED, arguments.out, arguments.firmware
        )
        _write(arguments, grid_records(cells), grid_records(cells))
        return 0 if all(cell.held for cell in cells) else 1
    if arguments.what == "network":
        outcomes = report_network(console, plant, arguments.set, arguments.seeds)
        _write(arguments, network_records(outcomes), network_records(outcomes))
        return 0
    cases: list[Summary] = []
    beside: list[Pair] = []
    bounds: list[Bound] = []
    runs: list[Run] = []
    dives: list[dict[str, Any]] = []
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console) as progress:
        if arguments.what in (None, "dives"):
            task = progress.add_task("diving", total=count(chosen, arguments.seeds, scenarios))
            runs = measure(
                arguments.set,
                plant,
                chosen,
                arguments.seeds,
                lambda: progress.advance(task),
                arguments.firmware,
                scenarios,
            )
            cases, dives = summaries(runs), as_records(runs)
        if arguments.what == "firmware":
            task = progress.add_task("diving", total=2 * len(chosen) * len(SCENARIOS) * arguments.seeds)
            both = measure_both(
                arguments.set,
                plant,
                chosen,
                arguments.seeds,
                lambda: progress.advance(task),
                arguments.firmware,
            )
            beside = pairs(*both)
            dives = [
                {"vehicle": vehicle} | record
                for vehicle, dived in zip(("simulator", "firmware"), both, strict=True)
                for record in as_records(dived)
            ]
        if arguments.what == "zenoh":
            task = progress.add_task("measuring subscribers", total=ROUNDS)
            try:
                bounds += subscriber_bounds(lambda: progress.advance(task))
            except NoReaderError as error:
                sys.stderr.write(f"holdfast bench: no figures: {error}\n")
                return 1
        if arguments.what in (None, "process"):
            task = progress.add_task("measuring the process", total=2)
            bounds += virtual(config, plant)
            progress.advance(task)
            bounds += [*process(), *latency()]
            progress.advance(task)
    variants = []
    if arguments.what == "ablation":
        variants = report(console, plant, arguments.set, arguments.seeds, arguments.out, arguments.firmware)
        dives = ablation_records(variants)
    if cases:
        for scenario in dived(cases):
            for delay_ms in LINKS:
                console.print(_case([c for c in cases if (c.scenario, c.delay_ms) == (scenario, delay_ms)]))
        console.print(_overview(cases, f"depth RMS, mm; ! chatter above {CHATTER_N} N a tick", _error))
        console.print(_overview(cases, "depth RMS over that of the floor", _ratio))
        console.print(_overview(cases, "heading RMS, °", _heading))
        console.print(f"plots: {', '.join(map(str, draw(runs, TITLES, arguments.out)))}", soft_wrap=True)
    if beside:
        console.print(side_by_side(beside))
    if bounds:
        console.print(_bounds(bounds))
    _write(arguments, _json(arguments.seeds, cases, bounds, variants, beside) | {"dives": dives}, dives)
    return 0 if all(bound.held for bound in bounds) else 1


def _position(console: Console, plant: SimConfig, arguments: argparse.Namespace) -> int:
    """Run `bench position`; 1 if the supervisor gave up a dive."""
    try:
        load_config(overrides=arguments.set)
        rows, courses = position_report.chosen(arguments.rows), position_report.sailed(arguments.scenarios)
    except (ConfigError, ValueError) as error:
        sys.stderr.write(f"holdfast bench: {error}\n")
        return 2
    found = position_report.report(
        console, plant, arguments.set, rows, courses, arguments.seeds, arguments.out, arguments.firmware
    )
    _write(arguments, found, found)
    return 0 if all(run["held"] for run in found) else 1


def _write(arguments: argparse.Namespace, content: Any, dives: Sequence[dict[str, Any]]) -> None:
    """Write what `--json` and `--table` ask for; the table has a row for each of `dives`."""
    if arguments.json:
        write_json(arguments.json, content)
    if arguments.table:
        write_table(arguments.table, dives)


def _case(cases: Sequence[Summary]) -> Table:
    """Return the table of one case, a line for each row."""
    first = cases[0]
    table = _table(f"{first.scenario}, {_delay(first.delay_ms)}: mean of {first.seeds} vehicles")
    for title in ("RMS\nmm", "×\nfloor", f"less default\nmm, {CONFIDENCE:.0%}"):
        table.add_column(title, justify="right", no_wrap=True)
    shown = [column for column in COLUMNS if any(not math.isnan(case.mean[column[0]]) for case in cases)]
    for _, title, _ in shown:
        table.add_column(title, justify="right", no_wrap=True)
    for case in cases:
        difference = ""
        if case.row not in (DEFAULT, FLOOR) and not math.isnan(case.difference_mm):
            difference = f"{case.difference_mm:+.2f}"
            if case.seeds > 1:
                difference += f" ± {case.high_mm - case.difference_mm:.2f}"
        table.add_row(
            TITLES.get(case.row, case.row) + (f" ({case.gave_up} lost)" if case.gave_up else ""),
            f"{case.mean['depth_rms_mm']:.2f}",
            f"{case.floor_ratio:.2f}",
            difference,
            *(_cell(case.mean[key], form) for key, _, form in shown),
            style="bold" if case.row == DEFAULT else "dim" if case.row == FLOOR else "",
        )
    return table


def _overview(cases: Sequence[Summary], title: str, cell: Callable[[Summary], str]) -> Table:
    """Return one figure of every row in every case."""
    table = _table(title)
    scenarios = dived(cases)
    for delay_ms in LINKS:
        for scenario in scenarios:
            heading = f"{scenario}\n{_delay(delay_ms)}"
            table.add_column(heading, justify="right", no_wrap=True)
    of = {(case.row, case.scenario, case.delay_ms): case for case in cases}
    for name in dict.fromkeys(case.row for case in cases):
        cells = [cell(of[name, scenario, delay_ms]) for delay_ms in LINKS for scenario in scenarios]
        table.add_row(TITLES.get(name, name), *cells, style="bold" if name == DEFAULT else "")
    return table


def _error(case: Summary) -> str:
    return f"{case.mean['depth_rms_mm']:.1f}" + ("!" if case.mean["chatter_n"] > CHATTER_N else "")


def _ratio(case: Summary) -> str:
    return f"{case.floor_ratio:.2f}"


def _heading(case: Summary) -> str:
    return _cell(case.mean["heading_rms_deg"], ".2f")


def _table(title: str) -> Table:
    table = Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, padding=0)
    table.add_column("", no_wrap=True)
    return table


def _delay(delay_ms: int) -> str:
    return f"+{delay_ms} ms" if delay_ms else "as is"


def _cell(value: float, form: str) -> str:
    return "" if math.isnan(value) else f"{value:{form}}"


def _json(
    seeds: int,
    cases: Sequence[Summary],
    bounds: Sequence[Bound],
    variants: Sequence[AblationResult],
    beside: Sequence[Pair],
) -> dict[str, Any]:
    """Return what each case came to, as flat records."""
    records = [
        {key: value for key, value in asdict(case).items() if key != "mean"} | case.mean for case in cases
    ]
    return {
        "seeds": seeds,
        "first_seed": FIRST_SEED,
        "rows": records,
        "ablation": [
            {key: value for key, value in asdict(one).items() if key != "each_mm"} for one in variants
        ],
        "firmware": pair_records(beside),
        "bounds": [asdict(bound) | {"held": bound.held} for bound in bounds],
    }


def _bounds(bounds: list[Bound]) -> Table:
    table = Table(title="The process")
    for title in ("figure", "measured", "bound", "held"):
        table.add_column(title, justify="left" if title == "figure" else "right")
    for bound in bounds:
        limit = "" if bound.limit is None else f"≤ {bound.limit:.3g} {bound.unit}"
        limit = limit if bound.at_least is None else f"≥ {bound.at_least:.3g} {bound.unit}"
        table.add_row(
            bound.name,
            f"{bound.value:.3g} {bound.unit}",
            limit,
            "" if not limit else "yes" if bound.held else "NO",
        )
    return table
