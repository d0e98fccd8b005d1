"""How deep the ground lies under the vehicle, from the ranges of a sonar or a DVL that looks down.

| symbol | meaning                                                              | unit |
|--------|----------------------------------------------------------------------|------|
| g      | depth of the ground: depth + range · cos(roll) cos(pitch)            | m    |
| v      | how fast it falls under the vehicle that moves over it               | m/s  |
| θ      | exp(−ω dt): what is left of a deviation after dt                     |      |

A fading-memory filter with a double pole: g += (1 − θ²) e, v += (1 − θ)² e / dt, e = sample − (g + v dt). It
follows a slope without lag. A sample that jumps is left out. Only a row of samples that agree with each other
is believed: a rise soon, because the vehicle might hit it, and a fall later.
"""

import math
from collections.abc import Sequence

from companion.records import Ground, Range

OMEGA_RADPS = 2.0
JUMP_M = 0.5
"""A sample further from the filter than this is left out."""

RISE_BELIEVED_S, FALL_BELIEVED_S = 1.0, 3.0
AGREEING = 5
"""Samples that have to agree as well."""

LOST_S = 1.0
"""Without a sample that was taken for longer than this, the ground is unknown."""

MAX_TILT_COS = math.cos(math.radians(30.0))
MAX_SLOPE_MPS = 0.5
UNKNOWN = Ground(math.nan, 0.0)


class GroundFinder:
    """Takes each tick's ranges; says where the ground is."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Forget the ground."""
        self._depth_m, self._rate_mps, self._at_s = math.nan, 0.0, -math.inf
        self._other_m, self._other_since_s, self._agreeing = math.nan, -math.inf, 0

    def step(self, now_s: float, ranges: Sequence[Range], depth_m: float, tilt_cos: float) -> Ground:
        """Take the ranges that came; `depth_m` is the vehicle's, `tilt_cos` of its down axis."""
        for one in ranges:
            if tilt_cos >= MAX_TILT_COS:
                self._take(one.t_s, depth_m + one.range_m * tilt_cos)
        gap_s = now_s - self._at_s
        if not gap_s <= LOST_S:
            return UNKNOWN
        return Ground(self._depth_m + self._rate_mps * max(gap_s, 0.0), self._rate_mps)

    def _take(self, t_s: float, sample_m: float) -> None:
        gap_s = t_s - self._at_s
        if gap_s <= 0.0:
            return
        error_m = sample_m - (self._depth_m + self._rate_mps * gap_s)
        if gap_s <= LOST_S and abs(error_m) <= JUMP_M:
            theta = math.exp(-OMEGA_RADPS * gap_s)
            rate = self._rate_mps + (1.0 - theta) ** 2 * error_m / gap_s
            self._depth_m = sample_m - theta**2 * error_m
            self._rate_mps = max(-MAX_SLOPE_MPS, min(rate, MAX_SLOPE_MPS))
            self._at_s = t_s
            self._agreeing = 0
        else:
            self._doubt(t_s, sample_m)

    def _doubt(self, t_s: float, sample_m: float) -> None:
        """Count the samples that agree with each other and not with the filter; believe enough of them."""
        if not self._agreeing or abs(sample_m - self._other_m) > JUMP_M:
            self._other_since_s, self._agreeing = t_s, 0
        self._other_m, self._agreeing = sample_m, self._agreeing + 1
        rises = not sample_m > self._depth_m
        long_s = RISE_BELIEVED_S if rises else FALL_BELIEVED_S
        if t_s - self._other_since_s >= long_s and self._agreeing >= AGREEING:
            self._depth_m, self._rate_mps, self._at_s = sample_m, 0.0, t_s
            self._agreeing = 0
