"""What an operator wants."""

from dataclasses import dataclass, field
from enum import IntEnum, auto

import numpy as np

from companion.records.dof import Array

ENGAGE_S = 5.0
"""So long a command or a button asks to engage: permitted later than that, it would come as a surprise."""


class Request(IntEnum):
    """What an operator can ask for."""

    ENGAGE = auto()
    STOP = auto()
    CLEAR_FAULT = auto()


@dataclass(frozen=True, slots=True)
class Setpoint:
    """Where to be. Arrays of shape (4,) in DOF order; a NaN target means: where it is when engaged.

    `eta_d_dot` and `eta_d_ddot` make a moving target a path; they are zero for a fixed one.
    """

    eta_d: Array
    eta_d_dot: Array = field(default_factory=lambda: np.zeros(4))
    eta_d_ddot: Array = field(default_factory=lambda: np.zeros(4))
