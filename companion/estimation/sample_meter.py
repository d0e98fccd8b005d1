"""How noisy the samples of a position are, and how much later than its rate: measured, not assumed by source.

relative_alt is the EKF's depth, or the raw barometer (docs/ardusub.md, "Telemetry"): ten readings a second,
each repeated until the next, with twenty times the noise, and older. Its samples show which of both it is:

| symbol | meaning                                          | unit      | equation                         |
|--------|--------------------------------------------------|-----------|----------------------------------|
| z, w   | position and rate, as measured                   | m, rad, … |                                  |
| d      | what the rate does not explain since the sample  | m; rad    | d = z₁ − z₀ − ∫w                 |
|        | before                                           |           |                                  |
| σ      | white noise: slow noise and motion leave no      | m; rad    | σ² = −E[d₀ d₁]                   |
|        | negative product                                 |           |                                  |
| e, a   | d and the change of w, summed up over LEVEL_S    | m, m/s; … | e = n − δ a, noise n             |
| δ      | delay of the position behind the rate            | s         | δ = −Σ e a/(Σ a² + ρ), ρ for     |
|        |                                                  |           | what is known beforehand         |

The configured noise is the least that is used: a vehicle that has no more keeps its gains to the last bit.
"""

import math
from collections import deque

from companion.core.bounds import clamped, limited, wrap
from companion.core.observers import MAX_GAP_S
from companion.mavlink.ardusub import READING_REPEATS_S

MEMORY_S, FIRST_S = 5.0, 2.0
"""Over how long noise is averaged: 50 readings of a barometer; for how long the configured noise counts at
first."""

NOISY, QUIET = 3.0, 2.0
"""Over the configured noise: from which on the measured one is used, and below which no longer. The EKF's
depth shows its steps of 1 mm: 0.5 to 1.0 mm, with 0.6 mm configured (firmware and simulator)."""

NEAR, GRADE = 1.5, math.sqrt(2.0)
"""The noise in use, the configured one times a power of GRADE, stays while the measured one is this near."""

MOST_NOISE = 0.3
"""m, rad: an even larger noise counts as this one, so that no sensor makes the observer blind."""

OUTLIER, JUMP = 4.0, 1.0
FIRST_STEP = 20.0
"""A larger step than OUTLIER σ, and than FIRST_STEP of the configured noise, counts as that; one of JUMP
(m, rad) or more is no noise: a reset. These and the times below were chosen on
ArduSub 4.5's raw barometer, and on a depth that is a hidden 0.15 s late (e13fbadc)."""

LEVEL_S, DELAY_MEMORY_S, CORRELATED_S = 0.7, 30.0, 0.3
"""What is slower tells nothing of the delay, for it may be a wrong density; how long the delay is remembered;
how long errors are taken to last."""

MOVING = 0.05
"""m/s, rad/s: where a is less, what moves the vehicle is noise that went around the loop, and misleads."""

RAW_LATER_S = 0.053
"""Lateness of a raw barometer beyond climb: no EKF brings it forward (docs/ardusub.md, "Telemetry")."""

START_SPREAD = 0.005
"""m, rad: standard deviation of e to begin with."""

PRIOR_S, TOLERATED_S, LATEST_S = 0.03, 0.02, 0.25
"""Standard deviation of the delay before it is found; largest difference between the delay in use and the one
found; largest delay."""


