"""The frozen records that pass between rooms.

Frames: NED, depth z positive down; psi is the heading, clockwise from north. DOF order is always
x, y, z, psi (inertial) or surge, sway, heave, yaw (body, Fossen's X, Y, Z, N). SI units and radians.
Times: `t_s` is this machine's monotonic clock, `boot_s` the autopilot's clock.
"""

import math
from dataclasses import dataclass, field
from enum import Enum, IntEnum, IntFlag, StrEnum, auto

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

DOFS = ("x", "y", "z", "psi")
AXES = ("surge", "sway", "heave", "yaw")
X, Y, Z, PSI = range(4)


@dataclass(frozen=True, slots=True)
class AxisCommand:
    """Normalised demands, -1..1: forward, right, down, clockwise, starboard down, bow up.

    Down, not up: ardusub.py flips it. Roll and pitch are ours only while levelling.
    """

    surge: float = 0.0
    sway: float = 0.0
    heave: float = 0.0
    yaw: float = 0.0
    roll: float = 0.0
    pitch: float = 0.0


NEUTRAL = AxisCommand()


# --- What came from the vehicle ---------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """The autopilot's own heartbeat. `mode` is ArduSub's custom_mode, `system_status` MAV_STATE."""

    t_s: float
    armed: bool
    mode: int
    system_status: int
    vehicle_type: int = 12
    """MAV_TYPE; 12 is a submarine."""


@dataclass(frozen=True, slots=True)
class Attitude:
    """Euler angles (rad) and body rates (rad/s), stamped by the autopilot."""

    t_s: float
    boot_s: float
    roll: float
    pitch: float
    yaw: float
    p: float
    q: float
    r: float


@dataclass(frozen=True, slots=True)
class Depth:
    """Depth in metres, positive down. `boot_s` is None where the message carries no stamp."""

    t_s: float
    boot_s: float | None
    z_m: float


@dataclass(frozen=True, slots=True)
class DepthRate:
    """Depth rate in m/s, positive down."""

    t_s: float
    boot_s: float | None
    w_mps: float


@dataclass(frozen=True, slots=True)
class Position:
    """Horizontal position (m) and velocity (m/s), north and east, from a DVL or another position source."""

    t_s: float
    boot_s: float
    x_m: float
    y_m: float
    vx_mps: float
    vy_mps: float


@dataclass(frozen=True, slots=True)
class ServoOutput:
    """Motor outputs as the autopilot reports them (µs), first servo first: the echo of our commands."""

    t_s: float
    boot_s: float
    pwm_us: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class TimeSync:
    """Answer to our TIMESYNC: we sent at `sent_s` (our clock), the autopilot's clock then read `boot_s`."""

    t_s: float
    sent_s: float
    boot_s: float


@dataclass(frozen=True, slots=True)
class Battery:
    """Battery voltage in volts."""

    t_s: float
    voltage_v: float


@dataclass(frozen=True, slots=True)
class PilotGain:
    """The live stick gain (0..1) that ArduSub applies to MANUAL_CONTROL."""

    t_s: float
    gain: float


@dataclass(frozen=True, slots=True)
class PilotToggle:
    """What a pilot's button switched: "InputHold" adds to the sticks, "RollPitch" makes x, y pitch, roll."""

    t_s: float
    name: str
    on: bool


@dataclass(frozen=True, slots=True)
class ReceiverChannels:
    """How many channels the autopilot says an RC receiver gives it."""

    t_s: float
    count: int


@dataclass(frozen=True, slots=True)
class Firmware:
    """The autopilot's version, such as "4.7.0 (dev)", and its (major, minor, patch)."""

    t_s: float
    text: str
    version: tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class EkfOrigin:
    """Whether the EKF knows where on earth it is: without, VFR_HUD.alt stays exactly 0."""

    t_s: float
    known: bool


@dataclass(frozen=True, slots=True)
class PilotInput:
    """Somebody else steers this vehicle: largest stick deflection, 0..1."""

    t_s: float
    deflection: float


@dataclass(frozen=True, slots=True)
class PilotHeartbeat:
    """The ground station on our own second link is alive."""

    t_s: float


@dataclass(frozen=True, slots=True)
class PilotSticks:
    """The pilot's MANUAL_CONTROL, which came through our relay.

    `sticks` are fractions of full stick, -1..1, down positive. The further fields, to be passed on as they
    came, are (buttons2, enabled_extensions) and aux1..aux6.
    """

    t_s: float
    sticks: AxisCommand
    buttons: int
    extensions: tuple[int, int]
    aux: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter's value, as the autopilot reports it."""

    t_s: float
    name: str
    value: float


@dataclass(frozen=True, slots=True)
class CommandAck:
    """The autopilot's answer to a command; `result` is MAV_RESULT. It can lie: the heartbeat is the truth."""

    t_s: float
    command: int
    result: int


@dataclass(frozen=True, slots=True)
class StatusText:
    """A line the autopilot wants a human to read; `severity` is MAV_SEVERITY."""

    t_s: float
    severity: int
    text: str


@dataclass(frozen=True, slots=True)
class Reboot:
    """The autopilot's clock started anew: all that was asked of it and learnt of its clock is void."""

    t_s: float


