"""Where the vehicle may be told to be: a box north and east, and two depths.

Places keep MARGIN_M from `[fence]`, so that the vehicle stays inside it: its reference overshoots by up to
2 cm and the vehicle is off its reference by some more (docs/guidance.md). Without `[fence]` in force only
`supervisor.max_depth_m` bounds a place.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

from companion.config import Config
from companion.core.bounds import clamped, limited
from companion.core.reference import ACCELERATION_LAG_S, RATE_LAG_S
from companion.guidance.paths.shapes import Path
from companion.records import Setpoint, Vector, Z, vector

Bounds = tuple[float, float]
MARGIN_M = 0.1
BRAKING_SHARE = 0.35
LAG_S = RATE_LAG_S + ACCELERATION_LAG_S
"""Share of an axis' acceleration to stop before the fence with, and how late the reference begins to."""


class Fence(NamedTuple):
    """North, east and depth, m: the least and the largest that is inside."""

    north_m: Bounds
    east_m: Bounds
    depth_m: Bounds

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
        """Return the rate of a target at `eta` so far as it still stops before the fence."""
        slowed = list(rate)
        for i, (low, high) in enumerate(self):
            if rate[i]:
                room = max(high - eta[i] if rate[i] > 0.0 else eta[i] - low, 0.0)
                a = BRAKING_SHARE * max_acceleration[i]
                # The speed v that needs this room: v T + v²/(2 a).
                slowed[i] = limited(rate[i], a * (math.hypot(LAG_S, math.sqrt(2.0 * room / a)) - LAG_S))
        return vector(slowed)


def fence(config: Config) -> Fence:
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


def _inside(bounds: Bounds) -> Bounds:
    low, high = bounds
    margin_m = min(MARGIN_M, 0.5 * (high - low))
    return low + margin_m, high - margin_m


def refuse_depth(setpoint: Setpoint, config: Config) -> None:
    """Raise ValueError for a setpoint that is infinite, or deeper than `supervisor.max_depth_m`."""
    deepest_m, motion = config.supervisor.max_depth_m, (*setpoint.eta_d_dot, *setpoint.eta_d_ddot)
    infinite = any(map(math.isinf, setpoint.eta_d)) or not all(map(math.isfinite, motion))
    if infinite or setpoint.eta_d[Z] > deepest_m:
        raise ValueError(
            f"setpoint {list(setpoint.eta_d)} (x, y, depth, heading): must be finite, "
            f"and no deeper than supervisor.max_depth_m = {deepest_m:g}"
        )
