"""How fast a leg is travelled: a parameter s(t) whose rate and acceleration are continuous and bounded.

The speed at s is the least of what the plan wants, the axes and the curvature permit, and the braking before
a slower place needs:

    v ≤ V / |p'|,   v ≤ √(a_n / |p''|),   v ≤ r / |ψ'|,   v ≤ √(α / |ψ''|),   v² ≤ v(s₁)² + 2 a_t (s₁ − s)

a_t and a_n, along and across, are together the acceleration of the plan. s follows that speed as the
reference follows its setpoint (`core.reference`), so it starts and stops with bounded jerk. A pace of less
than 1, where thrust saturates or the vehicle stays behind, slows it; 0 makes it wait.
"""

import math
from array import array
from bisect import bisect_right
from operator import add
from typing import NamedTuple

from companion.config import AxisSection, Config
from companion.core import reference
from companion.core.bounds import clamped, wrap
from companion.guidance.paths.curve import PathCurve, between
from companion.records import Setpoint, Vector, vector
from companion.steps import Steps

ALONG, ACROSS = 0.6, 0.8
"""Shares of the acceleration: 0.6² + 0.8² = 1."""
MARGIN = 0.97
"""Share of speed and acceleration: with it each path of tests/unit/test_paths.py stays within its limits."""
DRAG_SHARE = 0.7
"""Share of an axis' force for the drag in still water; the rest is for current and control."""
TINY = 1e-9
STEPS = 4
"""Points of the grid between two nodes: a corner of 12 nodes has 48."""
REFERENCE_LAG_S = reference.RATE_LAG_S + reference.ACCELERATION_LAG_S
ARRIVED_M, STANDS_MPS = 0.004, 0.006
"""A leg has ended this near its end, and this slow: a fraction of the error with which a path is held."""
SLOWEST_MPS = 0.005
"""What any place is passed with, however sharp."""


class PathLimits(NamedTuple):
    """Largest speeds and accelerations of the reference: m/s level and vertical, rad/s, m/s², rad/s²."""

    level: float
    vertical: float
    turn: float
    acceleration: float
    turn_acceleration: float


def limits(config: Config) -> PathLimits:
    """Return what the axes' limits, thrust and drag allow in every heading."""
    level = min(_fastest(config.surge), _fastest(config.sway))
    acceleration = min(axis.max_acceleration for axis in config.axes[:3])
    yaw = config.yaw
    return PathLimits(level, _fastest(config.heave), yaw.max_rate, acceleration, yaw.max_acceleration)


def _fastest(axis: AxisSection) -> float:
    """Return the speed of an axis that its `max_rate` and the drag leave."""
    d1, d2, force = axis.linear_damping, axis.quadratic_damping, DRAG_SHARE * axis.max_force
    return min(axis.max_rate, 2.0 * force / (d1 + math.sqrt(d1 * d1 + 4.0 * d2 * force) + TINY))


class Profile(NamedTuple):
    """The largest speed at each place of a curve, made by `profiled` before it is travelled."""

    curve: PathCurve
    acceleration: float
    max_speed: float
    loops: bool
    grid: "array[float]"
    caps: "array[float]"
    """The largest speed at each point of the grid."""
    braked: "array[float]"
    """The largest speed from which the limits of all later points can be met."""

    def speed(self, s: float) -> float:
        """Return the speed at s: between two points of the grid, what braking to the next one leaves."""
        i = self._before(s)
        s0, s1 = self.grid[i], self.grid[i + 1]
        cap = self.caps[i] + clamped((s - s0) / (s1 - s0), 0.0, 1.0) * (self.caps[i + 1] - self.caps[i])
        return min(cap, math.sqrt(self.braked[i + 1] ** 2 + 2.0 * self.acceleration * max(s1 - s, 0.0)))

    def slowest(self, begin: float, end: float) -> float:
        """Return the least speed from `begin` to `end`: a narrow corner may lie between the two."""
        if self.loops:
            length = self.curve.length
            begin, end = begin % length, begin % length + end - begin
            if end > length:
                return min(self._slowest(begin, length), self._slowest(0.0, min(end - length, length)))
        return self._slowest(begin, end)

    def _slowest(self, begin: float, end: float) -> float:
        between_them = self.braked[self._before(begin) + 1 : self._before(end) + 1]
        return min(self.speed(begin), self.speed(end), *between_them)

    def _before(self, s: float) -> int:
        """Return the point of the grid at s or before it, which has another one behind it."""
        return min(max(bisect_right(self.grid, s) - 1, 0), len(self.grid) - 2)


