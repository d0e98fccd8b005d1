"""What an operator wants."""

from enum import IntEnum, auto
from typing import NamedTuple

import msgspec

from companion.records.dof import ZERO, Vector

ENGAGE_S = 5.0
"""So long a command or a button asks to engage: permitted later than that, it would come as a surprise."""


class Request(IntEnum):
    """What an operator can ask for."""

    ENGAGE = auto()
    STOP = auto()
    CLEAR_FAULT = auto()
    RESET_MODEL = auto()
    WITHDRAW = auto()
    """Drop a request to engage; an engaged vehicle stays engaged."""


class Setpoint(NamedTuple):
    """Where to be, in DOF order; a NaN target means: where it is when engaged.

    `eta_d_dot` and `eta_d_ddot` make a moving target a path; they are zero for a fixed one.
    """

    eta_d: Vector
    eta_d_dot: Vector = ZERO
    eta_d_ddot: Vector = ZERO


class Guided(msgspec.Struct, frozen=True):
    """What moves the target.

    `kind` is hold, move, path, paused, waiting, refused, or "" while nothing is held.
    `number` counts the courses; `name` is the path's, or why it was refused. Lengths are along the path.
    """

    kind: str
    number: int
    name: str = ""
    progress_m: float = 0.0
    length_m: float = 0.0
    speed_mps: float = 0.0
    altitude_m: float = 0.0
    """Over the ground, that is kept; 0 for none, or none yet."""
    left_m: float = 0.0
    left_s: float = 0.0
    """To the end of the path or the move; infinite where it has none. The time is estimated."""
    pending: str = ""
    """What it does as soon as it engages, in words; empty: it holds where it is."""
