"""How deep the ground lies under the vehicle, from the ranges of a sonar or a DVL that looks down.

| symbol | meaning                                                                        | unit |
|--------|--------------------------------------------------------------------------------|------|
| g      | depth of the ground: depth + range · cos(roll) cos(pitch), of the range's time | m    |
| v      | how fast it falls under the vehicle that moves over it                         | m/s  |
| θ      | exp(−ω dt): what is left of a deviation after dt                               |      |
| T      | delay of the range, beyond that of telemetry: `delays.range_s`                 | s    |
| f      | how much of the vehicle's own vertical motion the ground makes                 |      |

A fading-memory filter with a double pole, which follows a slope without lag: g += (1 − θ²) e,
v += (1 − θ)² e / dt, e = sample − (g + v dt). Of samples that jump only a row that agrees is believed.

A ground that moves as the vehicle does is none: f is 0 for a range that answers the vehicle's motion, 1 for
one that is stuck or drifts by itself, 2 for one of the wrong sign, 1 − k for one that is k times too long. It
is the regression of the ground's deviations from straight motion on the vehicle's, and on their rate, which
takes up a delay other than T: in-phase part or amplitude, whichever is further from an answer.
"""

import math
from bisect import bisect_right
from collections.abc import Sequence
from operator import itemgetter
from typing import NamedTuple

from companion.records import Ground, Range

OMEGA_RADPS = 2.0
"""1/s; this and what follows were chosen (325ff984)."""

JUMP_M = 0.5
"""A sample further from the filter than this is left out."""

RISE_BELIEVED_S, FALL_BELIEVED_S = 1.0, 3.0
"""A rise sooner than a fall: the vehicle might hit it."""

AGREEING = 5
"""Samples that have to agree as well."""

LOST_S = 1.0
"""If no sample is accepted for longer than this, the ground is unknown."""

MAX_TILT_COS = math.cos(math.radians(60.0))
"""A range further from the vertical is left out."""
MAX_SLOPE_MPS = 0.5
UNKNOWN = Ground(math.nan, 0.0)

ANSWER_OMEGA_RADPS, ANSWER_MEMORY_S = 1.5, 5.0
"""High-pass of the motion, quicker than the vehicle follows a ground; memory of the fit, a nod's period."""

SCATTER_M, LEAST_INFORMATION = 0.015, 25.0
"""Least standard deviation of a range, in whole centimetres; f is reported when its own is below 1/5."""

HISTORY_S = 1.0
"""How much longer than the range's delay the vehicle's depth is kept: telemetry is late too."""

ANSWERS, MOVES_ALONG = 0.5, 0.7
"""Share of the vehicle's vertical motion that the estimated ground follows. Below 0.5 the range is real.
Above 0.7 (one standard deviation, 0.2, beyond one half) the range is stuck."""


class GroundTrack(NamedTuple):
    """The filter's ground, and the rate at which it falls."""

    depth_m: float
    rate_mps: float


class Answer:
    """Tells f from samples of the ground's depth and the vehicle's, of the same times."""

    def __init__(self) -> None:
        self._ground = self._depth = GroundTrack(math.nan, 0.0)
        self._before_m = 0.0
        self._sums = (0.0,) * 5
        self._scatter, self._count = 0.0, 0.0

    def take(self, ground_m: float, depth_m: float, gap_s: float) -> float:
        """Return f after one more pair, `gap_s` after the one before; NaN while the motion was too small."""
        if math.isnan(self._ground.depth_m):
            self._ground, self._depth = GroundTrack(ground_m, 0.0), GroundTrack(depth_m, 0.0)
        g = ground_m - (self._ground.depth_m + self._ground.rate_mps * gap_s)
        e = depth_m - (self._depth.depth_m + self._depth.rate_mps * gap_s)
        self._ground = _followed(self._ground, ground_m, gap_s, ANSWER_OMEGA_RADPS)
        self._depth = _followed(self._depth, depth_m, gap_s, ANSWER_OMEGA_RADPS)
        r, self._before_m = (e - self._before_m) / gap_s, e
        fade = math.exp(-gap_s / ANSWER_MEMORY_S)
        ee, er, rr, ge, gr = (
            fade * total + term
            for total, term in zip(self._sums, (e * e, e * r, r * r, g * e, g * r), strict=True)
        )
        self._sums = ee, er, rr, ge, gr
        apart = ee * rr - er * er
        if not apart > 1e-12:
            return math.nan
        f, late_s = (ge * rr - gr * er) / apart, (gr * ee - ge * er) / apart
        self._count = fade * self._count + 1.0
        self._scatter = fade * self._scatter + (g - f * e - late_s * r) ** 2
        information = apart / rr / (self._scatter / self._count + SCATTER_M**2)
        if information < LEAST_INFORMATION:
            return math.nan
        self._sums = (0.0,) * 5
        response = math.hypot(1.0 - f, late_s * math.sqrt(rr / ee))
        return f if abs(f) >= abs(1.0 - response) else 1.0 - response


