"""The model of the vehicle's file, followed along a table: what it predicts from each moment on. No files.

    m_u u' = X + b_u + c m_v r v − d1_u u − d2_u |u| u
    m_v v' = Y + b_v − c m_u r u − d1_v v − d2_v |v| v
    m_w w' = Z + b_w − d1_w w − d2_w |w| w
    I r'   = N + b_r + n v − d1_r r − d2_r |r| r

| symbol     | meaning                                                                    | unit       |
|------------|----------------------------------------------------------------------------|------------|
| u, v, w, r | velocity forward, right, down, and turn rate of the body                   | m/s, rad/s |
| X, Y, Z, N | thrust: ArduSub's mixer, the T200's curve, start of a motor, delay, lag    | N, N·m     |
| m, I       | inertia with added mass                                                    | kg, kg·m²  |
| d1, d2     | linear and quadratic damping                                               | N/(m/s), … |
| c          | the share of the Coriolis force that is there                              |            |
| n          | moment of a speed to the right                                             | N·s        |
| b          | a constant force: weight less buoyancy, a tether, a current                | N, N·m     |
| s          | how much later than the turn rate's stamp that of a speed is               | s          |
| g          | half-width of the thrusters' dead band                                     | µs         |

b, s and the delay belong to a table and stand in no file: `Track.settled` finds them, whatever predicts.

All forces are those of T200 thrusters. Motion tells forces only in proportion to inertia, so thrusters that
are stronger by a factor make m, d1, d2 and b smaller by that factor: just what the control law needs.
"""

from collections.abc import Iterable, Sequence
from functools import cached_property, lru_cache, partial
from typing import Final

import msgspec
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from companion.arrays import Array
from companion.config import VehicleFile
from companion.core.allocation import FACTORS, PER_NEWTON, T200_N, T200_PWM_US, T200_VOLTAGE_V
from companion.identify.least_squares import Bounds, Residuals, Solution, least_squares
from companion.identify.sample_table import STEP_S, Table
from companion.records import AXES

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
EVERY: Final = 3
"""One of this many windows is fitted: they overlap, and the others add little."""
MAX_KEPT: Final = 8
START_DELAYS_S: Final = (-0.25, 0.0)
LEAD_S: Final = 0.6
"""A demand shows for this time: through lag, start and delay."""

KEYS: Final = (
    *((axis, "mass") for axis in AXES),
    *((axis, "linear_damping") for axis in AXES),
    *((axis, "quadratic_damping") for axis in AXES),
    ("vehicle", "coriolis_share"),
    ("vehicle", "yaw_per_sway_ns"),
    ("thrusters", "lag_s"),
    ("thrusters", "start_s"),
)
"""Section and key of each parameter."""
MASS, LINEAR, QUADRATIC, CORIOLIS, COUPLING, LAG, START = 0, 4, 8, 12, 13, 14, 15
DELAY, BIAS, WEIGHT, LATER, DEAD, LEVEL_LATER = 16, 17, 19, 21, 22, 23
"""Behind KEYS: delay, b by axis (WEIGHT is heave's), s of the vertical speed, g, s of the horizontal."""
SMALL: Final = (*[0.3] * 3, 0.003)
LEAST: Final = np.array(
    (*[1.0] * 3, 0.02, *[0.0] * 9, -8.0, 0.02, 0.0, -0.5, *[-100.0] * 3, -10.0, -0.5, 5.0, -0.5)
)
MOST: Final = np.array((*[1e3] * 3, 1e2, *[3e2] * 3, 30.0, *[1e3] * 3, 30.0, 1.0, 8.0, 1.0, *[0.5] * 9))
MOST[[*range(BIAS, BIAS + 4), DEAD]] = 100.0, 100.0, 100.0, 10.0, 55.0
STEPS: Final = np.array((*SMALL * 3, 0.01, 0.01, *[0.001] * 3, *[0.01] * 3, *[0.001] * 2, 0.3, 0.001))
"""The least and the largest value of each parameter, and a small change of it, for the slope."""
PULL: Final = np.where(np.isin(np.arange(LEAST.size), (LATER, LEVEL_LATER)), 0.5, 0.0)
"""A lateness of 0.1 s has to explain 0.25 % of an axis' change: where little moved it is assumed to be 0."""
DEAD_BAND_US: Final = 28.0


def parameters(vehicle: VehicleFile) -> Array:
    """Return a vehicle's parameters in the order of KEYS, and behind them those that are in no file."""
    table = msgspec.to_builtins(vehicle)
    return np.array([*(table[section][key] for section, key in KEYS), *[0.0] * 6, DEAD_BAND_US, 0.0])


