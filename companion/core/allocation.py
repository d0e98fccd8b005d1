"""Newtons to normalised axis demands and back: thruster curve, dead band, voltage, shared saturation.

ArduSub turns axis demands a (-1..1) into motor demands t = M a, and motor demands linearly into PWM. A motor
then pushes T(t), which is neither linear nor symmetric. The horizontal motors serve surge, sway and yaw, the
vertical ones heave, roll and pitch: two groups of up to four motors and three axes, with the same equations.
Within a group the columns of M are orthogonal, so its pseudo-inverse is N⁻¹ Mᵀ, and

    f = M (S N)⁻¹ tau     t = T⁻¹(f + λ n)     a = N⁻¹ Mᵀ t       and what it gives:  tau = S Mᵀ T(M a)

| symbol | meaning                                                                        | unit    |
|--------|--------------------------------------------------------------------------------|---------|
| M      | ArduSub's factors, 1, -1 or 0: what a demand on each axis asks of each motor   |         |
| N      | how many motors serve each axis                                                |         |
| S      | force or moment on each axis for a newton of each of its motors                | 1, m    |
| f, T   | push of each motor at 16 V, and the curve that gives it                        | N       |
| n      | how four motors on three axes push against each other: Mᵀ n = 0                |         |
| λ      | how strongly they have to, so that axis demands exist that ask for t: nᵀ t = 0 | N       |
| w      | 1; -1 for a motor that runs the other way round: it pushes T(w t)              |         |
| k      | a motor that gives no thrust; without it the other three serve the three axes  |         |

Without motor k the three others push f = M₃⁻ᵀ S⁻¹ tau, and what is asked of k makes nᵀ t = 0:

    t_j = T⁻¹(f_j)     t_k = −n_k Σ n_j t_j

So heave without moments is the work of two motors on one diagonal, the fourth rests, and |t_k| ≤ 1 leaves
half of their demand. If k runs the other way round, t = w T⁻¹(f + λ n): heave is the work of k and of the
motor on its diagonal. Where it cannot give both, the moments are given whole and the forces are limited.
"""

import math
from typing import NamedTuple

from companion.core.bounds import limited
from companion.core.four import each, each_of_two
from companion.records import Axes

Three = tuple[float, float, float]
Four = tuple[float, float, float, float]
ByAxis = tuple[bool, bool, bool, bool, bool, bool]
Motors = tuple[float, float, float, float, float, float, float, float]
"""The horizontal motors, then the vertical ones; zeros stand for those that a frame does not have."""


class Curve(NamedTuple):
    """A piecewise linear function of 12 points, constant beyond them; by segment its slope."""

    x: tuple[float, ...]
    y: tuple[float, ...]
    slope: tuple[float, ...]


def _through(x: tuple[float, ...], y: tuple[float, ...]) -> Curve:
    """Return the curve through points of ascending x."""
    return Curve(x, y, tuple((y[k + 1] - y[k]) / (x[k + 1] - x[k]) for k in range(len(x) - 1)))


# T200 at 16 V (docs/ardusub.md, "From axis to newton"): motor demand t = (PWM - 1500)/400 against newtons.
T200_PWM_US = (1100, 1200, 1300, 1400, 1440, 1472, 1528, 1560, 1600, 1700, 1800, 1900)
T200_N = (-39.9, -26.6, -14.1, -4.7, -1.8, 0.0, 0.0, 2.2, 5.9, 17.9, 33.5, 51.5)
T200_VOLTAGE_V = 16.0
DEAD_BAND_N = 0.02
"""Half-width, per motor, over which the inverted curve crosses the dead band: a slope instead of a jump."""

_DEMAND = tuple((pwm_us - 1500) / 400 for pwm_us in T200_PWM_US)
_RISING_N = (*T200_N[:5], -DEAD_BAND_N, DEAD_BAND_N, *T200_N[7:])
PUSH = _through(_DEMAND, T200_N)
"""Demand to newtons."""
RISING_PUSH = _through(_DEMAND, _RISING_N)
"""The same without a dead band, which has an inverse: newtons to demand."""
DEMAND = _through(_RISING_N, _DEMAND)
LAST, DEAD_BAND = 11, 5
"""Last point of a curve, and the segment of the dead band."""

