"""A log in one form, whatever recorded it: commands and measurements over time. No files.

Body axes are forward, right, down (FRD), the pose is north, east, down (NED).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from companion.control.allocation import FACTORS, T200_VOLTAGE_V
from companion.records import AXES

Array = NDArray[np.float64]
STEP_S: Final = 0.1
MAX_GAP_S: Final = 0.6
"""Between two samples that are further apart nothing is known."""
MIN_MOTOR_HZ: Final = 4.0
"""Outputs of the motors that came more slowly give way to the sticks, where both are there."""
SLOPE_STEPS: Final = 2
"""A speed from positions is a slope over so many steps to either side."""
MIN_LENGTH_S, MAX_LENGTH_S = 3.0, 86400.0
ABSURD: Final = 1e4
"""No speed, angle or depth of a dive is larger."""


def no_progress(_: float) -> None:
    """Show nothing."""


class LogError(ValueError):
    """A file tells nothing of a dive; says why in one line."""


@dataclass(frozen=True)
class DiveLog:
    """What a log holds. NaN where something was not measured."""

    name: str
    command_s: Array
    """(n,) when each command was given."""
    commands: Array
    """(n, 6) demands on surge, sway, heave (down), yaw, roll, pitch, -1..1, until the next one."""
    voltage_v: Array
    """(n,) of the battery, 16 V where unknown."""
    t_s: Array
    """(m,) of the measurements."""
    velocity: Array
    """(m, 6) u, v, w (m/s), p, q, r (rad/s)."""
    attitude: Array
    """(m, 3) roll, pitch, heading (rad)."""
    depth: Array
    """(m,) below the surface, m."""
    notes: tuple[str, ...] = ()
    """What is peculiar about it."""


class Sample(NamedTuple):
    """A time (s) and the numbers that were true then."""

    t_s: float
    values: tuple[float, ...]


@dataclass
class Streams:
    """What a reader collects: samples of each kind, in any order and at any rate."""

    sticks: list[Sample] = field(default_factory=list)
    """Surge, sway, heave (down), yaw, roll, pitch, -1..1."""
    motors: list[Sample] = field(default_factory=list)
    """Demand on each motor, -1..1."""
    voltage: list[Sample] = field(default_factory=list)
    attitude: list[Sample] = field(default_factory=list)
    rates: list[Sample] = field(default_factory=list)
    ned: list[Sample] = field(default_factory=list)
    """Velocity north, east, down."""
    body: list[Sample] = field(default_factory=list)
    """Velocity forward, right, down."""
    depth: list[Sample] = field(default_factory=list)
    aided: list[Sample] = field(default_factory=list)
    """Whether the EKF's horizontal velocity is measured, 1 or 0; without a sample it is not."""
    notes: list[str] = field(default_factory=list)

    def log(self, name: str, frame: str) -> DiveLog:
        """Return the log on a grid of STEP_S. Raises LogError where commands or motion are missing."""
        command_s, commands = self._commands(frame)
        moving = self.body or self.ned or self.rates or self.attitude or self.depth
        if not moving:
            raise LogError("holds no motion: neither attitude nor depth nor speed")
        begin_s = max(command_s[0], min(sample.t_s for sample in moving))
        end_s = min(command_s[-1], max(sample.t_s for sample in moving))
        check_length(end_s - begin_s)
        t_s = np.arange(begin_s, end_s, STEP_S)
        attitude = _on(t_s, self.attitude, 3, angles=True)
        rates = _on(t_s, self.rates, 3)
        if not self.rates:
            rates = _slope(attitude)
        voltage = _on(command_s, self.voltage, 1)[:, 0]
        return DiveLog(
            name,
            command_s - begin_s,
            np.clip(commands, -1.0, 1.0),
            np.where((voltage > 6.0) & (voltage < 30.0), voltage, T200_VOLTAGE_V),
            t_s - begin_s,
            np.column_stack((self._speeds(t_s, attitude), rates)),
            attitude,
            _on(t_s, self.depth, 1)[:, 0],
            tuple(self.notes),
        )

    def _commands(self, frame: str) -> tuple[Array, Array]:
        """Return when there were commands, and which."""
        sources = [samples for samples in (self.motors, self.sticks) if len(samples) > 1]
        if not sources:
            raise LogError("holds no commands: neither outputs of the motors nor sticks")
        if len(sources) == 2 and _rate_hz(self.motors) < MIN_MOTOR_HZ < _rate_hz(self.sticks):
            sources.reverse()
        table = np.array(sorted((sample.t_s, *sample.values) for sample in sources[0]))
        if sources[0] is self.motors:
            factors = np.array(FACTORS[frame])
            count = min(len(factors), table.shape[1] - 1)
            return table[:, 0], table[:, 1 : 1 + count] @ np.linalg.pinv(factors[:count]).T
        if not self.motors:
            self.notes.append("commands are sticks: right in MANUAL at full pilot gain alone")
        return table[:, 0], table[:, 1:]

    def _speeds(self, t_s: Array, attitude: Array) -> Array:
        if self.body:
            return _on(t_s, self.body, 3)
        roll, pitch, heading = attitude.T
        if not self.ned:
            down = _slope(_on(t_s, self.depth, 1))[:, 0]
            return np.column_stack((np.full((t_s.size, 2), np.nan), down / (np.cos(roll) * np.cos(pitch))))
        north, east, down = _on(t_s, self.ned, 3).T
        aided = np.nan_to_num(_on(t_s, self.aided, 1)[:, 0]) > 0.5
        forward = np.cos(heading) * north + np.sin(heading) * east
        right = np.cos(heading) * east - np.sin(heading) * north
        u = np.cos(pitch) * forward - np.sin(pitch) * down
        lifted = np.sin(pitch) * forward + np.cos(pitch) * down
        v = np.cos(roll) * right + np.sin(roll) * lifted
        w = np.cos(roll) * lifted - np.sin(roll) * right
        return np.column_stack(
            (
                np.where(aided, u, np.nan),
                np.where(aided, v, np.nan),
                np.where(aided, w, down / (np.cos(roll) * np.cos(pitch))),
            )
        )