@dataclass(frozen=True, slots=True)
class EkfStatus:
    """What the autopilot's estimator says of itself: what it has, and its worst test ratio."""

    t_s: float
    attitude: bool
    depth: bool
    variance: float
    position: bool = False
    """Horizontal position and velocity."""
    initialised: bool = True


@dataclass(frozen=True, slots=True)
class Leak:
    """The autopilot's leak detector is wet."""

    t_s: float


Event = (
    Heartbeat
    | Attitude
    | Depth
    | DepthRate
    | Position
    | ServoOutput
    | TimeSync
    | Battery
    | PilotGain
    | PilotInput
    | PilotHeartbeat
    | PilotSticks
    | PilotToggle
    | ReceiverChannels
    | Firmware
    | EkfOrigin
    | Parameter
    | CommandAck
    | StatusText
    | Reboot
    | EkfStatus
    | Leak
)


class Sender(Enum):
    """Whose a datagram is, for a link that listens."""

    STRANGER = auto()
    BEHIND = auto()
    """Rightly signed, and not new: a replay, or a sender whose clock has to learn the time from us."""
    EXPECTED = auto()


@dataclass(slots=True)
class LinkCounters:
    """What became of the bytes that came in. Counted, never raised."""

    datagrams: int = 0
    messages: int = 0
    garbage: int = 0
    foreign: int = 0
    implausible: int = 0
    refused: int = 0
    """Signature bad, missing or replayed."""


# --- What the operator wants ------------------------------------------------------------------------------

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


# --- What the rooms tell each other -----------------------------------------------------------------------


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


@dataclass(frozen=True, slots=True)
class Wrench:
    """Body forces tau = X, Y, Z (N) and N (N·m), shape (4,)."""

    tau: Array


class State(StrEnum):
    """The supervisor's states."""

    IDLE = "IDLE"
    READY = "READY"
    ACTIVE = "ACTIVE"
    RAMP_DOWN = "RAMP_DOWN"
    HAND_OVER = "HAND_OVER"
    PILOT = "PILOT"
    FAULT = "FAULT"


class Condition(IntFlag):
    """What the supervisor looks at, a bit each."""

    LINK_LOST = auto()
    DEPTH_STALE = auto()
    ATTITUDE_STALE = auto()
    POSITION_STALE = auto()
    DISARMED = auto()
    WRONG_MODE = auto()
    FAILSAFE_UNSAFE = auto()
    PREFLIGHT_FAILURE = auto()
    NON_FINITE = auto()
    TICK_LATE = auto()
    TILTED = auto()
    PILOT_TAKEOVER = auto()
    OPERATOR_STOP = auto()
    ENGAGE_ASKED = auto()
    CLEAR_ASKED = auto()
    RAMPED_DOWN = auto()
    DEPTH_JUMPED = auto()
    DEPTH_OUT_OF_BOUNDS = auto()
    EKF_UNHEALTHY = auto()
    LEAK = auto()
    BATTERY_LOW = auto()
    AUTOPILOT_FAILSAFE = auto()
    REBOOTED = auto()
    SATURATED = auto()
    OFF_TRACK = auto()
    DELAY_TOO_LONG = auto()
    INNOVATION_LARGE = auto()
    QUEUE_FULL = auto()
    CONFIG_CHANGED = auto()
    HANDED_OVER = auto()
    HAND_OVER_REFUSED = auto()
    PILOT_LOST = auto()
    PILOT_LOST_SURFACE = auto()
    CLOCK_JUMPED = auto()
    CLOCK_INCONSISTENT = auto()
    YAW_RESET = auto()
    POSITION_RESET = auto()
    PEER_CHANGED = auto()
    FAILSAFE_SURFACES = auto()
    SURFACED = auto()
    TILT_PERSISTS = auto()


@dataclass(frozen=True, slots=True)
class Verdict:
    """The supervisor's word for this tick. `authority` 0..1 scales the wrench: 0 is neutral.

    `warnings` are those of the conditions that are only told; with `freeze` nothing may be learnt.
    `remedy` is the one thing to do that gets the operator on.
    """

    state: State
    conditions: Condition
    authority: float
    reason: str
    warnings: Condition = field(default_factory=lambda: Condition(0))
    freeze: bool = False
    remedy: str = ""


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


@dataclass(frozen=True, slots=True)
class LoopHealth:
    """How the process itself is doing."""

    tick: int
    rate_hz: float
    lateness_ms: float
    compute_us: float
    late_ticks: int
    samples_dropped: int
    strangers: int = 0
    """Datagrams of others than the links' peers."""
    peer_changes: int = 0
    left_out_bytes: int = 0
    """Of floods on the links."""


@dataclass(frozen=True, slots=True)
class ControlSample:
    """Everything of one tick, as it leaves for telemetry."""

    state: VehicleState
    eta_d: Array
    """Where it should be now, shape (4,); `dofs` is about `state.ahead_s` later."""

    dofs: DofSample
    command: AxisCommand
    requested: Wrench
    delivered: Wrench
    verdict: Verdict
    counters: LinkCounters
    loop: LoopHealth
    texts: tuple[StatusText, ...] = ()
    """What the autopilot said since the tick before."""