MIN_REACH = 1e-6
MIN_STRENGTH = 1e-6
NEWTON_STEPS = 2
SLOPE_STEP = 0.1
MIN_SLOPE_N = 1e-9
OVERLOAD = 1.01
HALVINGS, TURNED_HALVINGS = 10, 14
"""Steps of bisection: of the share of the forces that the motors can give beside what goes first; of λ."""

# Motor by motor: surge, sway, heave (down), yaw, roll and pitch factors of ArduSub's frames.
_HORIZONTAL: tuple[Axes, ...] = (
    (-1.0, 1.0, 0.0, 1.0, 0.0, 0.0),
    (-1.0, -1.0, 0.0, -1.0, 0.0, 0.0),
    (1.0, 1.0, 0.0, -1.0, 0.0, 0.0),
    (1.0, -1.0, 0.0, 1.0, 0.0, 0.0),
)
FACTORS: dict[str, tuple[Axes, ...]] = {
    "vectored": (*_HORIZONTAL, (0.0, 0.0, 1.0, 0.0, 1.0, 0.0), (0.0, 0.0, 1.0, 0.0, -1.0, 0.0)),
    "vectored_6dof": (
        *_HORIZONTAL,
        (0.0, 0.0, 1.0, 0.0, 1.0, -1.0),
        (0.0, 0.0, 1.0, 0.0, -1.0, -1.0),
        (0.0, 0.0, 1.0, 0.0, 1.0, 1.0),
        (0.0, 0.0, 1.0, 0.0, -1.0, 1.0),
    ),
}
HORIZONTAL = len(_HORIZONTAL)
YAW = 3
"""The first of the six axes that turns the vehicle."""
NO_MOTOR: Four = (0.0, 0.0, 0.0, 0.0)
FORWARD: Four = (1.0, 1.0, 1.0, 1.0)
NOTHING: Three = (0.0, 0.0, 0.0)
PER_NEWTON: Axes = (math.sqrt(0.5), math.sqrt(0.5), 1.0, math.sqrt(0.5) * (0.156 + 0.111), 0.218, 0.12)
"""S; lengths in m from docs/ardusub.md, "Vehicles"."""


class Group(NamedTuple):
    """Up to four motors and three axes: surge, sway, yaw, or heave, roll, pitch."""

    factors: tuple[Three, Three, Three, Three]
    """M, motor by motor; zero for a motor that is not there and for an axis that is not ours."""
    opposed: Four
    """n: 1 or -1 each, or 0 where no push is without a wrench."""
    shares: Three
    """N⁻¹; 0 for an axis without motors."""
    levers: Three
    """S."""
    max_tau: Three
    """Bound on what is asked of each axis, N or N·m."""
    first: Three
    """1 for an axis whose demand is met before the others': yaw; without a motor every moment."""
    whole: bool
    """Whether all motors give thrust."""
    ways: Four
    """w; 0 for motor k."""
    pushes: tuple[Three, Three, Three, Three]
    """M N⁻¹, without k M₃⁻ᵀ: by motor what it pushes for a newton on each axis; zero for k."""


class Thrusters(NamedTuple):
    """One frame's thrusters."""

    horizontal: Group
    vertical: Group
    motor_count: int
    """How many motors the frame has."""


def thrusters(frame: str, max_tau: Axes, tilts: bool) -> Thrusters:
    """Return the thrusters of `frame`, "vectored" or "vectored_6dof".

    `max_tau` bounds what is asked of each axis, N and N·m; `tilts` tells whether roll and pitch are ours.
    """
    factors = FACTORS[frame]
    ours = 1.0 if tilts else 0.0
    horizontal = [(surge, sway, yaw) for surge, sway, _, yaw, _, _ in factors[:HORIZONTAL]]
    vertical = [(heave, ours * roll, ours * pitch) for _, _, heave, _, roll, pitch in factors[HORIZONTAL:]]
    return Thrusters(
        _group(horizontal, (0, 1, 3), max_tau), _group(vertical, (2, 4, 5), max_tau), len(factors)
    )


