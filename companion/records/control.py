"""What the control equations give: forces, and demands on the vehicle's axes."""

from typing import NamedTuple

import msgspec

from companion.records.dof import Flags, Vector

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


class DofSample(msgspec.Struct, frozen=True):
    """The law's inside for all four DOFs; NED, `VehicleState.ahead_s` from now.

    tau = feedforward + feedback + d_hat, before saturation; `e`, `e_dot` are measured minus desired.
    """

    x_d: Vector
    x_d_dot: Vector
    x_d_ddot: Vector
    x: Vector
    x_dot: Vector
    e: Vector
    e_dot: Vector
    eps: Vector
    tau: Vector
    feedforward: Vector
    feedback: Vector
    d_hat: Vector
    d_observer: Vector
    weight_norm: Vector
    saturated: Flags
    adapting: Flags
    engaged: Flags
