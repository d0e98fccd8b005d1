"""What MAVLink messages say of a dive, whoever recorded them: one vehicle, one source for each signal."""

import math
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.arrays import Array
from companion.identify.sample_table import NoDiveError, Rows, Streams
from companion.mavlink.ardusub import DIRECTIONS, FUNCTIONS, NEUTRAL_US, SPAN_US, motor_outputs
from lab.identify.steering import MANUAL_CONTROL, OVERRIDE, Said, acted, is_armed, until_stale

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
    "HEARTBEAT": ("autopilot", "base_mode", "custom_mode", "type"),
    "EKF_STATUS_REPORT": ("flags",),
    "SYS_STATUS": ("voltage_battery",),
    MANUAL_CONTROL: ("target", *"xyzrts"),
    OVERRIDE: ("target_system", *(f"chan{n}_raw" for n in (5, 6, 3, 4, 2, 1))),
}
"""The numbers of each message; steering as surge, sway, heave, yaw, roll, pitch."""
EXTENSIONS: Final = {*"st", "type", *(f"servo{n}_raw" for n in range(9, 17))}
"""Fields that a sender may leave out: they are 0 then."""
NAMED: Final = {"NAMED_VALUE_FLOAT": ("name", "value"), "PARAM_VALUE": ("param_id", "param_value")}
USED: Final = (*FIELDS, *NAMED)
SAME_S: Final = 1.0
"""The same numbers under the same sequence number are one message that came twice, for so long."""
STAMPED: Final = 8
"""Numbers that tell a message with the vehicle's stamp; MAVLink 1 cuts off the rest."""
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
GENERIC: Final = float(mavlink.MAV_TYPE_GENERIC)
SUBMARINE: Final = float(mavlink.MAV_TYPE_SUBMARINE)


class Telemetry:
    """Collects what messages say, by their source."""

    def __init__(self) -> None:
        self._rows: dict[Source, dict[str, list[tuple[float, ...]]]] = {}
        self._last: dict[tuple[Source, int], tuple[float, str, list[float]]] = {}
        self.unread: Counter[str] = Counter()
        """Messages that could not be read, by name."""

    @property
    def heard(self) -> bool:
        """Whether a vehicle's attitude came."""
        return any("ATTITUDE" in rows for rows in self._rows.values())

    def take(self, t_s: float, source: Source, sequence: int, name: str, get: Fields) -> None:
        """Take a message of USED that arrived at `t_s`, unless it is the last one of that number again."""
        try:
            if name in NAMED:
                key, value = (get(field) for field in NAMED[name])
                kind, values = f"{name} {_text(key)}", [_number(value)]
            else:
                kind, values = name, [_number(get(field)) for field in FIELDS[name]]
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError):
            self.unread[name] += 1
        else:
            before_s, *before = self._last.get((source, sequence), (-math.inf, "", []))
            if before != [kind, values] or t_s - before_s > SAME_S:
                self._last[source, sequence] = t_s, kind, values
                self._rows.setdefault(source, {}).setdefault(kind, []).append((t_s, *values))

    def collected(self) -> Streams:
        """Return what one vehicle did; the notes say which one, and what tells it.

        Raises NoDiveError where it is no submarine, or nothing that steered it is known.
        """
        if not self.heard:
            has = ", ".join(sorted({name.split()[0] for rows in self._rows.values() for name in rows}))
            raise NoDiveError(f"holds no vehicle's ATTITUDE; it has {has or 'no message that is used'}")
        vehicle = max(self._rows, key=self._rank)
        said = {name: _once(name, given) for name, given in self._rows[vehicle].items()}
        kinds = {beat[4] for beat in self._rows[vehicle].get("HEARTBEAT", ())} - {GENERIC}
        if kinds and SUBMARINE not in kinds:
            raise NoDiveError(f"holds no submarine: system {vehicle[0]} is of MAV_TYPE {max(kinds):.0f}")
        stamps_s = _tied(said)
        speed = LOCAL if 2 * len(said.get(LOCAL, ())) >= len(said.get(GLOBAL, ())) else GLOBAL

        def rows(name: str, of: slice, scale: float = 1.0) -> Rows:
            return np.column_stack((stamps_s[name], scale * said[name][:, of])) if name in said else ()

        unit = 1.0 if speed == LOCAL else 0.01
        kind, commands, words = self._commands(vehicle[0], said, stamps_s)
        others = [f"{s}/{c}" for s, c in sorted({*self._rows} - {vehicle}) if self._rank((s, c))[2]]
        about = (
            f"vehicle: system/component {vehicle[0]}/{vehicle[1]}{', not ' if others else ''}"
            f"{', '.join(others)}; motion: ATTITUDE{f' and {speed}' if speed in said else ''}"
        )
        return Streams(
            attitude=rows("ATTITUDE", slice(2, 5)),
            rates=rows("ATTITUDE", slice(5, 8)),
            level=rows(speed, slice(2, 4), unit),
            down=rows(speed, slice(4, 5), unit),
            depth=rows(GLOBAL, slice(5, 6), -1e-3),
            aided=[(t_s, aided(flags)) for t_s, flags in said.get("EKF_STATUS_REPORT", ())],
            voltage=[(t_s, 1e-3 * mv) for t_s, mv in said.get("SYS_STATUS", ())],
            notes=(*not_read(self.unread), about, f"commands: {words}"),
            parameters=_parameters(said),
            **{kind: commands},
        )

    def _rank(self, source: Source) -> tuple[bool, bool, int]:
        """Rank a source as the vehicle: a submarine, an autopilot's, of the most attitude."""
        rows = self._rows[source]
        count = len(rows.get("ATTITUDE", ()))
        beats = rows.get("HEARTBEAT", ()) if count else ()
        steers = any(beat[1] != mavlink.MAV_AUTOPILOT_INVALID for beat in beats)
        return any(beat[4] == SUBMARINE for beat in beats), steers, count

    def _commands(self, system: int, said: Said, stamps_s: Mapping[str, Array]) -> tuple[str, Rows, str]:
        """Return "motors" or "sticks", their demands, and what tells them."""
        main = said[OUTPUTS][:, 2] == 0.0 if OUTPUTS in said else np.zeros(0, bool)
        at_s, words = stamps_s[OUTPUTS][main] if main.sum() > 1 else np.zeros(0), ""
        rate_hz = 1.0 / max(float(np.median(np.diff(np.sort(at_s)))), 1e-3) if at_s.size else 0.0
        if rate_hz < MIN_MOTOR_HZ:
            heard = [
                (row[0], name, source[0], row[1:])
                for source, given in self._rows.items()
                for name in (MANUAL_CONTROL, OVERRIDE)
                for row in given.get(name, ())
            ]
            sticks, words = acted(heard, system, said)
            if len(sticks):
                return (
                    "sticks",
                    sticks,
                    (f"not {OUTPUTS} at {rate_hz:.1f} Hz, but " if rate_hz else "") + words,
                )
            if not rate_hz:
                raise NoDiveError(f"holds no commands that acted on the vehicle: {words}")
            words = f", too slow to tell delays; {words}"
        parameters = _parameters(said)
        outputs = np.column_stack((at_s, said[OUTPUTS][main, 3:]))
        motors = motors_of(outputs, parameters, is_armed(at_s, said.get("HEARTBEAT")))
        if FUNCTIONS[0] not in parameters:
            words += (
                "; no SERVOn_FUNCTION and MOT_n_DIRECTION in it: motors 1 to 8, none reversed, are assumed"
            )
        return "motors", motors, f"{OUTPUTS} at {rate_hz:.1f} Hz{words}"


