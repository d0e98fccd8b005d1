"""Notices that the loop swings by itself, and says how far to draw the gains back.

A loop that is later than its gains bear swings with a period of a few delays: faster than any sea or path.
What of the demand is faster than HIGH_PASS_S, by its RMS of late, tells it: above `limit` the gains shrink,
within a second or two to a fraction; once it is quiet they come back slowly, so that they do not hunt.
"""

import math

import numpy as np

from companion.types import Array

HIGH_PASS_S = 0.15
MEMORY_S = 0.5
SHRINK_S = 1.0
RECOVER_S = 30.0
LEAST = 0.2


class Oscillation:
    """Watches the demands tau (…, 4); `calm` (…, 4) is the share of the gains that is left, LEAST..1."""

    def __init__(self, limit: Array) -> None:
        """Take the RMS of fast demand above which it counts as swinging, N or N·m, (4,)."""
        self._limit = limit
        self.reset()

    def reset(self) -> None:
        """Begin anew, with full gains."""
        self.calm: Array = np.ones_like(self._limit)
        self._slow: Array | None = None
        self._power: Array = np.zeros_like(self._limit)

    def step(self, tau: Array, dt_s: float) -> None:
        """Take one tick's demand."""
        slow = tau if self._slow is None else self._slow
        self._slow = slow + (tau - slow) * (1.0 - math.exp(-dt_s / HIGH_PASS_S))
        fast = tau - self._slow
        self._power = self._power + (fast * fast - self._power) * (1.0 - math.exp(-dt_s / MEMORY_S))
        swings = self._power > self._limit * self._limit
        calm = np.where(swings, self.calm * math.exp(-dt_s / SHRINK_S), self.calm + dt_s / RECOVER_S)
        self.calm = np.minimum(np.maximum(calm, LEAST), 1.0)
