"""What the estimator believes of the vehicle."""

import math
from typing import NamedTuple

import msgspec

from companion.records.dof import ZERO, Vector

CONTACT_S = 5.0
"""A link that was silent for longer is a new contact: longer than `supervisor.heartbeat_timeout_s`."""


class FrameShift(msgspec.Struct, frozen=True):
    """By how much the autopilot reset its estimate: yaw, clockwise, position, and depth."""

    turn_rad: float
    north_m: float
    east_m: float
    down_m: float = 0.0


class Ages(msgspec.Struct, frozen=True):
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
    depth_reset_s: float = math.inf
    """Since the autopilot's estimate was last reset."""


class Delays(msgspec.Struct, frozen=True):
    """What was measured of the loop's delays, seconds; `*_known` tells a measurement from a start value."""

    telemetry_s: float
    """Delay from the autopilot's stamp to arrival."""
    command_s: float
    """Delay from sending to the motor's PWM."""
    telemetry_known: bool
    command_known: bool
    hidden_s: float = 0.0
    """What no stamp shows (companion.core.hidden_delay)."""

    @property
    def total_s(self) -> float:
        """All together: what destabilises."""
        return self.telemetry_s + self.command_s + self.hidden_s


class VehicleModel(NamedTuple):
    """What the vehicle answers, by axis: surge, sway, heave, yaw (companion.core.vehicle_model).

    `gain` and `lag_s` are in use: force per command over inertia, relative to the nominal vehicle, and
    thruster lag. `found_*` is what was found, `log_gain_doubt` and `lag_doubt_s` its standard deviations.
    `dof_gain` is the gain in use by DOF, NED.
    """

    gain: Vector
    lag_s: Vector
    found_gain: Vector
    found_lag_s: Vector
    log_gain_doubt: Vector
    lag_doubt_s: Vector
    dof_gain: Vector


ONES: Vector = (1.0, 1.0, 1.0, 1.0)
LAGS: Vector = (0.15, 0.15, 0.15, 0.15)
NOMINAL = VehicleModel(ONES, LAGS, ONES, LAGS, ZERO, ZERO, ONES)
"""The nominal vehicle, of which nothing was found."""


class Ground(msgspec.Struct, frozen=True):
    """The ground under the vehicle: its depth (m), NaN where it is not known, and how fast it falls (m/s).

    `moves_along` is how much of the vehicle's own vertical motion it makes (`estimation.ground`): 0 where the
    range answers, NaN where the vehicle moved too little to tell.
    """

    depth_m: float
    rate_mps: float
    moves_along: float = math.nan

    @property
    def known(self) -> bool:
        """Whether there is one."""
        return not math.isnan(self.depth_m)


class Current(msgspec.Struct, frozen=True):
    """Velocity of the water over the ground, and its standard deviation (m/s); NaN where it is not known."""

    north_mps: float
    east_mps: float
    doubt_mps: float


class HeadingCheck(NamedTuple):
    """How far the heading is off by the course over ground, rad; NaN where that does not tell.

    `doubtful`: it is told. `lost`: by the course so far that no place can be held.
    """

    course_rad: float = math.nan
    doubtful: bool = False
    lost: bool = False


class VehicleState(msgspec.Struct, frozen=True):
    """What the estimator believes. Vectors in DOF order, NED: inside, or as reported (`estimation.frame`).

    `eta`, `eta_dot` are now; `eta_ahead`, `eta_dot_ahead` are `ahead_s` later, when a command sent now acts.
    `disturbance` is the observer's d in the paper's sign: m x'' = tau - h - d. `innovation` is the newest
    positions minus what was expected; a depth of too large an innovation was refused.
    `frame_shift` is what the autopilot's estimate was reset by since the tick before. A degree of freedom
    that was not measured for longer than its timeout, or never, is `stale`: `eta` stays what it was last,
    the rates and the disturbance are zero.
    """

    t_s: float
    boot_s: float
    eta: Vector
    eta_dot: Vector
    ahead_s: float
    eta_ahead: Vector
    eta_dot_ahead: Vector
    disturbance: Vector
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
    innovation: Vector = ZERO
    depth_refused: bool = False
    depth_doubt: str = ""
    attitude_doubt: str = ""
    position_doubt: str = ""
    """Why what is measured of it is not believed (`estimation.answers`); empty where it is."""
    clock_doubt_s: float = 0.0
    """How long stamps and answers to TIMESYNC have kept contradicting each other; 0 where they do not."""
    frame_shift: FrameShift | None = None
    depth_offset_m: float = 0.0
    """How much deeper the autopilot's depth reads than `eta` (`estimation.frame`)."""
    stale: tuple[bool, bool, bool, bool] = (False, False, False, False)
    dead_motor: int = 0
    """Number of the motor that gives no thrust (`thruster_watch`); 0 for none."""
    reversed_motor: int = 0
    """Number of the motor that pushes the other way; 0 for none."""
    model: VehicleModel = NOMINAL
    ground: Ground = Ground(math.nan, 0.0)
    current: Current = Current(math.nan, math.nan, math.nan)
    heading_check: HeadingCheck = HeadingCheck()
    heave_opposed: bool = False
    """Whether the vehicle moves against its vertical thrust."""

    @property
    def altitude_m(self) -> float:
        """Over the ground; NaN where it is not known."""
        return self.ground.depth_m - self.eta[2]
