"""The model of the vehicle's file, followed along a table: what it predicts from each moment on. No files.

    m_u u' = X + c m_v r v − d1_u u − d2_u |u| u
    m_v v' = Y − c m_u r u − d1_v v − d2_v |v| v
    m_w w' = Z + b − d1_w w − d2_w |w| w
    I r'   = N + n v − d1_r r − d2_r |r| r

| symbol     | meaning                                                                    | unit       |
|------------|----------------------------------------------------------------------------|------------|
| u, v, w, r | velocity forward, right, down, and turn rate of the body                   | m/s, rad/s |
| X, Y, Z, N | thrust: ArduSub's mixer, the T200's curve, start of a motor, delay, lag    | N, N·m     |
| m, I       | inertia with added mass                                                    | kg, kg·m²  |
| d1, d2     | linear and quadratic damping                                               | N/(m/s), … |
| c          | the share of the Coriolis force that is there                              |            |
| n          | moment of a speed to the right                                             | N·s        |
| b          | weight in water less buoyancy; in no file, 0 in a prediction               | N          |
| s          | how much later than the turn rate's stamp the vertical speed's is          | s          |
| g          | half-width of the thrusters' dead band                                     | µs         |

All forces are those of T200 thrusters. Motion tells forces only in proportion to inertia, so thrusters that
are stronger by a factor make m, d1, d2 and b smaller by that factor: just what the control law needs.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import msgspec
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from companion.config import VehicleFile
from companion.control.allocation import FACTORS, PER_NEWTON, T200_N, T200_PWM_US, T200_VOLTAGE_V
from companion.identify.samples import STEP_S, Table
from companion.records import AXES, Array

TICK_S: Final = 0.02
TICKS: Final = round(STEP_S / TICK_S)
MAX_TILT_RAD: Final = 0.35
"""Windows in which it rolls or pitches further are left out."""
HORIZONS_S: Final = (1.0, 2.0)
BODY: Final = (0, 1, 2, 5)
"""Surge, sway, heave and yaw among u, v, w, p, q, r."""
MOVED: Final = 0.03
"""m/s or rad/s: an axis whose velocity changes by less (RMS over a window) did not move."""
MIN_WINDOWS: Final = 5
LEAD_S: Final = 0.6
"""What was demanded so long before still shows: through lag, start and delay."""

KEYS: Final = (
    *((axis, "mass") for axis in AXES),
    *((axis, "linear_damping") for axis in AXES),
    *((axis, "quadratic_damping") for axis in AXES),
    ("vehicle", "coriolis_share"),
    ("vehicle", "yaw_per_sway_ns"),
    ("thrusters", "lag_s"),
    ("thrusters", "start_s"),
    ("thrusters", "delay_s"),
)
"""Section and key of each parameter."""
MASS, LINEAR, QUADRATIC, CORIOLIS, COUPLING, LAG, START, DELAY = 0, 4, 8, 12, 13, 14, 15, 16
WEIGHT, LATER, DEAD, LEVEL_LATER = 17, 18, 19, 20
"""Behind those of KEYS: b, s, g, and s of the horizontal speed."""
DEAD_BAND_US: Final = 28.0


def parameters(vehicle: VehicleFile) -> Array:
    """Return a vehicle's parameters in the order of KEYS, and behind them those that are in no file."""
    table = msgspec.to_builtins(vehicle)
    return np.array([*(table[section][key] for section, key in KEYS), 0.0, 0.0, DEAD_BAND_US, 0.0])


