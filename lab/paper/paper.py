"""`holdfast lab paper`: simulates the paper's cases, prints tables and checks, and draws the four figures."""

import argparse
from dataclasses import asdict
from pathlib import Path

from rich.console import Console
from rich.progress import track
from rich.table import Table

from lab.paper.plots import draw
from lab.paper.results import EXACT, NAMES, Check, Results, checks, middle
from lab.paper.simulation import COMPENSATORS, DISTURBANCES, LAWS, PaperCase, dive, figures, table
from lab.study import ruled
from lab.tables import write_json

TITLES = {"derived": "−m̄κε, as derived", "printed": "−κε, as printed"}
COLUMNS = {
    "rms_mm": "RMS e",
    "peak_mm": "peak e",
    "orbit_mm": "orbit",
    "peak_rate_mm_s": "max −ė",
    "thrust_rms_n": "thrust",
}


def run(arguments: argparse.Namespace) -> int:
    """Simulate, draw, print; return 1 if something that must come out did not."""
    console = Console()
    folder: Path = arguments.out
    cases = [*table(), EXACT]
    results = {case: figures(dive(case)) for case in track(cases, "cases", console=console)}
    draw(folder, results)
    if arguments.json:
        write_json(arguments.json, [asdict(case) | asdict(found) for case, found in results.items()])
    for law in LAWS:
        console.print(_cases(results, law))
    found = checks(results)
    console.print(_checks(found))
    console.print(f"The four figures: {folder}", soft_wrap=True)
    return 0 if all(check.held for check in found) else 1


def _cases(results: Results, law: str) -> Table:
    title = f"{TITLES[law]}: medians of 10 seeds in mm, mm/s, N"
    drawn = ruled(title, "water", "controller", *COLUMNS.values(), left=2)
    for water in DISTURBANCES:
        for kind in COMPENSATORS:
            case = PaperCase(water, law, *kind)
            cells = (_cell(middle(results, name, case)) for name in COLUMNS)
            drawn.add_row(water if kind == COMPENSATORS[0] else "", NAMES[kind], *cells)
        drawn.add_section()
    return drawn


def _cell(value: float) -> str:
    return f"{value:.{3 if value < 1.0 else 2 if value < 100.0 else 1}f}"


def _checks(found: list[Check]) -> Table:
    drawn = ruled("What must come out", "check", "measured", "wanted", "held")
    for check in found:
        drawn.add_row(check.text, f"{check.value:.3f}", check.wanted, "yes" if check.held else "NO")
    return drawn
