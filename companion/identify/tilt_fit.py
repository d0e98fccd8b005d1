"""Roll and pitch of a table: inertia, righting moment and lever of the horizontal thrusters. No files.

    I_φ p' = K − k_φ sin φ cos θ − ℓ Y − (d_φ + D_φ |p|) p          φ' = p + q sin φ tan θ
    I_θ q' = M − k_θ sin θ + ℓ X − (d_θ + D_θ |q|) q − n w         θ' = q cos φ

K and M are the thrusters' moments, ℓ is how far the horizontal thrusters are below the centre of gravity, n w
the moment of the speed downward. d, D and n stand in no file.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from companion.arrays import Array
from companion.identify.least_squares import jackknife, least_squares
from companion.identify.model import TICK_S, TICKS, Track
from companion.identify.sample_table import STEP_S

NAMES: Final = ("roll_inertia", "pitch_inertia", "roll_righting_nm", "pitch_righting_nm", "lever_m")
LENGTH_S = 1.0
MAX_ROLL_RAD = 1.0
MAX_SHARE: Final = (0.25, 0.25, 0.4, 0.4, 0.5)
"""A value with a larger share of doubt is not taken, nor a lever that is not known to MAX_LEVER_DOUBT_M."""
MAX_LEVER_DOUBT_M = 0.01
START: Final = np.array((0.8, 0.8, 4.0, 4.0, 0.02, 0.3, 0.3, 0.0, 0.1, 0.1))
LEAST: Final = np.array((0.02, 0.02, 0.0, 0.0, -1.0, 0.0, 0.0, -50.0, 0.0, 0.0))
MOST: Final = np.array((100.0, 100.0, 300.0, 300.0, 1.0, *[np.inf] * 5))
STEPS: Final = np.array((0.02, 0.02, 0.1, 0.1, 0.002, 0.02, 0.02, 0.1, 0.02, 0.02))
MIN_WINDOWS = 20
MIN_CHANGE_RADPS = 0.03
"""RMS over the windows; where it rolls or pitches less nothing is told."""
BLOCK_S = 20.0


def fit(tracks: Sequence[Track], theta: Array) -> dict[str, tuple[float, float]]:
    """Return what the tables tell of NAMES, with standard deviations; `theta`, by table, has the lag."""
    firsts = [_first(track) for track in tracks]
    if sum(first.size for first in firsts) < MIN_WINDOWS:
        return {}
    pairs = list(zip(tracks, firsts, strict=True))
    ends = np.concatenate([t.table.velocity[first + round(LENGTH_S / STEP_S), 3:5] for t, first in pairs])
    changes = ends - np.concatenate([track.table.velocity[first, 3:5] for track, first in pairs])
    if np.sqrt(np.mean(changes**2, axis=0)).min() < MIN_CHANGE_RADPS:
        return {}
    wrenches = [track.wrench(row) for track, row in zip(tracks, theta, strict=True)]

    def residuals(values: Array) -> Array:
        predicted = [
            _rates_after(track, first, wrench, values)
            for (track, first), wrench in zip(pairs, wrenches, strict=True)
        ]
        return np.asarray((np.concatenate(predicted) - ends).ravel())

    found = least_squares([residuals], START, (range(START.size), ()), STEPS, lambda _: (LEAST, MOST))
    block = [1e6 * k + track.table.t_s[first] // BLOCK_S for k, (track, first) in enumerate(pairs)]
    sigma = np.sqrt(np.diag(jackknife(found, [np.concatenate(block)])))
    return {
        name: (float(value), float(doubt))
        for name, value, doubt, share, most in zip(
            NAMES, found.theta[0], sigma, MAX_SHARE, MOST, strict=False
        )
        if doubt < share * abs(value) and (name != "lever_m" or doubt < MAX_LEVER_DOUBT_M) and value < most
    }


def _first(track: Track) -> NDArray[np.int64]:
    """Return the rows where a window begins: roll, pitch and their rates are known there and at its end."""
    table, rows = track.table, round(LENGTH_S / STEP_S)
    state = np.column_stack((table.attitude[:, :2], table.velocity[:, 3:5]))
    good = np.isfinite(state).all(axis=1) & (np.abs(state[:, :2]).max(axis=1) < MAX_ROLL_RAD)
    first = np.flatnonzero(good[:-rows] & good[rows:])
    return first[track.steered(first, LENGTH_S).all(axis=1)]


def _rates_after(track: Track, first: NDArray[np.int64], wrench: Array, values: Array) -> Array:
    """Return p, q (windows, 2) at the ends of windows."""
    I_roll, I_pitch, k_roll, k_pitch, lever_m, d_roll, d_pitch, n, D_roll, D_pitch = values.tolist()
    roll, pitch = track.table.attitude[first, :2].T
    p, q = track.table.velocity[first, 3:5].T
    down = np.nan_to_num(track.table.velocity[first, 2])
    for tick in range(round(LENGTH_S / TICK_S)):
        X, Y, _, _, K, M = wrench[TICKS * first + tick].T
        K = K - k_roll * np.sin(roll) * np.cos(pitch) - lever_m * Y
        M = M - k_pitch * np.sin(pitch) + lever_m * X - n * down
        p = (I_roll * p + TICK_S * K) / (I_roll + TICK_S * (d_roll + D_roll * np.abs(p)))
        q = (I_pitch * q + TICK_S * M) / (I_pitch + TICK_S * (d_pitch + D_pitch * np.abs(q)))
        roll = roll + TICK_S * (p + q * np.sin(roll) * np.tan(pitch))
        pitch = pitch + TICK_S * q * np.cos(roll)
    return np.column_stack((p, q))
