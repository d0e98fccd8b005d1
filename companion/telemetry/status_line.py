"""One line that says how a dive goes: for the log."""

import math
from math import degrees

from companion.records import PSI, ControlSample, Z
from companion.telemetry.glossary import on_engaging


def status_line(sample: ControlSample) -> str:
    """Return depth, heading, delays, state, and what is left of a path.

    What has not been measured says so. Nothing is wanted where nothing is held.
    """
    state, found, guided = sample.state, sample.state.delays, sample.guided
    telemetry = delay_text(found.telemetry_s, found.telemetry_known)
    command = delay_text(found.command_s, found.command_known)
    depth, heading = f"{state.eta[Z]:.3f} m", f"{degrees(state.eta[PSI]):.1f}°"
    if sample.dofs.engaged[Z]:
        depth += f" (wanted {sample.eta_d[Z]:.3f})"
    if sample.dofs.engaged[PSI]:
        heading += f" (wanted {degrees(sample.eta_d[PSI]):.1f})"
    left = left_text(guided.left_m, guided.left_s)
    parts = (
        f"depth {'not measured' if state.stale[Z] else depth}",
        f"heading {'not measured' if state.stale[PSI] else heading}",
        f"delays: telemetry {telemetry}, commands {command}; {sample.verdict.state}",
        f"{guided.kind}: {left}" if left else "",
        on_engaging(guided.pending),
    )
    return ", ".join(filter(None, parts))


def left_text(left_m: float, left_s: float) -> str:
    """Return the way and the time that are left of a path or a move; empty where none is."""
    if not math.isfinite(left_m + left_s):
        return "until stopped"
    return f"{left_m:.1f} m, about {duration_text(left_s)} left" if left_m > 0.0 or left_s > 0.0 else ""


def duration_text(seconds: float) -> str:
    """Return a time to go as a person says it."""
    minutes = round(seconds / 60.0)
    if seconds < 99.5:
        return f"{seconds:.0f} s"
    return f"{minutes} min" if minutes < 100 else f"{minutes // 60} h {minutes % 60:02d} min"


def delay_text(delay_s: float, known: bool) -> str:
    """Return a delay in ms, and whether it was measured.

    A measured one below 0 is what the clocks differ by beyond TIMESYNC's reach: no delay that can be told.
    """
    if known and delay_s < 0.0:
        return "about 0 ms"
    return f"{1e3 * delay_s:.0f} ms {'measured' if known else 'assumed'}"
