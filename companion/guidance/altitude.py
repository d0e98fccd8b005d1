"""An altitude over the ground that is kept: how the depth that is wanted follows the ground.

Without a ground the depth stays. It moves no faster than the axis' limits, so a rise that is steeper is not
followed in time, and a ground that jumps moves the vehicle slowly.

A range is believed if it answers the vehicle's own motion: the estimated ground did not follow the vehicle
(`Ground.moves_along`), or without a nod by less than half of its motion. A leg is half the range of the last
answer: the vehicle goes no deeper without another. A ground that follows the vehicle stops it. While the
range is doubted the depth is held; only a ground that is near is evaded.

A steady slope that is followed looks like a range that is stuck: the vehicle moves, and the range stays the
same. So the vehicle nods from half a leg on, and a range that is not stuck shows it. Meanwhile the
ground's rate, which would be the vehicle's own, makes a descent no faster. What is measured in the first half
of a nod comes from the time before it, and is no answer.
"""

import math
from typing import Self

from companion.core.bounds import clamped, limited
from companion.estimation.ground import ANSWERS, MOVES_ALONG
from companion.records import Ground

APPROACH_PER_S = 0.4
"""Share of the altitude's error that is corrected in a second."""

LEG_SHARE, LEG_M, RISE_LEGS = 0.5, 1.0, 2.0
"""A leg: this share of the range, and its largest length; a rise, which is safe, may have this many legs."""

NOD_M, NOD_S, NOD_FROM = 0.1, 4.0, 0.5
"""Amplitude of the nod, several times the scatter of a range; its period, eight times what is unknown of the
range's delay; and the part of a leg from which it nods."""


class AltitudeHold:
    """A depth that follows the ground. `altitude_m` is NaN until it is taken from where the vehicle is."""

    def __init__(self, altitude_m: float) -> None:
        self.altitude_m = altitude_m
        self.rest()

    @classmethod
    def of(cls, altitude_m: float) -> Self | None:
        """Return one of an altitude; None for NaN."""
        return None if math.isnan(altitude_m) else cls(altitude_m)

    def rest(self) -> None:
        """Begin again from where it will be, and decide anew what to believe."""
        self.depth_m = math.nan
        """What is wanted now, without the nod; NaN before it begins."""
        self.rate_mps = self.acceleration_mps2 = 0.0
        self.doubts = False
        """Whether the range did not answer the vehicle's motion, and has not answered since."""
        self._answered_m = self._ground_m = math.nan
        """Depth and ground of the last answer."""
        self._fails = self._nods = False
        self._nod_share = self._nod_s = 0.0
        self._nod = (0.0, 0.0, 0.0)
        """What the nod adds to the wanted depth, its rate and acceleration."""

    def take(self) -> None:
        """Keep the altitude to which the pilot moves it."""
        self.altitude_m = math.nan
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
            wanted = self._permitted(ground, wanted, acceleration_mps2)
        previous_mps = self.rate_mps
        self.rate_mps += limited(wanted - previous_mps, acceleration_mps2 * dt_s)
        self.acceleration_mps2 = (self.rate_mps - previous_mps) / dt_s if dt_s > 0.0 else 0.0
        self.depth_m += self.rate_mps * dt_s
        self._nod = self._nodded(dt_s)

    def _nodded(self, dt_s: float) -> tuple[float, float, float]:
        """Return the nod after `dt_s`; it swells and ends within half a period."""
        wanted = 1.0 if self._nods else 0.0
        self._nod_share += limited(wanted - self._nod_share, 2.0 * dt_s / NOD_S)
        self._nod_s = self._nod_s + dt_s if self._nod_share > 0.0 else 0.0
        depth_m = NOD_M * self._nod_share * math.sin(math.tau * self._nod_s / NOD_S)
        if not dt_s > 0.0:
            return self._nod
        before_m, before_mps, _ = self._nod
        rate_mps = (depth_m - before_m) / dt_s
        return depth_m, rate_mps, (rate_mps - before_mps) / dt_s

    def _permitted(self, ground: Ground, wanted_mps: float, acceleration_mps2: float) -> float:
        """Return the rate that the range's answers permit, and judge these."""
        if math.isnan(self._answered_m):
            self._answered_m, self._ground_m = self.depth_m, ground.depth_m
        moved_m, ground_m = self.depth_m - self._answered_m, ground.depth_m - self._ground_m
        rests_m = moved_m + 0.5 * self.rate_mps * abs(self.rate_mps) / acceleration_mps2
        leg_m = min(LEG_M, LEG_SHARE * (self._ground_m - self._answered_m))
        far = max(moved_m, -moved_m / RISE_LEGS) >= NOD_FROM * leg_m
        stayed = far and self._nod_share == 0.0 and abs(ground_m) <= ANSWERS * abs(moved_m)
        answers = abs(ground.moves_along) <= ANSWERS and not 0.0 < self._nod_s < 0.5 * NOD_S
        if stayed or answers:
            self._answered_m, self._ground_m = self.depth_m, ground.depth_m
            self.doubts = self._fails = self._nods = False
            return wanted_mps
        self._fails |= abs(ground.moves_along) > MOVES_ALONG
        self.doubts |= self._fails or rests_m >= leg_m or rests_m <= -RISE_LEGS * leg_m
        self._nods = self.doubts or far
        near = ground.depth_m - self.depth_m < LEG_SHARE * self.altitude_m
        if self.doubts:
            evades = wanted_mps < 0.0 and near and not (self._fails and moved_m <= -leg_m)
            return wanted_mps if evades else 0.0
        lacks = ground.depth_m - self.altitude_m - self.depth_m
        return min(wanted_mps, max(self.rate_mps, APPROACH_PER_S * lacks)) if self._nods else wanted_mps

    @property
    def target(self) -> tuple[float, float, float]:
        """Depth, rate and acceleration that are wanted, with the nod."""
        depth_m, rate_mps, acceleration_mps2 = self._nod
        return (
            self.depth_m + depth_m,
            self.rate_mps + rate_mps,
            self.acceleration_mps2 + acceleration_mps2,
        )

    def bound(self, shallow_m: float, deep_m: float) -> None:
        """Stop at the depths that are permitted."""
        if not shallow_m <= self.depth_m <= deep_m:
            self.depth_m = clamped(self.depth_m, shallow_m, deep_m)
            self.rate_mps = self.acceleration_mps2 = 0.0
