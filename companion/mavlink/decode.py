"""From the autopilot's messages to events in SI units, NED.

Source: docs/ardusub.md, "Telemetry", "Modes and arming", "MANUAL_CONTROL".
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from operator import attrgetter
from types import MappingProxyType
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion import records
from companion.mavlink.ardusub import (
    DIRECTIONS,
    FUNCTIONS,
    MAX_DISTANCE_M,
    MAX_SPEED_MPS,
    NEUTRAL_US,
    PRESSURES,
    QUALITY_PARAMETER,
    READING_REPEATS_S,
    SPAN_US,
    STICK,
    STICK_NEUTRAL_Z,
    DepthSource,
    motor_outputs,
)
from companion.mavlink.freshness import MESSAGES
from companion.mavlink.messages import CHUNK_CHARS, Message
from companion.mavlink.pilot_frames import override_deflection
from companion.records import Event, LinkCounters
from companion.telemetry.schemas import printable

UINT16_MAX: Final = 0xFFFF
MAX_DEPTH_M: Final = 12_000.0
MAX_ANGLE_RAD: Final = 6.3
MAX_RATE_RADPS: Final = 50.0
MAX_PWM_US: Final = 3000
MAX_VOLTAGE_V: Final = 1000.0
MAX_ROUND_TRIP_S: Final = 5.0
MAX_STAMP_SPREAD_S: Final = 10.0
"""A larger value is impossible and is dropped: deeper than the deepest trench, more than a turn, quicker than
a gyro measures, longer than a servo's pulse, older than any link keeps."""

WRAP_MS_S: Final = 2**32 / 1e3
WRAP_US_S: Final = 2**32 / 1e6
UNKNOWN_QUALITY, NO_SIGNAL, LEAST_QUALITY = 0, 1, 90.0
"""DISTANCE_SENSOR.signal_quality, up to 100; the least where RNGFND_SQ_MIN is missing: its default."""

PA_PER_M: Final = 9800.0
"""ArduSub's, at BARO_SPEC_GRAV 1 (docs/ardusub.md, "Telemetry")."""
RELEASES: Final = {0: "dev", 64: "alpha", 128: "beta", 192: "rc"}

EKF_DEPTH: Final = mavlink.EKF_VELOCITY_VERT | mavlink.EKF_POS_VERT_ABS
EKF_PLACE: Final = mavlink.EKF_POS_HORIZ_REL | mavlink.EKF_POS_HORIZ_ABS
LEAK_TEXT: Final = "leak detected"
"""ArduSub says so every 20 s while a detector is wet and FS_LEAK_ENABLE is not 0 (failsafe_leak_check)."""

MAX_CHUNKS: Final = 8
DEPTH_SENSOR: Final = mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
SERVOS: Final = attrgetter(*(f"servo{output}_raw" for output in range(1, len(FUNCTIONS) + 1)))


class ImplausibleError(Exception):
    """A value that no vehicle has."""


def _refuse_beyond(most: float, *values: float) -> None:
    """Raise ImplausibleError for a value beyond -most..most, or that is no number."""
    for value in values:
        if not -most <= value <= most:
            raise ImplausibleError


class BootClock:
    """The autopilot's clock in seconds since boot, from stamps that wrap.

    A stamp stands for the time nearest to the last one known: a wrap goes on counting, a reboot goes back.
    Only milliseconds move the clock: microseconds wrap too early to be trusted alone. A stamp far from the
    others moves it only when MESSAGES of them have come in a row.
    """

    def __init__(self) -> None:
        self.last_s: float | None = None
        self._far = 0

    def from_ns(self, stamp: int) -> float:
        """Seconds since boot of an int64 in ns; before any other stamp, its count of wraps is taken."""
        if self.last_s is None:
            self.last_s = stamp / 1e9
        return self._nearest(stamp / 1e9 % WRAP_MS_S, WRAP_MS_S)

    def from_ms(self, stamp: int) -> float:
        """Seconds since boot of a uint32 in ms."""
        boot_s = self._nearest(stamp / 1e3, WRAP_MS_S)
        near = self.last_s is None or abs(boot_s - self.last_s) <= MAX_STAMP_SPREAD_S
        self._far = 0 if near else self._far + 1
        if near or self._far >= MESSAGES:
            self.last_s, self._far = boot_s, 0
        return boot_s

    def from_us(self, stamp: int) -> float:
        """Seconds since boot of a uint32 in µs."""
        return self._nearest(stamp / 1e6, WRAP_US_S)

    def _nearest(self, boot_s: float, wrap_s: float) -> float:
        wraps = 0 if self.last_s is None else max(0, round((self.last_s - boot_s) / wrap_s))
        return boot_s + wrap_s * wraps


