"""From the autopilot's messages to events in SI units, NED.

Source: docs/ardusub.md, "Telemetry", "Modes and arming", "MANUAL_CONTROL".
"""

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.mavlink.ardusub import (
    INT16_MAX,
    LEAVE_ALONE,
    NEUTRAL_US,
    PRESSURES,
    QUALITY_PARAMETER,
    SPAN_US,
    STICK,
    STICK_NEUTRAL_Z,
    DepthSource,
    clip,
    from_stick,
)
from companion.mavlink.messages import Message
from companion.records import (
    Angles,
    Attitude,
    AttitudeTarget,
    AxisCommand,
    Battery,
    Depth,
    DepthRate,
    EkfOrigin,
    EkfStatus,
    Event,
    Firmware,
    GlobalOrigin,
    Heartbeat,
    Leak,
    LinkCounters,
    Parameter,
    PilotAction,
    PilotCommand,
    PilotGain,
    PilotInput,
    PilotSticks,
    PilotToggle,
    Position,
    PositionTarget,
    Pressure,
    Range,
    ReceiverChannels,
    ServoOutput,
    StatusText,
    TimeSync,
    Vector,
)
from companion.telemetry.degrees import metres
from companion.telemetry.schemas import printable

ARMED: Final = mavlink.MAV_MODE_FLAG_SAFETY_ARMED
UINT16_MAX: Final = 0xFFFF
ACTIONS: Final = frozenset(map(float, PilotAction))

MAX_DEPTH_M: Final = 12_000.0
MAX_SPEED_MPS: Final = 20.0
MAX_DISTANCE_M: Final = 1e5
MAX_RANGE_M: Final = 500.0
LOOKS_DOWN: Final = mavlink.MAV_SENSOR_ROTATION_PITCH_270
UNKNOWN_QUALITY: Final = 0
NO_SIGNAL: Final = 1
"""DISTANCE_SENSOR.signal_quality: 0 is unknown, 1 none, 100 the best."""
LEAST_QUALITY: Final = 90.0
"""Before RNGFND_SQ_MIN is known, or where there is none: its default."""
NO_SENSOR: Final = -1
"""In place of a sensor's number, for RANGEFINDER, which has none."""
MAX_ANGLE_RAD: Final = 6.3
MAX_RATE_RADPS: Final = 50.0
MAX_PWM_US: Final = 3000
MAX_VOLTAGE_V: Final = 1000.0
MAX_ROUND_TRIP_S: Final = 5.0
MAX_STAMP_SPREAD_S: Final = 10.0
FAR_STAMPS: Final = 20

PA_PER_M: Final = 9800.0
PA_PER_HPA: Final = 100.0
PRESSURE_REPEAT_S: Final = 0.2
RELEASES: Final = {0: "dev", 64: "alpha", 128: "beta", 192: "rc"}

EKF_ATTITUDE: Final = mavlink.EKF_ATTITUDE
EKF_DEPTH: Final = mavlink.EKF_VELOCITY_VERT | mavlink.EKF_POS_VERT_ABS
EKF_UNINITIALIZED: Final = mavlink.EKF_UNINITIALIZED
EKF_PLACE: Final = mavlink.EKF_POS_HORIZ_REL | mavlink.EKF_POS_HORIZ_ABS
LEAK_TEXT: Final = "leak detected"
"""ArduSub says so every 20 s while a detector is wet and FS_LEAK_ENABLE is not 0 (failsafe_leak_check)."""

CHUNK_CHARS: Final = 50
MAX_CHUNKS: Final = 8


