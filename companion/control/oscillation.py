"""Notices that the loop oscillates by itself, and says how far to draw back what an estimate may ask.

A loop that is later, or a vehicle that answers more strongly, than the gains bear oscillates faster than any
sea or path, and does not die away. So what of the demand is faster than HIGH_PASS_S is cut into half-swings:
HALF_SWINGS of them in a row, each larger than the limit and hardly smaller than the one before, are a limit
cycle. Engaging, a load or a setpoint make no such row. Each one more shrinks the gains, by as much as it
lasts; they come back slowly, so that they do not hunt.
"""

import math

import numpy as np

from companion.control.bounds import bounded
from companion.types import Array

SHARE = 0.12
"""Of an axis' largest force: the RMS of fast demand above which it may be a limit cycle."""

HIGH_PASS_S = 0.15
HALF_SWINGS = 3
LONGEST_S = 1.5
"""A half-swing that lasts longer is the sea's, or a setpoint's."""

KEPT = 0.7
"""A half-swing is no smaller than this beside the one before: else it is a transient that dies away."""

SHRINK_S = 0.4
RECOVER_S = 30.0
LEAST = 0.1
RELAPSE_SHARE = 0.7
"""Of the scale at which a limit cycle began: so far the gains come back within RECOVER_S."""

FORGET_S = 600.0
"""Beyond that they come back as slowly as this, from nothing to all of them."""

MEAN_S = 1.0


class Oscillation:
    """Watches the demands tau (…, 4); `gain_scale` (…, 4), LEAST..1, is what is left of the gains."""

    def __init__(self, max_force: Array) -> None:
        """Take the largest force that is asked of each axis, N or N·m, (4,): more than that moves nothing."""
        self._max_force = max_force
        self._amplitude = math.sqrt(2.0) * SHARE * max_force
        self.reset()

    def reset(self) -> None:
        """Begin anew, with full gains."""
        none = np.zeros_like(self._amplitude)
        self.gain_scale: Array = np.ones_like(none)
        self._ceiling: Array = np.ones_like(none)
        self._slow: Array | None = None
        self._peak, self._peak_before, self._count, self._lasts_s = none, none, none, none

    def step(self, tau: Array, dt_s: float) -> None:
        """Take one tick's demand."""
        tau = bounded(tau, self._max_force)
        slow = tau if self._slow is None else self._slow
        self._slow = slow + (tau - slow) * (1.0 - math.exp(-dt_s / HIGH_PASS_S))
        fast = tau - self._slow
        counted = self._count
        swung_s = self._half_swing_s(fast, dt_s)
        begins = (swung_s > 0.0) & (counted < HALF_SWINGS)
        ceiling = np.where(begins, RELAPSE_SHARE * self.gain_scale, self._ceiling + dt_s / FORGET_S)
        self._ceiling = np.minimum(np.maximum(ceiling, LEAST), 1.0)
        scale = self.gain_scale * np.exp(-swung_s / SHRINK_S) + dt_s / RECOVER_S
        self.gain_scale = np.minimum(np.maximum(scale, LEAST), self._ceiling)

    def _half_swing_s(self, fast: Array, dt_s: float) -> Array:
        """Return how long the half-swing lasted that ends now, s, where it is one of a limit cycle; else 0.

        `_peak` is the largest of the present half-swing, with its sign. It ends where as much again lies
        on the other side.
        """
        ends = (fast * self._peak < 0.0) & (np.abs(fast) > 0.5 * self._amplitude)
        size, lasts_s = np.abs(self._peak), self._lasts_s + dt_s
        stays = (size > KEPT * self._peak_before) | (self._count >= HALF_SWINGS)
        goes_on = (size > self._amplitude) & stays & (lasts_s < LONGEST_S)
        count = np.where(ends, (self._count + 1.0) * goes_on, self._count)
        swung_s = np.where(ends & (count >= HALF_SWINGS), lasts_s, 0.0)
        self._peak_before = np.where(ends, size, self._peak_before)
        larger = ends | (np.abs(fast) > size)
        self._peak = np.where(larger, fast, self._peak)
        self._lasts_s = np.where(ends, 0.0, lasts_s)
        self._count = count
        return swung_s


class DrawnBack:
    """A disturbance as it may become thrust: its mean of MEAN_S, and of what differs from that gain_scale².

    At full gains it is the disturbance itself. A constant one stays compensated whatever the scale: what is
    drawn back is all that is faster than 1/MEAN_S.
    """

    def __init__(self, mean: Array) -> None:
        """Begin with a known mean, (…, 4)."""
        self.mean = mean

    def step(self, d: Array, gain_scale: Array, dt_s: float) -> Array:
        """Take one tick's disturbance, return what may be used of it."""
        self.mean = self.mean + (d - self.mean) * (1.0 - math.exp(-dt_s / MEAN_S))
        return d - (1.0 - gain_scale * gain_scale) * (d - self.mean)
