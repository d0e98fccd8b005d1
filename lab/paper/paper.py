"""`holdfast paper` in the terminal: progress while it dives, then tables, and a folder with all of it."""

import argparse
import json
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from lab.paper.plots import draw, watched
from lab.paper.rows import NAMES, Claim, PaperRow, Rows, claims
from lab.paper.simulation import (
    COMPENSATORS,
    CORNERS,
    DISTURBANCES,
    DURATION_S,
    SEEDS,
    PaperCase,
    dive,
    table,
)
from lab.paper.summary import page

EXACT = PaperCase("none", "derived", "none", 1.0, 1.0, 0, 0.0)  # beside the table: a model that is right


def run(arguments: argparse.Namespace) -> int:
    """Dive, write the folder, print the tables; return 1 if something that must come out did not."""
    console = Console()
    folder: Path = arguments.out
    folder.mkdir(parents=True, exist_ok=True)
    cases = [*table(), EXACT]
    with Progress(console=console) as progress:
        diving = progress.add_task(f"{2 * len(cases)} dives at once", total=DURATION_S)
        drawing = progress.add_task("figures", total=1)
        result = dive(cases, watched(SEEDS), lambda: progress.advance(diving))
        rows = Rows(PaperRow(case, figures) for case, figures in zip(cases, result.figures, strict=True))
        exact = rows.pop()
        draw(folder, result.traces, rows)
        progress.advance(drawing)
    found = claims(rows)
    records = json.dumps([row.record() for row in rows], indent=1) + "\n"
    for file in (folder / "paper.json", arguments.json):
        if file:
            file.write_text(records, encoding="utf-8")
    (folder / "paper.md").write_text(page(rows, found, exact.figures.orbit_mm), encoding="utf-8")
    console.print(_dives(rows))
    console.print(_claims(found))
    console.print(f"The report: {folder / 'paper.md'}", soft_wrap=True)
    return 0 if all(claim.held for claim in found) else 1


def _dives(rows: Rows) -> Table:
    title = "Canonical case, medians of 10 draws of first weights: mm, mm/s, N"
    drawn = Table(title=title, box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for name in ("water", "controller"):
        drawn.add_column(name, no_wrap=True)
    for name in ("RMS e", "4 corners", "peak", "orbit", "max −ė", "thrust"):
        drawn.add_column(name, justify="right", no_wrap=True)
    for disturbance in DISTURBANCES:
        for compensator, wait_s in COMPENSATORS:
            here = {"disturbance": disturbance, "compensator": compensator, "wait_s": wait_s}
            corners = [rows.median("rms_mm", **here, mass_ratio=m, damping_ratio=h) for m, h in CORNERS]
            drawn.add_row(
                disturbance if compensator == "none" else "",
                NAMES[(compensator, wait_s)].removeprefix("law + "),
                f"{rows.median('rms_mm', **here):.3f}",
                f"{min(corners):.3g}–{max(corners):.3g}",
                *(f"{rows.median(figure, **here):.2f}" for figure in ("peak_mm", "orbit_mm")),
                *(f"{rows.median(figure, **here):.1f}" for figure in ("peak_rate_mm_s", "thrust_rms_n")),
            )
        drawn.add_section()
    return drawn


def _claims(found: list[Claim]) -> Table:
    drawn = Table(title="What must come out", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for title in ("claim", "measured", "wanted", "held"):
        drawn.add_column(title, justify="left" if title == "claim" else "right")
    for claim in found:
        drawn.add_row(claim.text, f"{claim.value:.3f}", claim.wanted, "yes" if claim.held else "NO")
    return drawn
