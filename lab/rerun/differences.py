"""Where today's commands part from the dive's."""

import numpy as np
from matplotlib.figure import Figure

from companion.records import AXES
from lab import style
from lab.rerun.rerun import Outcome


def draw(outcome: Outcome) -> Figure:
    """Draw each axis that differs: both commands, and today's minus the dive's."""
    difference = outcome.now - outcome.was
    rows = [i for i in range(4) if np.nan_to_num(difference[:, i]).any()]
    figure = Figure(figsize=(12.8, 1.2 + 2.6 * len(rows)), dpi=120, layout="constrained")
    axes = figure.subplots(len(rows), 2, squeeze=False, sharex=True)
    t_s = outcome.t_s - outcome.t_s[0]
    for (overlaid, apart), i in zip(axes, rows, strict=True):
        overlaid.plot(
            t_s, 100 * outcome.was[:, i], color=style.VERMILLION, linewidth=1.6, label="in the dive"
        )
        overlaid.plot(
            t_s, 100 * outcome.now[:, i], color=style.BLUE, linewidth=0.9, dashes=(4, 1.5), label="today"
        )
        apart.plot(t_s, 100 * difference[:, i], color=style.BLACK, linewidth=0.9)
        style.name(overlaid, f"{AXES[i].capitalize()} command", "% of full")
        style.name(apart, "Today minus the dive", "% of full")
        overlaid.legend(frameon=False, fontsize=style.SMALL, loc="upper right")
        for panel in (overlaid, apart):
            style.zero(panel)
            style.plain(panel)
    for panel in axes[-1]:
        panel.set_xlabel("time since the first tick (s)", fontsize=style.SMALL)
    return figure
