"""A picture of every scenario of the bench: who holds depth how well, and how restlessly."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from lab.bench.bench import FLOOR, LINKS, Run, dived, interval
from lab.bench.floor import CHATTER_N
from lab.style import BLUE, VERMILLION

COLOURS = {0: BLUE, 80: VERMILLION}
MARKERS = {0: "o", 80: "D"}
SHIFT = 0.17


def draw(runs: Sequence[Run], titles: Mapping[str, str], folder: Path) -> list[Path]:
    """Draw one PNG a scenario into `folder`; return their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    names = list(dict.fromkeys(run.row for run in runs if run.row != FLOOR))
    paths = []
    for scenario in dived(runs):
        figure, (left, right) = plt.subplots(
            1,
            2,
            figsize=(10.0, 1.6 + 0.38 * len(names)),
            sharey=True,
            width_ratios=(3, 2),
            layout="constrained",
        )
        for i, delay_ms in enumerate(LINKS):
            some = [run for run in runs if (run.scenario, run.delay_ms) == (scenario, delay_ms)]
            _dots(left, some, names, "depth_rms_mm", delay_ms, i)
            _dots(right, some, names, "chatter_n", delay_ms, i)
            lowest = np.mean([run.figures["depth_rms_mm"] for run in some if run.row == FLOOR])
            left.axvline(lowest, color=COLOURS[delay_ms], linestyle="--", linewidth=1.0, zorder=0)
        right.axvline(CHATTER_N, color="0.4", linestyle=":", linewidth=1.2, zorder=0)
        right.annotate(
            f"limit {CHATTER_N} N", (CHATTER_N, 1.0), xycoords=("data", "axes fraction"), xytext=(3, 3),
            textcoords="offset points", color="0.4", fontsize=8,
        )  # fmt: skip
        left.set_yticks(range(len(names)), [titles.get(name, name) for name in names])
        left.set_ylim(len(names) - 0.5, -0.5)
        right.tick_params(left=False)
        for axes, label in ((left, "depth error, RMS (mm)"), (right, "command's change, RMS (N a tick)")):
            axes.set_xscale("log")
            axes.set_xlabel(label)
            axes.xaxis.set_major_locator(mpl.ticker.LogLocator(subs=(1.0, 2.0, 3.0, 5.0)))
            axes.xaxis.set_major_formatter(mpl.ticker.StrMethodFormatter("{x:g}"))
            axes.xaxis.set_minor_formatter(mpl.ticker.NullFormatter())
            axes.grid(axis="x", color="0.9")
            axes.spines[["top", "right"]].set_visible(False)
        seeds = len({run.seed for run in runs})
        figure.suptitle(
            f"{scenario}: {seeds} vehicles; mean and 95 % interval, every dive a dot", fontsize=11
        )
        handles, labels = left.get_legend_handles_labels()
        handles.append(mpl.lines.Line2D([], [], color="0.3", linestyle="--", linewidth=1.0))
        figure.legend(handles, [*labels, "LQG floor"], loc="outside lower center", ncols=3, frameon=False)
        paths.append(folder / f"{scenario}.png")
        figure.savefig(paths[-1], dpi=130)
        plt.close(figure)
    return paths


def _dots(axes: Axes, runs: Sequence[Run], names: Sequence[str], key: str, delay_ms: int, i: int) -> None:
    """Draw one figure of every row at one delay: the dives faint, their mean with its interval."""
    colour, face = COLOURS[delay_ms], COLOURS[delay_ms] if delay_ms == 0 else "white"
    for y, name in enumerate(names):
        values = np.array([run.figures[key] for run in runs if run.row == name])
        height = y + SHIFT * (2 * i - 1)
        axes.plot(
            values, np.full(len(values), height + SHIFT / 2), ".", color=colour, alpha=0.4, markersize=3
        )
        low, high = interval(values)
        if len(values) > 1:
            axes.plot([max(low, 0.5 * values.min()), high], [height, height], color=colour, linewidth=2.0)
        label = (f"+{delay_ms} ms" if delay_ms else "delay as is") if y == 0 else None
        look: dict[str, Any] = {
            "color": colour,
            "markerfacecolor": face,
            "markersize": 5.0,
            "linestyle": "none",
        }
        axes.plot(values.mean(), height, marker=MARKERS[delay_ms], label=label, **look)
