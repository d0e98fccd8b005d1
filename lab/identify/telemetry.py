"""What MAVLink messages say of a dive, whoever recorded them: one vehicle, one source for each signal."""

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.identify.samples import NoDiveError, Sample, Streams
from companion.mavlink.ardusub import DIRECTIONS, from_pwm_us
from companion.records import Array
from lab.identify.steering import MANUAL_CONTROL, OVERRIDE, Rows, acted, is_armed, until_stale

Fields = Callable[[str], Any]
"""Gives a message's field of a name."""
Source = tuple[int, int]
"""System and component."""

LOCAL, GLOBAL, OUTPUTS = "LOCAL_POSITION_NED", "GLOBAL_POSITION_INT", "SERVO_OUTPUT_RAW"
FIELDS: Final = {
    "ATTITUDE": ("time_boot_ms", "roll", "pitch", "yaw", "rollspeed", "pitchspeed", "yawspeed"),
    LOCAL: ("time_boot_ms", "vx", "vy", "vz"),
    GLOBAL: ("time_boot_ms", "vx", "vy", "vz", "relative_alt"),
    OUTPUTS: ("time_usec", "port", *(f"servo{n}_raw" for n in range(1, 17))),
    "HEARTBEAT": ("autopilot", "base_mode", "custom_mode"),
    "EKF_STATUS_REPORT": ("flags",),
    "SYS_STATUS": ("voltage_battery",),
    MANUAL_CONTROL: ("target", *"xyzrts"),
    OVERRIDE: ("target_system", *(f"chan{n}_raw" for n in (5, 6, 3, 4, 2, 1))),
}
"""The numbers of each message; steering as surge, sway, heave, yaw, roll, pitch."""
EXTENSIONS: Final = {*"st", *(f"servo{n}_raw" for n in range(9, 17))}
"""Fields that a sender may leave out: they are 0 then."""
NAMED: Final = {"NAMED_VALUE_FLOAT": ("name", "value"), "PARAM_VALUE": ("param_id", "param_value")}
USED: Final = (*FIELDS, *NAMED)
BOOT_UNITS_S: Final = {"ATTITUDE": 1e-3, LOCAL: 1e-3, GLOBAL: 1e-3, OUTPUTS: 1e-6}
WRAP_S: Final = 2.0**32 * 1e-6
"""SERVO_OUTPUT_RAW's stamp begins again."""
JUMP_S: Final = 1.0
"""Clocks that come apart by more between two messages are tied anew: a reboot, a gap that was shortened."""
DRIFT_S: Final = 100.0
"""And so often, for they drift apart, by 50 µs a second at most."""
MIN_MOTOR_HZ: Final = 4.0
"""Outputs of the motors that came more slowly give way to sticks that acted."""
HORIZONTAL_VELOCITY, HORIZONTAL_POSITION, CONSTANT_POSITION = 1 << 1, 1 << 3 | 1 << 4, 1 << 7
"""Bits of EKF_STATUS_REPORT.flags and XKF4.SS: velocity; position, relative or not; it is assumed to stay."""
FIRST_MOTOR_FUNCTION: Final = 33
"""SERVOn_FUNCTION of motor 1."""