@dataclass(frozen=True)
class Track:
    """A table on the grid of the model: windows that begin with what was measured."""

    table: Table
    frame: str
    _wrenches: dict[tuple[float, ...], Array] = field(default_factory=dict, init=False, repr=False)

    @cached_property
    def first(self) -> NDArray[np.int64]:
        """The rows where a window of the shortest horizon begins: measured all along, and level."""
        return np.flatnonzero(self._whole(HORIZONS_S[0]))

    @cached_property
    def changes(self) -> Array:
        """Measured change of u, v, w, r over each horizon (windows, horizons, 4); NaN where unknown."""
        velocity, changes = self.table.velocity[:, BODY], []
        for horizon_s in HORIZONS_S:
            whole = np.append(self._whole(horizon_s), np.zeros(self.table.t_s.size, bool))[self.first]
            last = np.where(whole, self.first + round(horizon_s / STEP_S), self.first)
            whole = whole[:, None] & self.steered(self.first, horizon_s)[:, :4]
            changes.append(np.where(whole, velocity[last] - velocity[self.first], np.nan))
        return np.asarray(np.stack(changes, axis=1))

    def steered(self, first: NDArray[np.int64], horizon_s: float) -> NDArray[np.bool_]:
        """Tell of windows from these rows on which demands are known all along and LEAD_S before (n, 6)."""
        t_s, command_s = self.table.t_s[first], self.table.command_s
        unknown = np.cumsum(np.isnan(self.table.commands), axis=0)
        begin = np.searchsorted(command_s, t_s - LEAD_S, "right") - 1
        end = np.searchsorted(command_s, t_s + horizon_s, "right") - 1
        before = np.where((begin > 0)[:, None], unknown[begin - 1], 0)
        return np.asarray(unknown[np.maximum(end, 0)] == before)

    @cached_property
    def demands(self) -> Array:
        """What is asked of each motor from each command on, -1..1 (commands, motors)."""
        return np.asarray(
            np.clip(np.nan_to_num(self.table.commands) @ np.array(FACTORS[self.frame]).T, -1.0, 1.0)
        )

    def pushes(self, dead_band_us: float) -> Array:
        """Return the push of each motor that runs, from each command on, N (commands, motors)."""
        pwm_us = np.array(T200_PWM_US, float) - 1500.0
        pwm_us[5:7] = -dead_band_us, dead_band_us
        strength = (self.table.voltage_v / T200_VOLTAGE_V) ** 2
        return np.asarray(np.interp(400.0 * self.demands, pwm_us, T200_N) * strength[:, None])

    def _whole(self, horizon_s: float) -> NDArray[np.bool_]:
        """Tell of each row that is early enough whether the window from it on can be used."""
        tilt = np.abs(np.nan_to_num(self.table.attitude[:, :2])).max(axis=1)
        good = np.isfinite(self.table.velocity[:, BODY]).any(axis=1) & (tilt < MAX_TILT_RAD)
        rows = round(horizon_s / STEP_S) + 1
        if good.size < rows:
            return np.zeros(0, bool)
        return np.asarray(sliding_window_view(good, rows).all(axis=1))

    def wrench(self, theta: Array) -> Array:
        """Return the mean wrench in each tick on surge, sway, heave, yaw, roll, pitch, N and N·m (ticks, 6).

        A motor at rest, and one that reverses, gives nothing for the start. What it then is asked for acts
        later by the delay, through a first-order lag. Each tick's mean is exact: a command arrives
        within a tick, and a tick is as long as some delays.
        """
        timing = tuple(theta[[LAG, START, DELAY, DEAD, LATER, LEVEL_LATER]].tolist())
        if timing not in self._wrenches:  # most steps of a fit change other parameters
            self._wrenches.clear()
            self._wrenches[timing] = self._wrench(*timing)
        return self._wrenches[timing]

    def _wrench(
        self, lag_s: float, start_s: float, delay_s: float, dead_band_us: float, down_s: float, level_s: float
    ) -> Array:
        ends_s = TICK_S * np.arange(TICKS * self.table.t_s.size + 1.0)
        asked = _means(self.table.command_s, self.pushes(dead_band_us), start_s, ends_s - delay_s)
        wrench = (asked @ np.array(FACTORS[self.frame])) * np.array(PER_NEWTON)
        for axis, later_s in enumerate((level_s, level_s, down_s)):
            if later_s:
                impulse = np.concatenate(((0.0,), np.cumsum(wrench[:, axis])))
                wrench[:, axis] = np.diff(np.interp(ends_s - later_s, ends_s, impulse))
        keep = np.exp(-TICK_S / lag_s)
        share = lag_s / TICK_S * (1.0 - keep)  # of a tick that what was there before it still gives
        response = share * (1.0 - keep) * keep ** np.arange(max(1, round(15.0 * lag_s / TICK_S)))
        response = np.concatenate(((1.0 - share,), response))
        return np.column_stack([np.convolve(column, response)[: len(column)] for column in wrench.T])

    def predicted(self, theta: Array) -> Array:
        """Return the change of u, v, w, r that the model gives over each horizon (windows, horizons, 4)."""
        wrench = self.wrench(theta)[:, :4].T
        inertia, linear, quadratic = (theta[i : i + 4, None] for i in (MASS, LINEAR, QUADRATIC))
        start = np.nan_to_num(self.table.velocity[self.first][:, BODY]).T
        begin, last = TICKS * self.first, wrench.shape[1] - 1
        per_tick, half = inertia / TICK_S, 0.5 * linear
        velocity, changes = start, []
        for tick in range(round(HORIZONS_S[-1] / TICK_S)):
            force = wrench[:, np.minimum(begin + tick, last)]
            u, v, _, r = velocity
            force[0] += theta[CORIOLIS] * theta[MASS + 1] * r * v
            force[1] -= theta[CORIOLIS] * theta[MASS] * r * u
            force[2] += theta[WEIGHT]
            force[3] += theta[COUPLING] * v
            velocity = ((per_tick - half) * velocity + force) / (
                per_tick + half + quadratic * np.abs(velocity)
            )
            if any(tick + 1 == round(horizon_s / TICK_S) for horizon_s in HORIZONS_S):
                changes.append((velocity - start).T)
        return np.stack(changes, axis=1)


