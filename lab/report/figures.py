"""What a dive comes to, in figures: phases, thrust, loop, faults, the model that it shows. No drawing."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lab.report.identify import IdentifiedModel, identify
from lab.report.log import Array, Columns, Log, StateSpan

SETTLE_S = 3.0
"""After engaging, this long is the way in and not counted as holding."""

MOVING = {"x": 0.005, "y": 0.005, "z": 0.005, "psi": np.radians(0.5)}
"""A reference faster than this (m/s, rad/s) moves."""

AXIS_OF = {"x": "surge", "y": "sway", "z": "heave", "psi": "yaw"}
FORCE_OF = {axis: f"{axis}_delivered_{'nm' if axis == 'yaw' else 'n'}" for axis in AXIS_OF.values()}
NAMES = {"x": "north", "y": "east", "z": "depth", "psi": "heading"}
PLACE = {"x": "x", "y": "y", "z": "depth", "psi": "heading"}


@dataclass(frozen=True)
class Held:
    """How well one degree of freedom was held in one phase: mm or degrees, N or N·m.

    `thrust_mean` is while the reference rested. Figures while the reference moved are NaN where it did not.
    `true_rms` is against the simulator's truth, its mean taken off (a depth sensor's zero is no error of the
    controller), NaN without.
    """

    dof: str
    hold_s: float
    rms: float
    p95: float
    peak: float
    bias: float
    bias_sigma: float
    moving_rms: float
    true_rms: float
    thrust_rms: float
    thrust_mean: float
    chatter: float
    saturated: float
    steady_d_hat: float

    @property
    def unit(self) -> str:
        """Of errors."""
        return "°" if self.dof == "psi" else "mm"

    @property
    def thrust_unit(self) -> str:
        """Of thrust."""
        return "N·m" if self.dof == "psi" else "N"


@dataclass(frozen=True)
class Phase:
    """An engaged interval, how it ended, and each degree of freedom that was held."""

    number: int
    begin_s: float
    end_s: float
    ended: str
    held: list[Held]


@dataclass(frozen=True)
class LoopFigures:
    """How the process did, and what was lost between it and the file. Ages are those while engaged."""

    lateness_p50_ms: float
    lateness_p99_ms: float
    lateness_max_ms: float
    compute_p99_us: float
    late_ticks: int
    telemetry_delay_ms: float
    command_delay_ms: float
    delay_known: float
    link_age_p99_s: float
    depth_age_p99_s: float
    ticks_missing: int
    ticks: int


@dataclass(frozen=True)
class DiveFigures:
    """All of it. `models` by DOF; None where the dive was too short for it."""

    phases: list[Phase]
    faults: list[StateSpan]
    loop: LoopFigures
    models: dict[str, IdentifiedModel | None]
    voltage_min_v: float
    depth_max_m: float
    recorder_dropped: int


def faults_of(spans: Sequence[StateSpan]) -> list[StateSpan]:
    """Return each fault once, as the log of `holdfast run` has it: a gap in the recording ends none."""
    previous = ["", *(span.state for span in spans)]
    return [span for span, state in zip(spans, previous, strict=False) if span.state == "FAULT" != state]


def figures(log: Log) -> DiveFigures:
    """Work it out."""
    active = [span for span in log.spans if span.state == "ACTIVE" and span.end_s > span.begin_s]
    phases = [_phase(log, number, span) for number, span in enumerate(active, 1)]
    state = log.keys["state"]
    voltage = state["voltage_v"]
    return DiveFigures(
        phases=phases,
        faults=faults_of(log.spans),
        loop=_loop(log),
        models={dof: _model(log, phases, dof) for dof in NAMES},
        voltage_min_v=float(np.nanmin(voltage)) if np.isfinite(voltage).any() else np.nan,
        depth_max_m=float(np.nanmax(state["depth_m"])),
        recorder_dropped=max((status.dropped for status in log.recorder), default=0),
    )


def error(state: Columns, dof: str) -> Array:
    """Return measured minus desired at the present, mm or degrees, heading wrapped."""
    if dof == "psi":
        apart = state["heading_rad"] - state["heading_desired_rad"]
        return np.degrees((apart + np.pi) % (2.0 * np.pi) - np.pi)
    return 1e3 * (state[f"{PLACE[dof]}_m"] - state[f"{PLACE[dof]}_desired_m"])


def true_error(log: Log, state: Columns, dof: str) -> Array | None:
    """Return true minus desired, its mean taken off, or None without the simulator's truth."""
    if log.truth is None or dof not in ("z", "psi"):
        return None
    if dof == "z":
        apart = 1e3 * (log.truth.at("depth_m", state.at_s) - state["depth_desired_m"])
    else:
        apart = np.degrees(log.truth.at("heading_rad", state.at_s) - state["heading_desired_rad"])
        apart = (apart + 180.0) % 360.0 - 180.0
    return apart - float(np.nanmean(apart))


def _phase(log: Log, number: int, span: StateSpan) -> Phase:
    after = [later for later in log.spans if later.begin_s >= span.end_s]
    ended = f"{after[0].state}: {after[0].reason}" if after else "the recording ended"
    held = [figure for dof in NAMES if (figure := _held(log, span, dof)) is not None]
    return Phase(number, span.begin_s, span.end_s, ended, held)