def _group(factors: list[Three], axes: tuple[int, int, int], max_tau: Axes) -> Group:
    """Return a group of motors and the places of its axes among the six.

    Where three orthogonal columns of 1 and -1 serve four motors, their product is orthogonal to all three.
    """
    first, second, third, fourth = (*factors, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))[:4]
    motors = (first, second, third, fourth)
    i, j, k = axes
    served = [sum(abs(motor[axis]) for motor in motors) for axis in range(3)]
    shares = (_inverse(served[0]), _inverse(served[1]), _inverse(served[2]))
    p, q, r, s = ((a * shares[0], b * shares[1], c * shares[2]) for a, b, c in motors)
    return Group(
        factors=motors,
        opposed=each(math.prod, motors),
        shares=shares,
        levers=(PER_NEWTON[i], PER_NEWTON[j], PER_NEWTON[k]),
        max_tau=(max_tau[i], max_tau[j], max_tau[k]),
        first=(float(i == YAW), float(j == YAW), float(k == YAW)),
        whole=True,
        ways=FORWARD,
        pushes=(p, q, r, s),
    )


def can_lose(whole: Thrusters, motor: int) -> bool:
    """Tell whether the others serve all axes without `motor`, 1 to `motor_count`.

    Two vertical motors do not, nor do four whose roll and pitch are not ours.
    """
    if motor <= HORIZONTAL:
        return whole.horizontal.opposed[motor - 1] != 0.0
    return whole.vertical.opposed[motor - 1 - HORIZONTAL] != 0.0


def as_found(whole: Thrusters, dead: int, reversed_motor: int) -> Thrusters:
    """Return the thrusters as they are: without motor `dead`, or with one the other way round; 0 for none."""
    return turned_motor(whole, reversed_motor) if reversed_motor > 0 else without_motor(whole, dead)


def turned_motor(whole: Thrusters, motor: int) -> Thrusters:
    """Return the thrusters of which `motor`, 1 to `motor_count`, runs the other way round."""
    if motor <= HORIZONTAL:
        return whole._replace(horizontal=_with(whole.horizontal, motor - 1, -1.0))
    return whole._replace(vertical=_with(whole.vertical, motor - 1 - HORIZONTAL, -1.0))


def without_motor(whole: Thrusters, motor: int) -> Thrusters:
    """Return the thrusters that go on without `motor`; all for 0, and for one that nothing replaces."""
    if motor == 0 or not can_lose(whole, motor):
        return whole
    if motor <= HORIZONTAL:
        return whole._replace(horizontal=_without(whole.horizontal, motor - 1))
    return whole._replace(vertical=_without(whole.vertical, motor - 1 - HORIZONTAL))


def _without(group: Group, k: int) -> Group:
    return _with(group, k, 0.0)._replace(pushes=each(_pushes, (0, 1, 2, 3), k, group))


def _with(group: Group, k: int, way: float) -> Group:
    """Return a group whose motor k runs another way, with the moments first: yaw, or roll and pitch."""
    moments = group.first if group.first != NOTHING else (0.0, 1.0, 1.0)
    return group._replace(first=moments, whole=False, ways=each(_way, (0, 1, 2, 3), k, way))


def _way(motor: int, k: int, way: float) -> float:
    return way if motor == k else 1.0


def _pushes(j: int, k: int, group: Group) -> Three:
    """Return the row of motor j of (M − n n_k M_k) N⁻¹, which is M₃⁻ᵀ: motor k's work given back along n."""
    p, q, shares = group.factors[j], group.factors[k], group.shares
    back = group.opposed[j] * group.opposed[k]
    return (
        (p[0] - back * q[0]) * shares[0],
        (p[1] - back * q[1]) * shares[1],
        (p[2] - back * q[2]) * shares[2],
    )


def _inverse(served: float) -> float:
    return 1.0 / served if served else 0.0