def check_length(length_s: float) -> None:
    """Raise LogError where commands and motion are together for too short a time, or for days."""
    if not MIN_LENGTH_S <= length_s <= MAX_LENGTH_S:
        raise LogError(
            f"has commands and motion together for {max(length_s, 0.0):.1f} s: want {MIN_LENGTH_S:g} or more"
        )


def reported(log: DiveLog) -> list[str]:
    """Say what a log can tell: how long it is, what was measured, and which axes were moved."""
    length_s = float(log.t_s[-1] - log.t_s[0])
    measured = [
        words
        for words, columns in (
            ("speed over ground", (0, 1)),
            ("vertical speed", (2,)),
            ("turn rate", (5,)),
        )
        if np.isfinite(log.velocity[:, columns]).mean() > 0.1
    ]
    steered = [
        f"{axis} {share:.0%}"
        for axis, share in zip(AXES, np.mean(np.abs(log.commands[:, :4]) > 0.08, axis=0), strict=True)
        if share > 0.005
    ]
    name = Path(log.name).name
    return [
        f"{name}: {length_s:.0f} s; measured: {', '.join(measured) or 'attitude alone'}; "
        f"steered: {', '.join(steered) or 'nothing'} of the time",
        *(f"{name}: {note}" for note in log.notes),
    ]


def _rate_hz(samples: Sequence[Sample]) -> float:
    times = np.sort([sample.t_s for sample in samples])
    return float(1.0 / max(np.median(np.diff(times)), 1e-3))


def _on(t_s: Array, samples: Sequence[Sample], count: int, *, angles: bool = False) -> Array:
    """Return samples interpolated to times (n, count), NaN in gaps and where nothing came."""
    if len(samples) < 2:
        return np.full((t_s.size, count), np.nan)
    table = np.array(sorted((sample.t_s, *sample.values) for sample in samples))
    table = table[np.isfinite(table).all(axis=1) & (np.abs(table[:, 1:]) < ABSURD).all(axis=1)]
    if len(table) < 2:
        return np.full((t_s.size, count), np.nan)
    times, values = table[:, 0], np.unwrap(table[:, 1:], axis=0) if angles else table[:, 1:]
    i = np.clip(np.searchsorted(times, t_s), 1, times.size - 1)
    known = (times[0] <= t_s) & (t_s <= times[-1]) & (times[i] - times[i - 1] < MAX_GAP_S)
    on_grid = np.column_stack([np.interp(t_s, times, column) for column in values.T])
    return np.where(known[:, None], on_grid, np.nan)


def _slope(values: Array) -> Array:
    """Return the rates (n, k) of values on the grid."""
    rates = np.full_like(values, np.nan)
    span = 2 * SLOPE_STEPS
    if len(values) > span:
        rates[SLOPE_STEPS:-SLOPE_STEPS] = (values[span:] - values[:-span]) / (span * STEP_S)
    return rates
