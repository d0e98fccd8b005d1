"""Notices that the loop oscillates by itself, and says how far to draw back what an estimate may ask.

A loop that is later, or a vehicle that answers more strongly, than the gains bear oscillates faster than any
sea or path, and does not die away. So demand that is faster than HIGH_PASS_S, and by its RMS above a share of
the largest force for longer than any transient, is a limit cycle: engaging, a load or a setpoint ring for a
second at most. The gains then shrink until it is gone. They come back slowly, and less far than where the
cycle began, so that they do not hunt; but whole, where the cycle came of a delay that is known by then.
"""

import math

import numpy as np

from companion.control.bounds import bounded
from companion.records import Array

SHARE = 0.12
"""Of an axis' largest force: an RMS of fast demand above it is a limit cycle, if it lasts."""

HIGH_PASS_S = 0.15
MEMORY_S = 0.2
TRANSIENT_S = 1.1
SHRINK_S = 0.3
RECOVER_S = 10.0
LEAST = 0.1
RELAPSE_SHARE = 0.7
"""Of the scale at which a limit cycle began: so far the gains come back within RECOVER_S."""

FORGET_S = 600.0
"""Beyond that they come back as slowly as this, from nothing to all of them."""

EXPLAINED_S = 0.02
"""A delay believed so much longer than when the cycle began explains it: the gains allow for it now."""

MEAN_S = 1.0


class Oscillation:
    """Watches the demands tau (…, 4); `gain_scale` (…, 4), LEAST..1, is what is left of the gains."""

    def __init__(self, max_force: Array) -> None:
        """Take the largest force that is asked of each axis, N or N·m, (4,): more than that moves nothing."""
        self._max_force = max_force
        self._limit = SHARE * max_force
        self.reset()

    def reset(self) -> None:
        """Begin anew, with full gains."""
        self.gain_scale: Array = np.ones_like(self._limit)
        self._ceiling: Array = np.ones_like(self._limit)
        self._slow: Array | None = None
        self._power: Array = np.zeros_like(self._limit)
        self._lasts_s: Array = np.zeros_like(self._limit)
        self._delay_s: Array = np.full_like(self._limit, np.inf)
        """What the loop's delay was believed to be when the last cycle began."""

    def step(self, tau: Array, dt_s: float, delay_s: Array | float = 0.0) -> None:
        """Take one tick's demand, and the delay that the gains allow for."""
        tau = bounded(tau, self._max_force)
        slow = tau if self._slow is None else self._slow
        self._slow = slow + (tau - slow) * (1.0 - math.exp(-dt_s / HIGH_PASS_S))
        fast = tau - self._slow
        self._power = self._power + (fast * fast - self._power) * (1.0 - math.exp(-dt_s / MEMORY_S))
        above = self._power > self._limit * self._limit
        lasted_s, self._lasts_s = self._lasts_s, np.where(above, self._lasts_s + dt_s, 0.0)
        cycles = self._lasts_s > TRANSIENT_S
        begins = cycles & (lasted_s <= TRANSIENT_S)
        scale, ceiling = self.gain_scale, self._ceiling
        explained = delay_s > self._delay_s + EXPLAINED_S
        self._delay_s = np.where(begins, delay_s, np.where(explained, np.inf, self._delay_s))
        ceiling = np.where(begins, RELAPSE_SHARE * scale, ceiling + dt_s / FORGET_S)
        ceiling = np.where(explained & ~begins, 1.0, ceiling)
        scale = np.where(cycles, scale * math.exp(-dt_s / SHRINK_S), scale + dt_s / RECOVER_S)
        self._ceiling = np.minimum(np.maximum(ceiling, LEAST), 1.0)
        self.gain_scale = np.minimum(np.maximum(scale, LEAST), self._ceiling)


class ScaledDisturbance:
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


def mean_disturbance(mean: float, d: float, dt_s: float) -> float:
    """Return the mean over MEAN_S of a disturbance, after one tick of it."""
    return mean + (d - mean) * (1.0 - math.exp(-dt_s / MEAN_S))


def scaled_disturbance(mean: float, d: float, gain_scale: float) -> float:
    """Return a disturbance as it may become thrust: its mean, and of what differs from that gain_scale².

    At full gains it is the disturbance itself. A constant one stays compensated whatever the scale: what is
    drawn back is all that is faster than 1/MEAN_S.
    """
    return d - (1.0 - gain_scale * gain_scale) * (d - mean)