def _once(name: str, rows: list[tuple[float, ...]]) -> Array:
    """Return a message's rows in order of arrival, those with the vehicle's stamp when they first arrived."""
    ordered = sorted(rows)
    once = {row[1 : 1 + STAMPED]: row for row in reversed(ordered)}
    return np.array(sorted(once.values()) if name in BOOT_UNITS_S else ordered)


def _parameters(said: Said) -> dict[str, float]:
    return {name[12:]: float(of[-1, 1]) for name, of in said.items() if name[:12] == "PARAM_VALUE "}


def _tied(said: Said) -> dict[str, Array]:
    """Return the vehicle's stamps on the clock of the arrivals: the quickest message ties the two."""
    arrived_s = {name: said[name][:, 0] for name in BOOT_UNITS_S if name in said}
    boot_s = {name: said[name][:, 1] * BOOT_UNITS_S[name] for name in arrived_s}
    if OUTPUTS in said:
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


def motors_of(outputs: Array, parameters: Mapping[str, float], armed: Array) -> Array:
    """Return the demand on each motor from rows of outputs (µs), by SERVOn_FUNCTION and MOT_n_DIRECTION.

    It is unknown while the vehicle is not `armed`, 0: hands and winches may move it then. Raises NoDiveError
    where a parameter names an output that the log does not have.
    """
    pulses_us = np.trunc(np.pad(outputs, ((0, 0), (0, 16))))
    for motor, output in enumerate(found := motor_outputs(parameters), start=1):
        if output and (name := FUNCTIONS[output - 1]) in parameters and not pulses_us[:, output].any():
            has = ", ".join(map(str, np.flatnonzero(pulses_us[:, 1:].any(axis=0)) + 1))
            raise NoDiveError(f"{name} is motor {motor}, but the log has outputs {has or 'of 0'} alone")
    pwm_us = pulses_us[:, [output or -1 for output in found]]
    signs = [-1.0 if parameters.get(name, 1.0) < 0.0 else 1.0 for name in DIRECTIONS]
    demands = signs * np.clip((np.where(pwm_us == 0.0, NEUTRAL_US, pwm_us) - NEUTRAL_US) / SPAN_US, -1.0, 1.0)
    return until_stale(np.column_stack((outputs[:, 0], np.where(armed[:, None] == 0.0, math.nan, demands))))


def not_read(counts: Mapping[str, int]) -> tuple[str, ...]:
    """Say what could not be read, if anything."""
    what = ", ".join(f"{count} {name}" for name, count in sorted(counts.items()) if count)
    return (f"could not be read and left out: {what}",) if what else ()


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
