"""Commands and measurements in one table, whether a manoeuvre or a log filled it. No files.

Body axes are forward, right, down (FRD), the pose is north, east, down (NED).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np

from companion.arrays import Array
from companion.core.allocation import FACTORS, T200_VOLTAGE_V

STEP_S: Final = 0.1
MAX_GAP_S: Final = 0.6
"""Between two samples that are further apart nothing is known."""
HOLDS_S: Final = 10.0
"""A battery's voltage, and whether the speed is measured, count for this time."""
SLOPE_STEPS: Final = 2
"""A speed from positions is a slope over this many steps to either side."""
MIN_LENGTH_S, MAX_LENGTH_S = 3.0, 86400.0
ABSURD: Final = 1e4
"""No speed, angle or depth of a dive is larger."""
BATTERY_V: Final = (6.0, 30.0)
"""A voltage beyond these was not measured."""


Rows = Sequence[tuple[float, ...]] | Array
"""Each a time (s) and the numbers that were true then."""


class NoDiveError(ValueError):
    """There is too little to tell anything of a vehicle; says why in one line."""


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
    """(m, 3) roll, pitch, heading (rad), -π..π."""
    depth: Array
    """(m,) below the surface, m."""
    notes: tuple[str, ...] = ()
    """What is peculiar about it."""


class Streams(NamedTuple):
    """What a reader or a manoeuvre collected, rows in any order and at any rate."""

    sticks: Rows = ()
    """Surge, sway, heave (down), yaw, roll, pitch, -1..1."""
    motors: Rows = ()
    """Demand on each motor, -1..1; instead of sticks."""
    voltage: Rows = ()
    attitude: Rows = ()
    rates: Rows = ()
    level: Rows = ()
    """Velocity north and east."""
    down: Rows = ()
    """Velocity down."""
    body: Rows = ()
    """Velocity forward, right, down."""
    depth: Rows = ()
    aided: Rows = ()
    """Whether the EKF's horizontal velocity is measured, 1 or 0; without a row it is not."""
    notes: tuple[str, ...] = ()
    parameters: Mapping[str, float] = MappingProxyType({})
    """The vehicle's parameters that were received."""

    def table(self, name: str, frame: str) -> Table:
        """Return the table; `frame` says which motors serve which axis.

        Raises NoDiveError where commands or motion are missing, or together for too short a time.
        """
        command_s, commands = self._commands(frame)
        motion = (self.body, self.down, self.rates, self.attitude, self.depth)
        times = [row[0] for rows in motion for row in rows]
        if not times:
            raise NoDiveError("holds no motion: neither attitude nor depth nor speed")
        begin_s, end_s = max(command_s[0], min(times)), min(command_s[-1], max(times))
        if not MIN_LENGTH_S <= end_s - begin_s <= MAX_LENGTH_S:
            raise NoDiveError(
                f"has commands and motion together for {max(end_s - begin_s, 0.0):.1f} s: "
                f"want {MIN_LENGTH_S:g} or more, and not days"
            )
        t_s = np.arange(begin_s, end_s, STEP_S)
        attitude = _on(t_s, self.attitude, 3, angles=True)
        rates = _on(t_s, self.rates, 3) if len(self.rates) else _slope(attitude)
        voltage = _latest(command_s, self.voltage)
        sound = (voltage > BATTERY_V[0]) & (voltage < BATTERY_V[1])
        return Table(
            name,
            command_s - begin_s,
            np.clip(commands, -1.0, 1.0),
            np.where(sound, voltage, T200_VOLTAGE_V),
            t_s - begin_s,
            np.column_stack((self._speeds(t_s, attitude), rates)),
            (attitude + np.pi) % (2.0 * np.pi) - np.pi,
            _on(t_s, self.depth, 1)[:, 0],
            self.notes,
        )

    def _commands(self, frame: str) -> tuple[Array, Array]:
        factors = np.array(FACTORS[frame])
        given = in_order(self.motors if len(self.motors) else self.sticks)
        if len(given) < 2:
            raise NoDiveError("holds no commands: neither outputs of the motors nor sticks")
        if not len(self.motors):
            return given[:, 0], given[:, 1:]
        count = min(len(factors), given.shape[1] - 1)
        return given[:, 0], given[:, 1 : 1 + count] @ np.linalg.pinv(factors[:count]).T

    def _speeds(self, t_s: Array, attitude: Array) -> Array:
        """Return u, v, w (n, 3): as measured, or turned into the body's axes, or from the depth alone."""
        if len(self.body):
            return _on(t_s, self.body, 3)
        roll, pitch, heading = attitude.T
        down = (_on(t_s, self.down, 1) if len(self.down) else _slope(_on(t_s, self.depth, 1)))[:, 0]
        north, east = _on(t_s, self.level, 2).T
        forward = np.cos(heading) * north + np.sin(heading) * east
        right = np.cos(heading) * east - np.sin(heading) * north
        u = np.cos(pitch) * forward - np.sin(pitch) * down
        lifted = np.sin(pitch) * forward + np.cos(pitch) * down
        v = np.cos(roll) * right + np.sin(roll) * lifted
        w = np.cos(roll) * lifted - np.sin(roll) * right
        aided = (_latest(t_s, self.aided) > 0.5) & np.isfinite(w)
        alone = down / (np.cos(roll) * np.cos(pitch))
        unknown = np.full(t_s.size, np.nan)
        return np.where(aided, (u, v, w), (unknown, unknown, alone)).T


def in_order(rows: Rows) -> Array:
    """Return rows as an array, in order of time."""
    table = np.array(rows, float).reshape(len(rows), -1)
    return table[np.argsort(table[:, 0], kind="stable")] if len(rows) else table


def _on(t_s: Array, rows: Rows, count: int, *, angles: bool = False) -> Array:
    """Return rows interpolated to times (n, count), NaN in gaps and where nothing came."""
    on_grid = np.full((t_s.size, count), np.nan)
    times_s, *columns = in_order(rows).T if len(rows) else np.zeros((1 + count, 0))
    for column, values in enumerate(columns):
        sound = np.isfinite(times_s) & (np.abs(values) < ABSURD)
        times, values = times_s[sound], np.unwrap(values[sound]) if angles else values[sound]
        if times.size > 1:
            i = np.clip(np.searchsorted(times, t_s), 1, times.size - 1)
            known = (times[0] <= t_s) & (t_s <= times[-1]) & (times[i] - times[i - 1] < MAX_GAP_S)
            on_grid[known, column] = np.interp(t_s[known], times, values)
    return on_grid


def _latest(t_s: Array, rows: Rows) -> Array:
    """Return the last value (n,) of a number that came before each time, NaN where that is long ago."""
    if not len(rows):
        return np.full(t_s.size, np.nan)
    times, values = in_order(rows).T
    i = np.clip(np.searchsorted(times, t_s, side="right") - 1, 0, None)
    age_s = t_s - times[i]
    return np.where((age_s >= 0.0) & (age_s <= HOLDS_S), values[i], np.nan)


def _slope(values: Array) -> Array:
    rates = np.full_like(values, np.nan)
    span = 2 * SLOPE_STEPS
    if len(values) > span:
        rates[SLOPE_STEPS:-SLOPE_STEPS] = (values[span:] - values[:-span]) / (span * STEP_S)
    return rates
