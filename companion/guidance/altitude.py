"""An altitude over the ground that is kept: how the depth that is wanted follows the ground.

Without a ground the depth stays. It moves no faster than the axis' limits, so a rise that is steeper is not
followed in time, and a ground that jumps moves the vehicle slowly.
"""

import math

from companion.control.bounds import clamped, limited
from companion.records import Ground

APPROACH_PER_S = 0.4
"""Share of the error of the altitude that is made good in a second."""


class AltitudeHold:
    """A depth that follows the ground. `altitude_m` is NaN until it is taken from where the vehicle is."""

    def __init__(self, altitude_m: float) -> None:
        self.altitude_m = altitude_m
        self.depth_m = math.nan
        """What is wanted now; NaN before it begins."""
        self.rate_mps = self.acceleration_mps2 = 0.0
        self.by_hand = False
        """Whether the pilot moves the depth in this tick."""

    def rest(self) -> None:
        """Begin again from where it will be."""
        self.depth_m, self.rate_mps, self.acceleration_mps2 = math.nan, 0.0, 0.0

    def take(self) -> None:
        """Keep the altitude to which the pilot moves it."""
        self.altitude_m, self.by_hand = math.nan, True
        self.rest()

    def lacks_m(self, ground: Ground) -> float:
        """Return how far the wanted depth is from the altitude; 0 where the ground is not known."""
        lacks = ground.depth_m - self.altitude_m - self.depth_m
        return abs(lacks) if math.isfinite(lacks) else 0.0

    def step(
        self,
        ground: Ground,
        start_m: float,
        least_m: float,
        rate_mps: float,
        acceleration_mps2: float,
        dt_s: float,
    ) -> None:
        """Move the wanted depth by `dt_s`, within the limits of rate and acceleration.

        `start_m` is where it begins; an altitude that is taken from there is at least `least_m`.
        """
        if math.isnan(self.depth_m):
            self.depth_m = start_m
        if ground.known and math.isnan(self.altitude_m):
            self.altitude_m = max(ground.depth_m - self.depth_m, least_m)
        wanted = 0.0
        if ground.known:
            lacks = ground.depth_m - self.altitude_m - self.depth_m
            wanted = limited(ground.rate_mps + APPROACH_PER_S * lacks, rate_mps)
        previous_mps = self.rate_mps
        self.rate_mps += limited(wanted - previous_mps, acceleration_mps2 * dt_s)
        self.acceleration_mps2 = (self.rate_mps - previous_mps) / dt_s if dt_s > 0.0 else 0.0
        self.depth_m += self.rate_mps * dt_s

    def bound(self, shallow_m: float, deep_m: float) -> None:
        """Stop at the depths that are permitted."""
        if not shallow_m <= self.depth_m <= deep_m:
            self.depth_m = clamped(self.depth_m, shallow_m, deep_m)
            self.rate_mps = self.acceleration_mps2 = 0.0