class Telemetry:
    """Collects what messages say, by their source."""

    def __init__(self) -> None:
        self._rows: dict[Source, dict[str, list[tuple[float, ...]]]] = {}
        self.unread: Counter[str] = Counter()
        """Messages that could not be read, by name."""

    @property
    def heard(self) -> bool:
        """Whether a vehicle's attitude came."""
        return any("ATTITUDE" in rows for rows in self._rows.values())

    def take(self, t_s: float, source: Source, name: str, get: Fields) -> None:
        """Take a message of USED that arrived at `t_s`."""
        try:
            if name in NAMED:
                key, value = (get(field) for field in NAMED[name])
                kind, values = f"{name} {_text(key)}", [_number(value)]
            else:
                kind, values = name, [_number(get(field)) for field in FIELDS[name]]
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError):
            self.unread[name] += 1
        else:
            self._rows.setdefault(source, {}).setdefault(kind, []).append((t_s, *values))

    def collected(self) -> Streams:
        """Return what one vehicle did; the notes say which one, and what tells it.

        Raises NoDiveError where nothing that steered it is known.
        """
        streams = Streams(notes=not_read(self.unread))
        if not self.heard:
            return streams
        vehicle = max(self._rows, key=self._rank)
        rows = {name: np.array(sorted(given)) for name, given in self._rows[vehicle].items()}
        stamps_s = _tied(rows)
        speed = LOCAL if 2 * len(rows.get(LOCAL, ())) >= len(rows.get(GLOBAL, ())) else GLOBAL
        streams.attitude = _samples(stamps_s["ATTITUDE"], rows["ATTITUDE"][:, 2:5])
        streams.rates = _samples(stamps_s["ATTITUDE"], rows["ATTITUDE"][:, 5:8])
        if speed in rows:
            velocity = rows[speed][:, 2:5] * (1.0 if speed == LOCAL else 0.01)
            streams.level = _samples(stamps_s[speed], velocity[:, :2])
            streams.down = _samples(stamps_s[speed], velocity[:, 2:])
        if GLOBAL in rows:
            streams.depth = _samples(stamps_s[GLOBAL], -1e-3 * rows[GLOBAL][:, 5:])
        streams.aided = [Sample(t_s, (aided(flags),)) for t_s, flags in rows.get("EKF_STATUS_REPORT", ())]
        streams.voltage = [Sample(t_s, (1e-3 * mv,)) for t_s, mv in rows.get("SYS_STATUS", ())]
        others = [f"{s}/{c}" for s, c in sorted({*self._rows} - {vehicle}) if self._rank((s, c))[1]]
        streams.notes += [
            f"vehicle: system/component {vehicle[0]}/{vehicle[1]}{', not ' if others else ''}"
            f"{', '.join(others)}; motion: ATTITUDE{f' and {speed}' if speed in rows else ''}",
            f"commands: {self._commands(streams, vehicle[0], rows, stamps_s)}",
        ]
        return streams

    def _rank(self, source: Source) -> tuple[bool, int]:
        """Rank a source as the vehicle: an autopilot's, of the most attitude."""
        rows = self._rows[source]
        count = len(rows.get("ATTITUDE", ()))
        beats = rows.get("HEARTBEAT", ())
        return count > 0 and any(beat[1] != mavlink.MAV_AUTOPILOT_INVALID for beat in beats), count

    def _commands(self, streams: Streams, system: int, rows: Rows, stamps_s: Mapping[str, Array]) -> str:
        """Fill in either motors or sticks; return which, in words."""
        main = rows[OUTPUTS][:, 2] == 0.0 if OUTPUTS in rows else np.zeros(0, bool)
        at_s, words = stamps_s[OUTPUTS][main] if main.sum() > 1 else np.zeros(0), ""
        rate_hz = 1.0 / max(float(np.median(np.diff(np.sort(at_s)))), 1e-3) if at_s.size else 0.0
        if rate_hz < MIN_MOTOR_HZ:
            heard = [
                (row[0], name, source[0], row[1:])
                for source, given in self._rows.items()
                for name in (MANUAL_CONTROL, OVERRIDE)
                for row in given.get(name, ())
            ]
            streams.sticks, words = acted(heard, system, rows)
            if streams.sticks:
                return (f"not {OUTPUTS} at {rate_hz:.1f} Hz, but " if rate_hz else "") + words
            if not rate_hz:
                raise NoDiveError(f"holds no commands that acted on the vehicle: {words}")
            words = f", too slow to tell delays; {words}"
        parameters = {name[12:]: float(of[-1, 1]) for name, of in rows.items() if name[:12] == "PARAM_VALUE "}
        outputs = _samples(at_s, rows[OUTPUTS][main, 3:])
        streams.motors = motors_of(outputs, parameters, is_armed(at_s, rows.get("HEARTBEAT")))
        if "SERVO1_FUNCTION" not in parameters:
            words += (
                "; no SERVOn_FUNCTION and MOT_n_DIRECTION in it: motors 1 to 8, none reversed, are assumed"
            )
        return f"{OUTPUTS} at {rate_hz:.1f} Hz{words}"


