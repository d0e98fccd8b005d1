"""Degrees of freedom and axes: their names, their order, and the vectors that follow it."""

from collections.abc import Iterable
from typing import NamedTuple, TypeVar

Flags = tuple[bool, bool, bool, bool]
"""Yes or no for each degree of freedom, or for each axis."""
Vector = tuple[float, float, float, float]
"""A number of each degree of freedom, or of each axis."""

ZERO: Vector = (0.0, 0.0, 0.0, 0.0)


class Angles(NamedTuple):
    """Roll and pitch, rad: right side down, bow up."""

    roll: float
    pitch: float


LEVEL = Angles(0.0, 0.0)

DOFS = ("x", "y", "z", "psi")
AXES = ("surge", "sway", "heave", "yaw")
X, Y, Z, PSI = range(4)


T = TypeVar("T")


def vector(values: Iterable[T]) -> tuple[T, T, T, T]:
    """Return four of a kind, such as numbers, in the order of degrees of freedom or axes."""
    x, y, z, psi = values
    return (x, y, z, psi)


def chosen(where: Flags, first: Vector, second: Vector) -> Vector:
    """Return by degree of freedom the number of `first` where the flag is set, else that of `second`."""
    x, y, z, psi = (a if is_set else b for is_set, a, b in zip(where, first, second, strict=True))
    return (x, y, z, psi)


def either(first: Flags, second: Flags) -> Flags:
    """Return where at least one of the two is set."""
    return (first[0] or second[0], first[1] or second[1], first[2] or second[2], first[3] or second[3])


def without(first: Flags, second: Flags) -> Flags:
    """Return where the first is set and the second is not."""
    return (
        first[0] and not second[0],
        first[1] and not second[1],
        first[2] and not second[2],
        first[3] and not second[3],
    )