class SampleMeter:
    """Measures `noise` and `later_s` of one position, and brings its samples on to the time of its rate."""

    def __init__(self, configured: float, later_s: float, *, angular: bool) -> None:
        self.configured = configured
        self._angular = angular
        self._believed_s = later_s
        self.later_s = later_s
        """Delay of the position behind the rate, in use."""
        self.noise = configured
        """Standard deviation of the white noise, in use."""
        self._variance = configured * configured
        self._seen_s = FIRST_S
        self._rates: deque[tuple[float, float, float]] = deque(maxlen=32)
        """When rates of the last 0.6 s were true, the way that they have made by then, and the rates."""
        self._at_s, self._value, self._way, self._rate = math.nan, 0.0, 0.0, 0.0
        self._step = self._e = self._a = self._cross = self._square = 0.0
        self._spread = self._prior_s = 0.0
        self._forget()

    @property
    def noisy(self) -> bool:
        """Whether the noise is not the configured one."""
        return self.noise > self.configured

    def rate(self, at_s: float, rate: float) -> None:
        """Take a sample of the rate."""
        way = 0.0
        if self._rates:
            before_s, way, before = self._rates[-1]
            if 0.0 < at_s - before_s <= MAX_GAP_S:
                way += 0.5 * (rate + before) * (at_s - before_s)
            else:
                self._rates.clear()
                self._at_s = math.nan
        self._rates.append((at_s, way, rate))

    def position(self, at_s: float, value: float) -> float | None:
        """Take a sample; return it as it is at the time of the rate, or None if it only repeats one."""
        gap_s = at_s - self._at_s
        repeats = value == self._value and 0.0 <= gap_s < READING_REPEATS_S
        if not repeats:
            self._learn(at_s, value, gap_s)
        elif self.noisy:
            return None
        if self.later_s == 0.0:
            return value
        return value + self._way_to(at_s)[0] - self._way_to(at_s - self.later_s)[0]

    def _learn(self, at_s: float, value: float, gap_s: float) -> None:
        way, rate = self._way_to(at_s)
        moved, came, faster = value - self._value, way - self._way, rate - self._rate
        self._at_s, self._value, self._way, self._rate = at_s, value, way, rate
        step = (wrap(moved) if self._angular else moved) - came
        if not (0.0 < gap_s <= MAX_GAP_S and abs(step) < JUMP):
            self._step = self._e = self._a = 0.0
            return
        most = max(OUTLIER * OUTLIER * self._variance, (FIRST_STEP * self.configured) ** 2)
        weight = gap_s / (self._seen_s + gap_s)
        self._seen_s = min(self._seen_s + gap_s, MEMORY_S)
        self._variance += weight * (limited(-step * self._step, most) - self._variance)
        self._step = step
        self._use(math.sqrt(max(self._variance, 0.0)))

        keep, forget = math.exp(-gap_s / LEVEL_S), math.exp(-gap_s / DELAY_MEMORY_S)
        self._e, self._a = keep * self._e + step, keep * self._a + faster
        if abs(self._a) < MOVING:
            return
        left = self._e + self.later_s * self._a
        self._spread += weight * (min(left * left, OUTLIER * OUTLIER * self._spread) - self._spread)
        self._cross = forget * self._cross - self._e * self._a * gap_s
        self._square = forget * self._square + self._a * self._a * gap_s
        doubt = self._spread * CORRELATED_S / (PRIOR_S * PRIOR_S)
        found_s = (self._cross + self._prior_s * doubt) / (self._square + doubt)
        near_s = clamped(self.later_s, found_s - TOLERATED_S, found_s + TOLERATED_S)
        self.later_s = clamped(near_s, 0.0, LATEST_S)

    def _use(self, found: float) -> None:
        """Use the noise that was found, where it is much more than the configured one."""
        was = self.noisy
        if found <= (QUIET if was else NOISY) * self.configured:
            self.noise = self.configured
        elif not self.noise / NEAR < found < self.noise * NEAR:
            grades = round(math.log(found / self.configured, GRADE))
            self.noise = min(self.configured * GRADE**grades, max(MOST_NOISE, self.configured))
        if self.noisy is not was:  # another source
            self._forget()

    def _forget(self) -> None:
        """Take the delay for what is known beforehand of such a source."""
        self._prior_s = self.later_s = max(
            self._believed_s, RAW_LATER_S if self.noisy and not self._angular else 0.0
        )
        self._e = self._a = self._cross = self._square = 0.0
        self._spread = max(self._variance, START_SPREAD * START_SPREAD)

    def _way_to(self, at_s: float) -> tuple[float, float]:
        """Return the way that the rates have made until a time, and the rate then; 0 without rates."""
        for time_s, way, rate in reversed(self._rates):
            if time_s <= at_s:
                return way + rate * min(at_s - time_s, MAX_GAP_S), rate
        return (self._rates[0][1], self._rates[0][2]) if self._rates else (0.0, 0.0)
