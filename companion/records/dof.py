"""Degrees of freedom and axes: their names, their order, and the vectors that follow it."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Vector = tuple[float, float, float, float]
"""A number of each degree of freedom, or of each axis."""

ZERO: Vector = (0.0, 0.0, 0.0, 0.0)

DOFS = ("x", "y", "z", "psi")
AXES = ("surge", "sway", "heave", "yaw")
X, Y, Z, PSI = range(4)


def vector(values: Iterable[float]) -> Vector:
    """Return four numbers as a vector."""
    x, y, z, psi = values
    return (x, y, z, psi)
