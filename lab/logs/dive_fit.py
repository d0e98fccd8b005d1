"""The vehicle that predicts logs best over windows of 1 and 2 s, with its doubt. No files.

Minimises Σ (1 − R²) of the change of velocity, over axes and horizons (Levenberg, Marquardt). Nothing is
differentiated, and a window starts from what was measured: what a tether did before does not count. The doubt
is the sandwich estimator with the gradient summed over BLOCK_S: the errors of windows that overlap, and those
of a tether, are correlated (Newey and West, Econometrica, 1987).
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from companion.config import VehicleFile
from companion.identify.least_squares import least_squares
from companion.records import AXES
from lab.logs import tilting
from lab.logs.dive_log import Array, LogError, no_progress
from lab.logs.model import (
    CORIOLIS,
    COUPLING,
    DELAY,
    HORIZONS_S,
    KEYS,
    LAG,
    LINEAR,
    MASS,
    QUADRATIC,
    START,
    WEIGHT,
    Track,
    moved,
    parameters,
    score,
)

NAMES: Final = (*(f"{section}.{key}" for section, key in KEYS), "weight in water")
LEAST: Final = np.array((*[1.0] * 3, 0.02, *[0.0] * 8, 0.0, -8.0, 0.02, 0.0, 0.0, -100.0))
MOST: Final = np.array(
    (*[1000.0] * 3, 100.0, *[300.0] * 3, 100.0, *[3000.0] * 3, 100.0, 1.0, 8.0, 1.0, 0.5, 0.1, 100.0)
)
STEPS: Final = 0.3 * np.array(
    (5, 5, 8, 0.1, 3, 3, 3, 0.1, 10, 10, 10, 0.3, 0.1, 0.3, 0.02, 0.02, 0.02, 0.5), float
)
"""A small change of each, for the slope."""
START_SIZES: Final = (0.5, 1.0, 2.5)
START_LAG_S, START_START_S, START_DELAY_S = 0.06, 0.1, 0.01
BLOCK_S = 5.0
TRUSTED = 0.25
"""An inertia with a larger share of standard deviation is not written into the vehicle's file."""
MAX_UNEXPLAINED: Final = 0.35
"""Nor that of an axis of whose change over 2 s the model leaves a larger share: something else drove it."""
MAX_DOUBTS: Final = {CORIOLIS: 0.25, COUPLING: 1.0, LAG: 0.1, START: 0.1, DELAY: 0.1}
"""Nor is one of these that is known less well; N·s, s."""
APART = 0.15
"""Inertia and damping are told apart where neither's doubt is a larger share of it."""


@dataclass(frozen=True)
class DiveFit:
    """What logs tell: by NAMES the values and their standard deviations, NaN where not fitted."""

    theta: Array
    sigma: Array
    covariance: Array
    axes: tuple[bool, ...]
    """Which of surge, sway, heave and yaw were measured and moved."""
    speeds: tuple[float, ...]
    """RMS of each axis' velocity, m/s and rad/s."""
    unexplained: tuple[float, ...]
    """1 − R² of each axis over 2 s, on these logs."""
    tilt: dict[str, tuple[float, float]]
    """Keys of `[levelling]` with standard deviations."""

    def damping_at(self, axis: int) -> tuple[float, float]:
        """Return the damping at the RMS speed and its standard deviation: known better than its parts."""
        powers = np.zeros(len(NAMES))
        powers[LINEAR + axis], powers[QUADRATIC + axis] = self.speeds[axis], self.speeds[axis] ** 2
        return float(powers @ self.theta), math.sqrt(max(float(powers @ self.covariance @ powers), 0.0))

    def known(self, axis: int) -> bool:
        """Tell whether the inertia of an axis is known."""
        sure = self.sigma[MASS + axis] < TRUSTED * self.theta[MASS + axis]
        return bool(sure and self.unexplained[axis] < MAX_UNEXPLAINED)

    def apart(self, axis: int) -> bool:
        """Tell whether inertia and damping of an axis can be told apart."""
        drag, doubt = self.damping_at(axis)
        return bool(self.sigma[MASS + axis] < APART * self.theta[MASS + axis] and doubt < APART * drag)