def allocate(thrusters: Thrusters, tau: Axes, voltage_v: float, reach: Axes) -> tuple[Axes, ByAxis]:
    """Return the axes for body wrench `tau`, within ±`reach`, motors within ±1, and which ask for more.

    Where the horizontal motors would exceed the end of their curve or their reach, yaw's moment is given
    whole and the forces of surge and sway are cut, so that their direction is kept: the heading goes before
    the place. Heave, roll and pitch, without which no depth is held either, are scaled by one factor.
    """
    strength = thrust_at(voltage_v)
    (surge, sway, yaw), (short_x, short_y, short_n) = _group_axes(
        thrusters.horizontal, (tau[0], tau[1], tau[3]), strength, (reach[0], reach[1], reach[3])
    )
    (heave, roll, pitch), (short_z, short_k, short_m) = _group_axes(
        thrusters.vertical, (tau[2], tau[4], tau[5]), strength, (reach[2], reach[4], reach[5])
    )
    short = (short_x, short_y, short_z, short_n, short_k, short_m)
    return (surge, sway, heave, yaw, roll, pitch), short


def delivered(thrusters: Thrusters, axes: Axes, voltage_v: float) -> Axes:
    """Return the body wrench that the axes really give, N and N·m, at the nominal curve."""
    strength = thrust_at(voltage_v)
    X, Y, N = _group_wrench(thrusters.horizontal, (axes[0], axes[1], axes[3]), strength)
    Z, K, M = _group_wrench(thrusters.vertical, (axes[2], axes[4], axes[5]), strength)
    return (X, Y, Z, N, K, M)


def motors(thrusters: Thrusters, axes: Axes) -> Motors:
    """Return the demand on each motor, as the firmware computes it from the axes."""
    across = _by_motor(thrusters.horizontal.factors, (axes[0], axes[1], axes[3]))
    return across + _by_motor(thrusters.vertical.factors, (axes[2], axes[4], axes[5]))


def overloaded(thrusters: Thrusters, axes: Axes) -> ByAxis:
    """Tell axis by axis whether its motor group is asked for more than a motor can give."""
    a, b, c, d, e, f, g, h = motors(thrusters, axes)
    across = max(abs(a), abs(b), abs(c), abs(d)) > OVERLOAD
    upright = max(abs(e), abs(f), abs(g), abs(h)) > OVERLOAD
    return (across, across, upright, across, upright, upright)


def axes_from_motors(thrusters: Thrusters, demands: tuple[float, ...]) -> Axes:
    """Return the axes that make the firmware ask `demands` of its `motor_count` motors."""
    a, b, c, d, e, f, g, h = (*demands, 0.0, 0.0)[:8]
    surge, sway, yaw = _group_demands(thrusters.horizontal, (a, b, c, d))
    heave, roll, pitch = _group_demands(thrusters.vertical, (e, f, g, h))
    return (surge, sway, heave, yaw, roll, pitch)


def _group_axes(
    group: Group, tau: Three, strength: float, reach: Three
) -> tuple[Three, tuple[bool, bool, bool]]:
    """Return `allocate` of one group's axes."""
    levers, max_tau, first = group.levers, group.max_tau, group.first
    X, Y, Z = limited(tau[0], max_tau[0]), limited(tau[1], max_tau[1]), limited(tau[2], max_tau[2])
    wanted = (X / (levers[0] * strength), Y / (levers[1] * strength), Z / (levers[2] * strength))
    everything = _by_motor(group.pushes, wanted)
    turning, beyond = NO_MOTOR, 1.0
    if first != NOTHING:
        turning = _by_motor(group.pushes, (wanted[0] * first[0], wanted[1] * first[1], wanted[2] * first[2]))
        beyond = max(1.0, *each(_load, turning))
        turning = (turning[0] / beyond, turning[1] / beyond, turning[2] / beyond, turning[3] / beyond)
    share = min(1.0 / beyond, *each_of_two(_room, turning, everything))
    a, over = _shared(group, turning, everything, share, reach)
    if over > 1.0 and first != NOTHING:
        low, high = 0.0, share
        for _ in range(HALVINGS):
            share = 0.5 * (low + high)
            _, over = _shared(group, turning, everything, share, reach)
            if over > 1.0:
                high = share
            else:
                low = share
        share = low
        a, over = _shared(group, turning, everything, share, reach)
    cut = over > 1.0 or beyond > 1.0
    saturated = (
        cut or (share < 1.0 and first[0] == 0.0) or tau[0] != X,
        cut or (share < 1.0 and first[1] == 0.0) or tau[1] != Y,
        cut or (share < 1.0 and first[2] == 0.0) or tau[2] != Z,
    )
    return (a[0] / over, a[1] / over, a[2] / over), saturated


