"""Keeping numbers inside: angles inside a turn, values inside ±limit."""

import math
from typing import TypeVar

import numpy as np

from companion.records import Array

AngleT = TypeVar("AngleT", float, Array)


def wrap(angle: AngleT) -> AngleT:
    """Return an angle, or an array of them, brought to [−π, π) rad; NaN and infinity become NaN."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def bounded(x: Array, limit: Array) -> Array:
    """Return x within ±limit; NaN stays NaN. On four numbers twice as fast as np.clip."""
    return np.minimum(np.maximum(x, -limit), limit)


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