def _samples(t_s: Array, values: Array) -> list[Sample]:
    return [Sample(at_s, tuple(row)) for at_s, row in zip(t_s.tolist(), values.tolist(), strict=True)]


def _tied(rows: Rows) -> dict[str, Array]:
    """Return the vehicle's stamps on the clock of the arrivals: the quickest message ties the two."""
    arrived_s = {name: rows[name][:, 0] for name in BOOT_UNITS_S if name in rows}
    boot_s = {name: rows[name][:, 1] * BOOT_UNITS_S[name] for name in arrived_s}
    if OUTPUTS in rows:
        expected_s = np.interp(arrived_s[OUTPUTS], arrived_s["ATTITUDE"], boot_s["ATTITUDE"])
        boot_s[OUTPUTS] += WRAP_S * np.round((expected_s - boot_s[OUTPUTS]) / WRAP_S)
    everything_s = np.concatenate([*arrived_s.values()])
    order = np.argsort(everything_s, kind="stable")
    late_s = (everything_s - np.concatenate([*boot_s.values()]))[order]
    anew = (np.abs(np.diff(late_s)) > JUMP_S) | (np.diff(everything_s[order] // DRIFT_S) > 0)
    piece = np.concatenate(((0,), np.cumsum(anew)))
    least_s = np.full(piece[-1] + 1, np.inf)
    np.minimum.at(least_s, piece, late_s)
    stamps_s = np.empty_like(everything_s)
    stamps_s[order] = everything_s[order] - late_s + least_s[piece]
    ends = np.cumsum([times.size for times in arrived_s.values()])
    return dict(zip(arrived_s, np.split(stamps_s, ends[:-1]), strict=True))


def aided(flags: float) -> float:
    """Return 1 if the EKF's horizontal velocity is measured by these status bits, else 0."""
    bits = int(flags)
    measured = bits & HORIZONTAL_VELOCITY and bits & HORIZONTAL_POSITION
    return 1.0 if measured and not bits & CONSTANT_POSITION else 0.0


def motors_of(outputs: Sequence[Sample], parameters: Mapping[str, float], armed: Array) -> list[Sample]:
    """Return the demand on each motor from servo outputs (µs), by SERVOn_FUNCTION and MOT_n_DIRECTION.

    It is unknown while the vehicle is not `armed`, 0: hands and winches may move it then.
    """
    servo = {motor: motor for motor in range(1, 9)}
    for number in range(1, 17):
        motor = parameters.get(f"SERVO{number}_FUNCTION", 0.0) - FIRST_MOTOR_FUNCTION + 1
        if motor in servo:
            servo[int(motor)] = number
    signs = [-1.0 if parameters.get(name, 1.0) < 0.0 else 1.0 for name in DIRECTIONS]

    def demands(pwm_us: Sequence[float]) -> tuple[float, ...]:
        outputs_us = dict(enumerate(map(int, pwm_us), 1))
        return tuple(sign * from_pwm_us(outputs_us.get(servo[n]) or 1500) for n, sign in enumerate(signs, 1))

    rests = (math.nan,) * len(signs)
    return until_stale(
        Sample(t_s, rests if off else demands(pwm_us))
        for (t_s, pwm_us), off in zip(outputs, armed == 0.0, strict=True)
    )


def not_read(counts: Mapping[str, int]) -> list[str]:
    """Say what could not be read, if anything."""
    what = ", ".join(f"{count} {name}" for name, count in sorted(counts.items()) if count)
    return [f"could not be read and left out: {what}"] if what else []


def _number(value: Any) -> float:
    """Return a field as a finite number; BlueOS writes flags as words or as bits. Raises ValueError."""
    if isinstance(value, dict):
        value = value["bits"] if "bits" in value else value["type"]
    if isinstance(value, str):
        words = [word.strip() for word in value.split("|")]
        value = sum(getattr(mavlink, word) if word.isidentifier() else int(word, 0) for word in words if word)
    if not math.isfinite(value):
        raise ValueError("is not finite")
    return float(value)


def _text(name: Any) -> str:
    """Return a name, which BlueOS also writes as a list of characters or of their numbers."""
    if isinstance(name, list | tuple):
        name = "".join(chr(one) if isinstance(one, int) else str(one) for one in name)
    return str(name).partition("\0")[0]
