"""What the MAVLink links give: events from the vehicle and from the pilot, and what became of the bytes."""

from enum import Enum, IntEnum, auto
from typing import Any

import msgspec

from companion.records.control import AxisCommand
from companion.records.dof import Angles, Vector


class Event(msgspec.Struct, frozen=True, gc=False):
    """What the links gave at `t_s`, this machine's monotonic clock."""

    t_s: float


class Heartbeat(Event, frozen=True, gc=False):
    """The autopilot's own: custom_mode, MAV_STATE, MAV_TYPE (a submarine), MAV_AUTOPILOT (ArduPilot)."""

    armed: bool
    mode: int
    system_status: int
    vehicle_type: int = 12
    autopilot: int = 3


class Attitude(Event, frozen=True, gc=False):
    """Euler angles (rad) and body rates (rad/s), stamped by the autopilot."""

    boot_s: float
    roll: float
    pitch: float
    yaw: float
    p: float
    q: float
    r: float


class Depth(Event, frozen=True, gc=False):
    """Depth in metres, positive down. `boot_s` is None where the message carries no stamp."""

    boot_s: float | None
    z_m: float


class Pressure(Event, frozen=True, gc=False):
    """What the barometer in the water feels, as metres of water; its zero is no surface."""

    boot_s: float
    z_m: float


class DepthRate(Event, frozen=True, gc=False):
    """Depth rate in m/s, positive down."""

    boot_s: float | None
    w_mps: float


class Position(Event, frozen=True, gc=False):
    """Horizontal position (m) and velocity (m/s), north and east, from a DVL or another position source."""

    boot_s: float
    x_m: float
    y_m: float
    vx_mps: float
    vy_mps: float


class Range(Event, frozen=True, gc=False):
    """A range (m) along the vehicle's own down axis, to the ground, of one sonar or DVL of several."""

    range_m: float
    sensor: int = 0


class ServoOutput(Event, frozen=True, gc=False):
    """Motor outputs as the autopilot reports them (µs), first servo first: the echo of our commands."""

    boot_s: float
    pwm_us: tuple[int, ...]


class TimeSync(Event, frozen=True, gc=False):
    """Answer to our TIMESYNC: we sent at `sent_s` (our clock), the autopilot's clock then read `boot_s`."""

    sent_s: float
    boot_s: float


class Battery(Event, frozen=True, gc=False):
    """Battery voltage in volts."""

    voltage_v: float


class PilotGain(Event, frozen=True, gc=False):
    """The live stick gain (0..1) that ArduSub applies to MANUAL_CONTROL."""

    gain: float


class PilotToggle(Event, frozen=True, gc=False):
    """What a pilot's button switched: "InputHold" adds to the sticks, "RollPitch" makes x, y pitch, roll."""

    name: str
    on: bool


class ReceiverChannels(Event, frozen=True, gc=False):
    """How many channels the autopilot says an RC receiver gives it."""

    count: int


class FirmwareVersion(Event, frozen=True, gc=False):
    """The autopilot's version, such as "4.7.0 (dev)", and its (major, minor, patch)."""

    text: str
    version: tuple[int, int, int]


class EkfOrigin(Event, frozen=True, gc=False):
    """Whether the EKF knows where on earth it is: without, VFR_HUD.alt stays exactly 0."""

    known: bool


class GlobalOrigin(Event, frozen=True, gc=False):
    """Where on earth the EKF's origin is, WGS84, and how high over the sea."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float

    @property
    def place_deg(self) -> tuple[float, float]:
        """Latitude and longitude."""
        return self.latitude_deg, self.longitude_deg


class OtherHoldfast(Event, frozen=True, gc=False):
    """Another Holdfast with our ids is on the link: a frame that it sent, or an answer to it."""

    steers: bool


class PilotInput(Event, frozen=True, gc=False):
    """Somebody else steers this vehicle: largest stick deflection, 0..1."""

    deflection: float


class PilotHeartbeat(Event, frozen=True, gc=False):
    """The ground station on our own second link is alive."""


class PilotSticks(Event, frozen=True, gc=False):
    """The pilot's MANUAL_CONTROL, which came through our relay."""

    sticks: AxisCommand
    """Fractions of full stick."""
    buttons: int
    extensions: tuple[int, int]
    """buttons2 and enabled_extensions, passed on as they came, like aux1..aux6."""
    aux: tuple[int, ...]


class PilotAction(IntEnum):
    """What the pilot's buttons ask of Holdfast, and parameter 1 of its command."""

    ENGAGE = 1
    RELEASE = 2
    HOLD = 3
    """Stop, and hold this place."""


class PilotCommand(Event, frozen=True, gc=False):
    """The ground station's MAV_CMD_USER_1 to our component."""

    action: PilotAction


class Refused(Event, frozen=True, gc=False):
    """A message to us, or to a vehicle that we steer, that is not done, or not all of it: `words` say why."""

    words: str
    answer: Any = None
    """MAVLink's own answer, where there is one."""


class PositionTarget(Event, frozen=True, gc=False):
    """The ground station's SET_POSITION_TARGET_LOCAL_NED; NaN where it says nothing, heading last."""

    place: Vector
    velocity: Vector
    acceleration: Vector
    offset: bool
    """`place` counts from where the vehicle is."""
    body: bool
    """All are forward, right and down."""
    turns: bool
    """The heading counts from the vehicle's."""


class AttitudeTarget(Event, frozen=True, gc=False):
    """The ground station's SET_ATTITUDE_TARGET; angles and heading are NaN where it says nothing."""

    angles: Angles
    heading: float
    climb: float
    """Share of the largest climb rate, -1..1, up; 0 where nothing is said."""


class Parameter(Event, frozen=True, gc=False):
    """A parameter's value, as the autopilot reports it."""

    name: str
    value: float


class StatusText(Event, frozen=True, gc=False):
    """A line the autopilot wants a human to read; `severity` is MAV_SEVERITY."""

    severity: int
    text: str


class Reboot(Event, frozen=True, gc=False):
    """The autopilot's clock started again: what was asked of it and learnt of its clock is void."""


class EkfStatus(Event, frozen=True, gc=False):
    """What the autopilot's estimator says of itself: what it has, and its worst test ratio."""

    attitude: bool
    depth: bool
    variance: float
    position: bool = False
    initialised: bool = True
    absolute: bool = True
    """The position comes of a source of positions; else it is dead reckoning, and drifts."""


class DepthSensor(Event, frozen=True, gc=False):
    """What the autopilot says of its depth sensor; ArduSub doubts one that does not change for 2 s."""

    healthy: bool


class Leak(Event, frozen=True, gc=False):
    """The autopilot's leak detector is wet."""


SAMPLES = frozenset({Attitude, Depth, DepthRate, Position, Pressure, Range, ServoOutput})
"""What comes tick after tick and tells of motion alone: for the estimator and the pre-dive list."""


class Sender(Enum):
    """Whose a datagram is, for a link that listens."""

    STRANGER = auto()
    BEHIND = auto()
    """A sender to greet: our vehicle in MAVLink 1, or rightly signed but not new (replay, wrong clock)."""
    EXPECTED = auto()


class LinkCounters(msgspec.Struct):
    """What became of the bytes that came in. Counted, never raised."""

    datagrams: int = 0
    messages: int = 0
    garbage: int = 0
    foreign: int = 0
    implausible: int = 0
    refused: int = 0
    """Signature bad, missing or replayed."""
