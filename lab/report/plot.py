"""The picture after a dive: what was asked of each axis, how well it was held, with how much force."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lab import style
from lab.report.figures import AXES, SETTLE_S, DiveFigures, Phase, error
from lab.report.log import GAP_S, Array, Log

WIDTH_IN, AXIS_IN, MAP_IN, DPI = 12.8, 2.3, 5.0, 130
LINES = (style.VERMILLION, style.BLUE, style.ORANGE, style.GREEN, style.SKY)
"""Of dives beside each other."""


def draw(log: Log, figures: DiveFigures) -> Figure:
    """Draw a row for each axis that was held (value, error, force), and the map."""
    held = {hold.dof for phase in figures.phases for hold in phase.held} or {"z", "psi"}
    axes = [dof for dof in AXES if dof in held]
    mapped = int(np.isfinite(log.keys["state"]["x_m"] + log.keys["state"]["y_m"]).sum()) > 1
    rows: list[Any] = [[f"{dof} {what}" for what in "vef"] for dof in axes] + [["map"] * 3] * mapped
    heights = [AXIS_IN] * len(axes) + [MAP_IN] * mapped
    with rc_context({"agg.path.chunksize": 20_000}):
        figure = Figure(figsize=(WIDTH_IN, 0.5 + sum(heights)), dpi=DPI, layout="constrained")
        panels = figure.subplot_mosaic(rows, height_ratios=heights)
    for dof in axes:
        _axis(panels[f"{dof} v"], panels[f"{dof} e"], panels[f"{dof} f"], log, dof)
    if mapped:
        draw_map(panels["map"], log)
    for name, panel in panels.items():
        style.plain(panel)
        if name != "map":
            panel.set_xlim(0.0, log.duration_s)
            for phase in figures.phases:
                panel.axvspan(phase.begin_s, phase.end_s, color=style.WINDOW, linewidth=0, zorder=-10)
    for what in "vef":
        panels[f"{axes[-1]} {what}"].set_xlabel("time since the recording began (s)", fontsize=style.SMALL)
    return figure


def beside(dives: Mapping[str, tuple[Log, Phase]]) -> Figure:
    """Draw the errors of a phase of each dive, an axis a row."""
    axes = [dof for dof in AXES if any(dof == hold.dof for _, phase in dives.values() for hold in phase.held)]
    figure = Figure(figsize=(WIDTH_IN, 0.7 + AXIS_IN * len(axes)), dpi=DPI, layout="constrained")
    panels = figure.subplots(len(axes), sharex=True, squeeze=False)[:, 0]
    for dof, panel in zip(axes, panels, strict=True):
        for (name, (log, phase)), colour in zip(dives.items(), LINES * len(dives), strict=False):
            begin_s, by_us = phase.begin_s + SETTLE_S, phase.mode == "Holdfast"
            at_s, apart = error(log, dof, begin_s, phase.end_s, engaged=by_us)
            label = f"{phase.mode} ({name})"
            panel.plot(at_s - begin_s, apart, color=colour, linewidth=1.0, label=label)
        style.plain(panel)
        style.zero(panel)
        about = f"error ({AXES[dof].unit})"
        style.name(panel, f"{AXES[dof].name.capitalize()}: measured minus desired, or minus its mean", about)
    _legend(panels[0])
    panels[-1].set_xlabel(f"time since {SETTLE_S:.0f} s after the phase began (s)", fontsize=style.SMALL)
    return figure


def _axis(value: Axes, apart: Axes, force: Axes, log: Log, dof: str) -> None:
    """Draw one degree of freedom; error, demand and disturbance only while the vehicle was engaged."""
    axis, state, law = AXES[dof], log.keys["state"], log.keys[f"dof/{dof}"]
    name, on = axis.name.capitalize(), log.engaged(state["at_s"])
    scale, unit = (axis.scale, axis.unit) if dof == "psi" else (1.0, "m")
    measured, (_, error_now) = state[axis.value], error(log, dof, 0.0, np.inf)
    if dof == "psi":
        measured = np.unwrap(np.nan_to_num(measured))
    desired = scale * measured - error_now * (1.0 if dof == "psi" else 1e-3)
    value.plot(state["at_s"], scale * measured, color=style.BLUE, linewidth=1.6, label="measured")
    value.plot(state["at_s"], np.where(on, desired, np.nan), "k:", linewidth=1.2, label="desired")
    if dof == "z":
        value.invert_yaxis()
    style.name(value, name, f"{axis.name} ({unit})")
    _legend(value)

    apart.plot(state["at_s"], np.where(on, error_now, np.nan), color=style.BLUE, linewidth=0.9)
    style.zero(apart)
    style.name(apart, f"{name} error", f"measured minus desired ({axis.unit})")
    shown = np.abs(error_now[on & np.isfinite(error_now)])
    if shown.size:  # the scale of holding: a step does not flatten it
        limit = 1.25 * max(float(np.percentile(shown, 99.0)), 1e-3)
        apart.set_ylim(-limit, limit)

    held = law["engaged"] > 0.0
    for column, colour, label in (("tau", style.BLUE, "demand"), ("d_hat", style.ORANGE, r"$\hat d$")):
        force.plot(law["at_s"], np.where(held, law[column], np.nan), color=colour, linewidth=0.9, label=label)
    style.zero(force)
    style.name(force, "Moment" if dof == "psi" else "Force", f"{axis.name} ({axis.force_unit})")
    _legend(force)


def draw_map(panel: Axes, log: Log) -> None:
    """Draw where the dive was, where it should have been, and its paths; north up."""
    state = log.keys["state"]
    gap = np.diff(state["at_s"], append=state["at_s"][-1]) > GAP_S
    on = log.engaged(state["at_s"])

    def between_gaps(column: str, shown: np.ndarray) -> Array:
        return np.where(shown & ~gap, state[column], np.nan)

    for name, x_m, y_m in sorted({(plan.name, plan.x_m, plan.y_m) for plan in log.plans if plan.x_m}):
        panel.plot(y_m, x_m, color=style.FAINT, linewidth=3.0, alpha=0.4, label=f"path {name}")
    wanted = between_gaps("y_desired_m", on), between_gaps("x_desired_m", on)
    panel.plot(*wanted, color=style.ORANGE, linewidth=1.4, linestyle="--", label="reference")
    trail = between_gaps("y_m", ~gap), between_gaps("x_m", ~gap)
    panel.plot(*trail, color=style.BLUE, linewidth=1.2, label="estimate")
    panel.set_aspect("equal", adjustable="datalim")
    panel.set_xlabel("east (m)", fontsize=style.SMALL)
    style.name(panel, "From above", "north (m)")
    _legend(panel)


def _legend(panel: Axes) -> None:
    """Put the legend beside the title, where no line can be."""
    place: Any = {"loc": "lower right", "bbox_to_anchor": (1.0, 0.99), "borderaxespad": 0.0}
    panel.legend(ncols=8, frameon=False, fontsize=style.SMALL, columnspacing=1.2, **place)
