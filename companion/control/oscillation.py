"""Notices that the loop oscillates by itself, and says how far to draw back what an estimate may ask.

A loop that is later, or a vehicle that answers more strongly, than the gains bear oscillates faster than any
sea or path, and does not die away. So what of the demand is faster than HIGH_PASS_S is cut into half-swings:
HALF_SWINGS of them in a row, each larger than the limit and hardly smaller than the one before, are a limit
cycle. Engaging, a load or a setpoint make no such row. Each one more shrinks the gains, by as much as it
lasts; they come back slowly, so that they do not hunt.
"""

import math

import numpy as np

from companion.types import Array

HIGH_PASS_S = 0.15
HALF_SWINGS = 3
LONGEST_S = 1.5
"""A half-swing that lasts longer is the sea's, or a setpoint's."""

KEPT = 0.7
"""A half-swing is no smaller than this beside the one before: else it is a transient that dies away."""

SHRINK_S = 0.5
RECOVER_S = 30.0
LEAST = 0.2
D_HAT_LAG_S = 0.3


class Oscillation:
    """Watches the demands tau (…, 4); `gain_scale` (…, 4), LEAST..1, is what is left of the gains."""

    def __init__(self, limit: Array) -> None:
        """Take the RMS of fast demand above which it counts as oscillating, N or N·m, (4,)."""
        self._amplitude = math.sqrt(2.0) * limit
        self.reset()

    def reset(self) -> None:
        """Begin anew, with full gains."""
        none = np.zeros_like(self._amplitude)
        self.gain_scale: Array = np.ones_like(none)
        self._slow: Array | None = None
        self._peak, self._peak_before, self._count, self._lasts_s = none, none, none, none

    def step(self, tau: Array, dt_s: float) -> None:
        """Take one tick's demand."""
        slow = tau if self._slow is None else self._slow
        self._slow = slow + (tau - slow) * (1.0 - math.exp(-dt_s / HIGH_PASS_S))
        fast = tau - self._slow
        swung_s = self._half_swing_s(fast, dt_s)
        scale = self.gain_scale * np.exp(-swung_s / SHRINK_S) + dt_s / RECOVER_S
        self.gain_scale = np.minimum(np.maximum(scale, LEAST), 1.0)

    def _half_swing_s(self, fast: Array, dt_s: float) -> Array:
        """Return how long the half-swing lasted that ends now, s, where it is one of a limit cycle; else 0.

        `_peak` is the largest of the present half-swing, with its sign. It ends where as much again lies
        on the other side.
        """
        ends = (fast * self._peak < 0.0) & (np.abs(fast) > 0.5 * self._amplitude)
        size, lasts_s = np.abs(self._peak), self._lasts_s + dt_s
        goes_on = (size > self._amplitude) & (size > KEPT * self._peak_before) & (lasts_s < LONGEST_S)
        count = np.where(ends, (self._count + 1.0) * goes_on, self._count)
        swung_s = np.where(ends & (count >= HALF_SWINGS), lasts_s, 0.0)
        self._peak_before = np.where(ends, size, self._peak_before)
        larger = ends | (np.abs(fast) > size)
        self._peak = np.where(larger, fast, self._peak)
        self._lasts_s = np.where(ends, 0.0, lasts_s)
        self._count = count
        return swung_s


def slowed(before: Array, d_hat: Array, gain_scale: Array, dt_s: float) -> Array:
    """Return `before` moved towards `d_hat` for `dt_s`: a first-order lag of D_HAT_LAG_S (1/gain_scale − 1).

    At full gains it is d̂ itself. A constant disturbance stays compensated whatever the scale; what is
    drawn back is the bandwidth.
    """
    lag_s = D_HAT_LAG_S * (1.0 / gain_scale - 1.0)
    keep = np.exp(-dt_s / np.maximum(lag_s, 1e-9))
    return np.asarray(d_hat + (before - d_hat) * keep)
