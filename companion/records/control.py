"""What the control equations give: forces, and demands on the vehicle's axes."""

from typing import Generic, NamedTuple, TypeVar

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


N = TypeVar("N")
B = TypeVar("B")


class DofSample(NamedTuple, Generic[N, B]):
    """The law's inside, of one degree of freedom or of all four; NED, `VehicleState.ahead_s` from now.

    tau = feedforward + feedback + d_hat, before saturation; `e`, `e_dot` are measured minus desired.
    """

    x_d: N
    x_d_dot: N
    x_d_ddot: N
    x: N
    x_dot: N
    e: N
    e_dot: N
    eps: N
    tau: N
    feedforward: N
    feedback: N
    d_hat: N
    d_observer: N
    weight_norm: N
    saturated: B
    adapting: B
    engaged: B


Dofs = DofSample[Vector, Flags]
