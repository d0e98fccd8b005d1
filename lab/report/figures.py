"""What a dive comes to, in figures: phases, errors, thrust, warnings. No drawing."""

import math
from typing import NamedTuple

import numpy as np

from lab.report.log import Array, Columns, Log

SETTLE_S = 3.0
"""Time after engaging that does not count as holding."""
SHORTEST_S = 10.0
"""A flight mode that lasts so long is a phase of a dive that never engaged."""


class HeldAxis(NamedTuple):
    """A degree of freedom: its name, columns in `state` and `command`, m or rad times `scale` in `unit`."""

    name: str
    value: str
    desired: str
    force: str
    scale: float
    unit: str
    force_unit: str
    moving: float
    """A reference that is faster (m/s, rad/s) moves."""


HEADING = ("heading", "heading_rad", "heading_desired_rad", "yaw_delivered_nm", math.degrees(1.0), "°", "N·m")
AXES = {
    "z": HeldAxis("depth", "depth_m", "depth_desired_m", "heave_delivered_n", 1e3, "mm", "N", 0.005),
    "psi": HeldAxis(*HEADING, moving=math.radians(0.5)),
    "x": HeldAxis("north", "x_m", "x_desired_m", "surge_delivered_n", 1e3, "mm", "N", 0.005),
    "y": HeldAxis("east", "y_m", "y_desired_m", "sway_delivered_n", 1e3, "mm", "N", 0.005),
}


class Phase(NamedTuple):
    """An engaged interval, or one in `mode` if the dive has none, and how well each axis was held."""

    mode: str
    begin_s: float
    end_s: float
    held: dict[str, dict[str, float]]
    """For each degree of freedom the figures by their words in the table, mm or degrees: errors while the
    reference rested, SD and the band of 95 % about their mean. NaN: it never moved, or another steered."""

    def duration_s(self) -> float:
        """Return how long it lasts."""
        return self.end_s - self.begin_s

    @property
    def by_us(self) -> bool:
        """Whether Holdfast steered."""
        return self.mode == "Holdfast"

    def part(self, columns: Columns) -> Columns:
        """Return the rows of its time."""
        return columns[slice(*np.searchsorted(columns["at_s"], (self.begin_s, self.end_s)))]


def phases(log: Log) -> list[Phase]:
    """Return each engaged interval; of a dive that never engaged each flight mode."""
    engaged = [span for span in log.spans if span.state == "ACTIVE" and span.end_s > span.begin_s]
    modes = [span for span in log.modes if span.state and span.end_s - span.begin_s >= SHORTEST_S]
    begun = [
        Phase("Holdfast" if engaged else span.state, span.begin_s, span.end_s, {})
        for span in engaged or modes
    ]
    return [
        phase._replace(held={dof: found for dof in AXES if (found := _held(log, phase, dof))})
        for phase in begun
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
    steps, late = np.diff(log.keys["loop"]["tick"]), np.diff(log.keys["loop"]["late_ticks"])
    lost = {
        "ticks were left out by the loop, which was late": np.clip(late, 0, None).sum(),
        "ticks are missing in the file": np.clip(steps - 1, 0, None)[steps > 0].sum(),
    }
    said += [f"{count:.0f} {what}" for what, count in lost.items() if count] + log.notes
    if not any(span.state == "ACTIVE" for span in log.spans):
        said.append("it never engaged: errors are about the mean of each flight mode")
    return said


def error(log: Log, dof: str, phase: Phase) -> tuple[Array, Array]:
    """Return times and measured minus desired, mm or degrees; minus the mean where Holdfast did not steer."""
    axis, state = AXES[dof], phase.part(log.keys["state"])
    apart = state[axis.value] - (state[axis.desired] if phase.by_us else 0.0)
    if dof == "psi":
        middle = 0.0 if phase.by_us or not apart.size else np.angle(np.nanmean(np.exp(1j * apart)))
        apart = (apart - middle + np.pi) % (2.0 * np.pi) - np.pi
    apart = axis.scale * apart
    return state["at_s"], apart if phase.by_us else apart - _mean(apart)


def _held(log: Log, phase: Phase, dof: str) -> dict[str, float]:
    law, command = (phase.part(log.keys[key]) for key in (f"dof/{dof}", "command"))
    at_s, apart = error(log, dof, phase)
    if min(law.size, at_s.size, command.size) < 10 or not (law["engaged"].any() or not phase.by_us):
        return {}
    rate = np.abs(np.interp(at_s, law["at_s"], np.nan_to_num(law["x_d_dot"])))
    moving = (rate > AXES[dof].moving) & phase.by_us
    resting = ~moving & (at_s >= phase.begin_s + SETTLE_S)
    calm = apart[resting & np.isfinite(apart)]
    if not (phase.by_us or calm.size):
        return {}
    centred = np.abs(calm - _mean(calm))
    return {
        "RMS": _rms(calm),
        "SD": _rms(centred),
        "95 % within": float(np.percentile(centred, 95)) if calm.size else np.nan,
        "peak": float(np.abs(calm).max()) if calm.size else np.nan,
        "moving, RMS": _rms(apart[moving & np.isfinite(apart)]),
        "thrust, RMS": _rms(command[AXES[dof].force]) if phase.by_us else np.nan,
        "saturated": 100.0 * float(law["saturated"].mean()) if phase.by_us else np.nan,
    }


def _rms(values: Array) -> float:
    return float(np.sqrt(_mean(values * values)))


def _mean(values: Array) -> float:
    """Return the mean of what is known, NaN where nothing is."""
    return float(np.nanmean(values)) if np.isfinite(values).any() else math.nan