class BootClock:
    """The autopilot's clock in seconds since boot, from stamps that wrap.

    A stamp stands for the time nearest to the last one known: a wrap goes on counting, a reboot goes back.
    Only milliseconds move the clock: microseconds wrap too early to be trusted alone. A stamp far from the
    others moves it only when FAR_STAMPS of them have come in a row.
    """

    WRAP_MS_S: Final = 2**32 / 1e3
    WRAP_US_S: Final = 2**32 / 1e6

    def __init__(self) -> None:
        self.last_s: float | None = None
        self._far = 0

    def from_ns(self, stamp: int) -> float:
        """Seconds since boot of an int64 in ns; before any other stamp, its count of wraps is taken."""
        if self.last_s is None:
            self.last_s = stamp / 1e9
        return self._nearest(stamp / 1e9 % self.WRAP_MS_S, self.WRAP_MS_S)

    def from_ms(self, stamp: int) -> float:
        """Seconds since boot of a uint32 in ms."""
        boot_s = self._nearest(stamp / 1e3, self.WRAP_MS_S)
        near = self.last_s is None or abs(boot_s - self.last_s) <= MAX_STAMP_SPREAD_S
        self._far = 0 if near else self._far + 1
        if near or self._far >= FAR_STAMPS:
            self.last_s, self._far = boot_s, 0
        return boot_s

    def from_us(self, stamp: int) -> float:
        """Seconds since boot of a uint32 in µs."""
        return self._nearest(stamp / 1e6, self.WRAP_US_S)

    def _nearest(self, boot_s: float, wrap_s: float) -> float:
        if self.last_s is None:
            return boot_s
        return boot_s + wrap_s * max(0, round((self.last_s - boot_s) / wrap_s))


