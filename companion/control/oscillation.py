"""Notices that the loop oscillates by itself, and says how far to draw back what an estimate may ask.

A loop that is later, or a vehicle that answers more strongly, than the gains bear oscillates faster than any
sea or path. What of the demand is faster than HIGH_PASS_S tells it: by its RMS of late, and by turning back
REVERSALS times within REVERSALS_S, which a load, a setpoint or engaging does not do. Then the gains shrink to
a fraction within a second; once it is quiet they come back slowly, so that they do not hunt.
"""

import math

import numpy as np

from companion.types import Array, Flags

HIGH_PASS_S = 0.15
MEMORY_S = 0.5
REVERSALS, REVERSALS_S = 3, 1.5
REVERSAL_SHARE = 0.5
"""Of the limit: fast demand that goes beyond it on one side and then on the other has turned back."""

SHRINK_S = 0.5
RECOVER_S = 30.0
LEAST = 0.2
D_HAT_LAG_S = 0.3


class Oscillation:
    """Watches the demands tau (…, 4); `gain_scale` (…, 4), LEAST..1, is what is left of the gains."""

    def __init__(self, limit: Array) -> None:
        """Take the RMS of fast demand above which it counts as oscillating, N or N·m, (4,)."""
        self._limit = limit
        self.reset()

    def reset(self) -> None:
        """Begin anew, with full gains."""
        self.gain_scale: Array = np.ones_like(self._limit)
        self._slow: Array | None = None
        self._power: Array = np.zeros_like(self._limit)
        self._side: Array = np.zeros_like(self._limit)
        self._since_s: Array = np.full((REVERSALS, *self._limit.shape), math.inf)
        """Ages of the last reversals, the newest first."""

    def step(self, tau: Array, dt_s: float) -> None:
        """Take one tick's demand."""
        slow = tau if self._slow is None else self._slow
        self._slow = slow + (tau - slow) * (1.0 - math.exp(-dt_s / HIGH_PASS_S))
        fast = tau - self._slow
        self._power = self._power + (fast * fast - self._power) * (1.0 - math.exp(-dt_s / MEMORY_S))
        swings = (self._power > self._limit * self._limit) & self._turns_back(fast, dt_s)
        scale = np.where(
            swings, self.gain_scale * math.exp(-dt_s / SHRINK_S), self.gain_scale + dt_s / RECOVER_S
        )
        self.gain_scale = np.minimum(np.maximum(scale, LEAST), 1.0)

    def _turns_back(self, fast: Array, dt_s: float) -> Flags:
        """Tell where the fast demand has turned back REVERSALS times within REVERSALS_S."""
        beyond = np.abs(fast) > REVERSAL_SHARE * self._limit
        turned = beyond & (fast * self._side < 0.0)
        self._side = np.where(beyond, np.sign(fast), self._side)
        aged = self._since_s + dt_s
        newer = np.concatenate((np.zeros_like(aged[:1]), aged[:-1]))
        self._since_s = np.where(turned, newer, aged)
        return np.asarray(self._since_s[-1] < REVERSALS_S)


def slowed(before: Array, d_hat: Array, gain_scale: Array, dt_s: float) -> Array:
    """Return `before` moved towards `d_hat` for `dt_s`: a first-order lag of D_HAT_LAG_S (1/gain_scale − 1).

    At full gains it is d̂ itself. A constant disturbance stays compensated whatever the scale; what is
    drawn back is the bandwidth.
    """
    lag_s = D_HAT_LAG_S * (1.0 / gain_scale - 1.0)
    keep = np.exp(-dt_s / np.maximum(lag_s, 1e-9))
    return np.asarray(d_hat + (before - d_hat) * keep)