def _room(turning: float, everything: float) -> float:
    """Return the share (0..1) of what else is asked of a motor that it can give beside its `turning`, N."""
    pushing = everything - turning
    end = T200_N[LAST] if pushing > 0.0 else T200_N[0]
    return max((end - turning) / pushing, 0.0) if _load(everything) > 1.0 else 1.0


def _shared(group: Group, turning: Four, everything: Four, share: float, reach: Three) -> tuple[Three, float]:
    """Return the axes for `turning` and a share of the rest, N by motor, and how far beyond any goes."""
    forces = (
        turning[0] + share * (everything[0] - turning[0]),
        turning[1] + share * (everything[1] - turning[1]),
        turning[2] + share * (everything[2] - turning[2]),
        turning[3] + share * (everything[3] - turning[3]),
    )
    t = (
        interpolated(forces[0], DEMAND),
        interpolated(forces[1], DEMAND),
        interpolated(forces[2], DEMAND),
        interpolated(forces[3], DEMAND),
    )
    if min(group.ways) < 0.0:
        t = _turned(group, forces)
    elif not group.whole:
        t = _idle(group, t)
    a = _group_demands(group, t)
    if group.whole:
        t = _by_motor(group.factors, a)
        if group.opposed[0] != 0.0:
            t = _balanced(group, t, forces)
            a = _group_demands(group, t)
    over = max(
        1.0,
        abs(a[0]) / max(reach[0], MIN_REACH),
        abs(a[1]) / max(reach[1], MIN_REACH),
        abs(a[2]) / max(reach[2], MIN_REACH),
        abs(t[0]),
        abs(t[1]),
        abs(t[2]),
        abs(t[3]),
    )
    return a, over


def _idle(group: Group, t: Four) -> Four:
    """Return the demands with that on the motor without thrust for which nᵀ t = 0."""
    n, w = group.opposed, group.ways
    idle = n[0] * t[0] + n[1] * t[1] + n[2] * t[2] + n[3] * t[3]
    return (
        t[0] - (1.0 - w[0]) * n[0] * idle,
        t[1] - (1.0 - w[1]) * n[1] * idle,
        t[2] - (1.0 - w[2]) * n[2] * idle,
        t[3] - (1.0 - w[3]) * n[3] * idle,
    )


def _turned(group: Group, forces: Four) -> Four:
    """Return the demands t = w T⁻¹(f + λ n) for which nᵀ t = 0; where n is 0 every λ will do."""
    n, t = group.opposed, NO_MOTOR
    high = 3.0 * max(abs(forces[0]), abs(forces[1]), abs(forces[2]), abs(forces[3]))
    low = -high
    for _ in range(TURNED_HALVINGS):
        push = 0.5 * (low + high)
        t = (
            group.ways[0] * interpolated(forces[0] + push * n[0], DEMAND),
            group.ways[1] * interpolated(forces[1] + push * n[1], DEMAND),
            group.ways[2] * interpolated(forces[2] + push * n[2], DEMAND),
            group.ways[3] * interpolated(forces[3] + push * n[3], DEMAND),
        )
        if n[0] * t[0] + n[1] * t[1] + n[2] * t[2] + n[3] * t[3] < 0.0:
            low = push
        else:
            high = push
    return t


def _balanced(group: Group, t: Four, forces: Four) -> Four:
    """Return the demands t = T⁻¹(f + λ n) for which nᵀ t = 0: Newton steps from a `t` for which it holds."""
    n = group.opposed
    for _ in range(NEWTON_STEPS):
        r0, c0 = _missing(t[0], forces[0])
        r1, c1 = _missing(t[1], forces[1])
        r2, c2 = _missing(t[2], forces[2])
        r3, c3 = _missing(t[3], forces[3])
        push = -(n[0] * r0 * c0 + n[1] * r1 * c1 + n[2] * r2 * c2 + n[3] * r3 * c3) / (c0 + c1 + c2 + c3)
        t = (
            t[0] + (r0 + push * n[0]) * c0,
            t[1] + (r1 + push * n[1]) * c1,
            t[2] + (r2 + push * n[2]) * c2,
            t[3] + (r3 + push * n[3]) * c3,
        )
    return t