def fit(
    tracks: Sequence[Track], base: VehicleFile, progress: Callable[[float], None] = no_progress
) -> DiveFit:
    """Fit the model to logs, from `base` on, whose values stay where the logs tell nothing.

    Raises LogError where no axis was measured and moved.
    """
    axes = moved(tracks, HORIZONS_S[-1])
    if not axes.any():
        raise LogError("no axis was measured while it moved: nothing can be found")
    free = _free(axes)
    norms = _norms(tracks)

    def residuals(theta: Array) -> Array:
        return np.concatenate([_errors(track, theta, norms) for track in tracks])

    theta = min(_starts(parameters(base)), key=lambda start: float(np.sum(residuals(start) ** 2)))
    theta, J, r = least_squares(lambda _: residuals, theta, free, STEPS, _bounds_at, progress)
    covariance = np.full((len(NAMES), len(NAMES)), 0.0)
    covariance[np.ix_(free, free)] = _covariance(tracks, J, r)
    sigma = np.full(len(NAMES), np.nan)
    sigma[free] = np.sqrt(np.diag(covariance)[free])
    velocities = np.concatenate([track.log.velocity[:, (0, 1, 2, 5)] for track in tracks])
    speeds = [
        float(np.sqrt(np.nanmean(column**2))) if np.isfinite(column).any() else 0.0 for column in velocities.T
    ]
    rest = [score(tracks, theta, HORIZONS_S[-1])[name] for name in AXES]
    unexplained = tuple(1.0 if value is None else value for value in rest)
    tilt = tilting.fit(tracks, theta)
    return DiveFit(theta, sigma, covariance, tuple(map(bool, axes)), tuple(speeds), unexplained, tilt)


def vehicle(found: DiveFit, base: VehicleFile) -> tuple[VehicleFile, dict[str, str]]:
    """Return `base` with what was found, and notes behind the keys."""
    table: dict[str, Any] = msgspec.to_builtins(base)
    notes: dict[str, str] = {}
    some = any(map(found.known, range(len(AXES))))
    for i, (section, key) in enumerate(KEYS):
        value, sigma = float(found.theta[i]), float(found.sigma[i])
        if math.isnan(sigma):
            notes[f"{section}.{key}"] = "not identified"
        elif found.known(AXES.index(section)) if section in AXES else some and sigma < MAX_DOUBTS[i]:
            table[section][key] = float(f"{value:.4g}")
            notes[f"{section}.{key}"] = f"sd {sigma:.2g}"
        else:
            notes[f"{section}.{key}"] = f"not identified; these logs say {value:.3g}, sd {sigma:.2g}"
    for key in ("roll_inertia", "pitch_inertia", "lever_m", "roll_righting_nm", "pitch_righting_nm"):
        value, sigma = found.tilt.get(key, (math.nan, math.nan))
        if value == value:
            table["levelling"][key] = float(f"{value:.3g}")
            notes[f"levelling.{key}"] = f"sd {sigma:.2g}"
        else:
            notes[f"levelling.{key}"] = "not identified"
    return msgspec.convert(table, VehicleFile), notes


