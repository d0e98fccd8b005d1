"""The picture after a dive: what was asked of each axis, how well it was held, with how much force."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from lab import style
from lab.report.figures import AXES, DiveFigures, error
from lab.report.log import GAP_S, Array, Log

WIDTH_IN, STATES_IN, AXIS_IN, MAP_IN, DPI = 12.8, 0.7, 2.3, 5.0, 130
COLOURS = {
    "IDLE": "0.90",
    "READY": "0.78",
    "ACTIVE": style.BLUE,
    "RAMP_DOWN": style.YELLOW,
    "HAND_OVER": style.ORANGE,
    "PILOT": style.SKY,
    "FAULT": style.VERMILLION,
}
SEVERITY = {"warning": "v", "fault": "X"}
FENCE_SEEN = 3.0
"""A fence larger than so many times what is inside it is not drawn: the rest would be small."""


def draw(log: Log, figures: DiveFigures) -> Figure:
    """Draw states, a row for each axis that was held (value, error, force), and the map."""
    held = {hold.dof for phase in figures.phases for hold in phase.held} or {"z", "psi"}
    axes = [dof for dof in AXES if dof in held]
    mapped = int(np.isfinite(log.keys["state"]["x_m"] + log.keys["state"]["y_m"]).sum()) > 1
    height_in = 0.5 + STATES_IN + AXIS_IN * len(axes) + MAP_IN * mapped
    rows: list[Any] = [["states"] * 3, *([f"{dof} {what}" for what in "vef"] for dof in axes)]
    rows += [["map"] * 3] * mapped
    with rc_context({"agg.path.chunksize": 20_000}):
        figure = Figure(figsize=(WIDTH_IN, height_in), dpi=DPI, layout="constrained")
        panels = figure.subplot_mosaic(
            rows,
            height_ratios=[STATES_IN, *[AXIS_IN] * len(axes), *[MAP_IN] * mapped],
        )
    _states(panels["states"], log)
    for dof in axes:
        _axis(panels[f"{dof} v"], panels[f"{dof} e"], panels[f"{dof} f"], log, dof)
    if mapped:
        draw_map(panels["map"], log)
    for name, panel in panels.items():
        style.plain(panel)
        if name != "map":
            panel.set_xlim(0.0, log.duration_s)
        if name == "states":
            panel.tick_params(labelbottom=False)
        elif name != "map":
            for phase in figures.phases:
                panel.axvspan(phase.begin_s, phase.end_s, color=style.WINDOW, linewidth=0, zorder=-10)
            for span in figures.faults:
                panel.axvline(span.begin_s, color=style.VERMILLION, linewidth=1.2, linestyle="--", zorder=-1)
    for what in "vef":
        label = "time since the recording began (s)"
        panels[f"{axes[-1]} {what}"].set_xlabel(label, fontsize=style.SMALL)
    return figure


def _states(panel: Axes, log: Log) -> None:
    for span in log.spans:
        wide = max(span.end_s - span.begin_s, 0.002 * log.duration_s)
        colour = COLOURS.get(span.state, "0.5")
        panel.broken_barh([(span.begin_s, wide)], (0.0, 1.0), facecolor=colour, edgecolor="white")
    known = dict.fromkeys(span.state for span in log.spans)
    handles: list[Artist] = [Patch(facecolor=COLOURS.get(name, "0.5"), label=name) for name in known]
    for severity, marker in SEVERITY.items():
        times = [at_s for at_s, event in log.events if event.severity == severity]
        if times:
            handles += panel.plot(times, [1.3] * len(times), marker, color=style.BLACK, label=severity)
    panel.set_ylim(0.0, 1.6)
    panel.set_yticks([])
    style.name(panel, "What it did", "")
    _legend(panel, handles)


def _axis(value: Axes, apart: Axes, force: Axes, log: Log, dof: str) -> None:
    """Draw one degree of freedom; error, demand and disturbance only while the vehicle was engaged."""
    axis, state, law = AXES[dof], log.keys["state"], log.keys[f"dof/{dof}"]
    name, on = axis.name.capitalize(), log.engaged(state["at_s"])
    scale, unit = (axis.scale, axis.unit) if dof == "psi" else (1.0, "m")
    measured, error_now = state[axis.value], error(state, dof)
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
    full = held & (law["saturated"] > 0.0)
    if full.any():
        label = f"saturated {full.sum() / held.sum():.1%}"
        top = np.where(full, np.abs(np.nan_to_num(law["tau"][held])).max(), np.nan)
        force.plot(law["at_s"], top, color=style.VERMILLION, linewidth=3.0, label=label)
    style.zero(force)
    style.name(force, "Moment" if dof == "psi" else "Force", f"{axis.name} ({axis.force_unit})")
    _legend(force)


def draw_map(panel: Axes, log: Log) -> None:
    """Draw where the dive was, where it should have been, its paths, and the fence; north up."""
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
    known = np.flatnonzero(np.isfinite(state["x_m"] + state["y_m"]))
    for row, marker, label in ((known[0], "o", "first"), (known[-1], "s", "last")):
        panel.plot(state["y_m"][row], state["x_m"][row], marker, color=style.BLUE, label=label)
    if log.plans and log.plans[-1].fenced:
        (south, north), (west, east) = log.plans[-1].fence_north_m, log.plans[-1].fence_east_m
        inside = panel.dataLim
        if north - south <= FENCE_SEEN * inside.height and east - west <= FENCE_SEEN * inside.width:
            fence = Rectangle((west, south), east - west, north - south, linestyle="--", label="fence")
            fence.set(fill=False, edgecolor=style.VERMILLION)
            panel.add_patch(fence)
    panel.set_aspect("equal", adjustable="datalim")
    panel.set_xlabel("east (m)", fontsize=style.SMALL)
    style.name(panel, "From above", "north (m)")
    _legend(panel)


def _legend(panel: Axes, handles: Sequence[Artist] | None = None) -> None:
    """Put the legend beside the title, where no line can be."""
    panel.legend(
        handles=handles or panel.get_legend_handles_labels()[0],
        ncols=8,
        frameon=False,
        fontsize=style.SMALL,
        loc="lower right",
        bbox_to_anchor=(1.0, 0.99),
        borderaxespad=0.0,
        columnspacing=1.2,
    )
