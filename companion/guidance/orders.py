"""What an operator orders, as the engine takes it: a path, a move, pause and resume."""

import math
from typing import Any

import msgspec

from companion.config import Config
from companion.guidance.paths.shapes import Path, building
from companion.guidance.paths.time_law import limits
from companion.records import LEVEL, Angles, Vector
from companion.steps import Steps
from companion.telemetry.operator_commands import (
    Follow,
    Goto,
    Payload,
    SetPath,
    SetVelocity,
    in_words,
)
from companion.telemetry.plan import PathPlan

Order = Path | Goto | SetPath | SetVelocity


def ordering(command: Payload, config: Config) -> Steps[Order | None]:
    """Return the order that a command is, in steps: a long path takes a second; None for another command.

    Raises ValueError for a path that is none.
    """
    if isinstance(command, Follow):
        return (yield from building(command.path, limits(config)))
    return command if isinstance(command, Goto | SetPath | SetVelocity) else None


def place(order: Goto) -> Vector:
    """Return where a move goes, NaN where nothing is said."""
    x, y, z, psi = map(number_of, (order.x_m, order.y_m, order.depth_m, order.heading_deg))
    return (x, y, z, math.remainder(math.radians(psi), math.tau) if math.isfinite(psi) else psi)


def angles(order: Goto | PathPlan) -> Angles:
    """Return the angles at which roll and pitch are to be held, NaN where nothing is said."""
    return Angles(math.radians(number_of(order.roll_deg)), math.radians(number_of(order.pitch_deg)))


def number_of(value: float | msgspec.UnsetType) -> float:
    """Return a number that may be left out; NaN where it is."""
    return math.nan if isinstance(value, msgspec.UnsetType) else value


def place_words(eta: Vector, altitude_m: float = math.nan, held: Angles = LEVEL) -> str:
    """Return the words for a move to a place, NaN where nothing is said; empty if all are NaN."""
    x, y, z, psi = eta
    roll, pitch = (math.degrees(angle) or math.nan for angle in held)
    places = {"x_m": x, "y_m": y, "depth_m": z, "heading_deg": math.degrees(psi) % 360.0}
    places |= {"altitude_m": altitude_m, "roll_deg": roll, "pitch_deg": pitch}
    given: dict[str, Any] = {key: round(value, 2) for key, value in places.items() if math.isfinite(value)}
    return in_words(Goto(**given)) if given else ""
