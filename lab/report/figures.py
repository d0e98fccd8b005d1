"""What a dive comes to, in figures: phases, thrust, loop, faults. No drawing."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lab.report.log import Array, Columns, Log, StateSpan, between

SETTLE_S = 3.0
"""Time after engaging that does not count as holding."""


class HeldAxis(NamedTuple):
    """Name, columns in `state` and `command`, and units of a degree of freedom."""

    name: str
    value: str
    desired: str
    force: str
    scale: float
    """Factor from m or rad to `unit`."""
    unit: str
    force_unit: str
    moving: float
    """A reference that is faster (m/s, rad/s) moves."""


AXES = {
    "z": HeldAxis("depth", "depth_m", "depth_desired_m", "heave_delivered_n", 1e3, "mm", "N", 0.005),
    "psi": HeldAxis(
        *("heading", "heading_rad", "heading_desired_rad", "yaw_delivered_nm"),
        *(float(np.degrees(1.0)), "°", "N·m", float(np.radians(0.5))),
    ),
    "x": HeldAxis("north", "x_m", "x_desired_m", "surge_delivered_n", 1e3, "mm", "N", 0.005),
    "y": HeldAxis("east", "y_m", "y_desired_m", "sway_delivered_n", 1e3, "mm", "N", 0.005),
}

LOOP = {
    "lateness_ms": ("tick lateness (ms)", 1.0),
    "compute_us": ("tick compute (µs)", 1.0),
    "telemetry_delay_s": ("telemetry delay (ms)", 1e3),
    "command_delay_s": ("command delay (ms)", 1e3),
    "link_age_s": ("age of the link (s)", 1.0),
    "depth_age_s": ("age of depth (s)", 1.0),
}
"""Columns of `loop` that the page shows: name and scale."""


@dataclass(frozen=True)
class Holding:
    """How well one degree of freedom was held in one phase: mm or degrees, N or N·m.

    Errors and `thrust_mean` are those while the reference rested; `moving_rms` is NaN where it never moved.
    """

    dof: str
    hold_s: float
    rms: float
    p95: float
    peak: float
    bias: float
    moving_rms: float
    thrust_rms: float
    thrust_mean: float
    chatter: float
    saturated: float


@dataclass(frozen=True)
class Phase:
    """An engaged interval, how it ended, and each degree of freedom that was held."""

    number: int
    begin_s: float
    end_s: float
    ended: str
    held: list[Holding]


@dataclass(frozen=True)
class DiveFigures:
    """All of it. `loop`: median, p99 and worst by LOOP."""

    warnings: list[str]
    """What a pilot reads first."""
    phases: list[Phase]
    faults: list[StateSpan]
    loop: dict[str, tuple[float, float, float]]
    voltage_min_v: float
    depth_max_m: float


def figures(log: Log) -> DiveFigures:
    """Work it out."""
    phases: list[Phase] = []
    for span in log.spans:
        if span.state == "ACTIVE" and span.end_s > span.begin_s:
            after = [later for later in log.spans if later.begin_s >= span.end_s]
            ended = f"{after[0].state}: {after[0].reason}" if after else "the recording ended"
            held = [figure for dof in AXES if (figure := _held(log, span, dof)) is not None]
            phases.append(Phase(len(phases) + 1, span.begin_s, span.end_s, ended, held))
    state = log.keys["state"]
    return DiveFigures(
        warnings=[*_warnings(log), *([] if phases else ["it never engaged: the table of states says why"])],
        phases=phases,
        faults=faults_of(log.spans),
        loop={column: _spread(log, column) for column in LOOP},
        voltage_min_v=-_most(-state["voltage_v"]),
        depth_max_m=_most(state["depth_m"]),
    )


def faults_of(spans: Sequence[StateSpan]) -> list[StateSpan]:
    """Return each fault once, as the log of `holdfast run` has it: a gap in the recording ends none."""
    previous = ["", *(span.state for span in spans)]
    return [span for span, state in zip(spans, previous, strict=False) if span.state == "FAULT" != state]


def error(state: Columns, dof: str) -> Array:
    """Return measured minus desired at the present, mm or degrees, heading wrapped."""
    axis = AXES[dof]
    apart = state[axis.value] - state[axis.desired]
    if dof == "psi":
        apart = (apart + np.pi) % (2.0 * np.pi) - np.pi
    return np.asarray(axis.scale * apart)


def _warnings(log: Log) -> list[str]:
    said = [f"FAULT at {span.begin_s:.1f} s: {span.reason}" for span in faults_of(log.spans)]
    times: dict[str, list[float]] = {}
    for at_s, event in log.events:
        if event.severity != "info":
            times.setdefault(f"{event.severity} ({event.kind}): {event.text}", []).append(at_s)
    for text, seen_s in times.items():
        again = f", {len(seen_s)} times until {seen_s[-1]:.1f} s" if len(seen_s) > 1 else ""
        said.append(f"{text}, at {seen_s[0]:.1f} s{again}")
    loop = log.keys["loop"]
    steps = np.diff(loop["tick"])
    lost = {
        "messages were dropped by the recorder": log.dropped,
        "ticks were left out by the loop, which was late": np.clip(
            np.diff(loop["late_ticks"]), 0, None
        ).sum(),
        "ticks are missing in the file": np.clip(steps - 1, 0, None)[steps > 0].sum(),
    }
    return [*said, *(f"{count:.0f} {what}" for what, count in lost.items() if count), *log.notes]


def _held(log: Log, span: StateSpan, dof: str) -> Holding | None:
    law, state, command = (
        between(log.keys[key], span.begin_s, span.end_s) for key in (f"dof/{dof}", "state", "command")
    )
    if min(law.size, state.size, command.size) < 10 or not law["engaged"].any():
        return None
    rate = np.abs(np.interp(state["at_s"], law["at_s"], np.nan_to_num(law["x_d_dot"])))
    moving = rate > AXES[dof].moving
    holding = ~moving & (state["at_s"] >= span.begin_s + SETTLE_S)
    apart = error(state, dof)
    calm = apart[holding & np.isfinite(apart)]
    force = command[AXES[dof].force]
    return Holding(
        dof=dof,
        hold_s=float(holding.mean()) * (span.end_s - span.begin_s),
        rms=_rms(calm),
        p95=float(np.percentile(np.abs(calm), 95)) if calm.size else np.nan,
        peak=float(np.abs(calm).max()) if calm.size else np.nan,
        bias=_mean(calm),
        moving_rms=_rms(apart[moving & np.isfinite(apart)]),
        thrust_rms=_rms(force),
        thrust_mean=_mean(force[np.interp(command["at_s"], state["at_s"], holding) > 0.5]),
        chatter=_rms(np.diff(force)[np.diff(command["at_s"]) < 0.1]),
        saturated=float(law["saturated"].mean()),
    )


def _spread(log: Log, column: str) -> tuple[float, float, float]:
    """Return median, 99th percentile and greatest of a number of the loop; of ages those while engaged."""
    loop = log.keys["loop"]
    values = loop[column][log.engaged(loop["at_s"])] if column.endswith("age_s") else loop[column]
    if not values.size:
        return (np.nan,) * 3
    median, p99, worst = LOOP[column][1] * np.percentile(values, (50.0, 99.0, 100.0))
    return float(median), float(p99), float(worst)


def _rms(values: Array) -> float:
    return float(np.sqrt(_mean(values * values)))


def _mean(values: Array) -> float:
    """Return the mean of what is known, NaN where nothing is."""
    return float(np.nanmean(values)) if np.isfinite(values).any() else math.nan


def _most(values: Array) -> float:
    return float(np.nanmax(values)) if np.isfinite(values).any() else math.nan
