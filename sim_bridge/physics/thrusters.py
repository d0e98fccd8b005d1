"""From motor PWM to a wrench: thrust curve, dead band, voltage, start, lag, gain, health, inflow, geometry.

A motor that is driven above 1500 pushes the vehicle along its direction. Directions and positions are those
for which ArduSub's mixing factors mean what they say: a positive forward, lateral, throttle (up), roll, pitch
or yaw demand pushes to +X, +Y, -Z, +K, +M, +N. A test per axis ties it to `mixer`.

Thrusters 1 to 4 stand in the horizontal plane at 45°, front right, front left, rear right, rear left; 5 to 8
push down at the same corners. The frame `vectored` has 5 and 6 alone, right and left: 7 and 8 push nothing.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

from sim_bridge.physics.plant import Six
from sim_bridge.sim_config import ThrusterConfig

CURVE_US = (-400, -300, -200, -100, -60, -28, 28, 60, 100, 200, 300, 400)
"""Offset from 1500 µs; the middle pair is the edge of the dead band."""
CURVE_N = (-39.9, -26.6, -14.1, -4.7, -1.8, 0.0, 0.0, 2.2, 5.9, 17.9, 33.5, 51.5)
"""Static thrust of a T200 at 16 V."""
CURVE_VOLTAGE_V = 16.0
FULL_SPAN_US, FULL_N = CURVE_US[-1], CURVE_N[-1]
FULL_CURRENT_A = 24.0
NEUTRAL_US = 1500
DIAGONAL = math.sqrt(0.5)

Eight: TypeAlias = tuple[float, float, float, float, float, float, float, float]
"""One for each thruster."""
Curve: TypeAlias = tuple[float, float, float, float, float, float, float, float, float, float, float, float]

NO_THRUST: Eight = (0.0,) * 8
HEALTHY: Eight = (1.0,) * 8


class ThrusterBank(NamedTuple):
    """What the equations need to know of a set of thrusters."""

    number: int
    quadratic: bool
    dead_band_us: float
    curve_us: Curve
    """CURVE_US with this dead band."""
    lag_s: float
    start_s: float
    free_speed_m_s: float
    gain: Eight
    horizontal_m: tuple[float, float, float]
    vertical_m: tuple[float, float, float]
    axis_gain: Six


def thrusters_of(config: ThrusterConfig) -> ThrusterBank:
    """Make the parameters of configured thrusters."""
    count = 8 if config.frame == "vectored_6dof" else 6
    gain = config.gain * count if len(config.gain) == 1 else config.gain
    dead = config.dead_band_us
    return ThrusterBank(
        count,
        config.curve == "quadratic",
        dead,
        (-400.0, -300.0, -200.0, -100.0, -60.0, -dead, dead, 60.0, 100.0, 200.0, 300.0, 400.0),
        config.lag_s,
        config.start_s,
        config.free_speed_m_s,
        (*gain, *(0.0,) * (8 - count)),  # type: ignore[arg-type]  # eight by count
        config.horizontal_m,
        config.vertical_m,
        config.axis_gain,
    )


def each_motor(pwm: Sequence[int]) -> Eight:
    """Return PWM (µs) for eight motors: neutral where the frame has none."""
    a, b, c, d, e, f, g, h = (*pwm, 1500, 1500)[:8]
    return float(a), float(b), float(c), float(d), float(e), float(f), float(g), float(h)


def static_thrust(thrusters: ThrusterBank, health: Eight, pwm: Eight, voltage_v: float) -> Eight:
    """Steady thrust (N) at motor PWM (µs) and a voltage (V); `health` scales it: 0 is dead, -1 reversed."""
    return scaled(thrusters, health, _eight([curve(thrusters, us) for us in pwm]), voltage_v)


def scaled(thrusters: ThrusterBank, health: Eight, curve_n: Eight, voltage_v: float) -> Eight:
    """Steady thrust (N) of thrusters whose curve gives `curve_n` (N)."""
    scale = (voltage_v / CURVE_VOLTAGE_V) * (voltage_v / CURVE_VOLTAGE_V)
    return _eight([curve_n[i] * thrusters.gain[i] * health[i] * scale for i in range(len(curve_n))])


def curve(thrusters: ThrusterBank, pwm: float) -> float:
    """Steady thrust (N) of a healthy thruster of gain 1 at 16 V."""
    offset_us, us = pwm - NEUTRAL_US, thrusters.curve_us
    if abs(offset_us) <= thrusters.dead_band_us:
        return 0.0
    if thrusters.quadratic:
        u = offset_us / FULL_SPAN_US
        return FULL_N * u * abs(u)
    if not us[0] < offset_us < us[11]:
        return CURVE_N[0] if offset_us < 0.0 else CURVE_N[11]
    i = 0
    while offset_us > us[i + 1]:
        i += 1
    return CURVE_N[i] + (CURVE_N[i + 1] - CURVE_N[i]) / (us[i + 1] - us[i]) * (offset_us - us[i])


def lagged(thrust: Eight, static: Eight, follow: float) -> Eight:
    """One step of the first-order lag; `follow` is what `follow_of` gives for its length."""
    return _eight([thrust[i] + follow * (static[i] - thrust[i]) for i in range(len(thrust))])


class Starting(NamedTuple):
    """Which way each motor turns, -1, 0 or 1; for how long (s) another way was asked of it, with its sign."""

    turns: Eight
    asked_s: Eight


AT_REST = Starting(NO_THRUST, NO_THRUST)


def started(starting: Starting, static: Eight, start_s: float, dt: float) -> tuple[Starting, Eight]:
    """Return what gives thrust of what is asked: a motor turns another way only after `start_s`.

    A motor stops at once. One that is asked for less than `start_s` to turn another way stands still.
    """
    turns, asked_s, given = [], [], []
    for i in range(len(static)):
        way, waited_s, newtons = starting.turns[i], starting.asked_s[i], static[i]
        asked = math.copysign(1.0, newtons) if newtons != 0.0 else 0.0
        waits_s = (waited_s if waited_s * asked > 0.0 else 0.0) + asked * dt if asked != way else 0.0
        if asked == 0.0 or abs(waits_s) >= start_s - 1e-9:
            way, waits_s = asked, 0.0
        turns.append(way)
        asked_s.append(waits_s)
        given.append(newtons if asked == way else 0.0)
    return Starting(_eight(turns), _eight(asked_s)), _eight(given)


def _eight(values: Sequence[float]) -> Eight:
    return values[0], values[1], values[2], values[3], values[4], values[5], values[6], values[7]


def follow_of(lag_s: float, dt: float) -> float:
    """Return the part of the way to its static value that a thruster goes in `dt` (s)."""
    return 1.0 - math.exp(-dt / lag_s) if lag_s > 0.0 else 1.0


def wrench(thrusters: ThrusterBank, thrust: Eight) -> Six:
    """Sum up the body wrench (N, N·m)."""
    hx, hy, hz = thrusters.horizontal_m
    vx, vy, _ = thrusters.vertical_m
    g_x, g_y, g_z, g_k, g_m, g_n = thrusters.axis_gain
    a, b, c, d, e, f, g, h = thrust
    X = DIAGONAL * (-a - b + c + d)
    Y = DIAGONAL * (a - b + c - d)
    return (
        g_x * X,
        g_y * Y,
        g_z * (e + f + g + h),
        g_k * (vy * (e - f + g - h) - hz * Y),
        g_m * (vx * (g + h - e - f) + hz * X),
        g_n * (DIAGONAL * (hx + hy) * (a - b - c + d)),
    )


def inflow(thrusters: ThrusterBank, nu_r: Six) -> Eight:
    """Speed of the water into each thruster, along its direction (m/s): the transpose of `wrench` on nu_r.

    `nu_r` is the velocity relative to the water (m/s, rad/s, body).
    """
    hx, hy, hz = thrusters.horizontal_m
    vx, vy, _ = thrusters.vertical_m
    u, v, w, p, q, r = nu_r
    u, v, turn = DIAGONAL * (u + hz * q), DIAGONAL * (v - hz * p), DIAGONAL * (hx + hy) * r
    roll, pitch = vy * p, vx * q
    return (
        -u + v + turn,
        -u - v - turn,
        u + v - turn,
        u - v + turn,
        w + roll - pitch,
        w - roll - pitch,
        w + roll + pitch,
        w - roll + pitch,
    )


def in_water(thrust: Eight, inflow: Eight, free_speed_m_s: float, wet: float) -> Eight:
    """Return what is left of static thrust (N) in water that flows into the thrusters (m/s).

    T = a n|n| - b |n| u (Fossen 9.7) with a n|n| the static thrust, and T = 0 at full thrust and the free
    speed. `wet` 0..1 is the part of the thrusters that is under water.
    """
    b = math.sqrt(FULL_N) / free_speed_m_s if free_speed_m_s > 0.0 else 0.0
    return _eight([wet * (thrust[i] - b * math.sqrt(abs(thrust[i])) * inflow[i]) for i in range(len(thrust))])


def current_a(thrust: Eight) -> float:
    """Battery current (A): about |thrust|^1.5, 24 A each at full thrust."""
    total = 0.0
    for newtons in thrust:
        total += (abs(newtons) / FULL_N) ** 1.5
    return FULL_CURRENT_A * total