class Sensor:
    """Finds the ground by the ranges of one sensor."""

    def __init__(self) -> None:
        self._track = GroundTrack(math.nan, 0.0)
        self._at_s = self._came_s = -math.inf
        self._other_m, self._other_since_s, self._agreeing = math.nan, -math.inf, 0
        self._answer, self._moves_along = Answer(), math.nan
        self.failed = False
        """Whether its ground has moved along, and not stood still since."""

    def ground(self, now_s: float) -> Ground:
        """Return where the ground is by now."""
        if not now_s - self._came_s <= LOST_S:
            return UNKNOWN
        depth_m, rate_mps = self._track
        ground_m = depth_m + rate_mps * max(now_s - self._at_s, 0.0)
        return Ground(ground_m, rate_mps, self._moves_along)

    def take(self, one: Range, measured_s: float, depth_m: float, tilt_cos: float) -> None:
        """Take a range, and depth and tilt of when it was measured."""
        self._moves_along = math.nan
        sample_m = depth_m + one.range_m * tilt_cos if tilt_cos >= MAX_TILT_COS else math.nan
        gap_s = one.t_s - self._came_s
        if math.isnan(sample_m) or gap_s <= 0.0:
            return
        at_s = max(measured_s, self._at_s + 0.5 * gap_s if gap_s <= LOST_S else -math.inf)
        error_m = sample_m - (self._track.depth_m + self._track.rate_mps * (at_s - self._at_s))
        if gap_s <= LOST_S and abs(error_m) <= JUMP_M:
            followed, rate_mps = _followed(self._track, sample_m, at_s - self._at_s, OMEGA_RADPS)
            self._track = GroundTrack(followed, max(-MAX_SLOPE_MPS, min(rate_mps, MAX_SLOPE_MPS)))
            self._moves_along = self._answer.take(sample_m, depth_m, at_s - self._at_s)
            self._came_s, self._at_s, self._agreeing = one.t_s, at_s, 0
        else:
            self._doubt(one.t_s, at_s, sample_m)
        if abs(self._moves_along) > MOVES_ALONG:
            self.failed = True
        elif abs(self._moves_along) <= ANSWERS:
            self.failed = False

    def _doubt(self, t_s: float, at_s: float, sample_m: float) -> None:
        """Count the samples that agree with each other and not with the filter; believe enough of them."""
        if not self._agreeing or abs(sample_m - self._other_m) > JUMP_M:
            self._other_since_s, self._agreeing = t_s, 0
        self._other_m, self._agreeing = sample_m, self._agreeing + 1
        rises = not sample_m > self._track.depth_m
        long_s = RISE_BELIEVED_S if rises else FALL_BELIEVED_S
        if t_s - self._other_since_s >= long_s and self._agreeing >= AGREEING:
            self._track, self._came_s, self._at_s = GroundTrack(sample_m, 0.0), t_s, at_s
            self._agreeing = 0
            self._answer = Answer()


class Grounds:
    """The ground by one sensor of several: by one that answers, and as long as it does by the same."""

    def __init__(self, range_delay_s: float = 0.0) -> None:
        self._delay_s = range_delay_s
        self._poses: list[tuple[float, float, float]] = []
        """The vehicle of late: time, depth (m), cosine of the tilt."""
        self._sensors: dict[int, Sensor] = {}
        self._chosen = -1

    def step(
        self, now_s: float, ranges: Sequence[Range], depth_m: float, tilt_cos: float, telemetry_s: float = 0.0
    ) -> Ground:
        """Take the ranges that came, `telemetry_s` after they were sent; return the ground of the best.

        `depth_m` is the vehicle's now, `tilt_cos` of its down axis; NaN where it is not known.
        """
        self._poses.append((now_s, depth_m, tilt_cos))
        while self._poses[0][0] < now_s - self._delay_s - HISTORY_S:
            del self._poses[0]
        for one in ranges:
            measured_s = one.t_s - telemetry_s - self._delay_s
            sensor = self._sensors.setdefault(one.sensor, Sensor())  # 256 at most, by one byte
            sensor.take(one, measured_s, *self._pose(measured_s))
        best, most = UNKNOWN, -1
        for number, sensor in self._sensors.items():
            ground = sensor.ground(now_s)
            worth = 4 * ground.known + 2 * (not sensor.failed) + (number == self._chosen)
            if worth > most:
                best, most, chosen = ground, worth, number
        if self._sensors:
            self._chosen = chosen
        return best

    def _pose(self, at_s: float) -> tuple[float, float]:
        """Return depth and cosine of the tilt at a time; before the first the first."""
        poses = self._poses
        after = bisect_right(poses, at_s, key=itemgetter(0))
        if after == 0 or after == len(poses):
            return poses[min(after, len(poses) - 1)][1:]
        (t_s, z, tilt), (t_after_s, z_after, tilt_after) = poses[after - 1], poses[after]
        part = (at_s - t_s) / (t_after_s - t_s)
        return z + part * (z_after - z), tilt + part * (tilt_after - tilt)


def _followed(track: GroundTrack, sample_m: float, gap_s: float, omega_radps: float) -> GroundTrack:
    error_m = sample_m - (track.depth_m + track.rate_mps * gap_s)
    theta = math.exp(-omega_radps * gap_s)
    rate_mps = track.rate_mps + (1.0 - theta) ** 2 * error_m / gap_s
    return GroundTrack(sample_m - theta**2 * error_m, rate_mps)
