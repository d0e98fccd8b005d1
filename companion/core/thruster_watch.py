"""Which thruster gives no thrust, or pushes the other way: what explains best how the vehicle turns.

Hypothesis i, σ says that motor i gives a share σ of its push, hypothesis 0 that all push. About each axis of
rotation

    y = c v − k s − z h       v = u − (1 − σ) b_i f_i        (i = 0: v = u)

is fitted to the last seconds. c: a factor of the inertia or of all thrusters. k: righting moment, or damping.
z: error of the horizontal motors' lever, bounded by its standard deviation. The fit is done with z free and
with z = 0; a vertical motor is accused only if both say so. The accused motor is the one whose hypothesis
leaves less than EXPLAINS of the squares that hypothesis 0 and the other motors of its group leave. It is
reversed if σ = −1 or σ = −½ leaves clearly less than σ = 0. Else it is dead if σ = ½ leaves more: a motor
that still pushes must not count as dead, because the allocation around a dead motor does not bound that
motor's own demand. A motor with half of its push (σ = ½) is left as it is.

A reversed vertical motor turns the vehicle over within a second. So what is clear is believed sooner: the
time that a suspicion has to last is divided by how much clearer it is than EXPLAINS asks.

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
| σ       | share of its push that a motor gives: 0 dead, -1 reversed                        | 1          |
| ω, I    | rate p, q or r, nominal inertia                                                  | rad/s      |
| s       | roll, pitch; in yaw the rate                                                     | rad, rad/s |
| h       | force of the horizontal motors, over SLOW_S: sway for roll, surge for pitch      | N          |
| c, k, z | fitted, within bounds                                                            | 1, N·m, m  |

Products of pairs are averaged over MEMORY_S, from which the fit follows for any σ, c, k and z. A motor that
was accused is tested further, against hypothesis 0 and the other fault, and counts as sound again where
hypothesis 0 explains as much.
"""

import math
from typing import NamedTuple

