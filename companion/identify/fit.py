"""The vehicle that predicts a table best over windows of 1 and 2 s, with its doubt. No files, no clock.

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

from companion.config import VehicleFile
from companion.identify import tilt
from companion.identify.least_squares import Bounds, least_squares, sandwich
from companion.identify.model import (
    BODY,
    CORIOLIS,
    COUPLING,
    DEAD,
    DELAY,
    HORIZONS_S,
    KEYS,
    LAG,
    LATER,
    LEVEL_LATER,
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
from companion.identify.samples import NoDiveError
from companion.records import AXES, Array

LEAST: Final = np.array((*[1.0] * 3, 0.02, *[0.0] * 8, 0.0, -8.0, 0.02, 0.0, -0.02, -100.0, -0.03, 5.0, -0.1))
MOST: Final = np.array(
    (*[1e3] * 3, 1e2, *[300.0] * 3, 30.0, *[1e3] * 3, 30.0, 1.0, 8.0, 1.0, 0.5, 0.1, 100.0, 0.03, 55.0, 0.1)
)
STEPS: Final = np.array(
    (
        *[0.3] * 3,
        0.003,
        *[0.3] * 3,
        0.003,
        *[0.3] * 3,
        0.003,
        0.01,
        0.01,
        *[0.001] * 3,
        0.01,
        0.001,
        0.3,
        0.001,
    )
)
"""A small change of each, for the slope."""
START_SIZES: Final = (0.5, 1.0, 2.5)
START_LAG_S, START_START_S, START_DELAY_S = 0.06, 0.1, 0.01
BLOCK_S = 5.0
TRUSTED, TRUSTED_OF_MANOEUVRE = 0.25, 0.1
"""An inertia with a larger share of standard deviation is not written into the vehicle's file."""
MAX_UNEXPLAINED: Final = 0.35
"""Nor that of an axis of whose change over 2 s the model leaves a larger share: something else drove it."""
CALM: Final = 0.015
"""A manoeuvre leaves a smaller share in calm water; in waves inertia is found too large."""
MAX_DOUBTS: Final = {CORIOLIS: 0.25, COUPLING: 1.0, LAG: 0.1, START: 0.1, DELAY: 0.1}
"""Nor is one of these that is known less well; N·s, s."""
APART = 0.15
"""Inertia and damping are told apart where neither's doubt is a larger share of it."""


@dataclass(frozen=True)
class Fit:
    """What tables tell: by the model's numbers the values and standard deviations, NaN where not fitted."""

    theta: Array
    sigma: Array
    covariance: Array
    axes: tuple[bool, ...]
    """Which of surge, sway, heave and yaw were measured and moved."""
    speeds: tuple[float, ...]
    """RMS of each axis' velocity, m/s and rad/s."""
    unexplained: tuple[float, ...]
    """1 − R² of each axis over 2 s, on these tables."""
    tilt: dict[str, tuple[float, float]]
    """Keys of `[levelling]` with standard deviations."""
    manoeuvre: bool
    """Whether Holdfast itself moved it: the delay is then that of its link, too, and in no file."""

    def sum_of(self, *numbers: int) -> tuple[float, float]:
        """Return a sum of parameters and its standard deviation: known better than its parts."""
        return self._weighted(dict.fromkeys(numbers, 1.0))

    def damping_at(self, axis: int, speed: float | None = None) -> tuple[float, float]:
        """Return the damping at a speed, RMS if none is given, and its standard deviation."""
        speed = self.speeds[axis] if speed is None else speed
        return self._weighted({LINEAR + axis: speed, QUADRATIC + axis: speed**2})

    def known(self, axis: int) -> bool:
        """Tell whether the inertia of an axis is known."""
        trusted = TRUSTED_OF_MANOEUVRE if self.manoeuvre else TRUSTED
        sure = self.sigma[MASS + axis] < trusted * self.theta[MASS + axis]
        return bool(sure and self.unexplained[axis] < MAX_UNEXPLAINED)

    def apart(self, axis: int) -> bool:
        """Tell whether inertia and damping of an axis can be told apart."""
        drag, doubt = self.damping_at(axis)
        return bool(self.sigma[MASS + axis] < APART * self.theta[MASS + axis] and doubt < APART * drag)

    def _weighted(self, weights: dict[int, float]) -> tuple[float, float]:
        row = np.zeros(self.theta.size)
        row[[*weights]] = [*weights.values()]
        return float(row @ self.theta), math.sqrt(max(float(row @ self.covariance @ row), 0.0))