def _missing(demand: float, force: float) -> tuple[float, float]:
    """Return by how much a motor's push falls short of `force` (N), and the demand per newton around it."""
    rise = interpolated(demand + SLOPE_STEP, RISING_PUSH) - interpolated(demand - SLOPE_STEP, RISING_PUSH)
    push = interpolated(demand, RISING_PUSH)
    return force - push, 2.0 * SLOPE_STEP / (MIN_SLOPE_N if rise < MIN_SLOPE_N else rise)


def _by_motor(rows: tuple[Three, Three, Three, Three], a: Three) -> Four:
    """Return a matrix with a row for each motor times a vector by axis."""
    p, q, r, s = rows
    return (
        p[0] * a[0] + p[1] * a[1] + p[2] * a[2],
        q[0] * a[0] + q[1] * a[1] + q[2] * a[2],
        r[0] * a[0] + r[1] * a[1] + r[2] * a[2],
        s[0] * a[0] + s[1] * a[1] + s[2] * a[2],
    )


def _group_sums(group: Group, t: Four) -> Three:
    """Return Mᵀ t."""
    p, q, r, s = group.factors
    return (
        p[0] * t[0] + q[0] * t[1] + r[0] * t[2] + s[0] * t[3],
        p[1] * t[0] + q[1] * t[1] + r[1] * t[2] + s[1] * t[3],
        p[2] * t[0] + q[2] * t[1] + r[2] * t[2] + s[2] * t[3],
    )


def _group_demands(group: Group, t: Four) -> Three:
    """Return N⁻¹ Mᵀ t."""
    a, b, c = _group_sums(group, t)
    return a * group.shares[0], b * group.shares[1], c * group.shares[2]


def _group_wrench(group: Group, a: Three, strength: float) -> Three:
    """Return S Mᵀ T(M a), at a battery's strength."""
    pushes = each_of_two(_pushed, _by_motor(group.factors, a), group.ways)
    X, Y, Z = _group_sums(group, pushes)
    levers = group.levers
    return X * levers[0] * strength, Y * levers[1] * strength, Z * levers[2] * strength


def _pushed(demand: float, way: float) -> float:
    return interpolated(way * demand, PUSH)


def reserve(thrusters: Thrusters, axes: Axes, reach: Axes) -> float:
    """Return what share of the thrust is left, 0..1: that of the motor or the axis that has the least.

    A motor ends at full push, an axis at that of its `reach`.
    """
    used = max(0.0, *(_load(interpolated(t, PUSH)) for t in motors(thrusters, axes)))
    for a, most in zip(axes, reach, strict=True):
        used = max(used, interpolated(abs(a), PUSH) / max(interpolated(most, PUSH), DEAD_BAND_N))
    return max(0.0, 1.0 - used)


def interpolated(x: float, curve: Curve) -> float:
    """Return a curve's value at x; NaN for NaN."""
    points, values, slopes = curve
    k = DEAD_BAND
    if x > points[k + 1]:
        if x >= points[LAST]:
            return values[LAST]
        k += 1
        while x > points[k + 1]:
            k += 1
    elif x < points[k]:
        if x <= points[0]:
            return values[0]
        k -= 1
        while x < points[k]:
            k -= 1
    return values[k] + slopes[k] * (x - points[k])


def _load(newtons: float) -> float:
    """Return what share of its largest push a motor is asked for."""
    return newtons / (T200_N[LAST] if newtons > 0.0 else T200_N[0])


def thrust_at(voltage_v: float) -> float:
    """Return thrust as a share of that at 16 V: it goes about with the square of the voltage."""
    share = voltage_v / T200_VOLTAGE_V
    return max(share * share, MIN_STRENGTH)