def _means(t_s: Array, pushes: Array, start_s: float, ends_s: Array) -> Array:
    """Return the mean push of each motor between `ends_s` (n - 1, motors): it holds, once it has started."""
    next_s, means = np.append(t_s[1:], np.inf), []
    for push in pushes.T:
        runs_s = np.clip(_runs_from(t_s, np.sign(push), start_s), t_s, next_s)
        knots_s = np.column_stack((t_s, runs_s)).ravel()
        total = np.concatenate(((0.0,), np.cumsum(push[:-1] * (next_s - runs_s)[:-1])))
        beyond = push[-1] * np.maximum(ends_s - knots_s[-1], 0.0)
        means.append(np.diff(np.interp(ends_s, knots_s, np.repeat(total, 2)) + beyond) / np.diff(ends_s))
    return np.column_stack(means)


def _runs_from(t_s: Array, turns: Array, start_s: float) -> Array:
    """Return from when on a motor does what it is asked for at each command (n,).

    It stops at once, and turns another way after `start_s`. Asked for less than that to turn another way, it
    stands still meanwhile, and then goes on as before at once.
    """
    begins = np.flatnonzero(np.diff(turns, prepend=np.nan) != 0.0)
    way, lasts_s = turns[begins], np.diff(np.append(t_s[begins], np.inf))
    settled = np.where((way == 0.0) | (lasts_s >= start_s), np.arange(begins.size), -1)
    last = np.concatenate(((-1,), np.maximum.accumulate(settled)[:-1]))
    before = np.where(last >= 0, way[last], 0.0)
    at_s = t_s[begins] + np.where((way == 0.0) | (way == before), 0.0, start_s)
    return np.asarray(np.repeat(at_s, np.diff(np.append(begins, t_s.size))))


def moved(tracks: Sequence[Track]) -> NDArray[np.bool_]:
    """Tell which of surge, sway, heave and yaw were measured and moved, by horizon (horizons, 4)."""
    changes = np.concatenate([track.changes for track in tracks])
    counts = np.isfinite(changes).sum(axis=0)
    sums = np.nansum(changes**2, axis=0)
    return np.asarray((counts >= MIN_WINDOWS) & (sums > MOVED**2 * np.maximum(counts, 1)))


def score(tracks: Sequence[Track], theta: Array, horizon_s: float) -> dict[str, float | int | None]:
    """Return by axis 1 − R² of the change of velocity; None where it did not move. 1: "it stays as it is".

    Sums run over the windows of all `tracks`; `windows` counts them.
    """
    at = HORIZONS_S.index(horizon_s)
    changes = np.concatenate([track.changes[:, at] for track in tracks])
    errors = np.concatenate([track.predicted(theta)[:, at] for track in tracks]) - changes
    shares = np.nansum(errors**2, axis=0) / np.maximum(np.nansum(changes**2, axis=0), 1e-12)
    result: dict[str, float | int | None] = {
        name: round(float(share), 4) if moves else None
        for name, share, moves in zip(AXES, shares, moved(tracks)[at], strict=True)
    }
    result["windows"] = int(np.isfinite(changes).any(axis=1).sum())
    return result
