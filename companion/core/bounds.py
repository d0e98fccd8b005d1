"""Keeping numbers inside, one at a time: angles inside a turn, values inside ±limit.

NaN comes out as NaN: it ends at the supervisor's guard. Where `math` would raise, NaN or infinity comes out.
"""

import math


def wrap(angle: float) -> float:
    """Return an angle brought to [−π, π) rad; NaN and infinity become NaN."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def limited(x: float, limit: float) -> float:
    """Return a number within ±limit; NaN stays NaN."""
    if x > limit:
        return limit
    if x < -limit:
        return -limit
    return x


def clamped(x: float, low: float, high: float) -> float:
    """Return a number within low..high; NaN stays NaN."""
    if x > high:
        return high
    if x < low:
        return low
    return x


def square_root(x: float) -> float:
    """Return √x; NaN for a negative x."""
    return math.nan if x < 0.0 else math.sqrt(x)
