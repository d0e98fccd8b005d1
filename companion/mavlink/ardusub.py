"""ArduSub's signs, scales and modes: the only place that knows them.

| ArduSub's | ours |
|---|---|
| altitude, climb, throttle: up positive | depth, depth rate, heave: down positive |
| mm, cm/s, mV, µs, ms, ns | m, m/s, V, s |
| PWM 1100..1900 µs, sticks -1000..1000 | axis demand -1..1 |
| uint32 boot stamps that wrap (71.6 min in µs, 49.7 days in ms) | seconds since boot that do not |

Source: ArduSub facts, sections 'Who may steer', 'MANUAL_CONTROL', 'RC_CHANNELS_OVERRIDE', 'Modes', 'Arming',
'Telemetry'.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Final, Literal, TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.mavlink.codec import Message
from companion.records import (
    Attitude,
    AxisCommand,
    Battery,
    CommandAck,
    Depth,
    DepthRate,
    EkfOrigin,
    EkfStatus,
    Event,
    Firmware,
    Heartbeat,
    Leak,
    LinkCounters,
    Parameter,
    PilotGain,
    PilotInput,
    PilotSticks,
    PilotToggle,
    Position,
    ReceiverChannels,
    ServoOutput,
    StatusText,
    TimeSync,
)
from companion.telemetry.modes import Mode as Mode
from companion.telemetry.schemas import printable

DepthSource: TypeAlias = Literal["relative_alt", "vfr_hud", "ahrs2", "pressure"]
RateSource: TypeAlias = Literal["climb", "vz"]
ThrustPath: TypeAlias = Literal["rc_override", "manual_control"]

ARMED: Final = mavlink.MAV_MODE_FLAG_SAFETY_ARMED
UINT16_MAX: Final = 0xFFFF

NEUTRAL_US: Final = 1500
SPAN_US: Final = 400
LEAVE_ALONE: Final = UINT16_MAX
STICK: Final = 1000
STICK_NEUTRAL_Z: Final = 500
INT16_MAX: Final = 0x7FFF
MAX_GAIN: Final = 10.0
FLOAT32_HALF_STEP_US: Final = 6e-5
"""The firmware computes PWM in float32: what is nearer than this to a whole µs is that µs."""

MAX_DEPTH_M: Final = 12_000.0
MAX_SPEED_MPS: Final = 20.0
MAX_DISTANCE_M: Final = 1e5
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
PRESSURES: Final = (
    mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE,
    mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE2,
    mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE3,
)
"""By barometer: BARO_PRIMARY, where ArduSub notes which one is in the water, counts from 0."""

FRAMES: Final = {0.0: "bluerov1", 1.0: "vectored", 2.0: "vectored_6dof"}
"""Names of FRAME_CONFIG's values."""

RELEASES: Final = {0: "dev", 64: "alpha", 128: "beta", 192: "rc"}

EKF_ATTITUDE: Final = mavlink.EKF_ATTITUDE
EKF_DEPTH: Final = mavlink.EKF_VELOCITY_VERT | mavlink.EKF_POS_VERT_ABS
EKF_UNINITIALIZED: Final = mavlink.EKF_UNINITIALIZED
EKF_PLACE: Final = mavlink.EKF_POS_HORIZ_REL | mavlink.EKF_POS_HORIZ_ABS
LEAK_TEXT: Final = "leak detected"
"""ArduSub says so every 20 s while a detector is wet and FS_LEAK_ENABLE is not 0 (failsafe_leak_check)."""

CHUNK_CHARS: Final = 50
MAX_CHUNKS: Final = 8


# --- From the vehicle ---------------------------------------------------------------------------------------


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


