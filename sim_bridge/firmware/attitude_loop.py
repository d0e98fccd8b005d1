"""ArduSub's attitude loop of one axis: shaped angle target, angle to rate (P), rate to demand (PID).

Leans are small here, so roll, pitch and yaw are three axes. In MANUAL the loop does not run and its targets
stay: whoever turns in MANUAL and then enters another mode is first turned back, by 45° at most.

| name         | meaning                                             | parameter              |
|--------------|-----------------------------------------------------|------------------------|
| angle_p      | rate wanted by angle error, 1/s                     | ATC_ANG_xxx_P          |
| rate_p, i, d | demand by rate error                                | ATC_RAT_xxx_P, _I, _D  |
| filter_hz    | low-pass of the rate target and of its D term       | ATC_RAT_xxx_FLTT, FLTD |
| input_tc_s   | how fast the target follows an angle that is wanted | ATC_INPUT_TC           |
"""

import math
from typing import NamedTuple

from sim_bridge.firmware.params import Parameters
from sim_bridge.firmware.shaping import braking, clip, smoothing

SHAPING_RAD_S2 = math.radians(1100.0)
"""ATC_ACCEL_R_MAX, _P_MAX, _Y_MAX."""
LEAN_CORRECTION_RAD_S2, YAW_CORRECTION_RAD_S2 = 0.5 * SHAPING_RAD_S2, math.radians(120.0)
"""How hard an angle error is braked: half of the shaping, within limits of the firmware."""
MAX_YAW_ERROR_RAD = math.radians(45.0)


class AttitudeGains(NamedTuple):
    """Parameters of one axis, as in the table above."""

    angle_p: float
    rate_p: float
    rate_i: float
    rate_d: float
    integral_limit: float
    target_filter_hz: float
    derivative_filter_hz: float
    input_tc_s: float
    correction_rad_s2: float
    max_error_rad: float


class AxisLoop(NamedTuple):
    """What the loop remembers: target (rad, rad/s), rate target behind its filter, error, D term, I term."""

    angle: float
    rate: float
    filtered_rate: float
    error: float
    derivative: float
    integral: float
    demand: float


def gains(params: Parameters, name: str) -> AttitudeGains:
    """Return the gains of RLL, PIT or YAW."""
    yaw = name == "YAW"
    return AttitudeGains(
        params[f"ATC_ANG_{name}_P"],
        params[f"ATC_RAT_{name}_P"],
        params[f"ATC_RAT_{name}_I"],
        params[f"ATC_RAT_{name}_D"],
        params[f"ATC_RAT_{name}_IMAX"],
        params[f"ATC_RAT_{name}_FLTT"],
        params[f"ATC_RAT_{name}_FLTD"],
        max(0.01, params["ATC_INPUT_TC"]),
        YAW_CORRECTION_RAD_S2 if yaw else LEAN_CORRECTION_RAD_S2,
        MAX_YAW_ERROR_RAD if yaw else math.pi,
    )


def relaxed(angle: float, rate: float) -> AxisLoop:
    """Return an axis whose target is where the vehicle is, as while disarmed."""
    return AxisLoop(angle, rate, rate, 0.0, 0.0, 0.0, 0.0)


def toward_angle(gains: AttitudeGains, axis: AxisLoop, wanted: float, fastest: float, dt: float) -> AxisLoop:
    """Move the target towards an angle, at `fastest` rad/s at most."""
    angle = axis.angle + axis.rate * dt
    rate = braking(wrap(wanted - angle), 1.0 / gains.input_tc_s, SHAPING_RAD_S2, dt)
    return _aimed(axis, angle, clip(_limited(axis.rate, rate, dt), fastest))


def toward_rate(axis: AxisLoop, wanted: float, dt: float) -> AxisLoop:
    """Move the target at a rate."""
    return _aimed(axis, axis.angle + axis.rate * dt, _limited(axis.rate, wanted, dt))


def follow(gains: AttitudeGains, axis: AxisLoop, angle: float, rate: float, dt: float) -> AxisLoop:
    """Advance the loop: `demand` of the result is what the motors are asked, -1..1."""
    away = clip(wrap(axis.angle - angle), gains.max_error_rad)
    target = wrap(angle + away)
    return _rate_loop(
        gains,
        _aimed(axis, target, axis.rate),
        braking(away, gains.angle_p, gains.correction_rad_s2, dt) + axis.rate,
        rate,
        dt,
    )


def wrap(angle: float) -> float:
    """Return the angle within ±π."""
    return math.remainder(angle, math.tau)


def _aimed(axis: AxisLoop, angle: float, rate: float) -> AxisLoop:
    """Return the axis with another target: `_replace`, in a third of its time."""
    _, _, filtered, error, derivative, integral, demand = axis
    return AxisLoop(angle, rate, filtered, error, derivative, integral, demand)


def _limited(now: float, wanted: float, dt: float) -> float:
    return now + clip(wanted - now, SHAPING_RAD_S2 * dt)


def _rate_loop(gains: AttitudeGains, axis: AxisLoop, wanted: float, rate: float, dt: float) -> AxisLoop:
    filtered = axis.filtered_rate + smoothing(gains.target_filter_hz, dt) * (wanted - axis.filtered_rate)
    error = filtered - rate
    slope = (error - axis.error) / dt
    derivative = axis.derivative + smoothing(gains.derivative_filter_hz, dt) * (slope - axis.derivative)
    integral = clip(axis.integral + gains.rate_i * error * dt, gains.integral_limit)
    demand = clip(gains.rate_p * error + integral + gains.rate_d * derivative, 1.0)
    return AxisLoop(axis.angle, axis.rate, filtered, error, derivative, integral, demand)
