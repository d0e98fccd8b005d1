"""When a DVL reports, and which of its reports are invalid; the EKF carries its velocity on in between.

A Water Linked A50 in a pool, 1156 reports, github nschang/mr-dvl, commit 6dde9a8.
"""

import numpy as np

from sim_bridge.sim_config import DvlReports

DELAY_S = 0.1
"""Age of a velocity that the EKF takes for new. Assumed: about as long as a ping takes."""
USUAL_S, LATE_S = (0.117, 0.015), (0.39, 0.07)
"""Time since the last report, and its standard deviation."""
LATE_EVERY = 8
"""Each eighth or ninth report is late."""
OUTAGES_PER_MIN = (1.7, 22.0)
"""Of the time in which it measures: on a straight line, and turning at TURNING_RAD_S or faster (19.5 of all
time); linear between them."""
TURNING_RAD_S = 0.5
"""Turn rate in the circle. Assumed: the recording has none."""
LONG_SHARE, LONG_S, LONGEST_S = 0.25, 0.9, 1.8
"""Of the outages, the others last for one report; mean and longest, first invalid report to last."""
INVALID_SIGMA_M_S = 0.07
"""How far off an invalid velocity is."""


class DvlReporter:
    """Draws the reports of one DVL."""

    def __init__(self, config: DvlReports, step_s: float, rng: np.random.Generator) -> None:
        self._config, self._step_s, self._rng = config, step_s, rng
        self._until_s = self._out_s = 0.0
        self._late_in = 1
        self._was_valid = True

    def step(self, turn_rad_s: float) -> tuple[float, float] | None:
        """Go on by one step, turning so fast; return the error (m/s) of a velocity that is passed on now."""
        is_valid, normal = self.report(turn_rad_s), self._rng.standard_normal
        if is_valid:
            return (0.0, 0.0)
        if is_valid is None or self._rng.random() >= self._config.invalid_passed:
            return None
        return (INVALID_SIGMA_M_S * float(normal()), INVALID_SIGMA_M_S * float(normal()))

    def report(self, turn_rad_s: float) -> bool | None:
        """Go on by one step; return whether a report now is valid, None without one."""
        self._until_s -= self._step_s
        self._out_s -= self._step_s
        if self._until_s > 0.0:
            return None
        interval_s = self._interval_s()
        self._until_s += interval_s
        is_valid = self._out_s <= 0.0
        if is_valid and self._was_valid and self._rng.random() < interval_s * self._outages_per_s(turn_rad_s):
            is_valid = False
            if self._rng.random() < LONG_SHARE:
                self._out_s = min(LONG_S * float(self._rng.exponential()), LONGEST_S)
        self._was_valid = is_valid
        return is_valid

    def _interval_s(self) -> float:
        mean_s, sigma_s = USUAL_S
        self._late_in -= 1
        if not self._late_in:
            mean_s, sigma_s = LATE_S
            self._late_in = LATE_EVERY + int(self._rng.integers(2))
        return max(mean_s + sigma_s * float(self._rng.standard_normal()), self._step_s)

    def _outages_per_s(self, turn_rad_s: float) -> float:
        still, turning = OUTAGES_PER_MIN
        return (still + min(turn_rad_s / TURNING_RAD_S, 1.0) * (turning - still)) / 60.0