class Track:
    """A table on the grid of the model: windows that begin with what was measured, one `every` so many."""

    def __init__(self, table: Table, frame: str, every: int = 1) -> None:
        self.table = table
        self.frame = frame
        self.first = np.flatnonzero(self._whole(HORIZONS_S[0]))[::every]
        """The rows where a window of the shortest horizon begins: measured all along, and level."""
        self.demands = np.clip(np.nan_to_num(table.commands) @ np.array(FACTORS[frame]).T, -1.0, 1.0)
        """What is asked of each motor from each command on, -1..1 (commands, motors)."""
        self._driven_of, self._wrench_of = (
            lru_cache(MAX_KEPT)(self._driven),
            lru_cache(MAX_KEPT)(self._wrench),
        )

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

    def left_out(self) -> str:
        """Say how many of the windows of the shortest horizon tell nothing, and why."""
        measured, whole = (self._whole(HORIZONS_S[0], most) for most in (np.inf, MAX_TILT_RAD))
        counts = {
            "speed and turn rate are unknown": int(np.sum(~measured)),
            f"it rolls or pitches by {MAX_TILT_RAD} rad or more": int(measured.sum() - whole.sum()),
            "no command is known": int(np.isnan(self.changes[:, 0]).all(axis=1).sum()),
        }
        why = ", ".join(f"in {count} {what}" for what, count in counts.items() if count)
        return f"{sum(counts.values())} of {measured.size} windows of 1 s are left out: {why}" if why else ""

    def _whole(self, horizon_s: float, max_tilt_rad: float = MAX_TILT_RAD) -> NDArray[np.bool_]:
        """Tell of each row that is early enough whether the window from it on can be used."""
        tilt = np.abs(np.nan_to_num(self.table.attitude[:, :2])).max(axis=1)
        good = np.isfinite(self.table.velocity[:, BODY]).any(axis=1) & (tilt < max_tilt_rad)
        rows = round(horizon_s / STEP_S) + 1
        if good.size < rows:
            return np.zeros(0, bool)
        return np.asarray(sliding_window_view(good, rows).all(axis=1))

    def steered(self, first: NDArray[np.int64], horizon_s: float) -> NDArray[np.bool_]:
        """Tell of windows from these rows on which demands are known all along and LEAD_S before (n, 6)."""
        t_s, command_s = self.table.t_s[first], self.table.command_s
        unknown = np.cumsum(np.isnan(self.table.commands), axis=0)
        begin = np.searchsorted(command_s, t_s - LEAD_S, "right") - 1
        end = np.searchsorted(command_s, t_s + horizon_s, "right") - 1
        before = np.where((begin > 0)[:, None], unknown[begin - 1], 0)
        return np.asarray(unknown[np.maximum(end, 0)] == before)

    def wrench(self, theta: Array) -> Array:
        """Return the mean wrench in each tick on surge, sway, heave, yaw, roll, pitch, N and N·m (ticks, 6).

        A motor at rest, and one that reverses, gives nothing for the start. What it then is asked for acts
        later by the delay, through a first-order lag. Each tick's mean is exact: a command arrives
        within a tick, and a tick is as long as some delays. What was found last is kept: most steps of a fit
        change other parameters.
        """
        return np.asarray(self._wrench_of(*theta[[LAG, LATER, LEVEL_LATER, START, DELAY, DEAD]].tolist()))

    def _driven(self, start_s: float, delay_s: float, dead_band_us: float) -> Array:
        """Return the mean wrench without lag."""
        pwm_us = np.array(T200_PWM_US, float) - 1500.0
        pwm_us[5:7] = -dead_band_us, dead_band_us
        strength = (self.table.voltage_v / T200_VOLTAGE_V) ** 2
        pushes = np.interp(400.0 * self.demands, pwm_us, T200_N) * strength[:, None]
        ends_s = TICK_S * np.arange(TICKS * self.table.t_s.size + 1.0)
        asked = _means(self.table.command_s, pushes, start_s, ends_s - delay_s)
        return np.asarray((asked @ np.array(FACTORS[self.frame])) * np.array(PER_NEWTON))

    def _wrench(self, lag_s: float, down_s: float, level_s: float, *drive: float) -> Array:
        wrench = self._driven_of(*drive).copy()
        ends_s = TICK_S * np.arange(len(wrench) + 1.0)
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
        ends = [round(horizon_s / TICK_S) for horizon_s in HORIZONS_S]
        at = np.minimum(TICKS * self.first + np.arange(ends[-1])[:, None], wrench.shape[1] - 1)
        forces = wrench[:, at] + theta[BIAS : BIAS + 4, None, None]
        keeps, loses = inertia / TICK_S - 0.5 * linear, inertia / TICK_S + 0.5 * linear
        forward, right = theta[CORIOLIS] * theta[MASS + 1], theta[CORIOLIS] * theta[MASS]
        velocity, changes = start, []
        for tick in range(ends[-1]):
            force = forces[:, tick]
            u, v, _, r = velocity
            force[0] += forward * r * v
            force[1] -= right * r * u
            force[3] += theta[COUPLING] * v
            velocity = (keeps * velocity + force) / (loses + quadratic * np.abs(velocity))
            if tick + 1 in ends:
                changes.append((velocity - start).T)
        return np.stack(changes, axis=1)

    def thinned(self) -> "Track":
        """Return it with the windows that a fit takes."""
        return Track(self.table, self.frame, EVERY)

    def settled(self, theta: Array) -> Array:
        """Return parameters of which this table's own, constant force and timing, predict it best."""
        thinned = [self.thinned()]
        moving = moved(thinned)
        starts = [np.array(theta) for _ in START_DELAYS_S]
        for start, delay_s in zip(starts, START_DELAYS_S, strict=True):
            start[DELAY] = delay_s
        own = [*forces(moving[-1]), *times(moving[-1])]
        found = searched(thinned, moving, starts, ((), own), (LEAST, MOST))
        return np.asarray(found.theta[0])


