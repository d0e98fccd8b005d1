"""Resets of the autopilot's estimate: a step of yaw or position that its own rates do not explain.

The EKF may find that its yaw or position was wrong and correct it at once ("in-flight yaw alignment
complete"). The vehicle did not move then; the frame in which it is measured did. Inside, nothing moves
(`estimation.frame`).
"""

import math

from companion.control.bounds import wrap

YAW_RESET_RAD = math.radians(1.0)
"""In two logs of real vehicles no yaw differed by more than 0.2° from what its rates gave (docs/ardusub.md,
"Telemetry")."""

MAX_YAW_ACCELERATION = 40.0
"""rad/s²: what thrusters or a blow may do between two samples; a turn of 40° within 0.3 s takes 31."""

POSITION_RESET_M = 0.1
"""Less than a USBL's fix moves an EKF. A velocity that is wrong by more than 0.1 m/s looks like jumps."""

POSITION_WARNED_M = 0.25
"""A jump that is larger is told."""

MAX_ACCELERATION = 5.0
"""m/s², likewise."""

MEMORY_S = 1.0
"""Resets that are each too small are added up over this time. So a yaw that is corrected in many small steps
by more than about 1 °/s counts as reset as well; a slower correction is followed."""

MAX_GAP_S = 0.5
"""Over a longer gap nothing is known: the first sample after it starts again."""


class ResetDetector:
    """Compares each sample of one signal with what the rates say it should be since the sample before.

    Between two samples the rate is taken as a straight line. What a rate that does not follow this line can
    add is the uncertainty: half of its change times the gap, and what `max_acceleration` gives and takes back
    in the gap. It is no reset, so a gap in the telemetry while the vehicle really turns is none. Where it is
    larger than the threshold, what does not exceed it is not added up.
    """

    def __init__(self, threshold: float, max_acceleration: float, *, angular: bool) -> None:
        self._threshold = threshold
        self._max_acceleration = max_acceleration
        self._angular = angular
        self.restart()

    def restart(self) -> None:
        """Forget the last sample."""
        self._at_s = math.nan
        self._value = self._rate = self._unexplained = 0.0

    def extrapolated(self, at_s: float) -> float:
        """Return the signal's value at `at_s`, soon after its last sample; 0 before the first."""
        gap_s = at_s - self._at_s
        return self._value + self._rate * gap_s if 0.0 < gap_s <= MAX_GAP_S else self._value

    def step(self, at_s: float, value: float, rate: float) -> float:
        """Take the sample that was true at `at_s` (autopilot's clock); return the reset it shows, or 0."""
        gap_s = at_s - self._at_s
        moved, rate_change = value - self._value, rate - self._rate
        expected = 0.5 * gap_s * (rate + self._rate)
        self._at_s, self._value, self._rate = at_s, value, rate
        if not 0.0 < gap_s <= MAX_GAP_S:
            self._unexplained = 0.0
            return 0.0
        innovation = wrap(moved - expected) if self._angular else moved - expected
        uncertainty = 0.5 * abs(rate_change) * gap_s + 0.25 * self._max_acceleration * gap_s**2
        self._unexplained *= math.exp(-gap_s / MEMORY_S)
        if uncertainty < self._threshold or abs(innovation) > uncertainty:
            self._unexplained += innovation
        if not abs(self._unexplained) > self._threshold + uncertainty:
            return 0.0
        reset, self._unexplained = self._unexplained, 0.0
        return reset


def yaw_resets() -> ResetDetector:
    """Return the detector for yaw (rad) and its rate."""
    return ResetDetector(YAW_RESET_RAD, MAX_YAW_ACCELERATION, angular=True)


def position_resets() -> ResetDetector:
    """Return the detector for one horizontal coordinate (m) and its rate."""
    return ResetDetector(POSITION_RESET_M, MAX_ACCELERATION, angular=False)
