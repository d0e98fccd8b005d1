"""What the control equations give: forces, and demands on the vehicle's axes."""

from dataclasses import dataclass
from typing import NamedTuple

from companion.records.dof import Array, Flags

Axes = tuple[float, float, float, float, float, float]
"""A number of each axis: surge, sway, heave, yaw, roll, pitch."""


class AxisCommand(NamedTuple):
    """Normalised demands, -1..1: forward, right, down, clockwise, starboard down, bow up.

    Down, not up: companion.mavlink flips it. Roll and pitch are ours only while levelling.
    """

    surge: float = 0.0
    sway: float = 0.0
    heave: float = 0.0
    yaw: float = 0.0
    roll: float = 0.0
    pitch: float = 0.0


NEUTRAL = AxisCommand()


@dataclass(frozen=True, slots=True)
class Wrench:
    """Body forces tau = X, Y, Z (N) and N (N·m), shape (4,)."""

    tau: Array


@dataclass(frozen=True, slots=True)
class DofSample:
    """The law's inside for all four DOFs, shape (4,) each; NED, `VehicleState.ahead_s` from now.

    tau = feedforward + feedback + d_hat, before saturation; `e`, `e_dot` are measured minus desired.
    """

    x_d: Array
    x_d_dot: Array
    x_d_ddot: Array
    x: Array
    x_dot: Array
    e: Array
    e_dot: Array
    eps: Array
    tau: Array
    feedforward: Array
    feedback: Array
    d_hat: Array
    d_observer: Array
    weight_norm: Array
    saturated: Flags
    adapting: Flags
    engaged: Flags