class Decoder:
    """MAVLink messages to events in SI units, NED.

    Absurd and non-finite values yield no event; they count as `counters.implausible`. `ids` are the messages
    that mean something here: give them to the codec as `wanted`.

    depth_source   "relative_alt" GLOBAL_POSITION_INT.relative_alt;
                   "pressure" the pressure against BAROn_GND_PRESS

    The pressure is that SCALED_PRESSURE which BARO_PRIMARY names, in water of BARO_SPEC_GRAV; there is none
    before `parameters` has them.
    """

    def __init__(
        self,
        counters: LinkCounters,
        *,
        depth_source: DepthSource = "relative_alt",
        parameters: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        self._counters = counters
        self._depth_source = depth_source
        self._parameters = parameters
        self._origin_known = False
        self._clock = BootClock()
        self._texts = _TextAssembler()
        self._last_pressure = (-math.inf, math.nan)
        self._hears_distances = False
        """Whether a DISTANCE_SENSOR looks down."""
        handlers: dict[int, Callable[[Message, float], tuple[Event, ...]]] = {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: self._heartbeat,
            mavlink.MAVLINK_MSG_ID_ATTITUDE: self._attitude,
            mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: self._global_position,
            mavlink.MAVLINK_MSG_ID_VFR_HUD: self._vfr_hud,
            **dict.fromkeys(PRESSURES, self._pressure),
            mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: self._local_position,
            mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR: self._distance_sensor,
            mavlink.MAVLINK_MSG_ID_RANGEFINDER: self._rangefinder,
            mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: self._servo_output,
            mavlink.MAVLINK_MSG_ID_TIMESYNC: self._timesync,
            mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: self._battery_status,
            mavlink.MAVLINK_MSG_ID_SYS_STATUS: self._sys_status,
            mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: self._ekf_status,
            mavlink.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT: self._named_value,
            mavlink.MAVLINK_MSG_ID_PARAM_VALUE: self._param_value,
            mavlink.MAVLINK_MSG_ID_RC_CHANNELS: self._rc_channels,
            mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: self._autopilot_version,
            mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: self._global_origin,
            mavlink.MAVLINK_MSG_ID_STATUSTEXT: self._statustext,
            mavlink.MAVLINK_MSG_ID_MANUAL_CONTROL: self._manual_control,
            mavlink.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE: self._rc_channels_override,
            mavlink.MAVLINK_MSG_ID_COMMAND_LONG: pilot_commands,
        }
        self._handlers = handlers
        self.ids = frozenset(handlers) - {mavlink.MAVLINK_MSG_ID_COMMAND_LONG}
        """What is wanted of the vehicle; a command comes from a ground station."""

    def to_events(self, message: Message, t_s: float) -> tuple[Event, ...]:
        """Convert what came at `t_s`; empty for messages that we do not use. Never raises."""
        handler = self._handlers.get(message.MESSAGE_ID)
        return handler(message, t_s) if handler else ()

    def _implausible(self) -> tuple[Event, ...]:
        self._counters.implausible += 1
        return ()

    def _depth(self, t_s: float, boot_s: float | None, z_m: float) -> tuple[Event, ...]:
        if not -MAX_DEPTH_M <= z_m <= MAX_DEPTH_M:
            return self._implausible()
        return (Depth(t_s, boot_s, z_m),)

    def _voltage(self, t_s: float, voltage_v: float) -> tuple[Event, ...]:
        if voltage_v > MAX_VOLTAGE_V:
            return self._implausible()
        return (Battery(t_s, voltage_v),) if voltage_v > 0.0 else ()

    def _heartbeat(self, m: Message, t_s: float) -> tuple[Event, ...]:
        armed = bool(m.base_mode & ARMED)
        return (Heartbeat(t_s, armed, m.custom_mode, m.system_status, m.type, m.autopilot),)

    def _attitude(self, m: Message, t_s: float) -> tuple[Event, ...]:
        roll, pitch, yaw, p, q, r = m.roll, m.pitch, m.yaw, m.rollspeed, m.pitchspeed, m.yawspeed
        sane = (
            -MAX_ANGLE_RAD <= roll <= MAX_ANGLE_RAD
            and -MAX_ANGLE_RAD <= pitch <= MAX_ANGLE_RAD
            and -MAX_ANGLE_RAD <= yaw <= MAX_ANGLE_RAD
            and -MAX_RATE_RADPS <= p <= MAX_RATE_RADPS
            and -MAX_RATE_RADPS <= q <= MAX_RATE_RADPS
            and -MAX_RATE_RADPS <= r <= MAX_RATE_RADPS
        )
        if not sane:
            return self._implausible()
        return (Attitude(t_s, self._clock.from_ms(m.time_boot_ms), roll, pitch, yaw, p, q, r),)

    def _global_position(self, m: Message, t_s: float) -> tuple[Event, ...]:
        boot_s = self._clock.from_ms(m.time_boot_ms)
        events: tuple[Event, ...] = ()
        if self._depth_source == "relative_alt":
            events = self._depth(t_s, boot_s, -m.relative_alt / 1e3)
        if self._origin_known is not (known := bool(m.lat or m.lon or m.alt)):
            self._origin_known = known
            events += (EkfOrigin(t_s, known),)
        return events

    def _vfr_hud(self, m: Message, t_s: float) -> tuple[Event, ...]:
        if not -MAX_SPEED_MPS <= m.climb <= MAX_SPEED_MPS:
            return self._implausible()
        return (DepthRate(t_s, None, -m.climb),)

    def _pressure(self, m: Message, t_s: float) -> tuple[Event, ...]:
        """Drop the repeats of a reading: the sensor is slower than its stream."""
        parameters = self._parameters
        primary = int(parameters.get("BARO_PRIMARY", -1.0))
        gravity = parameters.get("BARO_SPEC_GRAV", 0.0)
        if dict(enumerate(PRESSURES)).get(primary) != m.MESSAGE_ID or gravity <= 0.0:
            return ()
        boot_s = self._clock.from_ms(m.time_boot_ms)
        read_s, reading = self._last_pressure
        if m.press_abs == reading and 0.0 <= boot_s - read_s < PRESSURE_REPEAT_S:
            return ()
        self._last_pressure = (boot_s, m.press_abs)
        pressure_pa, pa_per_m = m.press_abs * PA_PER_HPA, PA_PER_M * gravity
        if not abs(pressure_pa) <= MAX_DEPTH_M * pa_per_m:
            return self._implausible()
        pressure = Pressure(t_s, boot_s, pressure_pa / pa_per_m)
        surface_pa = parameters.get(f"BARO{primary + 1}_GND_PRESS", 0.0)
        if self._depth_source != "pressure" or surface_pa <= 0.0:
            return (pressure,)
        return (*self._depth(t_s, boot_s, (pressure_pa - surface_pa) / pa_per_m), pressure)

    def _local_position(self, m: Message, t_s: float) -> tuple[Event, ...]:
        x, y, vx, vy = m.x, m.y, m.vx, m.vy
        sane = (
            -MAX_DISTANCE_M <= x <= MAX_DISTANCE_M
            and -MAX_DISTANCE_M <= y <= MAX_DISTANCE_M
            and -MAX_SPEED_MPS <= vx <= MAX_SPEED_MPS
            and -MAX_SPEED_MPS <= vy <= MAX_SPEED_MPS
        )
        if not sane:
            return self._implausible()
        return (Position(t_s, self._clock.from_ms(m.time_boot_ms), x, y, vx, vy),)

    def _distance_sensor(self, m: Message, t_s: float) -> tuple[Event, ...]:
        """Take the sensors that look down; leave out what has too weak a signal or is beyond their limits.

        RNGFND_SQ_MIN is the least quality, as in ArduSub's SURFTRAK. Limits that are both 0 are unknown.
        """
        if m.orientation != LOOKS_DOWN:
            return ()
        self._hears_distances = True
        quality, range_m = m.signal_quality, m.current_distance / 1e2
        least = max(self._parameters.get(QUALITY_PARAMETER, LEAST_QUALITY), NO_SIGNAL + 1)
        limited = m.min_distance or m.max_distance
        heard = range_m and (not limited or m.min_distance <= m.current_distance <= m.max_distance)
        sound = heard and (quality == UNKNOWN_QUALITY or quality >= least)
        return (Range(t_s, range_m, m.id),) if sound else ()

    def _rangefinder(self, m: Message, t_s: float) -> tuple[Event, ...]:
        """Take its distance where no DISTANCE_SENSOR comes, which says more."""
        if self._hears_distances or m.distance == 0.0:
            return ()
        if not 0.0 < m.distance <= MAX_RANGE_M:
            return self._implausible()
        return (Range(t_s, m.distance, NO_SENSOR),)

    def _servo_output(self, m: Message, t_s: float) -> tuple[Event, ...]:
        """Port 0 alone, and only once another message has told how often the µs stamp has wrapped."""
        now_s = self._clock.last_s
        if m.port != 0 or now_s is None:
            return ()
        pwm_us = (
            m.servo1_raw,
            m.servo2_raw,
            m.servo3_raw,
            m.servo4_raw,
            m.servo5_raw,
            m.servo6_raw,
            m.servo7_raw,
            m.servo8_raw,
        )
        boot_s = self._clock.from_us(m.time_usec)
        if max(pwm_us) > MAX_PWM_US or abs(boot_s - now_s) > MAX_STAMP_SPREAD_S:
            return self._implausible()
        return (ServoOutput(t_s, boot_s, pwm_us),)

    def _timesync(self, m: Message, t_s: float) -> tuple[Event, ...]:
        """Take answers alone (tc1 set), and ours alone: another's ts1 is not near our clock."""
        sent_s = m.ts1 / 1e9
        if m.tc1 == 0 or not 0.0 <= t_s - sent_s <= MAX_ROUND_TRIP_S:
            return ()
        if m.tc1 < 0:
            return self._implausible()
        return (TimeSync(t_s, sent_s, self._clock.from_ns(m.tc1)),)

    def _battery_status(self, m: Message, t_s: float) -> tuple[Event, ...]:
        """Sum the cells of the first battery; without cell sensing the first cell carries it all."""
        if m.id != 0:
            return ()
        cells = (mv for mv in (*m.voltages, *m.voltages_ext) if mv != UINT16_MAX)
        return self._voltage(t_s, sum(cells) / 1e3)

    def _sys_status(self, m: Message, t_s: float) -> tuple[Event, ...]:
        if m.voltage_battery == UINT16_MAX:
            return ()
        return self._voltage(t_s, m.voltage_battery / 1e3)

    def _ekf_status(self, m: Message, t_s: float) -> tuple[Event, ...]:
        variance = max(m.velocity_variance, m.pos_vert_variance, m.compass_variance)
        if not math.isfinite(m.velocity_variance + m.pos_vert_variance + m.compass_variance):
            return self._implausible()
        initialised = not m.flags & EKF_UNINITIALIZED
        depth = m.flags & EKF_DEPTH == EKF_DEPTH and initialised
        moves = m.flags & mavlink.EKF_VELOCITY_HORIZ and not m.flags & mavlink.EKF_CONST_POS_MODE
        position = bool(moves and m.flags & EKF_PLACE)
        absolute = bool(m.flags & mavlink.EKF_POS_HORIZ_ABS)
        return (
            EkfStatus(t_s, bool(m.flags & EKF_ATTITUDE), depth, variance, position, initialised, absolute),
        )

    def _named_value(self, m: Message, t_s: float) -> tuple[Event, ...]:
        if m.name in ("InputHold", "RollPitch"):
            if m.value not in (0.0, 1.0):
                return self._implausible()
            return (PilotToggle(t_s, m.name, m.value == 1.0),)
        if m.name != "PilotGain":
            return ()
        if not 0.0 <= m.value <= 1.0:
            return self._implausible()
        return (PilotGain(t_s, m.value),)

    def _param_value(self, m: Message, t_s: float) -> tuple[Event, ...]:
        if not math.isfinite(m.param_value):
            return self._implausible()
        return (Parameter(t_s, m.param_id, m.param_value),)

    def _rc_channels(self, m: Message, t_s: float) -> tuple[Event, ...]:
        return (ReceiverChannels(t_s, m.chancount),)

    def _autopilot_version(self, m: Message, t_s: float) -> tuple[Event, ...]:
        major, minor, patch, release = m.flight_sw_version.to_bytes(4, "big")
        kind = f" ({RELEASES[release]})" if release in RELEASES else ""
        return (Firmware(t_s, f"{major}.{minor}.{patch}{kind}", (major, minor, patch)),)

    def _global_origin(self, m: Message, t_s: float) -> tuple[Event, ...]:
        latitude_deg, longitude_deg = m.latitude / 1e7, m.longitude / 1e7
        if abs(latitude_deg) > 90.0 or abs(longitude_deg) > 180.0:
            return self._implausible()
        return (GlobalOrigin(t_s, latitude_deg, longitude_deg, m.altitude / 1e3),)

    def _statustext(self, m: Message, t_s: float) -> tuple[Event, ...]:
        events: tuple[Event, ...] = ()
        for severity, text in self._texts.add(m):
            events += (StatusText(t_s, severity, text),)
            if LEAK_TEXT in text.lower():
                events += (Leak(t_s),)
        return events

    def _manual_control(self, m: Message, t_s: float) -> tuple[Event, ...]:
        sticks = max(abs(m.x), abs(m.y), abs(m.r)) / STICK
        throttle = abs(m.z - STICK_NEUTRAL_Z) / STICK_NEUTRAL_Z
        tilt = max(abs(m.s), abs(m.t)) / SPAN_US
        return (PilotInput(t_s, min(1.0, max(sticks, throttle, tilt))),)

    def _rc_channels_override(self, m: Message, t_s: float) -> tuple[Event, ...]:
        return (PilotInput(t_s, override_deflection(m) or 0.0),)


class _TextAssembler:
    """Puts STATUSTEXT's 50-character chunks together, one text at a time and at most MAX_CHUNKS long.

    A text whose next chunk is lost comes out cut, when another text begins. Control characters come out
    escaped.
    """

    def __init__(self) -> None:
        self._id = 0
        self._severity = 0
        self._chunks: list[str] = []

    def add(self, m: Message) -> list[tuple[int, str]]:
        """Return the texts (severity, text) that `m` completes."""
        done: list[tuple[int, str]] = []
        if self._chunks and (m.id != self._id or m.chunk_seq != len(self._chunks)):
            done.append(self._finish())
        self._id, self._severity = m.id, m.severity
        self._chunks.append(m.text)
        if m.id == 0 or len(m.text) < CHUNK_CHARS or len(self._chunks) == MAX_CHUNKS:
            done.append(self._finish())
        return done

    def _finish(self) -> tuple[int, str]:
        text = printable("".join(self._chunks))
        self._chunks.clear()
        return self._severity, text


def pilot_sticks(m: Message, t_s: float) -> PilotSticks:
    """Convert the pilot's MANUAL_CONTROL; INT16_MAX, MAVLink's word for an axis that is not there, rests."""
    return PilotSticks(
        t_s,
        AxisCommand(
            surge=from_stick(m.x),
            sway=from_stick(m.y),
            heave=0.0 if m.z == INT16_MAX else clip((STICK_NEUTRAL_Z - m.z) / STICK_NEUTRAL_Z),
            yaw=from_stick(m.r),
            roll=clip(m.t / SPAN_US),
            pitch=clip(m.s / SPAN_US),
        ),
        m.buttons,
        (m.buttons2, m.enabled_extensions),
        (m.aux1, m.aux2, m.aux3, m.aux4, m.aux5, m.aux6),
    )


def pilot_commands(m: Message, t_s: float) -> tuple[PilotCommand, ...]:
    """Convert a COMMAND_LONG to our component; empty for another command than MAV_CMD_USER_1."""
    if m.command != mavlink.MAV_CMD_USER_1:
        return ()
    return (PilotCommand(t_s, PilotAction(int(m.param1)) if m.param1 in ACTIONS else None),)


def override_deflection(m: Message) -> float | None:
    """Return how far an RC_CHANNELS_OVERRIDE moves the six axes, 0..1; None if it leaves them all alone."""
    channels = (m.chan1_raw, m.chan2_raw, m.chan3_raw, m.chan4_raw, m.chan5_raw, m.chan6_raw)
    offsets = [abs(us - NEUTRAL_US) for us in channels if us not in (0, LEAVE_ALONE)]
    return min(1.0, max(offsets) / SPAN_US) if offsets else None


POSITION, VELOCITY, ACCELERATION, DEPTH = 0b111, 0b111 << 3, 0b111 << 6, 1 << 2
IGNORES_YAW, IGNORES_YAW_RATE, IS_FORCE = 1 << 10, 1 << 11, 1 << 9
"""Bits of POSITION_TARGET_TYPEMASK. As in ArduSub one of three leaves out all; a depth may stand alone."""

IGNORES_ATTITUDE, IGNORES_THRUST = 1 << 7, 1 << 6
"""Bits of ATTITUDE_TARGET_TYPEMASK; ArduSub does not look at those of the rates."""

TARGET_FRAMES: Final = {
    mavlink.MAV_FRAME_LOCAL_NED: (False, False, False),
    mavlink.MAV_FRAME_LOCAL_OFFSET_NED: (True, False, False),
    mavlink.MAV_FRAME_BODY_NED: (True, True, False),
    mavlink.MAV_FRAME_BODY_OFFSET_NED: (True, True, True),
    mavlink.MAV_FRAME_BODY_FRD: (True, True, False),
}
"""Whether places count from the vehicle, whether axes are its own, whether headings count from its own."""

GLOBAL_FRAMES: Final = {
    mavlink.MAV_FRAME_GLOBAL: True,
    mavlink.MAV_FRAME_GLOBAL_INT: True,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT: False,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT: False,
}
"""Whether an altitude is over the sea, not over the surface of the water that is dived in."""


def position_target(m: Message, t_s: float, origin: GlobalOrigin | None = None) -> PositionTarget | None:
    """Convert SET_POSITION_TARGET_LOCAL_NED; None where it asks for what is not supported, or for nothing.

    A force is not followed, and an acceleration only beside a velocity.
    """
    frame, mask = TARGET_FRAMES.get(m.coordinate_frame), m.type_mask
    if frame is None or mask & IS_FORCE:
        return None
    heading = math.nan if mask & IGNORES_YAW else m.yaw
    rate = math.nan if mask & IGNORES_YAW_RATE else m.yaw_rate
    return _target(m, t_s, (m.x, m.y, m.z, heading), rate, frame)


def global_target(m: Message, t_s: float, origin: GlobalOrigin | None) -> PositionTarget | None:
    """Convert SET_POSITION_TARGET_GLOBAL_INT, None as above and for a place while no origin is known.

    As in ArduSub its heading is not read, and a depth that stands alone is under the EKF's origin.
    """
    over_the_sea, mask = GLOBAL_FRAMES.get(m.coordinate_frame), m.type_mask
    if over_the_sea is None or mask & IS_FORCE:
        return None
    north_m, east_m, depth_m = math.nan, math.nan, -m.alt
    if not mask & POSITION:
        if origin is None:
            return None
        place = m.lat_int / 1e7, m.lon_int / 1e7
        north_m, east_m = metres(place, origin.place_deg)
        depth_m += origin.altitude_m if over_the_sea else 0.0
    return _target(m, t_s, (north_m, east_m, depth_m, math.nan), math.nan, (False, False, False))


def _target(
    m: Message, t_s: float, place: Vector, rate: float, frame: tuple[bool, bool, bool]
) -> PositionTarget | None:
    """Return what the mask leaves of a target."""
    x, y, z, heading = place
    mask, nan = m.type_mask, math.nan
    if mask & POSITION:
        x, y, z = nan, nan, z if mask & POSITION == POSITION & ~DEPTH else nan
    u, v, w = (nan, nan, nan) if mask & VELOCITY else (m.vx, m.vy, m.vz)
    a, b, c = (nan, nan, nan) if mask & (VELOCITY | ACCELERATION) else (m.afx, m.afy, m.afz)
    places, speeds, accelerations = (x, y, z, heading), (u, v, w, rate), (a, b, c, nan)
    for values, most in ((places, MAX_DISTANCE_M), (speeds, MAX_SPEED_MPS), (accelerations, MAX_SPEED_MPS)):
        if any(abs(value) > most for value in values):
            return None
    if all(map(math.isnan, (*places, *speeds))):
        return None
    return PositionTarget(t_s, places, speeds, accelerations, *frame)


def attitude_target(m: Message, t_s: float, origin: GlobalOrigin | None = None) -> AttitudeTarget | None:
    """Convert SET_ATTITUDE_TARGET; None where it says nothing. Half thrust keeps the depth, as in ArduSub."""
    angles, heading, climb = Angles(math.nan, math.nan), math.nan, 0.0
    w, x, y, z = m.q
    if not m.type_mask & IGNORES_ATTITUDE and 0.9 < w * w + x * x + y * y + z * z < 1.1:
        roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
        pitch = math.asin(clip(2.0 * (w * y - z * x)))
        angles, heading = Angles(roll, pitch), math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    if not m.type_mask & IGNORES_THRUST and math.isfinite(m.thrust):
        climb = clip(2.0 * m.thrust - 1.0)
    if math.isnan(heading) and climb == 0.0:
        return None
    return AttitudeTarget(t_s, angles, heading, climb)