from companion.core.allocation import (
    HORIZONTAL,
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
from companion.core.four import each, each_of_two
from companion.records import Axes

SLOW_S = 1.0
SHORTEST_S = 0.02
MEMORY_S, QUICK_S = 2.0, 0.5
"""How long products are remembered; and while a motor is suspected to push the
other way: before that it may have been sound."""
LEAST_GAIN, MOST_GAIN = 0.3, 3.0
MOST_RIGHTING = 8.0
"""N·m/rad; in yaw N·m/(rad/s)."""

EXPLAINS = 0.4
DOUBTED = 0.6
"""A dead motor's hypothesis that leaves more than this share of what hypothesis 0 leaves is given up."""

CLEARLY = 0.05
"""Two shares of a motor differ if their residuals do by this part of that of hypothesis 0."""

UNCLEAR = 0.3
"""The part for a dead motor that may be a reversed one."""

MOST_CLEAR, HORIZONTAL_CLEAR = 10.0, 2.0
"""Largest divisor of HOLDS_S for a reversed motor: a vertical one, and a horizontal one, which can wait."""

LEAST_NM = 0.07
"""RMS of what hypothesis 0 leaves, below which it is not doubted."""

WATER_M = 0.034
"""The moment by which the water may tilt a moving vehicle (Munk's), for a newton of the horizontal motors."""

OFF_CENTRE_M, EDDIES_NM = 0.025, 0.11
"""Moment by which the water may turn a vehicle: for a newton of the horizontal motors, and without."""

MOTORS = (1, 2, 3, 4)
"""The motors of a group."""

HOLDS_S = 0.8
EXCUSED_S, RIGHTED_S = 20.0, 3.0
"""After a motor was found sound again, none is suspected for this time. After one was found reversed nothing
is judged until the vehicle is upright: the fit is for small tilts."""

BIAS_S, EXCUSED_BIAS_S = 60.0, 5.0
"""How slowly the fit learns a constant moment, such as that of a payload beside the centre."""
TINY = 1e-12

Five = tuple[float, float, float, float, float]
"""Values of hypothesis 0 and of the four motors of a group."""


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
    """Means of the products about one axis."""

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
    """Mean square of the moment that the water may make while the horizontal motors push."""


class TwoAxes(NamedTuple):
    """The two axes in which a group of motors is seen; the second has a weight."""

    first: Sums
    second: Sums
    weight: float


class Fault(NamedTuple):
    """A motor, 1 to 8, that gives `share` of its push: 0, or -1; or motor 0, or a motor that gives all."""

    motor: int
    share: float


class Suspect(NamedTuple):
    """The fault whose hypothesis has been the best, and for how long."""

    fault: Fault
    lasts_s: float
    clear: float
    """Factor by which its time counts."""


class WatchState(NamedTuple):
    """What is known."""

    lagged: Motors
    """Pushes as they act, N."""
    pushes: Motors
    """The same over SLOW_S."""
    slow: Turning
    """Over SLOW_S."""
    bias: Three
    """Constant part of u in roll, pitch and yaw, N·m."""
    across: TwoAxes
    """Yaw and roll, by the horizontal motors."""
    upright: TwoAxes
    """Roll and pitch, by the vertical motors."""
    suspect: Suspect
    dead: int
    """The motor that gives no thrust, 1 to 8; 0 while all do."""
    reversed: int
    """The motor that pushes the other way, 1 to 8; 0 while none does."""
    excused_s: float


NONE = (0.0, 0.0, 0.0, 0.0, 0.0)
NO_SUMS = Sums(NONE, NONE, NONE, NONE, NONE, yy=0.0, ys=0.0, ss=0.0, yh=0.0, sh=0.0, hh=0.0, oo=0.0)
NOTHING = TwoAxes(NO_SUMS, NO_SUMS, 1.0)
NO_FAULT = Fault(0, 1.0)
NOBODY = Suspect(NO_FAULT, 0.0, 1.0)
START = WatchState(
    lagged=(0.0,) * 8,
    pushes=(0.0,) * 8,
    slow=(0.0,) * 5,
    bias=(0.0,) * 3,
    across=NOTHING,
    upright=NOTHING,
    suspect=NOBODY,
    dead=0,
    reversed=0,
    excused_s=0.0,
)
"""All motors push, as far as is known."""


def rest(state: WatchState) -> WatchState:
    """Return what stays known where nobody steers: the motor that was accused."""
    return START._replace(dead=state.dead, reversed=state.reversed, excused_s=state.excused_s)


def watch(
    parameters: Parameters,
    state: WatchState,
    axes: Axes,
    voltage_v: float,
    turning: Turning,
    levers: Levers,
    delay_s: float,
    dt_s: float,
) -> WatchState:
    """Take the axes that went out, and how the vehicle turned before; `delay_s` from sensor to motor."""
    new = 1.0 - math.exp(-dt_s / SLOW_S)
    late = 1.0 - math.exp(-dt_s / max(parameters.lag_s + delay_s, SHORTEST_S))
    t, strength, slow = motors(parameters.thrusters, axes), thrust_at(voltage_v), state.slow
    across = each_of_two(_acting, state.lagged[:4], t[:4], strength, late)
    upright = each_of_two(_acting, state.lagged[4:], t[4:], strength, late)
    horizontal = each_of_two(_eased, state.pushes[:4], across, new)
    vertical = each_of_two(_eased, state.pushes[4:], upright, new)
    slow = (
        _eased(slow[0], turning[0], new),
        _eased(slow[1], turning[1], new),
        _eased(slow[2], turning[2], new),
        _eased(slow[3], turning[3], new),
        _eased(slow[4], turning[4], new),
    )
    bias, seen_across, seen_upright = summed(
        parameters, state, horizontal, vertical, slow, turning, levers, dt_s
    )
    suspect, fault, excused_s = judged(state, seen_across, seen_upright, levers, dt_s)
    if fault != believed(state) or (fault.share < 0.0 and excused_s > 0.0):
        seen_across, seen_upright = NOTHING, NOTHING
    return WatchState(
        lagged=across + upright,
        pushes=horizontal + vertical,
        slow=slow,
        bias=bias,
        across=seen_across,
        upright=seen_upright,
        suspect=suspect,
        dead=fault.motor if fault.share == 0.0 else 0,
        reversed=fault.motor if fault.share < 0.0 else 0,
        excused_s=excused_s,
    )


def believed(state: WatchState) -> Fault:
    """Return the fault that is believed."""
    if state.reversed > 0:
        return Fault(state.reversed, -1.0)
    return Fault(state.dead, 0.0) if state.dead > 0 else NO_FAULT


def _eased(before: float, now: float, new: float) -> float:
    return before + (now - before) * new


def _acting(before: float, demand: float, strength: float, new: float) -> float:
    """Return a motor's push as it acts, N."""
    return before + (interpolated(demand, PUSH) * strength - before) * new


def summed(
    parameters: Parameters,
    state: WatchState,
    horizontal: Four,
    vertical: Four,
    slow: Turning,
    turning: Turning,
    levers: Levers,
    dt_s: float,
) -> tuple[Three, TwoAxes, TwoAxes]:
    """Return the bias and the means after the pushes of this tick, and how the vehicle turned."""
    across, upright = parameters.thrusters.horizontal, parameters.thrusters.vertical
    slow_roll, slow_pitch, slow_p, slow_q, slow_r = slow
    bias = state.bias
    y_roll = parameters.roll_inertia * (turning[2] - slow_p) / SLOW_S
    y_pitch = parameters.pitch_inertia * (turning[3] - slow_q) / SLOW_S
    y_yaw = parameters.yaw_inertia * (turning[4] - slow_r) / SLOW_S
    X = _moments(across, 0, horizontal, across.levers[0], 0.0)
    Y = _moments(across, 1, horizontal, across.levers[1], 0.0)
    by_sway, by_surge = -levers.roll_m * Y[0], levers.pitch_m * X[0]
    K = _moments(upright, 1, vertical, upright.levers[1], by_sway - bias[0])
    M = _moments(upright, 2, vertical, upright.levers[2], by_surge - bias[1])
    N = _moments(across, 2, horizontal, across.levers[2], -bias[2])
    tip = (K[0], *each(_tipped, Y[1:], Y[0], K[0], levers.roll_m))

    keep = math.exp(-dt_s / (MEMORY_S if state.suspect.clear == 1.0 else QUICK_S))
    off_centre = OFF_CENTRE_M * OFF_CENTRE_M * (X[0] * X[0] + Y[0] * Y[0])
    aside = math.sqrt(off_centre + EDDIES_NM * EDDIES_NM)
    yaw = _mean(state.across.first, N, y_yaw, slow_r, 0.0, aside, keep)
    tipped = _mean(state.across.second, tip, y_roll, slow_roll, 0.0, 0.0, keep)
    roll = _mean(state.upright.first, K, y_roll, slow_roll, Y[0], WATER_M * Y[0], keep)
    pitch = _mean(state.upright.second, M, y_pitch, slow_pitch, X[0], WATER_M * X[0], keep)
    sound = state.dead + state.reversed == 0
    slowly = dt_s / (EXCUSED_BIAS_S if state.excused_s > 0.0 else BIAS_S) if sound else 0.0
    bias = (bias[0] + slowly * K[0], bias[1] + slowly * M[0], bias[2] + slowly * N[0])
    pitches = 1.0 if upright.shares[2] > 0.0 else 0.0
    return bias, TwoAxes(yaw, tipped, 1.0), TwoAxes(roll, pitch, pitches)


def _tipped(y: float, y_all: float, K: float, lever_m: float) -> float:
    """Return the moment in roll without a horizontal motor."""
    return K - lever_m * (y - y_all)


def _moments(group: Group, axis: int, f: Four, lever_m: float, others: float) -> Five:
    """Return v by hypothesis: of all motors of a group and `others`, and without each."""
    one, two = group.factors[0][axis] * lever_m * f[0], group.factors[1][axis] * lever_m * f[1]
    three, four = group.factors[2][axis] * lever_m * f[2], group.factors[3][axis] * lever_m * f[3]
    u = one + two + three + four + others
    return (u, u - one, u - two, u - three, u - four)


def _mean(before: Sums, v: Five, y: float, s: float, h: float, o: float, keep: float) -> Sums:
    """Return the means of the products after one more of each."""
    new, vv = 1.0 - keep, before.vv
    return Sums(
        vv=(
            keep * vv[0] + new * v[0] * v[0],
            keep * vv[1] + new * v[1] * v[1],
            keep * vv[2] + new * v[2] * v[2],
            keep * vv[3] + new * v[3] * v[3],
            keep * vv[4] + new * v[4] * v[4],
        ),
        vu=_products(before.vu, v, v[0], keep),
        vy=_products(before.vy, v, y, keep),
        vs=_products(before.vs, v, s, keep),
        vh=_products(before.vh, v, h, keep),
        yy=keep * before.yy + new * y * y,
        ys=keep * before.ys + new * y * s,
        ss=keep * before.ss + new * s * s,
        yh=keep * before.yh + new * y * h,
        sh=keep * before.sh + new * s * h,
        hh=keep * before.hh + new * h * h,
        oo=keep * before.oo + new * o * o,
    )


def _products(before: Five, v: Five, other: float, keep: float) -> Five:
    """Return the means of the products of each v with one number."""
    new = 1.0 - keep
    return (
        keep * before[0] + new * v[0] * other,
        keep * before[1] + new * v[1] * other,
        keep * before[2] + new * v[2] * other,
        keep * before[3] + new * v[3] * other,
        keep * before[4] + new * v[4] * other,
    )


def judged(
    state: WatchState, across: TwoAxes, upright: TwoAxes, levers: Levers, dt_s: float
) -> tuple[Suspect, Fault, float]:
    """Suspect a fault, or doubt the one that is believed; after HOLDS_S believe it."""
    fault, excused_s = believed(state), max(state.excused_s - dt_s, 0.0)
    suspected, clear = NO_FAULT, 1.0
    if excused_s == 0.0 and fault.motor == 0:
        suspected, clear = _suspect(across, upright, levers)
    elif excused_s == 0.0:
        suspected = _doubted(upright if fault.motor > HORIZONTAL else across, fault)
    same = suspected.motor > 0 and suspected == state.suspect.fault
    suspect = Suspect(suspected, state.suspect.lasts_s + dt_s * clear if same else 0.0, clear)
    if suspect.lasts_s < HOLDS_S:
        return suspect, fault, excused_s
    if suspected.share == 1.0:
        return NOBODY, NO_FAULT, EXCUSED_S
    return NOBODY, suspected, RIGHTED_S if suspected.share < 0.0 else 0.0


def _suspect(across: TwoAxes, upright: TwoAxes, levers: Levers) -> tuple[Fault, float]:
    """Return which motor is faulty, if any, and how clearly.

    A horizontal motor that pushes by itself turns the vehicle, and tilts it, which looks like a fault of a
    vertical motor: while more is left in yaw than in roll and pitch, none is suspected.
    """
    fault, clear = _suspect_in_group(across, False, 0.0, 0.0)
    aside = residual_about(0, across.first, 1.0)
    turned_more = aside > LEAST_NM * LEAST_NM and aside > residual(0, upright, 1.0, 0.0, 0.0)
    if fault.motor > 0 or _turns_alone(across.first) or turned_more:
        return fault, min(clear, HORIZONTAL_CLEAR)
    alone = upright.weight == 0.0
    fault, clear = _suspect_in_group(upright, alone, 0.0, 0.0)
    if (
        fault.motor == 0
        or fault != _suspect_in_group(upright, alone, levers.roll_doubt_m, levers.pitch_doubt_m)[0]
    ):
        return NO_FAULT, 1.0
    return Fault(fault.motor + HORIZONTAL, fault.share), clear


def _suspect_in_group(shown: TwoAxes, alone: bool, first_z: float, second_z: float) -> tuple[Fault, float]:
    """Return which motor of a group, 1 to 4, is faulty, and how clearly. z stays within ± the given.

    Two vertical motors are each `alone`: whichever way one pushes, its demand is only its own. There the roll
    does not tell a reversed motor from a dead one, for which its demand does not matter: it is turned, and
    what follows tells.
    """
    whole = residual(0, shown, 1.0, first_z, second_z)
    if not whole > _least(shown):
        return NO_FAULT, 1.0
    lost, margin = each(residual, MOTORS, shown, 0.0, first_z, second_z), CLEARLY * whole
    half = each(residual, MOTORS, shown, -0.5, first_z, second_z)
    turned = each_of_two(_lesser, half, each(residual, MOTORS, shown, -1.0, first_z, second_z))
    motor, least, others = _best(each_of_two(_lesser, lost, turned), whole)
    found = least < EXPLAINS * others
    if found and (alone or turned[motor - 1] + margin < lost[motor - 1]):
        return Fault(motor, -1.0), min(EXPLAINS * others / max(least, TINY), MOST_CLEAR)
    dead, least, others = _best(lost, whole)
    weak = residual(dead, shown, 0.5, first_z, second_z) if dead > 0 else least
    if least < min(EXPLAINS * others, weak, min(turned) + margin):
        return Fault(dead, 0.0), 1.0 if least < EXPLAINS * min(turned) else UNCLEAR
    return (Fault(motor, 0.5), 0.0) if found else (NO_FAULT, 1.0)


def _lesser(one: float, other: float) -> float:
    return min(one, other)


def _best(by_motor: Four, whole: float) -> tuple[int, float, float]:
    """Return the motor that leaves the least, or 0; how much; and what the next one leaves."""
    found, least, others = 0, whole, whole
    for motor in range(1, 5):
        one = by_motor[motor - 1]
        if one < least:
            found, least, others = motor, one, least
        elif one < others:
            others = one
    return found, least, others


def _least(shown: TwoAxes) -> float:
    """Return the mean square that says nothing, (N·m)²."""
    return LEAST_NM * LEAST_NM + shown.first.oo + shown.second.oo


def _turns_alone(sums: Sums) -> bool:
    """Tell whether a fault of any motor explains a turn better than none."""
    whole = residual_about(0, sums, 1.0)
    if not whole > LEAST_NM * LEAST_NM + sums.oo:
        return False
    least = min(*each(residual_about, MOTORS, sums, 0.0), *each(residual_about, MOTORS, sums, -1.0))
    return least < EXPLAINS * whole


def _doubted(shown: TwoAxes, fault: Fault) -> Fault:
    """Return what the motor of a fault that is believed does instead; no fault where that is not clear."""
    motor = fault.motor - HORIZONTAL if fault.motor > HORIZONTAL else fault.motor
    other = -1.0 - fault.share
    whole, found = residual(0, shown, 1.0, 0.0, 0.0), residual(motor, shown, fault.share, 0.0, 0.0)
    if not found > _least(shown):
        return NO_FAULT
    if residual(motor, shown, other, 0.0, 0.0) < EXPLAINS * min(found, whole):
        return Fault(fault.motor, other)
    sound = found > DOUBTED * whole if fault.share == 0.0 else whole < EXPLAINS * EXPLAINS * found
    return Fault(fault.motor, 1.0) if sound else NO_FAULT


def residual(motor: int, shown: TwoAxes, share: float, first_z: float, second_z: float) -> float:
    """Return what a hypothesis leaves in both axes."""
    second = residual_about(motor, shown.second, share, second_z)
    return residual_about(motor, shown.first, share, first_z) + shown.weight * second


def residual_about(motor: int, sums: Sums, share: float, most_z: float = 0.0) -> float:
    """Return the mean square of y − c v + k s + z h for the c, k and z that make it least, within bounds.

    v = u − (1 − σ) b f is the mixture of u and of that without the motor.
    """
    i, lost = motor, 1.0 - share
    vv = share * share * sums.vv[0] + 2.0 * share * lost * sums.vu[i] + lost * lost * sums.vv[i]
    vy, vs = share * sums.vy[0] + lost * sums.vy[i], share * sums.vs[0] + lost * sums.vs[i]
    return _residual_of_fit(sums, vv, vy, vs, share * sums.vh[0] + lost * sums.vh[i], most_z)


def _residual_of_fit(sums: Sums, vv: float, vy: float, vs: float, vh: float, most_z: float) -> float:
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
