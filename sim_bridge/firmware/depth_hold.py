"""ArduSub's depth loop: depth to climb rate to acceleration to throttle, P-P-PI with three low-passes."""

from typing import NamedTuple

from sim_bridge.firmware.shaping import braking, clip, smoothing

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
    """Gains of depth and climb rate (1/s), and of acceleration as the parameters state them."""

    depth_p: float
    climb_p: float
    rise_p: float
    rise_i: float


class DepthLoop(NamedTuple):
    """What the loop remembers: errors behind their filters (m/s, m/s²), integral and throttle (-1..1)."""

    climb_error: float
    rise_error: float
    integral: float
    throttle: float


AT_REST = DepthLoop(0.0, 0.0, 0.0, 0.0)


class ClimbTarget(NamedTuple):
    """The motion of the target, positive up: m/s, m/s²."""

    climb_m_s: float
    rise_m_s2: float


STILL = ClimbTarget(0.0, 0.0)


def toward_climb(wanted: ClimbTarget, climb_m_s: float, dt: float) -> ClimbTarget:
    """Return the target's motion `dt` (s) later, on its way to a climb rate; its jerk is bounded."""
    climb = wanted.climb_m_s + wanted.rise_m_s2 * dt
    hasten = clip(MAX_JERK_M_S3 / MAX_ACCELERATION_M_S2 * (climb_m_s - climb), MAX_ACCELERATION_M_S2)
    return ClimbTarget(climb, wanted.rise_m_s2 + clip(hasten - wanted.rise_m_s2, MAX_JERK_M_S3 * dt))


def step(
    gains: DepthGains,
    state: DepthLoop,
    too_deep_m: float,
    wanted: ClimbTarget,
    fastest_m_s: float,
    climb_m_s: float,
    rise_m_s2: float,
    dt: float,
) -> DepthLoop:
    """Advance by `dt` (s); `too_deep_m` is how far the target lies above, rates are positive up.

    `fastest_m_s` bounds the correction of depth.
    """
    to_target = clip(braking(too_deep_m, gains.depth_p, MAX_ACCELERATION_M_S2, dt), fastest_m_s)
    lacking = wanted.climb_m_s + to_target - climb_m_s
    climb_error = state.climb_error + smoothing(CLIMB_FILTER_HZ, dt) * (lacking - state.climb_error)
    excess = gains.climb_p * climb_error + wanted.rise_m_s2 - rise_m_s2
    rise_error = state.rise_error + smoothing(RISE_FILTER_HZ, dt) * (excess - state.rise_error)
    integral = clip(state.integral + 0.2 * gains.rise_i * rise_error * dt, 1.0)
    asked = clip(0.2 * gains.rise_p * rise_error + integral, 1.0)
    throttle = state.throttle + smoothing(THROTTLE_FILTER_HZ, dt) * (asked - state.throttle)
    return DepthLoop(climb_error, rise_error, integral, throttle)
