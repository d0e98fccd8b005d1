"""Which thruster gives no thrust: of nine hypotheses the one that explains how the vehicle turns.

Hypothesis i says that motor i pushes nothing, hypothesis 0 that all push. About each axis of rotation

    y = c v − k s − z h       v = u − b_i f_i        (i = 0: v = u)

is fitted to the last seconds: c stands for an inertia, or thrusters, that all differ from the nominal
ones by one factor; k for what rights a tilted vehicle, or brakes a turn; z for a lever of the horizontal
motors that is not the one that levelling found, within the doubt of that, or z = 0: a vertical motor is
dead by both fits or not at all. A dead motor is the one whose
hypothesis leaves less than EXPLAINS of the squares that hypothesis 0 and the three other motors of its
group leave, and less than if it had kept half of its push: a motor that still pushes must not be taken
for dead, because the allocation around a dead motor lets that motor's own demand go anywhere.

The horizontal motors are seen in yaw and, by their lever, in roll: that tells apart two which turn the
vehicle in the same way. The vertical motors are seen in roll and pitch. While more is left in yaw than
there, no vertical motor is suspected: a horizontal motor that is stuck turns the vehicle, and tilts it
too. Heave, surge and sway are not used: there a payload, a current or waves look like a weak motor. While
a motor has nothing to do its failure is not found, and does no harm.

| symbol  | meaning                                                                          | unit       |
|---------|----------------------------------------------------------------------------------|------------|
| f_i     | push of motor i by the nominal curve after lag and delay, over SLOW_S            | N          |
| b_i     | moment for a newton of motor i                                                   | m          |
| u, v    | moment of all motors, and of those that push; vu: mean product                   | N·m        |
| y       | I ω', over SLOW_S                                                                | N·m        |
| ω, I    | rate p, q or r, nominal inertia                                                  | rad/s      |
| s       | roll, pitch; in yaw the rate                                                     | rad, rad/s |
| h       | force of the horizontal motors, over SLOW_S: sway for roll, surge for pitch      | N          |
| c, k, z | fitted, within bounds                                                            | 1, N·m, m  |

Products of pairs are averaged over MEMORY_S, from which the fit follows for any c, k and z. A motor that was
found dead is tested further, against hypothesis 0, and counts as sound again where that explains as much.
"""

import math
from typing import NamedTuple

from companion.core.allocation import (
    PUSH,
    Four,
    Group,
    Motors,
    Three,
    Thrusters,
    interpolated,
    motors,
    thrust_at,
)
from companion.core.bounds import clamped
from companion.records import Axes

SLOW_S = 1.0
SHORTEST_S = 0.02
MEMORY_S = 2.0
LEAST_GAIN, MOST_GAIN = 0.3, 3.0
MOST_RIGHTING = 8.0
"""N·m/rad; in yaw N·m/(rad/s)."""

EXPLAINS = 0.4
DOUBTED = 0.6
"""A dead motor's hypothesis that leaves more than this share of what hypothesis 0 leaves is given up."""

LEAST_NM = 0.07
"""RMS of what hypothesis 0 leaves, below which it is not doubted."""

WATER_M = 0.034
"""The moment by which the water may tilt a moving vehicle (Munk's), for a newton of the horizontal motors."""

OFF_CENTRE_M, EDDIES_NM = 0.025, 0.11
"""The water may turn a vehicle by so much for a newton of the horizontal motors, and by so much without."""

HOLDS_S = 0.8
EXCUSED_S = 20.0
"""After a motor was found sound again, none is suspected for this time."""

BIAS_S, EXCUSED_BIAS_S = 60.0, 5.0
"""How slowly a constant moment, such as that of a payload beside the centre, is taken for what it is."""
TINY = 1e-12

Five = tuple[float, float, float, float, float]


class Parameters(NamedTuple):
    """The vehicle as it is believed: thrusters, inertias (kg m²) and the thrusters' lag (s)."""

    thrusters: Thrusters
    roll_inertia: float
    pitch_inertia: float
    yaw_inertia: float
    lag_s: float


