"""Degrees of freedom and axes: their names, their order, and the arrays that follow it."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

DOFS = ("x", "y", "z", "psi")
AXES = ("surge", "sway", "heave", "yaw")
X, Y, Z, PSI = range(4)
