"""The picture that several studies draw: a line for each row, every dive a dot."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from lab.study import Row
from lab.style import BLUE, ORANGE, SMALL, VERMILLION, save


def dots(
    path: Path,
    groups: Mapping[str, Sequence[Row]],
    columns: Mapping[str, str],
    lost: Callable[[Row], bool],
    title: str = "each dot a dive, diamond: mean, cross: given up",
) -> Path:
    """Draw a panel for each key of `columns`, with its label; a line for each of `groups`. Return `path`."""
    size = (3.7 * len(columns), 1.4 + 0.35 * len(groups))
    figure, panels = plt.subplots(
        1, len(columns), figsize=size, sharey=True, squeeze=False, layout="constrained"
    )
    for panel, (key, label) in zip(panels[0], columns.items(), strict=True):
        for y, some in enumerate(groups.values()):
            values, gone = np.array([row[key] for row in some]), np.array([lost(row) for row in some])
            panel.plot(values, np.full(len(some), y), "o", color=BLUE, markersize=4, alpha=0.5)
            panel.plot(values[gone], np.full(gone.sum(), y), "x", color=VERMILLION, markersize=8)
            panel.plot(values.mean(), y, "D", color=ORANGE, markeredgecolor="black", markersize=5)
        panel.set_xscale("log")
        panel.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 3.0, 5.0)))
        panel.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        panel.xaxis.set_minor_formatter(NullFormatter())
        panel.set_xlabel(label)
        panel.grid(axis="x", alpha=0.3)
    panels[0][0].set_yticks(range(len(groups)), list(groups), fontsize=SMALL)
    panels[0][0].invert_yaxis()
    figure.suptitle(title, fontsize=10)
    return save(figure, path, dpi=130)