class Levers(NamedTuple):
    """How far below the centre of gravity the horizontal motors push, as roll and as pitch show it, m."""

    roll_m: float
    roll_doubt_m: float
    pitch_m: float
    pitch_doubt_m: float


Turning = tuple[float, float, float, float, float]
"""Roll, pitch, p, q and r: how the vehicle is turned, and turns."""


class Sums(NamedTuple):
    """Means of the products about one axis; by hypothesis 0 and the four motors of a group."""

    vv: Five
    vu: Five
    vy: Five
    vs: Five
    vh: Five
    yy: float
    ys: float
    ss: float
    yh: float
    sh: float
    hh: float
    oo: float
    """Of the moment that the water may make while the horizontal motors push."""


class Suspect(NamedTuple):
    """The motor whose hypothesis has been the best, 1 to 8, or 0; and for how long."""

    motor: int
    lasts_s: float


class State(NamedTuple):
    """What is known."""

    lagged: Motors
    """Pushes as they act, N."""
    pushes: Motors
    """The same over SLOW_S."""
    slow: Turning
    """Over SLOW_S."""
    bias: Three
    """Constant part of u in roll, pitch and yaw, N·m."""
    roll: Sums
    pitch: Sums
    yaw: Sums
    tipped: Sums
    """Of roll, by the horizontal motors."""
    suspect: Suspect
    dead: int
    """The motor that gives no thrust, 1 to 8; 0 while all do."""
    excused_s: float