def _held(log: Log, span: StateSpan, dof: str) -> Held | None:
    law = log.keys.get(f"dof/{dof}")
    if law is None:
        return None
    law, state = law.between(span.begin_s, span.end_s), log.keys["state"].between(span.begin_s, span.end_s)
    command = log.keys["command"].between(span.begin_s, span.end_s)
    if min(law.at_s.size, state.at_s.size, command.at_s.size) < 10 or not law["engaged"].any():
        return None
    rate = np.abs(np.interp(state.at_s, law.at_s, np.nan_to_num(law["x_d_dot"])))
    moving = rate > MOVING[dof]
    holding = ~moving & (state.at_s >= span.begin_s + SETTLE_S)
    apart = error(state, dof)
    calm = apart[holding & np.isfinite(apart)]
    true = true_error(log, state, dof)
    force = command[FORCE_OF[AXIS_OF[dof]]]
    changes = np.diff(force)[np.diff(command.at_s) < 0.1]
    return Held(
        dof=dof,
        hold_s=float(holding.mean()) * (span.end_s - span.begin_s),
        rms=_rms(calm),
        p95=float(np.percentile(np.abs(calm), 95)) if calm.size else np.nan,
        peak=float(np.abs(calm).max()) if calm.size else np.nan,
        bias=float(calm.mean()) if calm.size else np.nan,
        bias_sigma=_mean_sigma(calm),
        moving_rms=_rms(apart[moving & np.isfinite(apart)]),
        true_rms=_rms(true[holding]) if true is not None else np.nan,
        thrust_rms=_rms(force),
        thrust_mean=_mean(force[np.interp(command.at_s, state.at_s, holding) > 0.5]),
        chatter=_rms(changes),
        saturated=float(law["saturated"].mean()),
        steady_d_hat=float(np.nanmean(law["d_hat"])),
    )


def _loop(log: Log) -> LoopFigures:
    loop = log.keys["loop"]
    late, tick = loop["lateness_ms"], loop["tick"]
    steps = np.diff(tick)
    known = loop["telemetry_delay_known"] * loop["command_delay_known"]
    active = np.zeros(tick.size, bool)
    for span in log.spans:
        if span.state == "ACTIVE":
            active |= (loop.at_s >= span.begin_s) & (loop.at_s < span.end_s)
    ages = {name: loop[name][active] for name in ("link_age_s", "depth_age_s")}
    return LoopFigures(
        lateness_p50_ms=float(np.percentile(late, 50)),
        lateness_p99_ms=float(np.percentile(late, 99)),
        lateness_max_ms=float(late.max()),
        compute_p99_us=float(np.percentile(loop["compute_us"], 99)),
        late_ticks=int(np.clip(np.diff(loop["late_ticks"]), 0, None).sum()),
        telemetry_delay_ms=1e3 * float(np.median(loop["telemetry_delay_s"])),
        command_delay_ms=1e3 * float(np.median(loop["command_delay_s"])),
        delay_known=float(known.mean()),
        link_age_p99_s=_p99(ages["link_age_s"]),
        depth_age_p99_s=_p99(ages["depth_age_s"]),
        ticks_missing=int(np.clip(steps - 1, 0, None)[steps > 0].sum()),
        ticks=tick.size,
    )


def _model(log: Log, phases: list[Phase], dof: str) -> IdentifiedModel | None:
    """Fit the longest phase in which it was held; body axes are the inertial ones only in heave and yaw."""
    if dof not in ("z", "psi"):
        return None
    spans = [phase for phase in phases if any(held.dof == dof for held in phase.held)]
    if not spans:
        return None
    longest = max(spans, key=lambda phase: phase.end_s - phase.begin_s)
    state = log.keys["state"].between(longest.begin_s, longest.end_s)
    command = log.keys["command"].between(longest.begin_s, longest.end_s)
    rate = state["heading_rate_radps" if dof == "psi" else "depth_rate_mps"]
    tau = np.interp(state.at_s, command.at_s, command[FORCE_OF[AXIS_OF[dof]]])
    law = log.keys[f"dof/{dof}"].between(longest.begin_s, longest.end_s)
    desired = np.interp(state.at_s, law.at_s, law["x_d_dot"])
    delay_s = float(np.median(log.keys["loop"]["command_delay_s"]))
    return identify(state.at_s, rate, desired, tau, delay_s, log.config("thrusters.lag_s", 0.15))


def _mean_sigma(values: Array) -> float:
    """Return the standard deviation of the mean of values that hang together, by means of ten stretches."""
    if values.size < 100:
        return float("nan")
    means = [part.mean() for part in np.array_split(values, 10)]
    return float(np.std(means, ddof=1) / np.sqrt(10))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.nanmean(values * values))) if values.size else float("nan")


def _mean(values: Array) -> float:
    return float(np.nanmean(values)) if values.size else float("nan")


def _p99(values: Array) -> float:
    return float(np.percentile(values, 99)) if values.size else float("nan")
