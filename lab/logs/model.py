"""The model of the vehicle's file, followed along a log: what it predicts from each moment on. No files.

    m_u u' = X + c m_v r v − d1_u u − d2_u |u| u
    m_v v' = Y − c m_u r u − d1_v v − d2_v |v| v
    m_w w' = Z + b − d1_w w − d2_w |w| w
    I r'   = N + n v − d1_r r − d2_r |r| r

| symbol     | meaning                                                                    | unit       |
|------------|----------------------------------------------------------------------------|------------|
| u, v, w, r | velocity forward, right, down, and turn rate of the body                   | m/s, rad/s |
| X, Y, Z, N | thrust: ArduSub's mixer, the T200's curve, delay, start of a motor, lag    | N, N·m     |
| m, I       | inertia with added mass                                                    | kg, kg·m²  |
| d1, d2     | linear and quadratic damping                                               | N/(m/s), … |
| c          | the share of the Coriolis force that is there                              |            |
| n          | moment of a speed to the right                                             | N·s        |
| b          | weight in water less buoyancy; in no file, 0 in a prediction               | N          |
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from companion.config import VehicleFile
from companion.control.allocation import FACTORS, PER_NEWTON, T200_N, T200_PWM_US, T200_VOLTAGE_V
from companion.records import AXES
from lab.batch.compiled import cached, slotted
from lab.logs.dive_log import Array, DiveLog

TICK_S: Final = 0.02
MAX_TILT_RAD: Final = 0.35
"""Windows in which it rolls or pitches further are left out."""
HORIZONS_S: Final = (1.0, 2.0)
BODY: Final = (0, 1, 2, 5)
"""Surge, sway, heave and yaw among u, v, w, p, q, r."""
MOVED: Final = 0.03
"""m/s or rad/s: an axis whose velocity changes by less (RMS over a window) did not move."""
MIN_WINDOWS: Final = 5

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
MASS, LINEAR, QUADRATIC, CORIOLIS, COUPLING, LAG, START, DELAY, WEIGHT = 0, 4, 8, 12, 13, 14, 15, 16, 17


def parameters(vehicle: VehicleFile) -> Array:
    """Return a vehicle's parameters in the order of KEYS, and a weight of 0 behind them."""
    table = msgspec.to_builtins(vehicle)
    return np.array([*(table[section][key] for section, key in KEYS), 0.0])


class Windows(NamedTuple):
    """Stretches of one length: the rows where each begins and ends, and their places on the grid."""

    first: NDArray[np.int64]
    last: NDArray[np.int64]
    begin: NDArray[np.int64]
    end: NDArray[np.int64]
    start: Array
    """(n, 6) velocity with which each begins, 0 where unknown."""
    changes: Array
    """(n, 4) measured change of u, v, w, r; NaN where unknown."""


@dataclass(frozen=True)
class Track:
    """A log on the grid of the model."""

    log: DiveLog
    frame: str

    @cached_property
    def thrust(self) -> Array:
        """What each motor is asked for, N (n, motors)."""
        times = np.arange(round(float(self.log.t_s[-1]) / TICK_S) + 2) * TICK_S
        i = np.clip(np.searchsorted(self.log.command_s, times + 1e-9, side="right") - 1, 0, None)
        demands = np.clip(self.log.commands[i] @ np.array(FACTORS[self.frame]).T, -1.0, 1.0)
        curve = (np.array(T200_PWM_US, float) - 1500.0) / 400.0
        strength = (self.log.voltage_v[i] / T200_VOLTAGE_V) ** 2
        return np.asarray(np.interp(demands, curve, T200_N) * strength[:, None])

    @cached_property
    def windows(self) -> dict[float, Windows]:
        """The windows of each horizon."""
        return {horizon_s: self._windows(horizon_s) for horizon_s in HORIZONS_S}

    def wrench(self, theta: Array) -> Array:
        """Return the wrench on surge, sway, heave, yaw, roll, pitch along the grid, N and N·m (n, 6)."""
        pushes = cached(slotted(motors_follow))(
            self.thrust, float(theta[LAG]), float(theta[START]), float(theta[DELAY]), TICK_S
        )
        return np.asarray((pushes @ np.array(FACTORS[self.frame])) * np.array(PER_NEWTON))

    def predicted(self, theta: Array, horizon_s: float, wrench: Array | None = None) -> Array:
        """Return the change of u, v, w, r that the model gives in each window (n, 4)."""
        windows = self.windows[horizon_s]
        if wrench is None:
            wrench = self.wrench(theta)
        ends = cached(slotted(velocities_after))(
            wrench, windows.begin, windows.end, windows.start, theta, TICK_S
        )
        return np.asarray(ends - windows.start[:, BODY])

    def _windows(self, horizon_s: float) -> Windows:
        t_s, rows = self.log.t_s, np.arange(self.log.t_s.size)
        step_s = float(np.median(np.diff(t_s)))
        after = np.clip(np.searchsorted(t_s, t_s + horizon_s), 1, t_s.size - 1)
        last = np.where(t_s + horizon_s - t_s[after - 1] < t_s[after] - t_s - horizon_s, after - 1, after)
        tilted = np.max(np.abs(np.nan_to_num(self.log.attitude[:, :2])), axis=1) >= MAX_TILT_RAD
        known = np.asarray(np.isfinite(self.log.velocity[:, BODY]).any(axis=1))
        tilts = _before(np.asarray(tilted))
        gaps = _before(np.diff(t_s, prepend=t_s[0]) > 0.3 + step_s)
        good = (
            (np.abs(t_s[last] - t_s - horizon_s) < step_s)
            & (tilts[last + 1] == tilts[rows])
            & (gaps[last + 1] == gaps[rows + 1])
            & known
            & known[last]
        )
        first, last = rows[good], last[good]
        return Windows(
            first,
            last,
            np.rint(t_s[first] / TICK_S).astype(np.int64),
            np.rint(t_s[last] / TICK_S).astype(np.int64),
            np.nan_to_num(self.log.velocity[first]),
            (self.log.velocity[last] - self.log.velocity[first])[:, BODY],
        )


