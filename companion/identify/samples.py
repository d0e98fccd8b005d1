"""Commands and measurements in one table, whether a manoeuvre or a log filled it. No files.

Body axes are forward, right, down (FRD), the pose is north, east, down (NED).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np

from companion.core.allocation import FACTORS, T200_VOLTAGE_V
from companion.records import Array

STEP_S: Final = 0.1
MAX_GAP_S: Final = 0.6
"""Between two samples that are further apart nothing is known."""
HOLDS_S: Final = 10.0
"""A battery's voltage, and whether the speed is measured, count for so long."""
SLOPE_STEPS: Final = 2
"""A speed from positions is a slope over so many steps to either side."""
MIN_LENGTH_S, MAX_LENGTH_S = 3.0, 86400.0
ABSURD: Final = 1e4
"""No speed, angle or depth of a dive is larger."""
BATTERY_V: Final = (6.0, 30.0)
"""A voltage beyond these was not measured."""


class NoDiveError(ValueError):
    """There is too little to tell anything of a vehicle; says why in one line."""


class Sample(NamedTuple):
    """A time (s) and the numbers that were true then."""

    t_s: float
    values: tuple[float, ...]


@dataclass(frozen=True)
class Table:
    """What was commanded and measured. NaN where something was not measured."""

    name: str
    command_s: Array
    """(n,) when each command was given."""
    commands: Array
    """(n, 6) demands on surge, sway, heave (down), yaw, roll, pitch, -1..1, until the next; NaN: unknown."""
    voltage_v: Array
    """(n,) of the battery, 16 V where unknown."""
    t_s: Array
    """(m,) of the measurements, STEP_S apart."""
    velocity: Array
    """(m, 6) u, v, w (m/s), p, q, r (rad/s)."""
    attitude: Array
    """(m, 3) roll, pitch, heading (rad)."""
    depth: Array
    """(m,) below the surface, m."""
    notes: tuple[str, ...] = ()
    """What is peculiar about it."""


