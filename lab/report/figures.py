"""What a dive comes to, in figures: phases, errors, thrust, warnings. No drawing."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from companion.telemetry.modes import MODE_NAMES
from lab.report.log import Array, Log, StateSpan, between

SETTLE_S = 3.0
"""Time after engaging that does not count as holding."""
SHORTEST_S = 10.0
"""A flight mode that lasts so long is a phase of a dive that never engaged."""


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


@dataclass(frozen=True)
class Phase:
    """An engaged interval, or one in `mode` if the dive has none, and how well each axis was held.

    Errors (mm, degrees) are those while the reference rested. SD and the band of 95 % are about the mean
    error. NaN: it never moved, or Holdfast did not steer.
    """

    mode: str
    begin_s: float
    end_s: float
    held: dict[str, dict[str, float]]
    """For each degree of freedom the figures by their words in the table."""


def phases(log: Log) -> list[Phase]:
    """Return each engaged interval; of a dive that never engaged each flight mode."""
    engaged = [span for span in log.spans if span.state == "ACTIVE" and span.end_s > span.begin_s]
    return [
        Phase(
            mode="Holdfast" if engaged else span.state,
            begin_s=span.begin_s,
            end_s=span.end_s,
            held={dof: found for dof in AXES if (found := _held(log, span, dof, bool(engaged)))},
        )
        for span in engaged or _modes(log)
    ]


def warnings(log: Log) -> list[str]:
    """Return what a pilot reads first: what was said since the recording began, and what was lost."""
    times: dict[str, list[float]] = {}
    for at_s, event in log.events:
        if event.severity != "info" and at_s >= 0.0:
            times.setdefault(f"{event.severity} ({event.kind}): {event.text}", []).append(at_s)
    said = [
        f"{text}, at {seen_s[0]:.1f} s"
        + (f", {len(seen_s)} times until {seen_s[-1]:.1f} s" if len(seen_s) > 1 else "")
        for text, seen_s in times.items()
    ]
    loop = log.keys["loop"]
    steps = np.diff(loop["tick"])
    lost = {
        "messages were dropped by the recorder": log.dropped,
        "ticks were left out by the loop, which was late": np.clip(
            np.diff(loop["late_ticks"]), 0, None
        ).sum(),
        "ticks are missing in the file": np.clip(steps - 1, 0, None)[steps > 0].sum(),
    }
    said += [f"{count:.0f} {what}" for what, count in lost.items() if count] + log.notes
    if not any(span.state == "ACTIVE" for span in log.spans):
        said.append("it never engaged: errors are about the mean of each flight mode")
    return said


def error(log: Log, dof: str, begin_s: float, end_s: float, *, engaged: bool = True) -> tuple[Array, Array]:
    """Return times and measured minus desired, mm or degrees; minus the mean where nothing was engaged."""
    axis, state = AXES[dof], between(log.keys["state"], begin_s, end_s)
    value, wanted = state[axis.value], state[axis.desired] if engaged else 0.0
    if dof == "psi":
        value = value - wanted
        middle = 0.0 if engaged else np.angle(np.nanmean(np.exp(1j * value)) if value.size else 1.0)
        return state["at_s"], np.degrees((value - middle + np.pi) % (2.0 * np.pi) - np.pi)
    apart = axis.scale * (value - wanted)
    return state["at_s"], apart if engaged else apart - _mean(apart)


def _modes(log: Log) -> list[StateSpan]:
    """Return the intervals in which the vehicle was armed in one flight mode."""
    state = log.keys["state"]
    mode = np.where(state["armed"] > 0.0, state["mode"], np.nan)
    begins = np.flatnonzero(np.diff(mode, prepend=np.nan) != 0.0)
    spans = []
    for first, end in zip(begins, [*begins[1:], mode.size], strict=True):
        begin_s, end_s = float(state["at_s"][first]), float(state["at_s"][end - 1])
        if np.isfinite(mode[first]) and end_s - begin_s >= SHORTEST_S:
            name = MODE_NAMES.get(int(mode[first]), f"mode {mode[first]:.0f}")
            spans.append(StateSpan(name, begin_s, end_s, ""))
    return spans


def _held(log: Log, span: StateSpan, dof: str, engaged: bool) -> dict[str, float]:
    law, command = (between(log.keys[key], span.begin_s, span.end_s) for key in (f"dof/{dof}", "command"))
    at_s, apart = error(log, dof, span.begin_s, span.end_s, engaged=engaged)
    if min(law.size, at_s.size, command.size) < 10 or not (law["engaged"].any() if engaged else True):
        return {}
    rate = np.abs(np.interp(at_s, law["at_s"], np.nan_to_num(law["x_d_dot"])))
    moving = (rate > AXES[dof].moving) & engaged
    resting = ~moving & (at_s >= span.begin_s + SETTLE_S)
    calm = apart[resting & np.isfinite(apart)]
    if not (engaged or calm.size):
        return {}
    centred = np.abs(calm - _mean(calm))
    return {
        "held": float(resting.mean()) * (span.end_s - span.begin_s),
        "RMS": _rms(calm),
        "SD": _rms(centred),
        "95 % within": float(np.percentile(centred, 95)) if calm.size else np.nan,
        "peak": float(np.abs(calm).max()) if calm.size else np.nan,
        "moving, RMS": _rms(apart[moving & np.isfinite(apart)]),
        "thrust, RMS": _rms(command[AXES[dof].force]) if engaged else np.nan,
        "saturated": 100.0 * float(law["saturated"].mean()) if engaged else np.nan,
    }


def _rms(values: Array) -> float:
    return float(np.sqrt(_mean(values * values)))


def _mean(values: Array) -> float:
    """Return the mean of what is known, NaN where nothing is."""
    return float(np.nanmean(values)) if np.isfinite(values).any() else math.nan
