"""`holdfast bench` in the terminal: progress while it dives, then tables, and the same figures as JSON."""

import argparse
import json
from dataclasses import asdict

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from companion.config import load_config
from lab.bench import PAPER_RMS_MM, SCENARIOS, Row, measure
from lab.bounds import Bound, process, virtual
from lab.lockstep import Link
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import load_config as load_plant

COLUMNS = (
    ("depth_rms_mm", "depth RMS mm"),
    ("depth_peak_mm", "peak mm"),
    ("heading_rms_deg", "heading RMS °"),
    ("thrust_rms_n", "thrust RMS N"),
    ("chatter_n", "chatter N/tick"),
)


def run(arguments: argparse.Namespace) -> int:
    """Run what was asked for; the exit status is 1 if a bound was not held."""
    console = Console()
    config, plant = load_config(overrides=arguments.set), load_plant(DEFAULT_CONFIG)
    rows: list[Row] = []
    bounds: list[Bound] = []
    with Progress(console=console) as progress:
        if arguments.what != "process":
            task = progress.add_task("diving", total=arguments.seeds * len(SCENARIOS))
            rows = measure(config, plant, Link(), arguments.seeds, lambda: progress.advance(task))
        if arguments.what != "dives":
            task = progress.add_task("measuring the process", total=2)
            bounds += virtual(config, plant)
            progress.advance(task)
            bounds += process()
            progress.advance(task)
    if rows:
        console.print(_dives(rows, arguments.seeds))
    if bounds:
        console.print(_bounds(bounds))
    if arguments.json:
        figures = {
            "seeds": arguments.seeds,
            "dives": {row.scenario: row.mean | {"paper_rms_mm": PAPER_RMS_MM[row.scenario]} for row in rows},
            "bounds": [asdict(bound) | {"held": bound.held} for bound in bounds],
        }
        arguments.json.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    return 0 if all(bound.held for bound in bounds) else 1


def _dives(rows: list[Row], seeds: int) -> Table:
    table = Table(title=f"Holding depth and heading, mean ± standard deviation of {seeds} vehicles")
    table.add_column("scenario")
    for _, title in COLUMNS:
        table.add_column(title, justify="right")
    table.add_column("paper.md RMS mm", justify="right")
    for row in rows:
        cells = [f"{row.mean[key]:.2f} ± {row.deviation[key]:.2f}" for key, _ in COLUMNS]
        table.add_row(row.scenario, *cells, f"{PAPER_RMS_MM[row.scenario]:.1f}")
    return table


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