@dataclass
class Streams:
    """What a reader or a manoeuvre collects: samples of each kind, in any order and at any rate."""

    sticks: list[Sample] = field(default_factory=list)
    """Surge, sway, heave (down), yaw, roll, pitch, -1..1."""
    motors: list[Sample] = field(default_factory=list)
    """Demand on each motor, -1..1; instead of sticks."""
    voltage: list[Sample] = field(default_factory=list)
    attitude: list[Sample] = field(default_factory=list)
    rates: list[Sample] = field(default_factory=list)
    level: list[Sample] = field(default_factory=list)
    """Velocity north and east."""
    down: list[Sample] = field(default_factory=list)
    """Velocity down."""
    body: list[Sample] = field(default_factory=list)
    """Velocity forward, right, down."""
    depth: list[Sample] = field(default_factory=list)
    aided: list[Sample] = field(default_factory=list)
    """Whether the EKF's horizontal velocity is measured, 1 or 0; without a sample it is not."""
    notes: list[str] = field(default_factory=list)

    def table(self, name: str, frame: str) -> Table:
        """Return the table; `frame` says which motors serve which axis.

        Raises NoDiveError where commands or motion are missing, or together for too short a time.
        """
        command_s, commands = self._commands(frame)
        motion = [*self.body, *self.down, *self.rates, *self.attitude, *self.depth]
        if not motion:
            raise NoDiveError("holds no motion: neither attitude nor depth nor speed")
        times = [sample.t_s for sample in motion]
        begin_s, end_s = max(command_s[0], min(times)), min(command_s[-1], max(times))
        if not MIN_LENGTH_S <= end_s - begin_s <= MAX_LENGTH_S:
            raise NoDiveError(
                f"has commands and motion together for {max(end_s - begin_s, 0.0):.1f} s: "
                f"want {MIN_LENGTH_S:g} or more, and not days"
            )
        t_s = np.arange(begin_s, end_s, STEP_S)
        attitude = _on(t_s, self.attitude, 3, angles=True)
        rates = _on(t_s, self.rates, 3) if self.rates else _slope(attitude)
        voltage = _latest(command_s, self.voltage)
        sound = (voltage > BATTERY_V[0]) & (voltage < BATTERY_V[1])
        return Table(
            name,
            command_s - begin_s,
            np.clip(commands, -1.0, 1.0),
            np.where(sound, voltage, T200_VOLTAGE_V),
            t_s - begin_s,
            np.column_stack((self._speeds(t_s, attitude), rates)),
            attitude,
            _on(t_s, self.depth, 1)[:, 0],
            tuple(self.notes),
        )

    def _commands(self, frame: str) -> tuple[Array, Array]:
        """Return when there were commands, and which."""
        given = self.motors or self.sticks
        if len(given) < 2:
            raise NoDiveError("holds no commands: neither outputs of the motors nor sticks")
        table = np.array(sorted((sample.t_s, *sample.values) for sample in given))
        if self.motors:
            factors = np.array(FACTORS[frame])
            count = min(len(factors), table.shape[1] - 1)
            return table[:, 0], table[:, 1 : 1 + count] @ np.linalg.pinv(factors[:count]).T
        return table[:, 0], table[:, 1:]

    def _speeds(self, t_s: Array, attitude: Array) -> Array:
        """Return u, v, w (n, 3): as measured, or turned into the body's axes, or from the depth alone."""
        if self.body:
            return _on(t_s, self.body, 3)
        roll, pitch, heading = attitude.T
        down = _on(t_s, self.down, 1)[:, 0] if self.down else _slope(_on(t_s, self.depth, 1))[:, 0]
        north, east = _on(t_s, self.level, 2).T
        forward = np.cos(heading) * north + np.sin(heading) * east
        right = np.cos(heading) * east - np.sin(heading) * north
        u = np.cos(pitch) * forward - np.sin(pitch) * down
        lifted = np.sin(pitch) * forward + np.cos(pitch) * down
        v = np.cos(roll) * right + np.sin(roll) * lifted
        w = np.cos(roll) * lifted - np.sin(roll) * right
        aided = (_latest(t_s, self.aided) > 0.5) & np.isfinite(w)
        alone = down / (np.cos(roll) * np.cos(pitch))
        return np.column_stack(
            (np.where(aided, u, np.nan), np.where(aided, v, np.nan), np.where(aided, w, alone))
        )


def _on(t_s: Array, samples: Sequence[Sample], count: int, *, angles: bool = False) -> Array:
    """Return samples interpolated to times (n, count), NaN in gaps and where nothing came."""
    on_grid = np.full((t_s.size, count), np.nan)
    table = np.array(sorted((sample.t_s, *sample.values) for sample in samples)).reshape(-1, 1 + count)
    for column in range(count):
        times, values = table[:, 0], table[:, 1 + column]
        sound = np.isfinite(times) & (np.abs(values) < ABSURD)
        times, values = times[sound], np.unwrap(values[sound]) if angles else values[sound]
        if times.size > 1:
            i = np.clip(np.searchsorted(times, t_s), 1, times.size - 1)
            known = (times[0] <= t_s) & (t_s <= times[-1]) & (times[i] - times[i - 1] < MAX_GAP_S)
            on_grid[known, column] = np.interp(t_s[known], times, values)
    return on_grid


def _latest(t_s: Array, samples: Sequence[Sample]) -> Array:
    """Return the last value (n,) of a number that came before each time, NaN where that is long ago."""
    if not samples:
        return np.full(t_s.size, np.nan)
    times, values = np.array(sorted((sample.t_s, sample.values[0]) for sample in samples)).T
    i = np.clip(np.searchsorted(times, t_s, side="right") - 1, 0, None)
    age_s = t_s - times[i]
    return np.where((age_s >= 0.0) & (age_s <= HOLDS_S), values[i], np.nan)


def _slope(values: Array) -> Array:
    """Return the rates (n, k) of values on the grid."""
    rates = np.full_like(values, np.nan)
    span = 2 * SLOPE_STEPS
    if len(values) > span:
        rates[SLOPE_STEPS:-SLOPE_STEPS] = (values[span:] - values[:-span]) / (span * STEP_S)
    return rates