NONE = (0.0, 0.0, 0.0, 0.0, 0.0)
NO_SUMS = Sums(NONE, NONE, NONE, NONE, NONE, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
NOBODY = Suspect(0, 0.0)
IDLE: Motors = (0.0,) * 8
STILL: Turning = (0.0,) * 5
NO_BIAS: Three = (0.0, 0.0, 0.0)
START = State(IDLE, IDLE, STILL, NO_BIAS, NO_SUMS, NO_SUMS, NO_SUMS, NO_SUMS, NOBODY, 0, 0.0)
"""All motors push, as far as is known."""


def rest(state: State) -> State:
    """Return what stays known where nobody steers: the motor that gave no thrust."""
    return State(
        IDLE,
        IDLE,
        STILL,
        NO_BIAS,
        NO_SUMS,
        NO_SUMS,
        NO_SUMS,
        NO_SUMS,
        NOBODY,
        state.dead,
        state.excused_s,
    )


def step(
    parameters: Parameters,
    state: State,
    axes: Axes,
    voltage_v: float,
    turning: Turning,
    levers: Levers,
    delay_s: float,
    dt_s: float,
) -> State:
    """Take the axes that went out, and how the vehicle turned before; `delay_s` from sensor to motor."""
    across, upright = parameters.thrusters.horizontal, parameters.thrusters.vertical
    new = 1.0 - math.exp(-dt_s / SLOW_S)
    late = 1.0 - math.exp(-dt_s / max(parameters.lag_s + delay_s, SHORTEST_S))
    lagged = _pushes(state.lagged, motors(parameters.thrusters, axes), thrust_at(voltage_v), late)
    f = _smoothed(state.pushes, lagged, new)
    roll, pitch, p, q, r = turning
    slow_roll, slow_pitch, slow_p, slow_q, slow_r = state.slow
    slow_roll = slow_roll + (roll - slow_roll) * new
    slow_pitch = slow_pitch + (pitch - slow_pitch) * new
    slow_p = slow_p + (p - slow_p) * new
    slow_q = slow_q + (q - slow_q) * new
    slow_r = slow_r + (r - slow_r) * new
    y_roll = parameters.roll_inertia * (p - slow_p) / SLOW_S
    y_pitch = parameters.pitch_inertia * (q - slow_q) / SLOW_S
    y_yaw = parameters.yaw_inertia * (r - slow_r) / SLOW_S

    horizontal, vertical = (f[0], f[1], f[2], f[3]), (f[4], f[5], f[6], f[7])
    X = _moments(across, 0, horizontal, across.levers[0], 0.0)
    Y = _moments(across, 1, horizontal, across.levers[1], 0.0)
    lever_m = levers.roll_m
    by_sway, by_surge = -lever_m * Y[0], levers.pitch_m * X[0]
    K = _moments(upright, 1, vertical, upright.levers[1], by_sway - state.bias[0])
    M = _moments(upright, 2, vertical, upright.levers[2], by_surge - state.bias[1])
    N = _moments(across, 2, horizontal, across.levers[2], -state.bias[2])
    tip = (
        K[0],
        K[0] - lever_m * (Y[1] - Y[0]),
        K[0] - lever_m * (Y[2] - Y[0]),
        K[0] - lever_m * (Y[3] - Y[0]),
        K[0] - lever_m * (Y[4] - Y[0]),
    )

    slowly = dt_s / (EXCUSED_BIAS_S if state.excused_s > 0.0 else BIAS_S) if state.dead == 0 else 0.0
    bias = (
        state.bias[0] + slowly * K[0],
        state.bias[1] + slowly * M[0],
        state.bias[2] + slowly * N[0],
    )
    keep = math.exp(-dt_s / MEMORY_S)
    by_roll = _summed(state.roll, K, y_roll, slow_roll, Y[0], WATER_M * Y[0], keep)
    by_pitch = _summed(state.pitch, M, y_pitch, slow_pitch, X[0], WATER_M * X[0], keep)
    off_centre = OFF_CENTRE_M * OFF_CENTRE_M * (X[0] * X[0] + Y[0] * Y[0])
    aside = math.sqrt(off_centre + EDDIES_NM * EDDIES_NM)
    by_yaw = _summed(state.yaw, N, y_yaw, slow_r, 0.0, aside, keep)
    tipped = _summed(state.tipped, tip, y_roll, slow_roll, 0.0, 0.0, keep)
    pitches = 1.0 if upright.shares[2] > 0.0 else 0.0

    dead, excused_s = state.dead, max(state.excused_s - dt_s, 0.0)
    if excused_s > 0.0:
        suspected = 0
    elif dead == 0:
        suspected = _suspected(by_yaw, tipped, 1.0)
        if suspected == 0 and not _doubted(by_yaw) and not _turned_more(by_yaw, by_roll, by_pitch, pitches):
            found = _suspected(by_roll, by_pitch, pitches)
            if found > 0 and found == _suspected(
                by_roll, by_pitch, pitches, levers.roll_doubt_m, levers.pitch_doubt_m
            ):
                suspected = found + 4
    elif dead > 4:
        suspected = dead if _given_up(by_roll, by_pitch, pitches, dead - 4) else 0
    else:
        suspected = dead if _given_up(by_yaw, tipped, 1.0, dead) else 0
    same = suspected > 0 and suspected == state.suspect.motor
    suspect = Suspect(suspected, state.suspect.lasts_s + dt_s if same else 0.0)
    if suspect.lasts_s >= HOLDS_S:
        excused_s = EXCUSED_S if dead > 0 else 0.0
        dead, suspect = 0 if dead > 0 else suspected, NOBODY
    return State(
        lagged,
        f,
        (slow_roll, slow_pitch, slow_p, slow_q, slow_r),
        bias,
        by_roll,
        by_pitch,
        by_yaw,
        tipped,
        suspect,
        dead,
        excused_s,
    )


def _pushes(before: Motors, demands: Motors, strength: float, new: float) -> Motors:
    """Return the push of each motor as it acts, N."""
    return (
        before[0] + (interpolated(demands[0], PUSH) * strength - before[0]) * new,
        before[1] + (interpolated(demands[1], PUSH) * strength - before[1]) * new,
        before[2] + (interpolated(demands[2], PUSH) * strength - before[2]) * new,
        before[3] + (interpolated(demands[3], PUSH) * strength - before[3]) * new,
        before[4] + (interpolated(demands[4], PUSH) * strength - before[4]) * new,
        before[5] + (interpolated(demands[5], PUSH) * strength - before[5]) * new,
        before[6] + (interpolated(demands[6], PUSH) * strength - before[6]) * new,
        before[7] + (interpolated(demands[7], PUSH) * strength - before[7]) * new,
    )


def _smoothed(before: Motors, now: Motors, new: float) -> Motors:
    return (
        before[0] + (now[0] - before[0]) * new,
        before[1] + (now[1] - before[1]) * new,
        before[2] + (now[2] - before[2]) * new,
        before[3] + (now[3] - before[3]) * new,
        before[4] + (now[4] - before[4]) * new,
        before[5] + (now[5] - before[5]) * new,
        before[6] + (now[6] - before[6]) * new,
        before[7] + (now[7] - before[7]) * new,
    )


def _moments(group: Group, axis: int, f: Four, lever_m: float, others: float) -> Five:
    """Return v by hypothesis: of all motors of a group and `others`, and without each."""
    one, two = group.factors[0][axis] * lever_m * f[0], group.factors[1][axis] * lever_m * f[1]
    three, four = group.factors[2][axis] * lever_m * f[2], group.factors[3][axis] * lever_m * f[3]
    u = one + two + three + four + others
    return (u, u - one, u - two, u - three, u - four)


def _summed(before: Sums, v: Five, y: float, s: float, h: float, o: float, keep: float) -> Sums:
    """Return the means of the products after one more of each."""
    a, b, c, d, e = v
    new = 1.0 - keep
    return Sums(
        (
            keep * before.vv[0] + new * a * a,
            keep * before.vv[1] + new * b * b,
            keep * before.vv[2] + new * c * c,
            keep * before.vv[3] + new * d * d,
            keep * before.vv[4] + new * e * e,
        ),
        (
            keep * before.vu[0] + new * a * a,
            keep * before.vu[1] + new * b * a,
            keep * before.vu[2] + new * c * a,
            keep * before.vu[3] + new * d * a,
            keep * before.vu[4] + new * e * a,
        ),
        (
            keep * before.vy[0] + new * a * y,
            keep * before.vy[1] + new * b * y,
            keep * before.vy[2] + new * c * y,
            keep * before.vy[3] + new * d * y,
            keep * before.vy[4] + new * e * y,
        ),
        (
            keep * before.vs[0] + new * a * s,
            keep * before.vs[1] + new * b * s,
            keep * before.vs[2] + new * c * s,
            keep * before.vs[3] + new * d * s,
            keep * before.vs[4] + new * e * s,
        ),
        (
            keep * before.vh[0] + new * a * h,
            keep * before.vh[1] + new * b * h,
            keep * before.vh[2] + new * c * h,
            keep * before.vh[3] + new * d * h,
            keep * before.vh[4] + new * e * h,
        ),
        keep * before.yy + new * y * y,
        keep * before.ys + new * y * s,
        keep * before.ss + new * s * s,
        keep * before.yh + new * y * h,
        keep * before.sh + new * s * h,
        keep * before.hh + new * h * h,
        keep * before.oo + new * o * o,
    )


def left(sums: Sums, hypothesis: int, most_z: float = 0.0) -> float:
    """Return the mean square of y − c v + k s + z h for the c, k and z that make it least, within bounds."""
    i = hypothesis
    return _left(sums, sums.vv[i], sums.vy[i], sums.vs[i], sums.vh[i], most_z)


def _left_weak(sums: Sums, motor: int, most_z: float) -> float:
    """Return what `left` does, for a motor that keeps half of its push: v = u − b f/2."""
    vv = 0.25 * (sums.vv[0] + 2.0 * sums.vu[motor] + sums.vv[motor])
    vy, vs = 0.5 * (sums.vy[0] + sums.vy[motor]), 0.5 * (sums.vs[0] + sums.vs[motor])
    return _left(sums, vv, vy, vs, 0.5 * (sums.vh[0] + sums.vh[motor]), most_z)


def _left(sums: Sums, vv: float, vy: float, vs: float, vh: float, most_z: float) -> float:
    """Fit c and k to what h does not explain, which gives z; within its bound, fit them again."""
    if most_z == 0.0:
        return _fitted(vv, vy, vs, sums.yy, sums.ys, sums.ss)[2]
    yh, sh, hh = sums.yh, sums.sh, max(sums.hh, TINY)
    c, k, _ = _fitted(
        vv - vh * vh / hh,
        vy - vh * yh / hh,
        vs - vh * sh / hh,
        sums.yy - yh * yh / hh,
        sums.ys - yh * sh / hh,
        sums.ss - sh * sh / hh,
    )
    z = clamped((c * vh - k * sh - yh) / hh, -most_z, most_z)
    yy, vy, ys = sums.yy + 2.0 * z * yh + z * z * hh, vy + z * vh, sums.ys + z * sh
    return _fitted(vv, vy, vs, yy, ys, sums.ss)[2]


def _fitted(vv: float, vy: float, vs: float, yy: float, ys: float, ss: float) -> tuple[float, float, float]:
    """Return c and k within their bounds, and the mean square of y − c v + k s that they leave."""
    vv, ss = max(vv, TINY), max(ss, TINY)
    apart = max(vv * ss - vs * vs, TINY * vv)
    c = clamped((vy * ss - vs * ys) / apart, LEAST_GAIN, MOST_GAIN)
    k = clamped((c * vs - ys) / ss, 0.0, MOST_RIGHTING)
    c = clamped((vy + k * vs) / vv, LEAST_GAIN, MOST_GAIN)
    return c, k, yy - 2.0 * c * vy + c * c * vv + 2.0 * k * ys - 2.0 * c * k * vs + k * k * ss


def _least(first: Sums, second: Sums) -> float:
    """Return the mean square that says nothing, (N·m)²."""
    return LEAST_NM * LEAST_NM + first.oo + second.oo


def _suspected(
    first: Sums, second: Sums, weight: float, most_z: float = 0.0, second_most_z: float = 0.0
) -> int:
    """Return which motor of a group gives no thrust, 1 to 4; 0 for none. The second axis has a `weight`."""
    whole = left(first, 0, most_z) + weight * left(second, 0, second_most_z)
    if not whole > _least(first, second):
        return 0
    found, least, others = 0, whole, whole
    for motor in range(1, 5):
        one = left(first, motor, most_z) + weight * left(second, motor, second_most_z)
        if one < least:
            found, least, others = motor, one, least
        elif one < others:
            others = one
    if found == 0 or not least < EXPLAINS * others:
        return 0
    weak = _left_weak(first, found, most_z) + weight * _left_weak(second, found, second_most_z)
    return found if least < weak else 0


def _doubted(sums: Sums) -> bool:
    """Tell whether the loss of any motor explains a turn better than no loss."""
    whole = left(sums, 0)
    least = min(left(sums, 1), left(sums, 2), left(sums, 3), left(sums, 4))
    return whole > LEAST_NM * LEAST_NM + sums.oo and least < EXPLAINS * whole


def _turned_more(yaw: Sums, first: Sums, second: Sums, weight: float) -> bool:
    """Tell whether more is left of a turn than of roll and pitch.

    A horizontal motor that pushes by itself turns the vehicle, and tilts it, which looks like the loss of a
    vertical motor.
    """
    aside = left(yaw, 0)
    return aside > LEAST_NM * LEAST_NM and aside > left(first, 0) + weight * left(second, 0)


def _given_up(first: Sums, second: Sums, weight: float, motor: int) -> bool:
    """Tell whether it is no longer clear that a motor that was found dead pushes nothing."""
    whole = left(first, 0) + weight * left(second, 0)
    without = left(first, motor) + weight * left(second, motor)
    return without > _least(first, second) and without > DOUBTED * whole