def said(found: DiveFit) -> Iterator[str]:
    """Say what the logs tell, and what a better log would need."""
    for axis, name in enumerate(AXES):
        if not found.axes[axis]:
            yield f"{name}: not measured, or it did not move: the base's numbers stay; {_needs(axis)}"
            continue
        drag, doubt = found.damping_at(axis)
        unit = "rad/s" if name == "yaw" else "m/s"
        text = (
            f"{name}: inertia {found.theta[MASS + axis]:.3g} (sd {found.sigma[MASS + axis]:.2g}), "
            f"damping at {found.speeds[axis]:.2f} {unit} {drag:.3g} (sd {doubt:.2g})"
        )
        if found.unexplained[axis] >= MAX_UNEXPLAINED:
            text += f"; not identified: {found.unexplained[axis]:.0%} of its change is not explained"
        elif not found.apart(axis):
            text += (
                "; inertia and damping cannot be told apart well: a better log starts and stops this axis "
                "often, at several speeds, and lets it coast"
            )
        yield text
    lag, start, delay = (1e3 * found.theta[i] for i in (LAG, START, DELAY))
    together = math.sqrt(
        max(float(found.covariance[np.ix_((LAG, START, DELAY), (LAG, START, DELAY))].sum()), 0.0)
    )
    yield (
        f"thrust is late by {lag + start + delay:.0f} ms from rest (sd {1e3 * together:.0f}): lag {lag:.0f}, "
        f"start {start:.0f}, delay {delay:.0f} ms, which are known together better than apart"
    )
    if found.axes[2]:
        yield f"weight in water less buoyancy: {found.theta[WEIGHT]:.2f} N (sd {found.sigma[WEIGHT]:.2g})"
    if not found.tilt:
        yield "roll and pitch: not identified; a better log moves their sticks, too"


def _needs(axis: int) -> str:
    if axis < 2:
        return "a better log has a speed over ground, of a DVL or motion capture, and steers this axis"
    return "a better log steers this axis, both ways, from rest and back to rest"


def _free(axes: NDArray[np.bool_]) -> list[int]:
    free = [part + axis for part in (MASS, LINEAR, QUADRATIC) for axis in range(4) if axes[axis]]
    if axes[0] and axes[1] and axes[3]:
        free.append(CORIOLIS)
    if axes[1] and axes[3]:
        free.append(COUPLING)
    return [*free, LAG, START, DELAY, *([WEIGHT] if axes[2] else [])]


def _starts(base: Array) -> Iterator[Array]:
    """Give parameters to begin with: vehicles slower and quicker than `base`."""
    for size in START_SIZES:
        theta = base.copy()
        theta[MASS : MASS + 4] *= size
        theta[[LAG, START, DELAY]] = START_LAG_S, START_START_S, START_DELAY_S
        yield np.clip(theta, LEAST, MOST)


def _norms(tracks: Sequence[Track]) -> dict[float, Array]:
    """Return by horizon the root of each axis' sum of squared changes (4,); infinite if it did not move."""
    norms = {}
    for horizon_s in HORIZONS_S:
        sums = sum(np.nansum(track.windows[horizon_s].changes ** 2, axis=0) for track in tracks)
        norms[horizon_s] = np.where(moved(tracks, horizon_s), np.sqrt(np.maximum(sums, 1e-12)), np.inf)
    return norms


def _errors(track: Track, theta: Array, norms: dict[float, Array]) -> Array:
    """Return the errors of a log's windows, one horizon after the other."""
    wrench = track.wrench(theta)
    return np.concatenate(
        [
            np.nan_to_num(
                (track.predicted(theta, horizon_s, wrench) - track.windows[horizon_s].changes) / norm
            ).ravel()
            for horizon_s, norm in norms.items()
        ]
    )


def _bounds_at(theta: Array) -> tuple[Array, Array]:
    least, most = LEAST.copy(), MOST.copy()
    least[:4], most[:4] = np.maximum(LEAST[:4], 0.4 * theta[:4]), np.minimum(MOST[:4], 2.5 * theta[:4])
    return least, most


def _covariance(tracks: Sequence[Track], J: Array, r: Array) -> Array:
    inverse = np.linalg.pinv(J.T @ J, hermitian=True)
    scores = J * r[:, None]
    middle = np.zeros_like(inverse)
    at = 0
    for track in tracks:
        blocks: dict[int, Array] = {}
        for horizon_s in HORIZONS_S:
            times = track.log.t_s[track.windows[horizon_s].first]
            for block, rows in zip(
                (times // BLOCK_S).astype(int),
                scores[at : at + 4 * times.size].reshape(times.size, 4, -1),
                strict=True,
            ):
                blocks[block] = blocks.get(block, 0.0) + rows.sum(axis=0)
            at += 4 * times.size
        for total in blocks.values():
            middle += np.outer(total, total)
    return np.asarray(inverse @ middle @ inverse)
