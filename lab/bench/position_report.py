"""`holdfast bench position` in the terminal: a table for each course, a picture, and the same as JSON."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot as plt
from rich import box
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from lab.bench.position import COURSES, FIGURES, ROWS, Course, Run, measure
from lab.bench.rows import Row
from lab.style import BLACK, BLUE, GREEN, ORANGE, PRINTED, SMALL, VERMILLION
from sim_bridge.config import SimConfig

COLUMNS = {
    "place_rms_mm": ("place RMS\nmm", ".0f"),
    "place_peak_mm": ("peak, most\nmm", ".0f"),
    "believed_rms_mm": ("as believed\nmm", ".0f"),
    "depth_rms_mm": ("depth RMS\nmm", ".1f"),
    "heading_rms_deg": ("heading RMS\n°", ".2f"),
    "tilt_deg": ("tilt, most\n°", ".1f"),
    "saturated_percent": ("saturated\n%", ".0f"),
    "chatter_n": ("chatter\nN/tick", ".2f"),
}
LOOKS = {
    "default": (BLUE, "-"),
    "pid": (VERMILLION, "-."),
    "poshold": (GREEN, "--"),
    "poshold_stock": (ORANGE, ":"),
}
SEEN_EVERY = 5


def chosen(names: Sequence[str] | None) -> list[Row]:
    """Return the rows of these names, all without any. Raises ValueError for a name that is none."""
    known = {row.name: row for row in ROWS}
    if unknown := set(names or ()).difference(known):
        raise ValueError(f"no such row: {min(unknown)}; bench position has {', '.join(known)}")
    return [row for row in ROWS if names is None or row.name in names]


def sailed(names: Sequence[str] | None) -> list[Course]:
    """Return the courses of these names, all without any. Raises ValueError for a name that is none."""
    known = {course.name: course for course in COURSES}
    if unknown := set(names or ()).difference(known):
        raise ValueError(f"no such scenario: {min(unknown)}; bench position has {', '.join(known)}")
    return [course for course in COURSES if names is None or course.name in names]


def report(
    console: Console,
    base: SimConfig,
    settings: Sequence[str],
    rows: Sequence[Row],
    courses: Sequence[Course],
    seeds: int,
    out: Path,
    firmware: Path | None = None,
) -> list[dict[str, Any]]:
    """Dive, print a table a course, draw; return flat records, one a dive."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console) as progress:
        task = progress.add_task("diving", total=len(rows) * len(courses) * seeds)
        runs = measure(settings, base, rows, courses, seeds, lambda: progress.advance(task), firmware)
    for course in courses:
        console.print(_table(course, rows, [run for run in runs if run.course == course.name]))
    console.print(f"plot: {draw(runs, courses, out)}", soft_wrap=True)
    return [
        {"row": run.row, "course": run.course, "seed": run.seed, "held": run.held} | run.figures
        for run in runs
    ]


def draw(runs: Sequence[Run], courses: Sequence[Course], out: Path) -> Path:
    """Draw the first vehicle of every course from above into `out`; return the picture's path."""
    out.mkdir(parents=True, exist_ok=True)
    titles = {row.name: row.title for row in ROWS}
    with mpl.rc_context(PRINTED):
        figure, panels = plt.subplots(1, len(courses), figsize=(3.3 * len(courses), 3.6), squeeze=False)
        for panel, course in zip(panels[0], courses, strict=True):
            mine = [run for run in runs if run.course == course.name]
            shown = [run for run in mine if run.seed == mine[0].seed]
            for run in shown:
                colour, line = LOOKS[run.row]
                north, east = run.track.truth[::SEEN_EVERY, :2].T
                panel.plot(east, north, color=colour, linestyle=line, linewidth=1.0, label=titles[run.row])
            north, east = shown[0].track.reference[:, :2].T
            still = np.ptp(north) + np.ptp(east) < 0.1
            panel.plot(
                east[:1] if still else east,
                north[:1] if still else north,
                color=BLACK,
                linestyle="none" if still else ":",
                marker="+" if still else "",
                markersize=12,
                label="reference",
            )
            panel.set_aspect("equal", adjustable="datalim")
            panel.set_xlabel("east (m)")
            panel.set_title(course.title.replace(", ", ",\n", 1), fontsize=SMALL)
        panels[0][0].set_ylabel("north (m)")
        handles, labels = panels[0][0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(handles), frameon=False)
        path = out / "position.png"
        figure.savefig(path)
        plt.close(figure)
    return path


def _table(course: Course, rows: Sequence[Row], runs: Sequence[Run]) -> Table:
    seeds = len({run.seed for run in runs})
    table = Table(
        title=f"{course.title}; {seeds} vehicles",
        title_justify="left",
        title_style="bold",
        box=box.SIMPLE_HEAD,
        padding=0,
    )
    table.add_column("", no_wrap=True)
    for key in FIGURES:
        table.add_column(COLUMNS[key][0], justify="right", no_wrap=True)
    for row in rows:
        mine = [run for run in runs if run.row == row.name]
        lost = sum(not run.held for run in mine)
        cells = []
        for key in FIGURES:
            values = [run.figures[key] for run in mine]
            most = key in ("tilt_deg", "place_peak_mm")
            cells.append(f"{max(values) if most else np.mean(values):{COLUMNS[key][1]}}")
        table.add_row(row.title + (f" ({lost} lost)" if lost else ""), *cells)
    return table
