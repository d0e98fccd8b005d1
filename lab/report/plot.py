"""The picture after a dive: what was asked of each axis, how well it was held, with how much force."""

from collections.abc import Mapping
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lab import style
from lab.report.figures import AXES, Phase, error
from lab.report.log import GAP_S, Log

WIDTH_IN, AXIS_IN, MAP_IN, DPI = 12.8, 2.3, 5.0, 130
COLOURS = (style.BLUE, style.VERMILLION, style.GREEN, style.SKY)
"""Of dives beside each other."""


def draw(dives: Mapping[str, tuple[Log, Phase]]) -> Figure:
    """Draw a phase of each dive, a row for each axis that was held (value, error, force), and the map."""
    held = {dof for _, phase in dives.values() for dof in phase.held} or {"z", "psi"}
    axes = [dof for dof in AXES if dof in held]
    mapped = any(np.isfinite(log.keys["state"]["x_m"]).sum() > 1 for log, _ in dives.values())
    rows: list[Any] = [[f"{dof} {what}" for what in "vef"] for dof in axes] + [["map"] * 3] * mapped
    heights = [AXIS_IN] * len(axes) + [MAP_IN] * mapped
    with rc_context({"agg.path.chunksize": 20_000}):
        figure = Figure(figsize=(WIDTH_IN, 0.5 + sum(heights)), dpi=DPI, layout="constrained")
        panels = figure.subplot_mosaic(rows, height_ratios=heights)
    for (name, (log, phase)), colour in zip(dives.items(), cycle(COLOURS), strict=False):
        label = f"{phase.mode} ({name})" if len(dives) > 1 else "measured"
        for dof in axes:
            _axis([panels[f"{dof} {what}"] for what in "vef"], log, phase, dof, label, colour)
        if mapped:
            draw_map(panels["map"], log, phase, colour)
    for dof in axes:
        errors = np.concatenate([np.abs(line.get_ydata()) for line in panels[f"{dof} e"].get_lines()])
        limit = max(3.0 * float(np.nanpercentile(errors, 90.0)), 1e-3)  # a step does not flatten the rest
        panels[f"{dof} e"].set_ylim(-limit, limit)
    told = [panels[f"{axes[0]} {what}"].get_legend_handles_labels() for what in "vf"]
    lines = {label: line for handles, labels in told for line, label in zip(handles, labels, strict=True)}
    figure.legend(lines.values(), lines, loc="outside upper left", ncols=5, frameon=False)
    for panel in panels.values():
        style.plain(panel)
    for what in "vef":
        panels[f"{axes[-1]} {what}"].set_xlabel("time (s)", fontsize=style.SMALL)
    return figure


def _axis(panels: list[Axes], log: Log, phase: Phase, dof: str, label: str, colour: str) -> None:
    """Draw one degree of freedom; force and disturbance only where Holdfast steered."""
    (value, apart, force), axis, name = panels, AXES[dof], AXES[dof].name.capitalize()
    state, law = (phase.part(log.keys[key]) for key in ("state", f"dof/{dof}"))
    at_s, error_now = error(log, dof, phase)
    if phase.by_us:
        error_now = np.where(log.engaged(at_s), error_now, np.nan)
    at_s = at_s - phase.begin_s
    scale, unit = (axis.scale, axis.unit) if dof == "psi" else (1.0, "m")
    measured = scale * (np.unwrap(np.nan_to_num(state[axis.value])) if dof == "psi" else state[axis.value])
    value.plot(at_s, measured, color=colour, linewidth=1.6, label=label)
    if phase.by_us:
        value.plot(at_s, measured - error_now * scale / axis.scale, "k:", linewidth=1.2, label="desired")
    if dof == "z" and not value.yaxis_inverted():
        value.invert_yaxis()
    style.name(value, name, f"{axis.name} ({unit})")

    apart.plot(at_s, error_now, color=colour, linewidth=0.9)
    style.zero(apart)
    style.name(apart, f"{name} error", f"measured minus desired ({axis.unit})")

    held = log.engaged(law["at_s"])
    for column, line, told in (("tau", "-", "demand"), ("d_hat", "--", r"$\hat d$")):
        drawn = np.where(held, law[column], np.nan)
        force.plot(law["at_s"] - phase.begin_s, drawn, line, color=colour, linewidth=0.9, label=told)
    style.zero(force)
    style.name(force, "Moment" if dof == "psi" else "Force", f"{axis.name} ({axis.force_unit})")


def draw_map(panel: Axes, log: Log, phase: Phase, colour: str) -> None:
    """Draw where the dive was, and dotted where it should have been; north up, nothing in a gap."""
    state = phase.part(log.keys["state"])
    known = np.diff(state["at_s"], append=state["at_s"][-1:]) < GAP_S
    for which, shown, line, of in (
        ("m", known, "-", colour),
        ("desired_m", known & log.engaged(state["at_s"]), ":", style.BLACK),
    ):
        east, north = (np.where(shown, state[f"{axis}_{which}"], np.nan) for axis in "yx")
        panel.plot(east, north, line, color=of, linewidth=1.2)
    panel.set_aspect("equal", adjustable="datalim")
    panel.set_xlabel("east (m)", fontsize=style.SMALL)
    style.name(panel, "From above", "north (m)")
