"""What the estimator believes of the vehicle."""

import math
from dataclasses import dataclass, field

import numpy as np

from companion.records.dof import Array, Flags


@dataclass(frozen=True, slots=True)
class FrameShift:
    """By how much the autopilot reset its estimate: yaw, clockwise, and horizontal position."""

    turn_rad: float
    north_m: float
    east_m: float


@dataclass(frozen=True, slots=True)
class Ages:
    """Seconds since each signal last came; infinite before the first."""

    link_s: float
    heartbeat_s: float
    depth_s: float
    attitude_s: float
    position_s: float
    pilot_s: float = math.inf
    """The ground station's heartbeat."""
    yaw_reset_s: float = math.inf
    position_reset_s: float = math.inf
    """Since the autopilot's estimate was last reset."""


@dataclass(frozen=True, slots=True)
class Delays:
    """What was measured of the loop's delays, seconds; `*_known` tells a measurement from a start value.

    `telemetry_s` runs from the autopilot's stamp to arrival, `command_s` from sending to the motor's PWM;
    `hidden_s` is what no stamp shows (companion.hidden_delay).
    """

    telemetry_s: float
    command_s: float
    telemetry_known: bool
    command_known: bool
    hidden_s: float = 0.0

    @property
    def total_s(self) -> float:
        """All together: what destabilises."""
        return self.telemetry_s + self.command_s + self.hidden_s


@dataclass(frozen=True, slots=True)
class VehicleState:
    """What the estimator believes. Arrays of shape (4,) in DOF order, NED.

    `eta`, `eta_dot` are now; `eta_ahead`, `eta_dot_ahead` are `ahead_s` later, when a command sent now acts.
    `disturbance` is the observer's d in the paper's sign: m x'' = tau - h - d. `innovation` is by how much
    the newest positions missed what was expected; a depth that missed by too much was refused.
    `frame_shift` is what the autopilot's estimate was reset by since the tick before. A degree of freedom
    that was not measured for longer than its timeout, or never, is `stale`: `eta` stays what it was last,
    the rates and the disturbance are zero.
    """

    t_s: float
    boot_s: float
    eta: Array
    eta_dot: Array
    ahead_s: float
    eta_ahead: Array
    eta_dot_ahead: Array
    disturbance: Array
    roll: float
    pitch: float
    p: float
    q: float
    armed: bool
    mode: int
    system_status: int
    voltage_v: float
    pilot_gain: float
    ages: Ages
    delays: Delays
    innovation: Array = field(default_factory=lambda: np.zeros(4))
    depth_refused: bool = False
    clock_doubt_s: float = 0.0
    """How long stamps and answers to TIMESYNC have kept contradicting each other; 0 where they do not."""
    frame_shift: FrameShift | None = None
    stale: Flags = field(default_factory=lambda: np.zeros(4, bool))
