"""Resets of the autopilot's estimate: a step of yaw, position or depth that its own rates do not explain.

The EKF may find that its yaw or position was wrong and correct it at once ("in-flight yaw alignment
complete"); relative_alt gets another zero when home or origin is set. The vehicle did not move then; the
frame in which it is measured did. Inside, nothing moves (`estimation.frame`).
"""

import math
from collections import deque

from companion.core.bounds import wrap
from companion.core.observers import MAX_GAP_S

YAW_RESET_RAD = math.radians(1.0)
"""In two logs of real vehicles no yaw differed by more than 0.2° from what its rates gave (docs/ardusub.md,
"Telemetry")."""

MAX_YAW_ACCELERATION = 40.0
"""rad/s²: what thrusters or a blow may do between two samples; a turn of 40° within 0.3 s takes 31."""

POSITION_RESET_M = 0.1
"""A USBL's fix moves an EKF by more. A velocity that is wrong by more than 0.1 m/s looks like jumps."""

POSITION_WARNED_M = 0.25
"""A jump that is larger is reported."""

MAX_ACCELERATION = 5.0
"""m/s², likewise; chosen (7a814046)."""

DEPTH_RESET_M = 0.04
"""Smaller jumps are followed. In waves relative_alt differs from the integrated climb rate by 15 mm at
most (simulator)."""

MEMORY_S = 1.0
"""Resets that are each too small are added up over this time: a yaw that is corrected by less than about
1 °/s is followed."""

BLIND_S, BLIND_YAW_RAD, BLIND_POSITION_M = 2.0, math.radians(20.0), 0.5
"""What a short interruption may add to the fastest rate before and after it; chosen."""

NOISE_LASTS_S = 5.0
"""What the climb rate did not explain within this time counts as the noise of depth; so slowly the usual
difference of depth and pressure follows the present one."""

WANDER_LASTS_S = 60.0
"""The time for noise that comes and goes, such as the lag of an EKF with GPS in waves.
This and the next were chosen on dives of ArduSub 4.5 whose home was set in mid-dive (f3de568a)."""

PRESSURE_LASTS_S = 1.2
"""A pressure that is older says nothing: with nobody asking it comes at 2 Hz."""

JUDGED_AFTER_S = 0.15
"""A pressure that was true this long after a reset of depth shows whether the vehicle moved."""

SPIKE_M, SPIKE_S = 0.5, 0.11
"""A pressure that jumped by this, and away from the depth, or a depth that jumped, is a spike unless it lasts
longer than a barometer's reading, which may come in many messages."""

MOST_IN_A_ROW = 8
"""Without a pressure more jumps than that, with less than MEMORY_S between them, are a wrong climb rate."""


class ResetDetector:
    """Compares each sample of one signal with what the rates say it should be since the sample before.

    Between two samples the rate is a straight line. The uncertainty is what another one can add: half of its
    change times the gap, and what `max_acceleration` gives and takes back in it. Where it is larger than the
    threshold, what does not exceed it is not added up. Over a gap of up to BLIND_S `blind` is added to the
    way at the larger rate.
    """

    def __init__(
        self, threshold: float, max_acceleration: float, blind: float = math.inf, *, angular: bool
    ) -> None:
        self.threshold, self._blind = threshold, blind
        self._max_acceleration = max_acceleration
        self._angular = angular
        self._at_s = math.nan
        self._value = self._rate = self.unexplained = 0.0
        self.rate_change = 0.0
        """Change of the rate from the sample before to the last one."""

    def extrapolated(self, at_s: float) -> float:
        """Return the signal's value at `at_s`, soon after its last sample; 0 before the first."""
        gap_s = at_s - self._at_s
        return self._value + self._rate * gap_s if 0.0 < gap_s <= MAX_GAP_S else self._value

    def step(self, at_s: float, value: float, rate: float) -> float:
        """Take the sample that was true at `at_s` (autopilot's clock); return the reset it shows, or 0."""
        gap_s = at_s - self._at_s
        moved, self.rate_change = value - self._value, rate - self._rate
        expected = 0.5 * gap_s * (rate + self._rate)
        self._at_s, self._value, self._rate = at_s, value, rate
        innovation = wrap(moved - expected) if self._angular else moved - expected
        if not 0.0 < gap_s <= MAX_GAP_S:
            self.unexplained = 0.0
            most = self._blind + (abs(rate) + abs(self.rate_change)) * gap_s
            return innovation if 0.0 < gap_s <= BLIND_S and abs(innovation) > most else 0.0
        uncertainty = 0.5 * abs(self.rate_change) * gap_s + 0.25 * self._max_acceleration * gap_s**2
        self.unexplained *= math.exp(-gap_s / MEMORY_S)
        if uncertainty < self.threshold or abs(innovation) > uncertainty:
            self.unexplained += innovation
        return self.rest() if abs(self.unexplained) > self.threshold + uncertainty else 0.0

    def rest(self) -> float:
        """Return what the rates have not explained so far, and begin again."""
        unexplained, self.unexplained = self.unexplained, 0.0
        return unexplained


class Spikes:
    """Leaves out what is far from where it should be, until it has been so for SPIKE_S."""

    def __init__(self) -> None:
        self._since_s = math.inf
        self.over = False
        """Whether the last sample came after a spike."""

    def leave_out(self, at_s: float, *, far: bool) -> bool:
        """Take when a sample was true and whether it is far; tell whether to leave it out."""
        self.over = not far and math.isfinite(self._since_s)
        self._since_s = min(self._since_s, at_s) if far else math.inf
        if at_s - self._since_s >= SPIKE_S:
            self._since_s = -math.inf
        return self.doubtful

    @property
    def doubtful(self) -> bool:
        """Whether the last sample was left out."""
        return math.isfinite(self._since_s)