class Converter:
    """MAVLink messages to events in SI units, NED.

    Absurd and non-finite values yield no event; they count as `counters.implausible`. `ids` are the messages
    that mean something here: give them to the codec as `wanted`.

    depth_source   "relative_alt" GLOBAL_POSITION_INT.relative_alt; "vfr_hud" .alt; "ahrs2" .altitude;
                   "pressure" that SCALED_PRESSURE which BARO_PRIMARY names, against BAROn_GND_PRESS in water
                   of BARO_SPEC_GRAV; no depth before `parameters` tells them
    rate_source    "climb" VFR_HUD.climb; "vz" GLOBAL_POSITION_INT.vz
    """

    def __init__(
        self,
        counters: LinkCounters,
        *,
        depth_source: DepthSource = "relative_alt",
        rate_source: RateSource = "climb",
        parameters: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        self._counters = counters
        self._depth_source = depth_source
        self._rate_source = rate_source
        self._parameters = parameters
        self._origin_known = False
        self._clock = BootClock()
        self._texts = _TextAssembler()
        self._last_pressure = (-math.inf, math.nan)
        handlers: dict[int, Callable[[Message, float], tuple[Event, ...]]] = {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: self._heartbeat,
            mavlink.MAVLINK_MSG_ID_ATTITUDE: self._attitude,
            mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: self._global_position,
            mavlink.MAVLINK_MSG_ID_VFR_HUD: self._vfr_hud,
            mavlink.MAVLINK_MSG_ID_AHRS2: self._ahrs2,
            **dict.fromkeys(PRESSURES, self._pressure),
            mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: self._local_position,
            mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: self._servo_output,
            mavlink.MAVLINK_MSG_ID_TIMESYNC: self._timesync,
            mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: self._battery_status,
            mavlink.MAVLINK_MSG_ID_SYS_STATUS: self._sys_status,
            mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: self._ekf_status,
            mavlink.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT: self._named_value,
            mavlink.MAVLINK_MSG_ID_PARAM_VALUE: self._param_value,
            mavlink.MAVLINK_MSG_ID_COMMAND_ACK: self._command_ack,
            mavlink.MAVLINK_MSG_ID_RC_CHANNELS: self._rc_channels,
            mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: self._autopilot_version,
            mavlink.MAVLINK_MSG_ID_STATUSTEXT: self._statustext,
            mavlink.MAVLINK_MSG_ID_MANUAL_CONTROL: self._manual_control,
            mavlink.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE: self._rc_channels_override,
        }
        if depth_source != "ahrs2":
            del handlers[mavlink.MAVLINK_MSG_ID_AHRS2]
        if depth_source != "pressure":
            for message_id in PRESSURES:
                del handlers[message_id]
        self._handlers = handlers
        self.ids = frozenset(handlers)

    def to_events(self, message: Message, t_s: float) -> tuple[Event, ...]:
        """Convert what came at `t_s`; empty for messages that say nothing we use. Never raises."""
        handler = self._handlers.get(message.get_msgId())
        return handler(message, t_s) if handler else ()

    def _implausible(self) -> tuple[Event, ...]:
        self._counters.implausible += 1
        return ()

    def _depth(self, t_s: float, boot_s: float | None, z_m: float) -> tuple[Event, ...]:
        if not -MAX_DEPTH_M <= z_m <= MAX_DEPTH_M:
            return self._implausible()
        return (Depth(t_s, boot_s, z_m),)

    def _depth_rate(self, t_s: float, boot_s: float | None, w_mps: float) -> tuple[Event, ...]:
        if not -MAX_SPEED_MPS <= w_mps <= MAX_SPEED_MPS:
            return self._implausible()
        return (DepthRate(t_s, boot_s, w_mps),)

    def _voltage(self, t_s: float, voltage_v: float) -> tuple[Event, ...]:
        if voltage_v > MAX_VOLTAGE_V:
            return self._implausible()
        return (Battery(t_s, voltage_v),) if voltage_v > 0.0 else ()

    def _heartbeat(self, m: Message, t_s: float) -> tuple[Event, ...]:
        return (Heartbeat(t_s, bool(m.base_mode & ARMED), m.custom_mode, m.system_status, m.type),)

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
        if self._rate_source == "vz":
            events += self._depth_rate(t_s, boot_s, m.vz / 1e2)
        if self._origin_known is not (known := bool(m.lat or m.lon or m.alt)):
            self._origin_known = known
            events += (EkfOrigin(t_s, known),)
        return events

    def _vfr_hud(self, m: Message, t_s: float) -> tuple[Event, ...]:
        events: tuple[Event, ...] = ()
        if self._depth_source == "vfr_hud":
            events = self._depth(t_s, None, -m.alt)
        if self._rate_source == "climb":
            events += self._depth_rate(t_s, None, -m.climb)
        return events

    def _ahrs2(self, m: Message, t_s: float) -> tuple[Event, ...]:
        return self._depth(t_s, None, -m.altitude)

    def _pressure(self, m: Message, t_s: float) -> tuple[Event, ...]:
        """Drop the repeats of a reading: the sensor is slower than its stream."""
        parameters = self._parameters
        primary = int(parameters.get("BARO_PRIMARY", -1.0))
        surface_pa = parameters.get(f"BARO{primary + 1}_GND_PRESS", 0.0)
        gravity = parameters.get("BARO_SPEC_GRAV", 0.0)
        if m.get_msgId() != dict(enumerate(PRESSURES)).get(primary) or surface_pa <= 0.0 or gravity <= 0.0:
            return ()
        boot_s = self._clock.from_ms(m.time_boot_ms)
        read_s, reading = self._last_pressure
        if m.press_abs == reading and 0.0 <= boot_s - read_s < PRESSURE_REPEAT_S:
            return ()
        self._last_pressure = (boot_s, m.press_abs)
        return self._depth(t_s, boot_s, (m.press_abs * PA_PER_HPA - surface_pa) / (PA_PER_M * gravity))

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
        return (EkfStatus(t_s, bool(m.flags & EKF_ATTITUDE), depth, variance, position, initialised),)

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

    def _command_ack(self, m: Message, t_s: float) -> tuple[Event, ...]:
        return (CommandAck(t_s, m.command, m.result),)

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
        """Give the texts (severity, text) that `m` completes."""
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


# --- To the vehicle -----------------------------------------------------------------------------------------


class Commands:
    """Builds the messages for one vehicle; `Codec.encode` packs them."""

    def __init__(self, target_system: int = 1, target_component: int = 1) -> None:
        self._system = target_system
        self._component = target_component

    def heartbeat(self) -> Message:
        """Our own sign of life, as an onboard controller."""
        return mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_ONBOARD_CONTROLLER,
            mavlink.MAV_AUTOPILOT_INVALID,
            0,
            0,
            mavlink.MAV_STATE_ACTIVE,
            3,
        )

    def rc_override(self, command: AxisCommand, *, tilts: bool = False) -> Message:
        """Four axes as PWM, with `tilts` all six; camera and all further channels are left alone."""
        return mavlink.MAVLink_rc_channels_override_message(
            self._system,
            self._component,
            _pwm_us(command.pitch) if tilts else LEAVE_ALONE,
            _pwm_us(command.roll) if tilts else LEAVE_ALONE,
            _pwm_us(-command.heave),
            _pwm_us(command.yaw),
            _pwm_us(command.surge),
            _pwm_us(command.sway),
            LEAVE_ALONE,
            LEAVE_ALONE,
        )

    def manual_control(
        self, command: AxisCommand, gain: float, throttle_gain: float, pilot: PilotSticks | None = None
    ) -> Message:
        """Axes as sticks that undo the pilot's `gain` and JS_THR_GAIN, within `manual_control_reach`.

        Pitch and roll go as s and t, which ArduSub adds in µs. Buttons and all further fields are those of
        the pilot, where there is one.
        """
        x, y, z, r = _sticks(command, gain, throttle_gain)
        s, t = _pwm_us(command.pitch) - NEUTRAL_US, _pwm_us(command.roll) - NEUTRAL_US
        buttons, extensions, aux = (pilot.buttons, pilot.extensions, pilot.aux) if pilot else (0, (0, 0), ())
        return mavlink.MAVLink_manual_control_message(
            self._system, x, y, z, r, buttons, *extensions, s, t, *aux
        )

    def set_mode(self, mode: Mode) -> Message:
        """Ask for a flight mode; HEARTBEAT tells whether it was granted."""
        return self._command(
            mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, float(mode)
        )

    def arm(self, armed: bool) -> Message:
        """Ask to arm or disarm; HEARTBEAT tells whether it was granted (facts: 'Arming')."""
        return self._command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, float(armed))

    def message_interval(self, message_id: int, rate_hz: float) -> Message:
        """Ask for a message `rate_hz` times a second; 0 stops it."""
        interval_us = 1e6 / rate_hz if rate_hz > 0.0 else -1.0
        return self._command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, float(message_id), interval_us)

    def request_message(self, message_id: int) -> Message:
        """Ask for one message, once."""
        return self._command(mavlink.MAV_CMD_REQUEST_MESSAGE, float(message_id))

    def set_origin(self, latitude_deg: float, longitude_deg: float) -> Message:
        """Tell the EKF where on earth it is, at sea level; dropped silently if it knows already."""
        return mavlink.MAVLink_set_gps_global_origin_message(
            self._system, round(latitude_deg * 1e7), round(longitude_deg * 1e7), 0
        )

    def timesync(self, now_s: float) -> Message:
        """Ask for the autopilot's clock; the answer carries our `now_s` back."""
        return mavlink.MAVLink_timesync_message(0, round(now_s * 1e9))

    def read_parameter(self, name: str) -> Message:
        """Ask for a parameter's value; `name` has at most 16 ASCII characters."""
        return mavlink.MAVLink_param_request_read_message(self._system, self._component, name.encode(), -1)

    def _command(self, command: int, *params: float) -> Message:
        padded = (*params, *(0.0,) * (7 - len(params)))
        return mavlink.MAVLink_command_long_message(self._system, self._component, command, 0, *padded)