class Decoder:
    """MAVLink messages to events in SI units, NED: the method `_attitude` takes ATTITUDE, and so on.

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
        self._battery = UINT16_MAX
        self._handlers: dict[int, Callable[[Message, float], Iterable[Event]]] = {
            message_id: handler
            for message_id, kind in mavlink.mavlink_map.items()
            if (handler := getattr(self, f"_{kind.msgname.lower()}", None))
        }
        self.ids = frozenset(self._handlers)

    def to_events(self, message: Message, t_s: float) -> list[Event]:
        """Convert what came at `t_s`; empty for messages that we do not use. Never raises."""
        handler = self._handlers.get(message.MESSAGE_ID)
        try:
            return list(handler(message, t_s)) if handler else []
        except ImplausibleError:
            self._counters.implausible += 1
            return []

    def _heartbeat(self, m: Message, t_s: float) -> Iterator[Event]:
        armed = bool(m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        yield records.Heartbeat(t_s, armed, m.custom_mode, m.system_status, m.type, m.autopilot)

    def _attitude(self, m: Message, t_s: float) -> Iterable[Event]:
        angles, rates = (m.roll, m.pitch, m.yaw), (m.rollspeed, m.pitchspeed, m.yawspeed)
        _refuse_beyond(MAX_ANGLE_RAD, *angles)
        _refuse_beyond(MAX_RATE_RADPS, *rates)
        return (records.Attitude(t_s, self._clock.from_ms(m.time_boot_ms), *angles, *rates),)

    def _global_position_int(self, m: Message, t_s: float) -> Iterator[Event]:
        """Give the depth, if it is sane, and whether the EKF knows its origin, where that changes."""
        boot_s, depth_m = self._clock.from_ms(m.time_boot_ms), -m.relative_alt / 1e3
        known = bool(m.lat or m.lon or m.alt)
        if self._depth_source == "relative_alt":
            if abs(depth_m) <= MAX_DEPTH_M:
                yield records.Depth(t_s, boot_s, depth_m)
            else:
                self._counters.implausible += 1
        if self._origin_known is not known:
            self._origin_known = known
            yield records.EkfOrigin(t_s, known)

    def _vfr_hud(self, m: Message, t_s: float) -> Iterable[Event]:
        _refuse_beyond(MAX_SPEED_MPS, m.climb)
        return (records.DepthRate(t_s, None, -m.climb),)

    def _scaled_pressure(self, m: Message, t_s: float) -> Iterator[Event]:
        """Drop the repeats of a reading: the sensor is slower than its stream."""
        parameters = self._parameters
        primary = int(parameters.get("BARO_PRIMARY", -1.0))
        gravity = parameters.get("BARO_SPEC_GRAV", 0.0)
        if PRESSURES.index(m.MESSAGE_ID) != primary or gravity <= 0.0:
            return
        boot_s = self._clock.from_ms(m.time_boot_ms)
        read_s, reading = self._last_pressure
        if m.press_abs == reading and 0.0 <= boot_s - read_s < READING_REPEATS_S:
            return
        self._last_pressure = (boot_s, m.press_abs)
        pressure_pa, pa_per_m = m.press_abs * 100.0, PA_PER_M * gravity
        _refuse_beyond(MAX_DEPTH_M * pa_per_m, pressure_pa)
        surface_pa = parameters.get(f"BARO{primary + 1}_GND_PRESS", 0.0)
        if self._depth_source == "pressure" and surface_pa > 0.0:
            depth_m = (pressure_pa - surface_pa) / pa_per_m
            if abs(depth_m) <= MAX_DEPTH_M:
                yield records.Depth(t_s, boot_s, depth_m)
            else:
                self._counters.implausible += 1
        yield records.Pressure(t_s, boot_s, pressure_pa / pa_per_m)

    _scaled_pressure2 = _scaled_pressure3 = _scaled_pressure

    def _local_position_ned(self, m: Message, t_s: float) -> Iterable[Event]:
        _refuse_beyond(MAX_DISTANCE_M, m.x, m.y)
        _refuse_beyond(MAX_SPEED_MPS, m.vx, m.vy)
        return (records.Position(t_s, self._clock.from_ms(m.time_boot_ms), m.x, m.y, m.vx, m.vy),)

    def _distance_sensor(self, m: Message, t_s: float) -> Iterator[Event]:
        """Take the sensors that look down; leave out what has too weak a signal or is beyond their limits.

        RNGFND_SQ_MIN is the least quality, as in ArduSub's SURFTRAK. Limits that are both 0 are unknown.
        """
        if m.orientation != mavlink.MAV_SENSOR_ROTATION_PITCH_270:
            return
        quality, range_m = m.signal_quality, m.current_distance / 1e2
        least = max(self._parameters.get(QUALITY_PARAMETER, LEAST_QUALITY), NO_SIGNAL + 1)
        limited = m.min_distance or m.max_distance
        within = range_m and (not limited or m.min_distance <= m.current_distance <= m.max_distance)
        if within and (quality == UNKNOWN_QUALITY or quality >= least):
            yield records.Range(t_s, range_m, m.id)

    def _servo_output_raw(self, m: Message, t_s: float) -> Iterator[Event]:
        """Give the motors' outputs as if none were reversed (MOT_n_DIRECTION = -1); 0 for a motor without.

        Port 0 alone, and only once another message has told how often the µs stamp has wrapped.
        """
        now_s = self._clock.last_s
        if m.port != 0 or now_s is None:
            return
        outputs_us = (0, *SERVOS(m))
        pulses_us = [outputs_us[output] for output in motor_outputs(self._parameters)]
        boot_s = self._clock.from_us(m.time_usec)
        if max(pulses_us) > MAX_PWM_US or abs(boot_s - now_s) > MAX_STAMP_SPREAD_S:
            raise ImplausibleError
        turned = (self._parameters.get(direction, 1.0) < 0.0 for direction in DIRECTIONS)
        pwm_us = (
            2 * NEUTRAL_US - us if us and turn else us for us, turn in zip(pulses_us, turned, strict=True)
        )
        yield records.ServoOutput(t_s, boot_s, tuple(pwm_us))

    def _timesync(self, m: Message, t_s: float) -> Iterator[Event]:
        """Take answers alone (tc1 set), and ours alone: another's ts1 is not near our clock."""
        sent_s = m.ts1 / 1e9
        if m.tc1 == 0 or not 0.0 <= t_s - sent_s <= MAX_ROUND_TRIP_S:
            return
        if m.tc1 < 0:
            raise ImplausibleError
        yield records.TimeSync(t_s, sent_s, self._clock.from_ns(m.tc1))

    def _battery_status(self, m: Message, t_s: float) -> Iterator[Event]:
        """Sum the cells; without cell sensing the first cell carries it all."""
        millivolts = sum(mv for mv in (*m.voltages, *m.voltages_ext) if mv != UINT16_MAX)
        yield from self._voltage(t_s, m.id, millivolts)

    def _sys_status(self, m: Message, t_s: float) -> Iterator[Event]:
        if m.onboard_control_sensors_present & DEPTH_SENSOR:
            yield records.DepthSensor(t_s, bool(m.onboard_control_sensors_health & DEPTH_SENSOR))
        if m.voltage_battery != UINT16_MAX:
            yield from self._voltage(t_s, 0, m.voltage_battery)

    def _voltage(self, t_s: float, battery: int, millivolts: int) -> Iterator[Event]:
        """Give the voltage of the first battery that has one."""
        _refuse_beyond(MAX_VOLTAGE_V, millivolts / 1e3)
        if millivolts and battery <= self._battery:
            self._battery = battery
            yield records.Battery(t_s, millivolts / 1e3)

    def _ekf_status_report(self, m: Message, t_s: float) -> Iterator[Event]:
        variances = m.velocity_variance, m.pos_vert_variance, m.compass_variance
        if not math.isfinite(sum(variances)):
            raise ImplausibleError
        flags = m.flags
        initialised = not flags & mavlink.EKF_UNINITIALIZED
        moves = flags & mavlink.EKF_VELOCITY_HORIZ and not flags & mavlink.EKF_CONST_POS_MODE
        yield records.EkfStatus(
            t_s,
            attitude=bool(flags & mavlink.EKF_ATTITUDE),
            depth=flags & EKF_DEPTH == EKF_DEPTH and initialised,
            variance=max(variances),
            position=bool(moves and flags & EKF_PLACE),
            initialised=initialised,
            absolute=bool(flags & mavlink.EKF_POS_HORIZ_ABS),
        )

    def _named_value_float(self, m: Message, t_s: float) -> Iterator[Event]:
        if m.name in ("InputHold", "RollPitch"):
            if m.value not in (0.0, 1.0):
                raise ImplausibleError
            yield records.PilotToggle(t_s, m.name, m.value == 1.0)
        elif m.name == "PilotGain":
            if not 0.0 <= m.value <= 1.0:
                raise ImplausibleError
            yield records.PilotGain(t_s, m.value)

    def _param_value(self, m: Message, t_s: float) -> Iterator[Event]:
        if not math.isfinite(m.param_value):
            raise ImplausibleError
        yield records.Parameter(t_s, m.param_id, m.param_value)

    def _rc_channels(self, m: Message, t_s: float) -> Iterator[Event]:
        yield records.ReceiverChannels(t_s, m.chancount)

    def _autopilot_version(self, m: Message, t_s: float) -> Iterator[Event]:
        major, minor, patch, release = m.flight_sw_version.to_bytes(4, "big")
        kind = f" ({RELEASES[release]})" if release in RELEASES else ""
        yield records.FirmwareVersion(t_s, f"{major}.{minor}.{patch}{kind}", (major, minor, patch))

    def _gps_global_origin(self, m: Message, t_s: float) -> Iterator[Event]:
        latitude_deg, longitude_deg = m.latitude / 1e7, m.longitude / 1e7
        _refuse_beyond(90.0, latitude_deg)
        _refuse_beyond(180.0, longitude_deg)
        yield records.GlobalOrigin(t_s, latitude_deg, longitude_deg, m.altitude / 1e3)

    def _statustext(self, m: Message, t_s: float) -> Iterator[Event]:
        for severity, text in self._texts.add(m):
            yield records.StatusText(t_s, severity, text)
            if LEAK_TEXT in text.lower():
                yield records.Leak(t_s)

    def _manual_control(self, m: Message, t_s: float) -> Iterator[Event]:
        sticks = max(abs(m.x), abs(m.y), abs(m.r)) / STICK
        throttle = abs(m.z - STICK_NEUTRAL_Z) / STICK_NEUTRAL_Z
        tilt = max(abs(m.s), abs(m.t)) / SPAN_US
        yield records.PilotInput(t_s, min(1.0, max(sticks, throttle, tilt)))

    def _rc_channels_override(self, m: Message, t_s: float) -> Iterator[Event]:
        yield records.PilotInput(t_s, override_deflection(m) or 0.0)


class _TextAssembler:
    """Puts STATUSTEXT's 50-character chunks together, one text at a time and at most MAX_CHUNKS long.

    A text whose next chunk is lost comes out cut, when another text begins. Control characters come out
    escaped.
    """

    def __init__(self) -> None:
        self._id = 0
        self._severity = 0
        self._chunks: list[str] = []

    def add(self, m: Message) -> Iterator[tuple[int, str]]:
        """Give the texts (severity, text) that `m` completes."""
        if self._chunks and (m.id != self._id or m.chunk_seq != len(self._chunks)):
            yield self._finished()
        self._id, self._severity = m.id, m.severity
        self._chunks.append(m.text)
        if m.id == 0 or len(m.text) < CHUNK_CHARS or len(self._chunks) == MAX_CHUNKS:
            yield self._finished()

    def _finished(self) -> tuple[int, str]:
        text = printable("".join(self._chunks))
        self._chunks.clear()
        return self._severity, text