def yaw_resets() -> ResetDetector:
    """Return the detector for yaw (rad) and its rate."""
    return ResetDetector(YAW_RESET_RAD, MAX_YAW_ACCELERATION, BLIND_YAW_RAD, angular=True)


def position_resets() -> ResetDetector:
    """Return the detector for one horizontal coordinate (m) and its rate."""
    return ResetDetector(POSITION_RESET_M, MAX_ACCELERATION, BLIND_POSITION_M, angular=False)


class DepthResets:
    """Finds the resets of depth: what neither the climb rate nor, where it comes, the pressure explains.

    A jump is believed at once, and the pressure (SCALED_PRESSURE) that comes later takes it back if it shows
    the jump as well. What comes in many small steps is believed once pressure says so. A noisy depth, such as
    the raw barometer's, has to jump by twice its noise; jumps that were motion count as noise.
    """

    def __init__(self) -> None:
        self._detector = ResetDetector(DEPTH_RESET_M, MAX_ACCELERATION, angular=False)
        self._noise_m = self._usual_noise_m = 0.0
        """Now, and when the difference of depth and pressure was the usual one last."""
        self._depths = deque[tuple[float, float]](maxlen=25)
        """The last samples: when they were true (autopilot's clock), and m."""
        self.late = False
        """Whether the last pressure has shown a reset that looked like a motion until then."""
        self._doubtful: list[tuple[float, float]] = []
        """Resets that no pressure has judged: when, and m."""
        self.spikes = Spikes()
        """Spikes of the pressure."""
        self._pressure_s, self._pressed_m = -math.inf, math.nan
        self._usual_m = math.nan
        """Usual difference between depth and the pressure's depth."""
        self._peak_m = self._wander_m = 0.0
        """How far the difference has gone since it was the usual one, and how far it goes and returns."""

    def step(self, at_s: float, depth_m: float, rate_mps: float, surprise_m: float, *, climbs: bool) -> float:
        """Take a depth as `ResetDetector.step` does; return the reset it shows (m), or 0.

        `surprise_m` is how far it is from our own prediction; `climbs` tells whether `rate_mps` was measured.
        """
        detector, pressed = self._detector, at_s - self._pressure_s < PRESSURE_LASTS_S
        if not pressed:
            self._usual_m = math.nan
            if self._doubtful and at_s - self._doubtful[-1][0] > MEMORY_S:
                self.accept()
        gap_s = max(at_s - self._depths[-1][0], 0.0) if self._depths else 0.0
        self._depths.append((at_s, depth_m))
        self._noise_m *= math.exp(-gap_s / NOISE_LASTS_S)
        detector.threshold = max(DEPTH_RESET_M, 2.0 * self._noise_m)
        reset_m = detector.step(at_s, depth_m, rate_mps)
        if not reset_m:
            self._noise_m = max(self._noise_m, abs(detector.unexplained))
        elif not pressed and len(self._doubtful) >= MOST_IN_A_ROW:
            self._noise_m = max(self._noise_m, abs(reset_m))
        elif pressed or (climbs and 2.0 * surprise_m * reset_m > reset_m**2):
            self._doubtful.append((at_s, reset_m))
            return self._took(reset_m)
        return 0.0

    def pressed(self, at_s: float, depth_m: float) -> float:
        """Take the pressure's depth that was true at `at_s`; return the reset it shows, or takes back."""
        self.late = False
        gap_s = max(at_s - self._pressure_s, 0.0)
        self._pressure_s = at_s
        self._wander_m *= math.exp(-gap_s / WANDER_LASTS_S)
        difference_m = next((z for t_s, z in reversed(self._depths) if t_s <= at_s), math.nan) - depth_m
        if math.isnan(self._usual_m):
            self._usual_m = difference_m
        surprise_m = difference_m - self._usual_m
        jumped = abs(surprise_m) > SPIKE_M and abs(depth_m - self._pressed_m) > SPIKE_M
        if self.spikes.leave_out(at_s, far=jumped and not self._doubtful):
            return 0.0
        self._pressed_m = depth_m
        if self._doubtful:
            if at_s - self._doubtful[0][0] < JUDGED_AFTER_S:
                return 0.0
            judged_m = sum(reset_m for t_s, reset_m in self._doubtful if t_s <= at_s)
            self._doubtful = [(t_s, reset_m) for t_s, reset_m in self._doubtful if t_s > at_s]
            surprise_m += sum(reset_m for _, reset_m in self._doubtful)
            if abs(surprise_m + judged_m) < 0.5 * abs(judged_m):
                self._noise_m = max(self._noise_m, abs(judged_m))
                return self._took(-judged_m)
        unlike_m = self._detector.unexplained - surprise_m
        if surprise_m * self._peak_m < 0.0:
            self._wander_m, self._peak_m = max(self._wander_m, abs(self._peak_m)), 0.0
        self._peak_m = max(self._peak_m, surprise_m, key=abs)
        if abs(surprise_m) < 0.25 * DEPTH_RESET_M:
            self._usual_noise_m = self._noise_m
        least_m = max(DEPTH_RESET_M, 4.0 * self._usual_noise_m, 3.0 * self._wander_m)
        if max(2.0 * abs(unlike_m), least_m) < abs(surprise_m):
            self._detector.unexplained, self._noise_m = 0.0, self._usual_noise_m
            self.late = True
            return self._took(surprise_m)
        self._usual_m += (1.0 - math.exp(-gap_s / NOISE_LASTS_S)) * surprise_m
        return 0.0

    def accept(self) -> None:
        """Take nothing back of what was reset so far."""
        self._doubtful.clear()

    def _took(self, reset_m: float) -> float:
        self._usual_m += reset_m
        return reset_m