def pilot_sticks(m: Message, t_s: float) -> PilotSticks:
    """Convert the pilot's MANUAL_CONTROL; INT16_MAX, MAVLink's word for an axis that is not there, rests."""
    return PilotSticks(
        t_s,
        AxisCommand(
            surge=_fraction(m.x),
            sway=_fraction(m.y),
            heave=0.0 if m.z == INT16_MAX else _clip((STICK_NEUTRAL_Z - m.z) / STICK_NEUTRAL_Z),
            yaw=_fraction(m.r),
            roll=_clip(m.t / SPAN_US),
            pitch=_clip(m.s / SPAN_US),
        ),
        m.buttons,
        (m.buttons2, m.enabled_extensions),
        (m.aux1, m.aux2, m.aux3, m.aux4, m.aux5, m.aux6),
    )


def override_deflection(m: Message) -> float | None:
    """Return how far an RC_CHANNELS_OVERRIDE moves the six axes, 0..1; None if it leaves them all alone."""
    channels = (m.chan1_raw, m.chan2_raw, m.chan3_raw, m.chan4_raw, m.chan5_raw, m.chan6_raw)
    offsets = [abs(us - NEUTRAL_US) for us in channels if us not in (0, LEAVE_ALONE)]
    return min(1.0, max(offsets) / SPAN_US) if offsets else None


