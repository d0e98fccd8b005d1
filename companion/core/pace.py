"""How fast the reference may move: slower where thrust does not suffice, or where it tilts the vehicle.

A target that is far away is approached with `max_rate`, which against a current, with a load or on a tilted
vehicle can be more than it bears. What saturates is slowed, so that it arrives later and not aslant.

The pace of a degree of freedom is the share of its `max_rate` that is left, LEAST_PACE..1.
"""

import math

from companion.core.bounds import clamped
from companion.core.tilt import LEAST_PACE

SLOW_DOWN_S, RECOVER_S = 0.5, 4.0


def step(pace: float, saturated: bool, dt_s: float) -> float:
    """Return the pace after a tick; it falls while the degree of freedom saturates."""
    slower = pace * math.exp(-dt_s / SLOW_DOWN_S)
    return clamped(slower if saturated else pace + dt_s / RECOVER_S, LEAST_PACE, 1.0)


def on_a_tilt(pace: float, tilt_share: float) -> float:
    """Return what a tilt leaves of a pace in x, y or z; `tilt_share` (0..1) is what it leaves of thrust."""
    most = LEAST_PACE if tilt_share < LEAST_PACE else tilt_share
    return most if pace > most else pace