class TimeLaw:
    """One curve under way, from s = 0 to the end of its laps; `laps` may be infinite."""

    def __init__(self, profile: Profile, laps: float = 1.0) -> None:
        self._profile = profile
        self._parameters = reference.Parameters(profile.max_speed, profile.acceleration, angular=False)
        self._end = laps * profile.curve.length
        self._state = reference.ReferenceState(0.0, 0.0, 0.0, 0.0, 0.0)

    @property
    def s(self) -> float:
        """Where it is, m from the start, laps included."""
        return self._state.x_d

    @property
    def s_dot(self) -> float:
        """How fast it goes, m/s."""
        return self._state.x_d_dot

    @property
    def left_m(self) -> float:
        """How far the end is; a turn on the spot is no way."""
        return max(self._end - self.s, 0.0) * math.hypot(*self._profile.curve[0].dp[:3])

    @property
    def arrived(self) -> bool:
        """Whether it stands at the end."""
        return self._end - self.s < ARRIVED_M and abs(self.s_dot) < STANDS_MPS

    def halt(self) -> None:
        """Stand still at once: somebody else moves the vehicle."""
        self._state = reference.ReferenceState(self.s, 0.0, 0.0, 0.0, 0.0)

    def step(self, pace: float, dt_s: float) -> Setpoint:
        """Advance by `dt_s` at `pace`, the share of the speed that may be used; return where to be."""
        allowed = self._profile.slowest(self.s, self.s + self.s_dot * REFERENCE_LAG_S)
        share = pace * allowed / self._profile.max_speed
        self._state = reference.advance(self._parameters, self._state, self._end, 0.0, 0.0, share, dt_s)
        return self.setpoint()

    def setpoint(self) -> Setpoint:
        """Return pose, rate and acceleration now."""
        s, s_dot, s_ddot, curve = self.s, self.s_dot, self._state.x_d_ddot, self._profile.curve
        lap = math.floor(s / curve.length) if self._profile.loops and s < self._end else 0
        node = curve.at(s - lap * curve.length)
        x, y, z, psi = node.p
        psi += lap * curve.turn_rad
        rate = vector([p * s_dot for p in node.dp])
        acc = vector(map(add, [p * s_dot * s_dot for p in node.ddp], [p * s_ddot for p in node.dp]))
        return Setpoint((x, y, z, wrap(psi)), rate, acc)


def profiled(
    curve: PathCurve, speed: float, acceleration: float, limits: PathLimits, *, loops: bool = False
) -> Steps[Profile]:
    """Return a curve's profile by the plan's speed and acceleration; `loops` for several laps."""
    most = min(acceleration, limits.acceleration) * MARGIN
    grid, caps = array("d"), array("d")
    for i in range(len(curve)):
        a, b = curve[i], curve[min(i + 1, len(curve) - 1)]
        for k in range(STEPS if i + 1 < len(curve) else 1):
            node = between(a, b, a.s + (b.s - a.s) * k / STEPS) if k else a
            grid.append(node.s)
            caps.append(_cap(node.dp, node.ddp, speed, most, limits))
        yield 1
    braked = array("d", caps)
    for _ in range(2 if loops else 1):
        if loops:
            braked[-1] = min(braked[-1], braked[0])
        for i in range(len(grid) - 2, -1, -1):
            way = grid[i + 1] - grid[i]
            braked[i] = min(braked[i], math.sqrt(braked[i + 1] ** 2 + 2.0 * ALONG * most * way))
            yield 1
    return Profile(curve, ALONG * most, max(caps), loops, grid, caps, braked)


def _cap(dp: Vector, ddp: Vector, speed: float, acceleration: float, limits: PathLimits) -> float:
    level, vertical, turn = math.hypot(dp[0], dp[1]), abs(dp[2]), abs(dp[3])
    bend, turn_bend = math.hypot(*ddp[:3]), abs(ddp[3])
    least = min(
        MARGIN * speed / max(math.hypot(level, vertical), TINY),
        MARGIN * limits.level / max(level, TINY),
        MARGIN * limits.vertical / max(vertical, TINY),
        MARGIN * limits.turn / max(turn, TINY),
        math.sqrt(ACROSS * acceleration / max(bend, TINY)),
        math.sqrt(ACROSS * limits.turn_acceleration / max(turn_bend, TINY)),
    )
    return max(least, SLOWEST_MPS)