def searched(
    tracks: Sequence[Track],
    moving: NDArray[np.bool_],
    starts: Iterable[Array],
    free: tuple[Sequence[int], Sequence[int]],
    bounds: Bounds,
) -> Solution:
    """Search from the best of `starts` on; no inertia changes much in a round."""
    least, most = bounds

    def bounds_at(theta: Array) -> Bounds:
        low, high = least.copy(), most.copy()
        low[:4] = np.maximum(least[:4], 0.4 * theta[0, :4])
        high[:4] = np.minimum(most[:4], 2.5 * theta[0, :4])
        return low, high

    parts = residuals(tracks, moving)
    best = min(starts, key=lambda start: sum(float(np.sum(part(start) ** 2)) for part in parts))
    return least_squares(parts, best, free, STEPS, bounds_at, PULL)


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


def forces(axes: NDArray[np.bool_]) -> list[int]:
    """Return which constant forces are found, where these axes moved."""
    return [BIAS + axis for axis in range(len(AXES)) if axes[axis]]


def times(axes: NDArray[np.bool_]) -> list[int]:
    """Return which of delay and lateness are found, where these axes moved."""
    later = [LATER] if axes[2] and axes[3] else []
    return [DELAY, *later, *([LEVEL_LATER] if axes[:2].any() and axes[2:].any() else [])]


def residuals(tracks: Sequence[Track], moving: NDArray[np.bool_]) -> list[Residuals]:
    """Return for each track what its prediction misses, as a share of what all of them change."""
    changes = np.concatenate([track.changes for track in tracks])
    norms = np.where(moving, np.sqrt(np.maximum(np.nansum(changes**2, axis=0), 1e-12)), np.inf)

    def part(track: Track, theta: Array) -> Array:
        return np.asarray(np.nan_to_num((track.predicted(theta) - track.changes) / norms).ravel())

    return [partial(part, track) for track in tracks]


def unexplained(tracks: Sequence[Track], thetas: Iterable[Array]) -> Array:
    """Return 1 − R² of the change of velocity (horizons, 4), NaN where none was measured."""
    changes = np.concatenate([track.changes for track in tracks])
    predicted = [track.predicted(theta) for track, theta in zip(tracks, thetas, strict=True)]
    squares = np.nansum(changes**2, axis=0)
    squares[squares == 0.0] = np.nan
    return np.asarray(np.nansum((np.concatenate(predicted) - changes) ** 2, axis=0) / squares)


def score(tracks: Sequence[Track], thetas: Sequence[Array]) -> dict[str, dict[str, float | int | None]]:
    """Return 1 − R² of the change of velocity by horizon (s) and axis. 1: "it stays as it is".

    None where an axis did not move. Sums run over the windows of all `tracks`; `windows` counts them.
    """
    rows: dict[str, dict[str, float | int | None]] = {}
    for at, (shares, moves) in enumerate(zip(unexplained(tracks, thetas), moved(tracks), strict=True)):
        known = (np.isfinite(track.changes[:, at]).any(axis=1) for track in tracks)
        rows[f"{HORIZONS_S[at]:g}"] = {
            name: round(float(share), 4) if moved_here else None
            for name, share, moved_here in zip(AXES, shares, moves, strict=True)
        } | {"windows": sum(int(windows.sum()) for windows in known)}
    return rows
