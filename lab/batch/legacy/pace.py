"""How fast the reference may move: slower where thrust does not suffice, or where it tilts the vehicle.

A target that is far away is approached with `max_rate`, which against a current, with a load or on a tilted
vehicle can be more than it bears. What saturates is slowed, so that it arrives later and not aslant.
"""

import math

import numpy as np

from companion.control.tilt import LEAST_PACE
from lab.batch.legacy.records import Array, Flags

SLOW_DOWN_S, RECOVER_S = 0.5, 4.0


class Pace:
    """The share (4,) of each degree of freedom's `max_rate` that is left, LEAST_PACE..1."""

    def __init__(self) -> None:
        self._pace: Array = np.ones(4)

    def step(self, tilt_share: float, saturated: Flags, dt_s: float) -> Array:
        """Take one tick: what the tilt leaves (0..1), and which degrees of freedom saturate."""
        slower = self._pace * math.exp(-dt_s / SLOW_DOWN_S)
        self._pace = np.where(saturated, slower, self._pace + dt_s / RECOVER_S)
        self._pace = np.minimum(np.maximum(self._pace, LEAST_PACE), 1.0)
        tilted = max(tilt_share, LEAST_PACE)
        return np.asarray(np.minimum(self._pace, (tilted, tilted, tilted, 1.0)))
