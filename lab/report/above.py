"""The dive from above: where it was, where it should have been, the paths it followed, and the fence."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from companion.telemetry.schemas import Plan
from lab import style
from lab.report.log import GAP_S, Array, Columns, Log

SIZE_IN, DPI = (8.0, 8.0), 120
FENCE_SEEN = 3.0
"""A fence larger than so many times what is inside it is not drawn: the rest would be small."""


def draw_above(log: Log) -> Figure | None:
    """Draw the map, north up; None where no position came."""
    state = log.keys["state"]
    north, east = state["x_m"], state["y_m"]
    known = np.flatnonzero(np.isfinite(north + east))
    if known.size < 2:
        return None
    figure = Figure(figsize=SIZE_IN, dpi=DPI, layout="constrained")
    panel = figure.subplots()
    paths = {(plan.name, plan.x_m, plan.y_m) for plan in log.plans if plan.x_m}
    for i, (name, x_m, y_m) in enumerate(sorted(paths)):
        label = "path" if len(paths) == 1 else f"path {name or i + 1}"
        panel.plot(y_m, x_m, color=style.FAINT, linewidth=3.0, alpha=0.4, label=label)
    engaged = np.interp(state.at_s, log.keys["dof/x"].at_s, log.keys["dof/x"]["engaged"]) > 0.5
    wanted = _apart(state, "y_desired_m", engaged), _apart(state, "x_desired_m", engaged)
    panel.plot(*wanted, color=style.ORANGE, linewidth=1.4, linestyle="--", label="reference")
    every = np.ones(state.at_s.size, bool)
    trail = _apart(state, "y_m", every), _apart(state, "x_m", every)
    panel.plot(*trail, color=style.BLUE, linewidth=1.2, label="estimate")
    for index, marker, label in ((known[0], "o", "first"), (known[-1], "s", "last")):
        panel.plot(east[index], north[index], marker, color=style.BLUE, label=label, linestyle="none")
    fence = log.plans[-1] if log.plans and log.plans[-1].fenced else None
    if fence is not None and _small(fence, panel.dataLim.width, panel.dataLim.height):
        (south, top), (west, right) = fence.fence_north_m, fence.fence_east_m
        panel.add_patch(
            Rectangle(
                (west, south),
                right - west,
                top - south,
                fill=False,
                edgecolor=style.VERMILLION,
                linestyle="--",
                label="fence",
            )
        )
    panel.set_aspect("equal", adjustable="datalim")
    panel.set_xlabel("east (m)", fontsize=style.SMALL)
    style.name(panel, "From above", "north (m)")
    style.plain(panel)
    panel.legend(frameon=False, fontsize=style.SMALL, ncols=3, loc="lower right", bbox_to_anchor=(1.0, 1.0))
    return figure


def _apart(state: Columns, name: str, shown: np.ndarray) -> Array:
    """Return a column, NaN where it is not shown and before a gap of the recording."""
    gap = np.diff(state.at_s, append=state.at_s[-1]) > GAP_S
    return np.where(shown & ~gap, state[name], np.nan)


def _small(fence: Plan, width_m: float, height_m: float) -> bool:
    sizes = [np.ptp(side) for side in (fence.fence_east_m, fence.fence_north_m) if len(side) == 2]
    return len(sizes) == 2 and sizes[0] <= FENCE_SEEN * width_m and sizes[1] <= FENCE_SEEN * height_m
