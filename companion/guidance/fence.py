"""Where the vehicle may be sent: a box north and east, two depths, and how near the ground.

Places keep MARGIN_M from `[fence]`. Without `[fence]` in force only `supervisor.max_depth_m` bounds a place.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

from companion.config import Config
from companion.core.bounds import clamped, limited
from companion.estimation.frame import Offset
from companion.guidance.course import Course
from companion.guidance.paths.shapes import Path
from companion.guidance.paths.time_law import REFERENCE_LAG_S, limits
from companion.records import Setpoint, Vector, Z, vector

Interval = tuple[float, float]
MARGIN_M = 0.1
"""Distance of the reference from the fence: it overshoots by 2 cm, and the vehicle is off by some more."""
BRAKING_SHARE = 0.35
"""Share of an axis' acceleration to stop before the fence with: the reference is late (REFERENCE_LAG_S)."""


class Fence(NamedTuple):
    """North, east and depth, m: the least and the largest that is inside."""

    north_m: Interval
    east_m: Interval
    depth_m: Interval

    def outside(self, place: Sequence[float]) -> str:
        """Return which bound a place (x, y, z) breaks, in words; "" for one inside. NaN breaks none."""
        for name, value, (low, high) in zip(("x_m", "y_m", "depth_m"), place, self, strict=False):
            if value < low or value > high:
                margin = f" ({MARGIN_M:g} m inside the fence)" if math.isfinite(low) else ""
                return f"{name} = {value:.2f}: must be {low:g} to {high:g}{margin}"
        return ""

    def left_by(self, path: Path, start: Vector) -> str:
        """Return an outermost place of a path from `start`, in words; "" where all of it is inside."""
        offset = path.start(start)
        for place in path.extremes:
            x, y, z = (a + b for a, b in zip(place, offset, strict=False))
            if refused := self.outside((x, y, z)):
                return f"the path leaves the fence at x {x:.2f}, y {y:.2f}, depth {z:.2f} m: {refused}"
        return ""

    def inside(self, target: Setpoint) -> Setpoint:
        """Return the target, at rest at the fence in each coordinate that lies beyond it."""
        if not self.outside(target.eta_d):
            return target
        eta, rate, acc = list(target.eta_d), list(target.eta_d_dot), list(target.eta_d_ddot)
        for i, (low, high) in enumerate(self):
            if not low <= eta[i] <= high:
                eta[i], rate[i], acc[i] = clamped(eta[i], low, high), 0.0, 0.0
        return Setpoint(vector(eta), vector(rate), vector(acc))

    def braked(self, eta: Vector, rate: Vector, max_acceleration: Vector) -> Vector:
        """Return the rate of a target at `eta`, limited so that the target stops before the fence."""
        slowed = list(rate)
        for i, (low, high) in enumerate(self):
            if rate[i]:
                room = max(high - eta[i] if rate[i] > 0.0 else eta[i] - low, 0.0)
                a = BRAKING_SHARE * max_acceleration[i]
                # The speed v that needs this room: v T + v²/(2 a).
                fastest = a * (math.hypot(REFERENCE_LAG_S, math.sqrt(2.0 * room / a)) - REFERENCE_LAG_S)
                slowed[i] = limited(rate[i], fastest)
        return vector(slowed)


def fence_of(config: Config) -> Fence:
    """Return what bounds a place: the deepest setpoint and, where it is in force, `[fence]` less its margin.

    A fence whose least depth is 0 leaves the surface open.
    """
    given, deepest_m = config.fence, config.supervisor.max_depth_m
    if not given.enabled:
        anywhere = (-math.inf, math.inf)
        return Fence(anywhere, anywhere, (-math.inf, deepest_m))
    shallow_m, deep_m = _inside(given.depth_m)
    least_m = shallow_m if given.depth_m[0] > 0.0 else 0.0
    return Fence(_inside(given.north_m), _inside(given.east_m), (least_m, min(deep_m, deepest_m)))


def _inside(bounds: Interval) -> Interval:
    low, high = bounds
    margin_m = min(MARGIN_M, 0.5 * (high - low))
    return low + margin_m, high - margin_m


class Bounds:
    """What a configuration permits to ask for; the methods that return nothing raise ValueError."""

    def __init__(self, config: Config) -> None:
        self.config = config
        self.fence, self.limits = fence_of(config), limits(config)
        surge, sway, heave, yaw = (axis.max_acceleration for axis in config.axes)
        self.max_acceleration: Vector = (min(surge, sway), min(surge, sway), heave, yaw)
        """Largest acceleration by DOF, in any heading."""
        surge, sway, heave, yaw = (axis.max_rate for axis in config.axes)
        self._max_rate: Vector = (min(surge, sway), min(surge, sway), heave, yaw)

    def refuse_depth(self, setpoint: Setpoint) -> None:
        """Refuse a setpoint that is infinite, or deeper than `supervisor.max_depth_m`."""
        deepest_m = self.config.supervisor.max_depth_m
        infinite = any(map(math.isinf, setpoint.eta_d)) or not all(
            map(math.isfinite, (*setpoint.eta_d_dot, *setpoint.eta_d_ddot))
        )
        if infinite or setpoint.eta_d[Z] > deepest_m:
            raise ValueError(
                f"setpoint {list(setpoint.eta_d)} (x, y, depth, heading): must be finite, "
                f"and no deeper than supervisor.max_depth_m = {deepest_m:g}"
            )

    def checked(self, setpoint: Setpoint) -> Setpoint:
        """Return a setpoint that is permitted; raise ValueError for another."""
        self.refuse_depth(setpoint)
        if refused := self.fence.outside(setpoint.eta_d):
            raise ValueError(f"setpoint beyond the fence: {refused}")
        return setpoint

    def check(self, course: Course, start: Vector) -> None:
        """Refuse a path or a move that leaves its bounds from `start`."""
        if course.path is not None:
            if refused := self.fence.left_by(course.path, start):
                raise ValueError(refused)
            return
        goal = course.goal(start)
        self.checked(Setpoint(goal))
        if goal[Z] < 0.0:
            raise ValueError(f"depth_m: {goal[Z]:.2f} m is above the surface; must be 0 or more")

    def permit_altitude(self, altitude_m: float) -> None:
        """Refuse an altitude below `supervisor.min_altitude_m`; NaN is none."""
        least_m = self.config.supervisor.min_altitude_m
        if altitude_m < least_m:
            raise ValueError(
                f"altitude_m = {altitude_m:g}: must be supervisor.min_altitude_m = {least_m:g} or more"
            )

    def fenced(self, target: Setpoint, now: Offset) -> Setpoint:
        """Return a target inside, held at the fence, which is where the EKF's frame is `now`."""
        outside = now.setpoint_outside(target)
        kept = self.fence.inside(outside)
        return target if kept is outside else now.setpoint_inside(kept)

    def slowed(self, target: Setpoint) -> Setpoint:
        """Return a target inside with its rates and accelerations within the axes' limits."""
        rate = vector(map(limited, target.eta_d_dot, self._max_rate))
        rise = vector(map(limited, target.eta_d_ddot, self.max_acceleration))
        return Setpoint(target.eta_d, rate, rise)