def stick_demand(sticks: AxisCommand, gain: float, throttle_gain: float) -> AxisCommand:
    """Return what the vehicle makes of the pilot's sticks: demands as `AxisCommand` counts them."""
    reach = manual_control_reach(gain, throttle_gain)
    return AxisCommand(
        surge=sticks.surge * reach.surge,
        sway=sticks.sway * reach.sway,
        heave=sticks.heave * reach.heave,
        yaw=sticks.yaw * reach.yaw,
        roll=sticks.roll,
        pitch=sticks.pitch,
    )


def manual_control_reach(gain: float, throttle_gain: float) -> AxisCommand:
    """Largest demand on each axis, 0..1, that MANUAL_CONTROL can express at this gain."""
    level, throttle = _full_stick(gain, throttle_gain)
    level = min(1.0, level)
    return AxisCommand(surge=level, sway=level, heave=min(1.0, throttle), yaw=level)


def quantise(
    command: AxisCommand, path: ThrustPath, gain: float = 1.0, throttle_gain: float = 1.0
) -> AxisCommand:
    """Give what the vehicle applies of `command`.

    RC_CHANNELS_OVERRIDE: whole µs. MANUAL_CONTROL: whole stick steps, then µs with the fraction cut off, as
    the firmware's integers do; so up to 1 µs less forward, right and clockwise, 2 µs less up.
    """
    if path == "rc_override":
        return AxisCommand(
            surge=_demand(_pwm_us(command.surge)),
            sway=_demand(_pwm_us(command.sway)),
            heave=-_demand(_pwm_us(-command.heave)),
            yaw=_demand(_pwm_us(command.yaw)),
            roll=_demand(_pwm_us(command.roll)),
            pitch=_demand(_pwm_us(command.pitch)),
        )
    x, y, z, r = _sticks(command, gain, throttle_gain)
    level, throttle = _full_stick(gain, throttle_gain)
    scale = SPAN_US / STICK * level
    throttle_scale = SPAN_US / STICK_NEUTRAL_Z * throttle
    throttle_base = _whole_us(NEUTRAL_US - STICK_NEUTRAL_Z * throttle_scale)
    return AxisCommand(
        surge=_demand(_whole_us(NEUTRAL_US + x * scale)),
        sway=_demand(_whole_us(NEUTRAL_US + y * scale)),
        heave=-_demand(_whole_us(throttle_base + z * throttle_scale)),
        yaw=_demand(_whole_us(NEUTRAL_US + r * scale)),
        roll=_demand(_pwm_us(command.roll)),
        pitch=_demand(_pwm_us(command.pitch)),
    )