def fit(
    tracks: Sequence[Track],
    base: VehicleFile,
    progress: Callable[[float], None] = lambda share: None,
    excited: Sequence[int] | None = None,
) -> Fit:
    """Fit the model to tables, from `base` on, whose values stay where the tables tell nothing.

    Args:
        tracks: the tables.
        base: where it begins.
        progress: is told a share of 1.
        excited: the axes that a manoeuvre moved. Its commands and stamps are exact: dead band and lateness of
            the vertical speed's stamp are found, too. None: a log, in which any axis may have moved.

    Raises NoDiveError where no axis was measured and moved.

    """
    moving = moved(tracks)
    if excited is not None:
        moving &= np.isin(np.arange(len(AXES)), excited)
    axes = moving[-1]
    if not axes.any():
        raise NoDiveError("no axis was measured while it moved: nothing can be found")
    free = _free(axes, manoeuvre=excited is not None)
    changes = np.concatenate([track.changes for track in tracks])
    norms = np.where(moving, np.sqrt(np.maximum(np.nansum(changes**2, axis=0), 1e-12)), np.inf)

    def residuals(theta: Array) -> Array:
        predicted = np.concatenate([track.predicted(theta) for track in tracks])
        return np.asarray(np.nan_to_num((predicted - changes) / norms).ravel())

    theta = min(_starts(parameters(base)), key=lambda start: float(np.sum(residuals(start) ** 2)))
    found = least_squares(residuals, theta, free, STEPS, _bounds_at, progress)
    block = [1e6 * k + track.table.t_s[track.first] // BLOCK_S for k, track in enumerate(tracks)]
    covariance, sigma = np.zeros((theta.size, theta.size)), np.full(theta.size, np.nan)
    covariance[np.ix_(free, free)] = sandwich(found, np.concatenate(block))
    sigma[free] = np.sqrt(np.diag(covariance)[free])
    velocities = np.concatenate([track.table.velocity[:, BODY] for track in tracks])
    speeds = np.sqrt(np.nansum(velocities**2, axis=0) / np.maximum(np.isfinite(velocities).sum(axis=0), 1))
    rest = [score(tracks, found.theta, HORIZONS_S[-1])[name] for name in AXES]
    return Fit(
        theta=found.theta,
        sigma=sigma,
        covariance=covariance,
        axes=tuple(axes.tolist()),
        speeds=tuple(speeds.tolist()),
        unexplained=tuple(1.0 if value is None else value for value in rest),
        tilt=tilt.fit(tracks, found.theta),
        manoeuvre=excited is not None,
    )


def vehicle(found: Fit, base: VehicleFile) -> tuple[VehicleFile, dict[str, str]]:
    """Return `base` with what was found, and notes behind the keys."""
    table: dict[str, Any] = msgspec.to_builtins(base)
    notes: dict[str, str] = {}
    some = any(map(found.known, range(len(AXES))))
    for i, (section, key) in enumerate(KEYS):
        value, sigma = float(found.theta[i]), float(found.sigma[i])
        if i == DELAY:
            value = max(value, 0.0)  # a log's stamps are true to a tick
        if math.isnan(sigma) or (found.manoeuvre and i == DELAY):
            notes[f"{section}.{key}"] = "not identified"
        elif found.known(AXES.index(section)) if section in AXES else some and sigma < MAX_DOUBTS[i]:
            table[section][key] = float(f"{value:.4g}")
            notes[f"{section}.{key}"] = f"sd {sigma:.2g}"
        else:
            notes[f"{section}.{key}"] = f"not identified; found {value:.3g}, sd {sigma:.2g}"
    for key in tilt.NAMES:
        value, sigma = found.tilt.get(key, (math.nan, math.nan))
        if value == value:
            table["levelling"][key] = float(f"{value:.3g}")
            notes[f"levelling.{key}"] = f"sd {sigma:.2g}"
        else:
            notes[f"levelling.{key}"] = "not identified"
    return msgspec.convert(table, VehicleFile), notes


def reported(found: Fit, base: VehicleFile) -> Iterator[str]:
    """Say what was found, beside what `base` says, and what a better record would need."""
    before = parameters(base)
    for axis, name in enumerate(AXES):
        if not found.axes[axis]:
            yield f"{name}: not measured, or it did not move: the base's numbers stay; {_needs(axis)}"
            continue
        speed, unit = found.speeds[axis], "rad/s" if name == "yaw" else "m/s"
        drag, doubt = found.damping_at(axis)
        believed = before[LINEAR + axis] * speed + before[QUADRATIC + axis] * speed**2
        text = (
            f"{name}: inertia {found.theta[MASS + axis]:.3g} (sd {found.sigma[MASS + axis]:.2g}, before "
            f"{before[MASS + axis]:.3g}), damping at {speed:.2f} {unit} {drag:.3g} (sd {doubt:.2g}, before "
            f"{believed:.3g})"
        )
        if found.unexplained[axis] >= MAX_UNEXPLAINED:
            text += f"; not identified: {found.unexplained[axis]:.0%} of its change is not explained"
        elif not found.known(axis) or not found.apart(axis):
            text += f"; inertia and damping cannot be told apart well; {_needs(axis)}"
        elif found.manoeuvre and found.unexplained[axis] > CALM:
            text += (
                f"; {found.unexplained[axis]:.1%} of its change is not explained: if there were waves or a "
                "current, its inertia is found too large"
            )
        yield text
    lag, start, delay = (1e3 * found.theta[i] for i in (LAG, START, DELAY))
    late_s, doubt_s = found.sum_of(LAG, START, DELAY)
    yield (
        f"thrust is late by {1e3 * late_s:.0f} ms from rest (sd {1e3 * doubt_s:.0f}): lag {lag:.0f}, "
        f"start {start:.0f}, delay {delay:.0f} ms, which are known together better than apart"
    )
    if found.axes[2]:
        yield f"net buoyancy {-found.theta[WEIGHT]:.2f} N (sd {found.sigma[WEIGHT]:.2g})"
    if not found.tilt:
        yield f"roll and pitch: not identified; {_needs(len(AXES))}"


def _needs(axis: int) -> str:
    if axis == len(AXES):
        return "a better log moves their sticks, and a manoeuvre needs a position, to push surge and sway"
    if axis < 2:
        return "surge and sway need a speed over ground, such as a DVL's, and a log that steers them"
    return (
        "heave and yaw need vehicle.steering_mode = manual and a calm place, and a log starts and stops them "
        "often, at several speeds"
    )


def _free(axes: Array, *, manoeuvre: bool) -> list[int]:
    """Return which parameters are looked for."""
    free = [i + axis for i in (MASS, LINEAR, QUADRATIC) for axis in range(len(AXES)) if axes[axis]]
    if axes[[0, 1, 3]].all():
        free.append(CORIOLIS)
    if axes[[1, 3]].all():
        free.append(COUPLING)
    free += [LAG, START, DELAY]
    if axes[2]:
        free.append(WEIGHT)
    if manoeuvre:
        free.append(DEAD)
    if manoeuvre and axes[2] and axes[3]:
        free.append(LATER)
    if manoeuvre and axes[:2].any() and axes[3]:
        free.append(LEVEL_LATER)
    return free


def _starts(base: Array) -> Iterator[Array]:
    """Give parameters to begin with: vehicles slower and quicker than `base`."""
    for size in START_SIZES:
        theta = base.copy()
        theta[MASS : MASS + 4] *= size
        theta[[LAG, START, DELAY]] = START_LAG_S, START_START_S, START_DELAY_S
        yield np.clip(theta, LEAST, MOST)


def _bounds_at(theta: Array) -> Bounds:
    least, most = LEAST.copy(), MOST.copy()
    least[:4], most[:4] = np.maximum(LEAST[:4], 0.4 * theta[:4]), np.minimum(MOST[:4], 2.5 * theta[:4])
    return least, most