def _before(flags: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return how many flags stand before each place, and before the end."""
    return np.concatenate(((0,), np.cumsum(flags))).astype(np.int64)


def moved(tracks: Sequence[Track], horizon_s: float) -> NDArray[np.bool_]:
    """Tell which of surge, sway, heave and yaw were measured and moved."""
    changes = np.concatenate([track.windows[horizon_s].changes for track in tracks])
    counts = np.isfinite(changes).sum(axis=0)
    sums = np.nansum(changes**2, axis=0)
    return np.asarray((counts >= MIN_WINDOWS) & (sums > MOVED**2 * np.maximum(counts, 1)))


def score(tracks: Sequence[Track], theta: Array, horizon_s: float) -> dict[str, float | int | None]:
    """Return by axis 1 − R² of the change of velocity; None where it did not move. 1: "it stays as it is".

    Sums run over the windows of all `tracks`; `windows` counts them.
    """
    errors, changes = np.zeros(4), np.zeros(4)
    for track in tracks:
        measured = track.windows[horizon_s].changes
        errors += np.nansum((track.predicted(theta, horizon_s) - measured) ** 2, axis=0)
        changes += np.nansum(measured**2, axis=0)
    moves = moved(tracks, horizon_s)
    result: dict[str, float | int | None] = {
        name: round(float(errors[i] / changes[i]), 4) if moves[i] else None for i, name in enumerate(AXES)
    }
    result["windows"] = sum(len(track.windows[horizon_s].first) for track in tracks)
    return result


# --- Compiled ---------------------------------------------------------------------------------------------


def motors_follow(asked: Array, lag_s: float, start_s: float, delay_s: float, tick_s: float) -> Array:
    """Return the push of each motor (n, motors), N: `asked`, later by a delay, a start from rest, and a lag.

    A motor at rest, and one that reverses, gives nothing for `start_s`.
    """
    count, motors = asked.shape
    pushes = np.zeros((count, motors))
    keep = np.exp(-tick_s / lag_s)
    whole = int(delay_s / tick_s)
    part = delay_s / tick_s - whole
    for motor in range(motors):
        push, waits_s, turns = 0.0, start_s, 0.0
        for i in range(count):
            late, later = max(i - whole, 0), max(i - whole - 1, 0)
            wanted = (1.0 - part) * asked[late, motor] + part * asked[later, motor]
            if wanted * turns <= 0.0:
                turns = 1.0 if wanted > 0.0 else -1.0 if wanted < 0.0 else 0.0
                waits_s = start_s
            if turns != 0.0 and waits_s > 0.0:
                wanted *= max(1.0 - waits_s / tick_s, 0.0)
                waits_s -= tick_s
            push = wanted + (push - wanted) * keep
            pushes[i, motor] = push
    return pushes


def velocities_after(
    wrench: Array, begin: Array, end: Array, start: Array, theta: Array, tick_s: float
) -> Array:
    """Return u, v, w, r (n, 4) at the end of windows that begin with `start` (n, 6)."""
    ends = np.zeros((begin.size, 4))
    m_u, m_v, m_w, m_r = theta[0], theta[1], theta[2], theta[3]
    share, coupling, weight = theta[12], theta[13], theta[17]
    for k in range(begin.size):
        u, v, w, r = start[k, 0], start[k, 1], start[k, 2], start[k, 5]
        for i in range(begin[k], end[k]):
            X = wrench[i, 0] + share * m_v * r * v
            Y = wrench[i, 1] - share * m_u * r * u
            N = wrench[i, 3] + coupling * v
            u = (m_u * u + tick_s * X) / (m_u + tick_s * (theta[4] + theta[8] * abs(u)))
            v = (m_v * v + tick_s * Y) / (m_v + tick_s * (theta[5] + theta[9] * abs(v)))
            w = (m_w * w + tick_s * (wrench[i, 2] + weight)) / (
                m_w + tick_s * (theta[6] + theta[10] * abs(w))
            )
            r = (m_r * r + tick_s * N) / (m_r + tick_s * (theta[7] + theta[11] * abs(r)))
        ends[k, 0], ends[k, 1], ends[k, 2], ends[k, 3] = u, v, w, r
    return ends