def unmirrored(event: ServoOutput, parameters: Mapping[str, float]) -> ServoOutput:
    """Return what the outputs would be if no motor were reversed by MOT_n_DIRECTION = -1."""
    return replace(
        event,
        pwm_us=tuple(
            2 * NEUTRAL_US - pwm if pwm and parameters.get(f"MOT_{i}_DIRECTION", 1.0) < 0.0 else pwm
            for i, pwm in enumerate(event.pwm_us, start=1)
        ),
    )


def motor_demand(pwm_us: Sequence[int]) -> tuple[float, ...]:
    """Motor demands -1..1 from servo outputs in µs; no pulse (0) is no thrust."""
    return tuple((us - NEUTRAL_US) / SPAN_US if us else 0.0 for us in pwm_us)


def _pwm_us(demand: float) -> int:
    if not math.isfinite(demand):
        return NEUTRAL_US
    return NEUTRAL_US + round(SPAN_US * _clip(demand))


def _demand(pwm_us: int) -> float:
    return _clip((pwm_us - NEUTRAL_US) / SPAN_US)


def _whole_us(us: float) -> int:
    return int(us + FLOAT32_HALF_STEP_US)


def _full_stick(gain: float, throttle_gain: float) -> tuple[float, float]:
    """Give what full stick demands on the level axes and on the throttle; 0 where the gains are absurd."""
    level = gain if 0.0 < gain <= MAX_GAIN else 0.0
    return level, level * (throttle_gain if 0.0 < throttle_gain <= MAX_GAIN else 0.0)


def _sticks(command: AxisCommand, gain: float, throttle_gain: float) -> tuple[int, int, int, int]:
    level, throttle = _full_stick(gain, throttle_gain)
    return (
        round(STICK * _deflection(command.surge, level)),
        round(STICK * _deflection(command.sway, level)),
        STICK_NEUTRAL_Z - round(STICK_NEUTRAL_Z * _deflection(command.heave, throttle)),
        round(STICK * _deflection(command.yaw, level)),
    )


def _deflection(demand: float, full_stick: float) -> float:
    if not math.isfinite(demand) or full_stick == 0.0:
        return 0.0
    return _clip(_clip(demand) / full_stick)


def _fraction(stick: int) -> float:
    return 0.0 if stick == INT16_MAX else _clip(stick / STICK)


def _clip(value: float) -> float:
    return -1.0 if value < -1.0 else 1.0 if value > 1.0 else value
