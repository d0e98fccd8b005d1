"""What guidance and supervisor give the law in a tick: who may steer, and where to go."""

from typing import NamedTuple

from companion.records import Angles, Axes, Flags, Setpoint


class Permission(NamedTuple):
    """What the supervisor allows in this tick."""

    authority: float
    """0..1: the share of the wrench that is sent."""
    freeze: bool
    """Nothing is learnt."""
    active: bool
    releases: bool
    """The force falls evenly to zero from the last one while active, whatever the law asks then."""
    rests: bool
    """Nothing was held until now: law and reference start where the vehicle is."""
    regained: Flags
    """What is held again: its reference starts where the vehicle is."""
    trusts_thrusters: bool
    """All motors count as sound again."""
    reach: Axes
    """Largest demand on each axis."""


class Wanted(NamedTuple):
    """Where to go, which degrees of freedom the law holds, and at which angles roll and pitch."""

    target: Setpoint
    engaged: Flags
    angles: Angles
