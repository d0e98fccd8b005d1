"""How deep the ground lies under the vehicle, from the ranges of a sonar or a DVL that looks down.

| symbol | meaning                                                                        | unit |
|--------|--------------------------------------------------------------------------------|------|
| g      | depth of the ground: depth + range · cos(roll) cos(pitch), of the range's time | m    |
| v      | how fast it falls under the vehicle that moves over it                         | m/s  |
| θ      | exp(−ω dt): what is left of a deviation after dt                               |      |
| T      | delay of the range, beyond that of telemetry: `delays.range_s`                 | s    |

A fading-memory filter with a double pole: g += (1 − θ²) e, v += (1 − θ)² e / dt, e = sample − (g + v dt). It
follows a slope without lag. A sample that jumps is left out. Only a row of samples that agree with each other
is believed: a rise soon, because the vehicle might hit it, and a fall later.

A range that is added to a depth of another time moves the ground with the vehicle, and an altitude that is
held then oscillates. So it is added to the depth of T before it was sent.
"""

import math
from bisect import bisect_right
from collections.abc import Sequence
from typing import NamedTuple

from companion.records import Ground, Range

OMEGA_RADPS = 2.0
JUMP_M = 0.5
"""A sample further from the filter than this is left out."""

RISE_BELIEVED_S, FALL_BELIEVED_S = 1.0, 3.0
AGREEING = 5
"""Samples that have to agree as well."""

LOST_S = 1.0
"""Without a sample that was taken for longer than this, the ground is unknown."""

MAX_TILT_COS = math.cos(math.radians(60.0))
"""A range further from the vertical is left out. The ground is taken for flat up to there."""
MAX_SLOPE_MPS = 0.5
UNKNOWN = Ground(math.nan, 0.0)

HISTORY_S = 1.0
"""How much longer than the range's delay the vehicle's depth is kept: telemetry is late too."""


class Track(NamedTuple):
    """The filter's ground, and the rate at which it falls."""

    depth_m: float
    rate_mps: float


class GroundFinder:
    """Takes each tick's ranges, which are `range_delay_s` late; says where the ground is."""

    def __init__(self, range_delay_s: float = 0.0) -> None:
        self._delay_s = range_delay_s
        self._times_s: list[float] = []
        self._poses: list[tuple[float, float]] = []
        self._track = Track(math.nan, 0.0)
        self._at_s = self._came_s = -math.inf
        self._other_m, self._other_since_s, self._agreeing = math.nan, -math.inf, 0

    def step(
        self,
        now_s: float,
        ranges: Sequence[Range],
        depth_m: float,
        tilt_cos: float,
        telemetry_s: float = 0.0,
    ) -> Ground:
        """Take the ranges that came, `telemetry_s` after they were sent.

        `depth_m` is the vehicle's now, `tilt_cos` of its down axis; NaN where it is not known.
        """
        self._times_s.append(now_s)
        self._poses.append((depth_m, tilt_cos))
        while self._times_s[0] < now_s - self._delay_s - HISTORY_S:
            del self._times_s[0], self._poses[0]
        for one in ranges:
            self._take(one, one.t_s - telemetry_s)
        if not now_s - self._came_s <= LOST_S:
            return UNKNOWN
        depth_m, rate_mps = self._track
        return Ground(depth_m + rate_mps * max(now_s - self._at_s, 0.0), rate_mps)

    def _take(self, one: Range, sent_s: float) -> None:
        measured_s = sent_s - self._delay_s
        sample_m = self._sample_m(one.range_m, measured_s)
        gap_s = one.t_s - self._came_s
        if math.isnan(sample_m) or gap_s <= 0.0:
            return
        at_s = max(measured_s, self._at_s + 0.5 * gap_s if gap_s <= LOST_S else -math.inf)
        error_m = sample_m - (self._track.depth_m + self._track.rate_mps * (at_s - self._at_s))
        if gap_s <= LOST_S and abs(error_m) <= JUMP_M:
            self._track = _followed(self._track, sample_m, at_s - self._at_s)
            self._came_s, self._at_s, self._agreeing = one.t_s, at_s, 0
        else:
            self._doubt(one.t_s, at_s, sample_m)

    def _sample_m(self, range_m: float, at_s: float) -> float:
        """Return the ground's depth of a range that was true at `at_s`; NaN where it says nothing."""
        depth_m, tilt_cos = self._pose(at_s)
        return depth_m + range_m * tilt_cos if tilt_cos >= MAX_TILT_COS else math.nan

    def _pose(self, at_s: float) -> tuple[float, float]:
        """Return depth and cosine of the tilt at a time; before the first the first."""
        times_s, poses = self._times_s, self._poses
        after = bisect_right(times_s, at_s)
        if after == 0 or after == len(times_s):
            return poses[min(after, len(poses) - 1)]
        before = after - 1
        part = (at_s - times_s[before]) / (times_s[after] - times_s[before])
        (z, tilt), (z_after, tilt_after) = poses[before], poses[after]
        return z + part * (z_after - z), tilt + part * (tilt_after - tilt)

    def _doubt(self, t_s: float, at_s: float, sample_m: float) -> None:
        """Count the samples that agree with each other and not with the filter; believe enough of them."""
        if not self._agreeing or abs(sample_m - self._other_m) > JUMP_M:
            self._other_since_s, self._agreeing = t_s, 0
        self._other_m, self._agreeing = sample_m, self._agreeing + 1
        rises = not sample_m > self._track.depth_m
        long_s = RISE_BELIEVED_S if rises else FALL_BELIEVED_S
        if t_s - self._other_since_s >= long_s and self._agreeing >= AGREEING:
            self._track, self._came_s, self._at_s = Track(sample_m, 0.0), t_s, at_s
            self._agreeing = 0


def _followed(track: Track, sample_m: float, gap_s: float) -> Track:
    """Return a filter after a sample, `gap_s` after the one before."""
    error_m = sample_m - (track.depth_m + track.rate_mps * gap_s)
    theta = math.exp(-OMEGA_RADPS * gap_s)
    rate_mps = track.rate_mps + (1.0 - theta) ** 2 * error_m / gap_s
    rate_mps = max(-MAX_SLOPE_MPS, min(rate_mps, MAX_SLOPE_MPS))
    return Track(sample_m - theta**2 * error_m, rate_mps)
