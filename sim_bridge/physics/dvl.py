"""When a DVL reports, and which of its reports are invalid (`sim_bridge.config.DvlReports`)."""

import numpy as np

from sim_bridge.config import DvlReports


class DvlReporter:
    """Draws the reports of one DVL."""

    def __init__(self, config: DvlReports, step_s: float, rng: np.random.Generator) -> None:
        self._config, self._step_s, self._rng = config, step_s, rng
        self._until_s = self._out_s = 0.0
        self._late_in = 1
        self._was_valid = True

    def step(self, turn_rad_s: float) -> tuple[float, float] | None:
        """Go on by one step, turning so fast; return the error (m/s) of a velocity that is passed on now."""
        is_valid, config, normal = self.report(turn_rad_s), self._config, self._rng.standard_normal
        if is_valid:
            return (0.0, 0.0)
        if is_valid is None or self._rng.random() >= config.invalid_passed:
            return None
        return (config.invalid_sigma_m_s * float(normal()), config.invalid_sigma_m_s * float(normal()))

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
            is_valid, config = False, self._config
            if self._rng.random() < config.long_share:
                self._out_s = min(config.long_s * float(self._rng.exponential()), config.longest_s)
        self._was_valid = is_valid
        return is_valid

    def _interval_s(self) -> float:
        config = self._config
        mean_s, sigma_s = config.period_s, config.period_sigma_s
        self._late_in -= 1
        if not self._late_in:
            mean_s, sigma_s = config.late_s, config.late_sigma_s
            self._late_in = config.late_every + int(self._rng.integers(2))
        return max(mean_s + sigma_s * float(self._rng.standard_normal()), self._step_s)

    def _outages_per_s(self, turn_rad_s: float) -> float:
        still, turning = self._config.outages_per_min
        return (still + min(turn_rad_s / self._config.turning_rad_s, 1.0) * (turning - still)) / 60.0
