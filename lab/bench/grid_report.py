"""`holdfast bench grid` in the terminal: a table of every dive that was not held, a summary and a picture."""

import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from rich import box
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from companion.config import Config
from lab import style
from lab.bench.grid import AXES, GAINS, LAGS_S, LONGEST_S, PLACES, SUBSETS, Outcome, measure
from sim_bridge.config import SimConfig

SHOWN_S = 30.0
"""Where the colours of the picture end."""

ERRORS = ("north", "east", "depth", "heading")
UNITS = ("mm", "mm", "mm", "°")


def report(
    console: Console,
    subsets: Sequence[str],
    config: Config,
    base: SimConfig,
    seed: int,
    out: Path,
    firmware: Path | None = None,
) -> list[Outcome]:
    """Dive the cells of `subsets`, print tables, draw the picture; return what came of each."""
    cells = [*dict.fromkeys(cell for name in subsets for cell in SUBSETS[name]())]
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console) as progress:
        task = progress.add_task("diving the grid", total=len(cells))
        outcomes = measure(cells, config, base, seed, lambda: progress.advance(task), firmware)
    console.print(_failed(outcomes))
    console.print(_summary(outcomes))
    console.print(f"picture: {draw(outcomes, out)}", soft_wrap=True)
    return outcomes


def as_records(outcomes: Sequence[Outcome]) -> list[dict[str, Any]]:
    """Return flat records."""
    return [
        asdict(one.cell)
        | {"seed": one.seed, "gave_up": one.gave_up, "held": one.held, "chatter_n": one.chatter_n}
        | {f"cycle_{place}_s": s for place, s in zip(PLACES, one.cycles_s, strict=True)}
        | {f"rms_{place}": rms for place, rms in zip(ERRORS, one.rms, strict=True)}
        for one in outcomes
    ]


def _table(title: str) -> Table:
    return Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, padding=(0, 1))


def _failed(outcomes: Sequence[Outcome]) -> Table:
    table = _table(f"Not held: a limit cycle of {LONGEST_S:g} s, or given up")
    for column in ("vehicle and link", "cycle, s", "of", "given up"):
        table.add_column(column, justify="right" if column == "cycle, s" else "left")
    for one in outcomes:
        if not one.held:
            where = PLACES[int(np.nanargmax(one.cycles_s))] if not math.isnan(one.cycle_s) else ""
            table.add_row(str(one.cell), f"{one.cycle_s:.1f}", where, one.gave_up)
    return table


def _summary(outcomes: Sequence[Outcome]) -> Table:
    table = _table("By axis: dives, what was held, and errors after 60 s (median, worst of what was held)")
    table.add_column("axis")
    for column in ("dives", "held", "given up", "worst cycle, s"):
        table.add_column(column, justify="right")
    for name, unit in zip(ERRORS, UNITS, strict=True):
        table.add_column(f"{name}, {unit}", justify="right")
    for axis in AXES:
        some = [one for one in outcomes if one.cell.axis == axis]
        if not some:
            continue
        errors = np.array([one.rms for one in some if not one.gave_up]).reshape(-1, len(ERRORS))
        table.add_row(
            axis,
            str(len(some)),
            str(sum(one.held for one in some)),
            str(sum(bool(one.gave_up) for one in some)),
            f"{max(one.cycle_s for one in some):.1f}",
            *(f"{np.median(column):.1f}, {column.max():.1f}" if len(column) else "" for column in errors.T),
        )
    return table


def draw(outcomes: Sequence[Outcome], out: Path) -> Path:
    """Draw the longest limit cycle over gain and lag, a panel an axis; return the picture's path."""
    out.mkdir(parents=True, exist_ok=True)
    figure, panels = plt.subplots(1, len(AXES), figsize=(15.0, 3.6), sharey=True, layout="constrained")
    for panel, axis in zip(panels, AXES, strict=True):
        worst = np.full((len(LAGS_S), len(GAINS)), np.nan)
        ended, dives = np.zeros(worst.shape, int), np.zeros(worst.shape, int)
        for one in outcomes:
            if one.cell.axis == axis:
                i = int(np.argmin([abs(one.cell.lag_s - lag_s) for lag_s in LAGS_S]))
                j = int(np.argmin([abs(math.log(one.cell.gain / gain)) for gain in GAINS]))
                worst[i, j] = np.nanmax([worst[i, j], one.cycle_s, 0.0])
                ended[i, j] += bool(one.gave_up)
                dives[i, j] += 1
        image = panel.imshow(worst, cmap="cividis", vmin=0.0, vmax=SHOWN_S, origin="lower", aspect="auto")
        for i, j in np.ndindex(*worst.shape):
            if dives[i, j]:
                text = f"{worst[i, j]:.0f}" + (f"\n{ended[i, j]}/{dives[i, j]}" if ended[i, j] else "")
                dark = worst[i, j] < 0.5 * SHOWN_S
                panel.text(j, i, text, ha="center", va="center", fontsize=7, color="w" if dark else "k")
        panel.set_xticks(range(len(GAINS)), [f"{gain:.2g}" for gain in GAINS])
        panel.set_yticks(range(len(LAGS_S)), [f"{lag_s:g}" for lag_s in LAGS_S])
        panel.set_xlabel("gain over nominal")
        panel.set_title(axis, loc="left", fontweight="bold", fontsize=11)
        panel.tick_params(labelsize=style.SMALL)
    panels[0].set_ylabel("thruster lag (s)")
    figure.colorbar(image, ax=panels, label="longest limit cycle (s)")
    figure.suptitle("worst of all delays and waters; below it, dives given up / dives", fontsize=10)
    path = out / "grid.png"
    figure.savefig(path, dpi=130)
    plt.close(figure)
    return path
