"""What a real instrument adds to its reading: a bias that walks, steps, jitter and outages. Seeded."""

import math

import numpy as np

from sim_bridge.sim_config import Defects


class Defective:
    """The defects of one instrument; without any, it draws nothing."""

    def __init__(self, config: Defects, step_s: float, rng: np.random.Generator) -> None:
        self.active = config != Defects()
        self.bias = 0.0
        """Bias in the instrument's unit."""
        self.out = False
        """Whether there is no reading now."""
        self.late_s = 0.0
        """How much later than its delay a reading is now."""
        self._config = config
        self._rng = rng
        self._kick = config.walk_per_sqrt_s * math.sqrt(step_s)
        self._fails = step_s / config.outage_every_s if config.outage_every_s else 0.0
        self._returns = step_s / config.outage_s

    def step(self) -> None:
        """Go on by one step: exponentially distributed times in and out of order."""
        if not self.active:
            return
        self.bias += self._kick * float(self._rng.standard_normal())
        self.late_s = self._config.jitter_s * float(self._rng.random())
        self.out = bool(self._rng.random() < (1.0 - self._returns if self.out else self._fails))

    def rounded(self, value: float) -> float:
        """Return the value in whole steps."""
        step = self._config.step
        return step * math.floor(value / step + 0.5) if step else value
