"""Roll and pitch of a log: inertia, righting moment and lever of the horizontal thrusters. No files.

    I_φ p' = K − k_φ sin φ cos θ − ℓ Y − (d_φ + D_φ |p|) p          φ' = p + q sin φ tan θ
    I_θ q' = M − k_θ sin θ + ℓ X − (d_θ + D_θ |q|) q − n w         θ' = q cos φ

K and M are the thrusters' moments, ℓ is how far the horizontal thrusters are below the centre of gravity, n w
the moment of the speed downward. d, D and n stand in no file.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from companion.identify.least_squares import least_squares
from lab.batch.compiled import cached, slotted
from lab.logs.dive_log import Array
from lab.logs.model import TICK_S, Track

NAMES: Final = ("roll_inertia", "pitch_inertia", "roll_righting_nm", "pitch_righting_nm", "lever_m")
LENGTH_S = 1.0
MAX_ROLL_RAD = 1.0
MAX_SHARE: Final = (0.25, 0.25, 0.4, 0.4, 0.0)
"""A value with a larger share of doubt is not taken; a lever is if it is known to MAX_LEVER_DOUBT_M."""
MAX_LEVER_DOUBT_M = 0.01
START: Final = np.array((0.8, 0.8, 4.0, 4.0, 0.02, 0.3, 0.3, 0.0, 0.1, 0.1))
LEAST: Final = np.array((0.02, 0.02, 0.0, 0.0, -1.0, 0.0, 0.0, -50.0, 0.0, 0.0))
MOST: Final = np.full(START.size, np.inf)
STEPS: Final = np.array((0.02, 0.02, 0.1, 0.1, 0.002, 0.02, 0.02, 0.1, 0.02, 0.02))
MIN_WINDOWS = 20
MIN_CHANGE_RADPS = 0.05
"""RMS over the windows; where it rolls or pitches less nothing is told."""
BLOCK_S = 20.0


def fit(tracks: Sequence[Track], theta: Array) -> dict[str, tuple[float, float]]:
    """Return what the logs tell of NAMES, with standard deviations; `theta` has the thrusters' lag."""
    windows = [(track, part) for track in tracks if (part := _windows(track)) is not None]
    parts = [part for _, part in windows]
    if sum(len(part[0]) for part in parts) < MIN_WINDOWS:
        return {}
    changes = np.concatenate([part[4] - part[2][:, 2:4] for part in parts])
    if np.sqrt(np.mean(changes**2, axis=0)).min() < MIN_CHANGE_RADPS:
        return {}
    wrenches = [track.wrench(theta) for track, _ in windows]
    blocks = np.concatenate([1e6 * k + part[0] * TICK_S // BLOCK_S for k, part in enumerate(parts)])

    def residuals(values: Array) -> Array:
        return np.concatenate(
            [
                (cached(slotted(rates_after))(wrench, *part[:4], values, TICK_S) - part[4]).ravel()
                for wrench, part in zip(wrenches, parts, strict=True)
            ]
        )

    values, J, r = least_squares(
        lambda _: residuals, START, range(START.size), STEPS, lambda _: (LEAST, MOST)
    )
    inverse = np.linalg.pinv(J.T @ J, hermitian=True)
    scores = (J * r[:, None]).reshape(-1, 2, START.size).sum(axis=1)
    middle = np.zeros_like(inverse)
    for block in np.unique(blocks):
        total = scores[blocks == block].sum(axis=0)
        middle += np.outer(total, total)
    sigma = np.sqrt(np.diag(inverse @ middle @ inverse))
    return {
        name: (float(value), float(doubt))
        for name, value, doubt, share in zip(NAMES, values, sigma, MAX_SHARE, strict=False)
        if doubt < (share * value if share else MAX_LEVER_DOUBT_M)
    }


def _windows(track: Track) -> tuple[Array, Array, Array, Array, Array] | None:
    """Return begins and ends on the grid, φ, θ, p, q, w (n, 5), speeds down, and p, q at the ends."""
    log = track.log
    if not np.isfinite(log.velocity[:, 3:5]).any():
        return None
    last = np.clip(np.searchsorted(log.t_s, log.t_s + LENGTH_S), 0, log.t_s.size - 1)
    state = np.column_stack((log.attitude[:, :2], log.velocity[:, 3:5], np.nan_to_num(log.velocity[:, 2])))
    good = (
        np.isfinite(state).all(axis=1)
        & np.isfinite(state[last]).all(axis=1)
        & (np.abs(log.t_s[last] - log.t_s - LENGTH_S) < 0.2)
        & (np.abs(state[:, :2]).max(axis=1) < MAX_ROLL_RAD)
        & (np.abs(state[last, :2]).max(axis=1) < MAX_ROLL_RAD)
    )
    if not good.any():
        return None
    ends = last[good]
    return (
        np.rint(log.t_s[good] / TICK_S).astype(np.int64),
        np.rint(log.t_s[ends] / TICK_S).astype(np.int64),
        state[good],
        np.nan_to_num(log.velocity[good][:, 2]),
        log.velocity[ends, 3:5],
    )


def rates_after(
    wrench: Array, begin: Array, end: Array, state: Array, down: Array, values: Array, tick_s: float
) -> Array:
    """Return p, q (n, 2) at the ends of windows."""
    ends = np.zeros((begin.size, 2))
    for k in range(begin.size):
        roll, pitch, p, q = state[k, 0], state[k, 1], state[k, 2], state[k, 3]
        for i in range(begin[k], end[k]):
            K = wrench[i, 4] - values[2] * np.sin(roll) * np.cos(pitch) - values[4] * wrench[i, 1]
            M = wrench[i, 5] - values[3] * np.sin(pitch) + values[4] * wrench[i, 0] - values[7] * down[k]
            p = (values[0] * p + tick_s * K) / (values[0] + tick_s * (values[5] + values[8] * abs(p)))
            q = (values[1] * q + tick_s * M) / (values[1] + tick_s * (values[6] + values[9] * abs(q)))
            roll += tick_s * (p + q * np.sin(roll) * np.tan(pitch))
            pitch += tick_s * q * np.cos(roll)
        ends[k, 0], ends[k, 1] = p, q
    return ends
