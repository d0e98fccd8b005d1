"""ArduSub's depth loop: depth to climb rate to acceleration to throttle, P-P-PI with three low-passes."""

import math
from typing import NamedTuple

CLIMB_FILTER_HZ, RISE_FILTER_HZ, THROTTLE_FILTER_HZ = 5.0, 20.0, 2.0
"""Low-passes: the errors of climb rate (PSC_VELZ_FLTE) and of acceleration (PSC_ACCZ_FLTE), and the throttle
behind them (a constant of the firmware)."""
MAX_ACCELERATION_M_S2 = 1.0
"""PILOT_ACCEL_Z."""
MAX_JERK_M_S3 = 25.0
"""PSC_JERK_Z, less where the filter of the acceleration (20 Hz) could not follow."""
GAINS = ("PSC_POSZ_P", "PSC_VELZ_P", "PSC_ACCZ_P", "PSC_ACCZ_I")
"""The parameters that `DepthGains` is made of."""


class DepthGains(NamedTuple):
    """Of depth and climb rate (1/s), and of acceleration as the parameters state them."""

    depth_p: float
    climb_p: float
    rise_p: float
    rise_i: float


class State(NamedTuple):
    """What the loop remembers: errors behind their filters (m/s, m/s²), integral and throttle (-1..1)."""

    climb_error: float
    rise_error: float
    integral: float
    throttle: float


AT_REST = State(0.0, 0.0, 0.0, 0.0)


class Wanted(NamedTuple):
    """The motion of the target, positive up: m/s, m/s²."""

    climb_m_s: float
    rise_m_s2: float


STILL = Wanted(0.0, 0.0)


def toward_climb(wanted: Wanted, climb_m_s: float, dt: float) -> Wanted:
    """Return the target's motion `dt` (s) later, on its way to a climb rate; its jerk is bounded."""
    climb = wanted.climb_m_s + wanted.rise_m_s2 * dt
    hasten = clip(MAX_JERK_M_S3 / MAX_ACCELERATION_M_S2 * (climb_m_s - climb), MAX_ACCELERATION_M_S2)
    return Wanted(climb, wanted.rise_m_s2 + clip(hasten - wanted.rise_m_s2, MAX_JERK_M_S3 * dt))


def step(
    gains: DepthGains,
    state: State,
    too_deep_m: float,
    wanted: Wanted,
    fastest_m_s: float,
    climb_m_s: float,
    rise_m_s2: float,
    dt: float,
) -> State:
    """Advance by `dt` (s); `too_deep_m` is how far the target lies above, rates are positive up.

    `fastest_m_s` bounds the correction of depth.
    """
    to_target = clip(approach(gains.depth_p, too_deep_m), fastest_m_s)
    lacking = wanted.climb_m_s + to_target - climb_m_s
    climb_error = state.climb_error + smoothing(CLIMB_FILTER_HZ, dt) * (lacking - state.climb_error)
    excess = gains.climb_p * climb_error + wanted.rise_m_s2 - rise_m_s2
    rise_error = state.rise_error + smoothing(RISE_FILTER_HZ, dt) * (excess - state.rise_error)
    integral = clip(state.integral + 0.2 * gains.rise_i * rise_error * dt, 1.0)
    asked = clip(0.2 * gains.rise_p * rise_error + integral, 1.0)
    throttle = state.throttle + smoothing(THROTTLE_FILTER_HZ, dt) * (asked - state.throttle)
    return State(climb_error, rise_error, integral, throttle)


def approach(gain_per_s: float, error_m: float) -> float:
    """Speed (m/s) towards a target that is `error_m` away: proportional near it, farther off as if it braked.

    The firmware's square-root controller, with MAX_ACCELERATION_M_S2.
    """
    near_m = MAX_ACCELERATION_M_S2 / gain_per_s**2
    if abs(error_m) <= near_m:
        return gain_per_s * error_m
    return math.copysign(math.sqrt(2.0 * MAX_ACCELERATION_M_S2 * (abs(error_m) - 0.5 * near_m)), error_m)


def smoothing(cutoff_hz: float, dt: float) -> float:
    """Share of the way that the firmware's first-order low-pass goes in one step of `dt` (s)."""
    return dt / (dt + 1.0 / (2.0 * math.pi * cutoff_hz))


def clip(value: float, limit: float) -> float:
    """Return `value` within ±`limit`."""
    return max(-limit, min(limit, value))
