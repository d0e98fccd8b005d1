"""The vehicle that predicts tables best over windows of 1 and 2 s, with its doubt. No files, no clock.

Minimises Σ (1 − R²) of the change of velocity, over axes and horizons (Levenberg, Marquardt). Nothing is
differentiated, and a window starts from what was measured: what a tether did before does not count. The doubt
leaves out blocks of BLOCKS_S: the errors of windows that overlap, and those of a tether, are correlated.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from companion.arrays import Array
from companion.config import VehicleFile
from companion.identify import model, tilt_fit
from companion.identify.least_squares import Bounds, Solution, jackknife
from companion.identify.model import Track, parameters
from companion.identify.sample_table import NoDiveError
from companion.records import AXES, PSI, X, Y, Z

START_SIZES: Final = (0.5, 1.0, 2.5)
START_LAG_S, START_START_S = 0.06, 0.1
TIMES: Final = {
    model.LAG: "lag",
    model.DELAY: "delay",
    model.LATER: "lateness of the vertical speed",
    model.LEVEL_LATER: "lateness of the horizontal speed",
}
EXACT: Final = {model.DELAY: (-0.02, 0.1), model.LATER: (-0.03, 0.03), model.LEVEL_LATER: (-0.1, 0.1)}
"""Bounds in a manoeuvre, of which Holdfast itself stamped commands and arrivals, s."""
BLOCKS_S: Final = (5.0, 20.0, 60.0)
MIN_BLOCKS = 8
"""The doubt is the largest that these blocks give, where there are at least this many."""
TRUSTED, TRUSTED_OF_MANOEUVRE = 0.25, 0.1
"""An inertia with a larger share of standard deviation is not written into the vehicle's file."""
MAX_UNEXPLAINED: Final = 0.35
"""Nor that of an axis of whose change over 2 s the model leaves a larger share: something else drove it."""
CALM: Final = 0.015
"""A manoeuvre leaves a smaller share in calm water; in waves inertia is found too large."""
MAX_DOUBT: Final = 0.5
"""What has a larger share of it is not known: the base's value stays, and the rest is fitted with it."""
MUCH = 0.9
"""An axis that is known badly is written where its fit leaves a smaller share of what the base leaves."""
DEPTH_SCALE: Final = 0.02
"""More doubt of heave, as a share: the EKF's depth shows 0.97 to 1 of a motion (docs/ardusub.md)."""
APART = 0.15
"""Inertia and damping are told apart where neither's doubt is a larger share of it."""


@dataclass(frozen=True)
class Fit:
    """What tables tell: by the model's numbers the values and standard deviations, NaN where not fitted."""

    tables: tuple[str, ...]
    """Names."""
    thetas: Array
    """Parameters by table: its own differ."""
    sigma: Array
    covariance: Array
    """Covariance of the shared parameters and of the first table's own."""
    at_bound: tuple[int, ...]
    """Parameters that ended at a bound."""
    axes: tuple[bool, ...]
    """Which of surge, sway, heave and yaw were measured and moved."""
    speeds: tuple[float, ...]
    """RMS of each axis' velocity, m/s and rad/s."""
    unexplained: tuple[float, ...]
    """1 − R² of each axis over 2 s, on these tables."""
    unexplained_before: tuple[float, ...]
    """The unexplained share with the base's parameters."""
    doubtful: dict[int, tuple[float, float]]
    """Parameters that are not known: what was found, and its standard deviation."""
    tilt: dict[str, tuple[float, float]]
    """Keys of `[levelling]` with standard deviations."""
    manoeuvre: bool
    """Whether Holdfast itself moved it: the delay is then that of its link, too, and in no file."""

    @property
    def theta(self) -> Array:
        """The shared parameters, and the first table's own."""
        return np.asarray(self.thetas[0])

    def sum_of(self, *numbers: int) -> tuple[float, float]:
        """Return a sum of parameters and its standard deviation: known better than its parts."""
        return self._weighted(dict.fromkeys(numbers, 1.0))

    def damping_at(self, axis: int, speed: float | None = None) -> tuple[float, float]:
        """Return the damping at a speed, RMS if none is given, and its standard deviation."""
        speed = self.speeds[axis] if speed is None else speed
        return self._weighted({model.LINEAR + axis: speed, model.QUADRATIC + axis: speed**2})

    def known(self, axis: int) -> bool:
        """Tell whether the inertia of an axis is known."""
        trusted = TRUSTED_OF_MANOEUVRE if self.manoeuvre else TRUSTED
        sure = self.sigma[model.MASS + axis] < trusted * self.theta[model.MASS + axis]
        return bool(sure and self.unexplained[axis] < MAX_UNEXPLAINED)

    def taken(self, axis: int) -> bool:
        """Tell whether an axis is written: known, or at least found and predicted better than by the base."""
        found = self.axes[axis] and not {model.MASS + axis} & {*self.at_bound, *self.doubtful}
        better = self.unexplained[axis] < MUCH * self.unexplained_before[axis]
        return self.known(axis) or bool(found and better)

    def apart(self, axis: int) -> bool:
        """Tell whether inertia and damping of an axis can be told apart."""
        drag, doubt = self.damping_at(axis)
        return bool(
            self.sigma[model.MASS + axis] < APART * self.theta[model.MASS + axis] and doubt < APART * drag
        )

    def _weighted(self, weights: dict[int, float]) -> tuple[float, float]:
        row = np.zeros(self.theta.size)
        row[[*weights]] = [*weights.values()]
        return float(row @ self.theta), math.sqrt(max(float(row @ self.covariance @ row), 0.0))


def fit(tracks: Sequence[Track], base: VehicleFile, excited: Sequence[int] | None = None) -> Fit:
    """Fit the model to tables, from `base` on, whose values stay where the tables tell nothing.

    `excited` are the axes that a manoeuvre moved, whose commands and stamps are exact: the dead band is
    found, too. None: logs, in which any axis may have moved.

    Raises NoDiveError where no axis was measured and moved.
    """
    moving = model.moved(tracks)
    if excited is not None:
        moving &= np.isin(np.arange(len(AXES)), excited)
    if not moving[-1].any():
        raise NoDiveError("no axis was measured while it moved: nothing can be found")
    least, most = model.LEAST.copy(), model.MOST.copy()
    for number, bounds in EXACT.items() if excited is not None else ():
        least[number], most[number] = bounds
    velocities = np.concatenate([track.table.velocity[:, model.BODY] for track in tracks])
    speeds = np.sqrt(np.nansum(velocities**2, axis=0) / np.maximum(np.isfinite(velocities).sum(axis=0), 1))
    theta, covariance, doubtful = _sure(
        tracks, base, moving, (least, most), speeds, manoeuvre=excited is not None
    )
    covariance = covariance + _of_depth_scale(theta[0], covariance)
    sigma = np.sqrt(np.diag(covariance))
    bound = sigma.astype(bool) & ((theta <= least + 1e-4) | (theta >= most - 1e-4))
    before = [track.settled(parameters(base)) for track in tracks]
    return Fit(
        tables=tuple(track.table.name for track in tracks),
        thetas=theta,
        sigma=np.where(sigma > 0.0, sigma, np.nan),
        covariance=covariance,
        at_bound=tuple(np.flatnonzero(bound.any(axis=0)).tolist()),
        axes=tuple(moving[-1].tolist()),
        speeds=tuple(speeds.tolist()),
        unexplained=tuple(model.unexplained(tracks, theta)[-1].tolist()),
        unexplained_before=tuple(model.unexplained(tracks, before)[-1].tolist()),
        doubtful=doubtful,
        tilt=tilt_fit.fit(tracks, theta),
        manoeuvre=excited is not None,
    )


def _sure(
    tracks: Sequence[Track],
    base: VehicleFile,
    moving: NDArray[np.bool_],
    bounds: Bounds,
    speeds: Array,
    *,
    manoeuvre: bool,
) -> tuple[Array, Array, dict[int, tuple[float, float]]]:
    """Return parameters by table, their covariance, and what is not known of the vehicle.

    The most doubtful parameter is set to that of `base`, and all others are fitted anew, until none is. The
    two parts of a damping are judged by their sum at the axis' speed. Of an axis whose inertia is not known
    everything is that of `base`.
    """
    before, doubtful, moving = parameters(base), dict[int, tuple[float, float]](), moving.copy()
    thinned, starts = [track.thinned() for track in tracks], [np.clip(x, *bounds) for x in _starts(before)]
    while True:
        shared = [i for i in _shared(moving[-1], manoeuvre=manoeuvre) if i not in doubtful]
        numbers = [*shared, *(own := model.forces(moving[-1]))]
        found = model.searched(thinned, moving, starts, (shared, own), bounds)
        theta, covariance = found.theta, _covariance(found, thinned, numbers)
        doubts = {i: _doubt(i, theta[0], covariance, speeds) for i in shared if i < len(model.KEYS)}
        worst = max(doubts, key=doubts.__getitem__)
        if doubts[worst] <= MAX_DOUBT:
            return theta, covariance, doubtful
        doubtful[worst] = float(theta[0, worst]), math.sqrt(covariance[worst, worst])
        fixed = [worst]
        if worst < len(AXES):
            fixed, moving[:, worst] = [i + worst for i in (model.MASS, model.LINEAR, model.QUADRATIC)], False
        if not moving[-1].any():
            return theta, covariance, doubtful
        starts = [theta[0].copy()]
        starts[0][fixed] = before[fixed]


def _of_depth_scale(theta: Array, covariance: Array) -> Array:
    """Return the covariance of what was fitted of heave's inertia and damping if depth has another scale."""
    change = np.zeros(theta.size)
    for number, power in ((model.MASS, 1.0), (model.LINEAR, 1.0), (model.QUADRATIC, 2.0)):
        if covariance[number + Z, number + Z] > 0.0:
            change[number + Z] = power * DEPTH_SCALE * theta[number + Z]
    return np.outer(change, change)


def _doubt(number: int, theta: Array, covariance: Array, speeds: Array) -> float:
    """Return a parameter's standard deviation as a share of it; of a part of a damping, that of the sum."""
    weights, axis = np.zeros(theta.size), number % len(AXES)
    weights[number] = 1.0
    if model.LINEAR <= number < model.CORIOLIS:
        weights[[model.LINEAR + axis, model.QUADRATIC + axis]] = speeds[axis], speeds[axis] ** 2
    least = 2.0 * model.TICK_S if number in (model.LAG, model.START) else 1e-9  # a tick is near enough
    variance = max(float(weights @ covariance @ weights), 0.0)
    return math.sqrt(variance) / max(abs(float(weights @ theta)), least)


def _covariance(found: Solution, tracks: Sequence[Track], numbers: Sequence[int]) -> Array:
    """Return the covariance of all parameters; `numbers` are the fitted ones, in the order of `found`."""
    covariances = list[Array]()
    for block_s in BLOCKS_S:
        blocks = [1e6 * k + track.table.t_s[track.first] // block_s for k, track in enumerate(tracks)]
        if not covariances or sum(np.unique(block).size for block in blocks) >= MIN_BLOCKS:
            covariances.append(jackknife(found, blocks)[: len(numbers), : len(numbers)])
    variances = np.array([np.diag(covariance) for covariance in covariances])
    larger = np.sqrt(variances.max(axis=0) / np.maximum(variances[0], 1e-300))
    every = np.zeros((model.LEAST.size, model.LEAST.size))
    every[np.ix_(numbers, numbers)] = covariances[0] * np.outer(larger, larger)
    return every


def vehicle(found: Fit, base: VehicleFile) -> tuple[VehicleFile, dict[str, str]]:
    """Return `base` with what was found, and notes behind the keys.

    Lag, start and what couples the axes come from the fit that gave the inertia, however well they are known.
    """
    table: dict[str, Any] = msgspec.to_builtins(base)
    notes: dict[str, str] = {}
    for i, (section, key) in enumerate(model.KEYS):
        value, sigma = float(found.theta[i]), float(found.sigma[i])
        axes = [AXES.index(section)] if section in AXES else range(len(AXES))
        if i in found.doubtful:
            value, sigma = found.doubtful[i]
            notes[f"{section}.{key}"] = f"not known; found {value:.3g}, sd {sigma:.2g}"
        elif math.isnan(sigma):
            notes[f"{section}.{key}"] = "not identified"
        elif any(map(found.taken, axes)):
            table[section][key] = float(f"{value:.4g}")
            apart = (
                ""
                if section == "thrusters" or sigma <= MAX_DOUBT * abs(value)
                else "; only its sum with the other part is known"
            )
            notes[f"{section}.{key}"] = f"sd {sigma:.2g}{apart}"
        else:
            notes[f"{section}.{key}"] = f"not identified; found {value:.3g}, sd {sigma:.2g}"
    notes |= {f"levelling.{key}": "not identified" for key in tilt_fit.NAMES}
    for key, (value, sigma) in found.tilt.items():
        table["levelling"][key] = float(f"{value:.3g}")
        notes[f"levelling.{key}"] = f"sd {sigma:.2g}"
    return msgspec.convert(table, VehicleFile), notes


def reported(found: Fit, base: VehicleFile) -> Iterator[str]:
    """Say what was found, beside what `base` says, and what a better record would need."""
    for axis, name in enumerate(AXES):
        if found.axes[axis]:
            yield _axis_words(found, parameters(base), axis)
        else:
            yield f"{name}: not measured, or it did not move: the base's numbers stay; {_needs(axis)}"
    for i, (value, sigma) in found.doubtful.items():
        yield (
            f"{'.'.join(model.KEYS[i])}: not known, found {value:.3g} with an sd of {sigma:.2g}, more than "
            f"half of it: the base's {parameters(base)[i]:.4g} stays, and the rest is fitted with it"
        )
    lag, start, delay = (1e3 * found.theta[i] for i in (model.LAG, model.START, model.DELAY))
    late_s, doubt_s = found.sum_of(model.LAG, model.START, model.DELAY)
    yield (
        f"thrust is late by {1e3 * late_s:.0f} ms from rest (sd {1e3 * doubt_s:.0f}): lag {lag:.0f}, "
        f"start {start:.0f}, delay {delay:.0f} ms, which are known together better than apart"
    )
    for i in (model.LATER, model.LEVEL_LATER):
        if found.sigma[i] > 0.0:
            yield f"{TIMES[i]}: {1e3 * found.theta[i]:.0f} ms (sd {1e3 * found.sigma[i]:.0f})"
    for name, theta in zip(found.tables, found.thetas, strict=True):
        pairs = [(axis, theta[model.BIAS + i]) for i, axis in enumerate(AXES) if found.axes[i]]
        text = ", ".join(f"{axis} {force:.2g} {'N m' if axis == 'yaw' else 'N'}" for axis, force in pairs)
        yield f"{Path(name).name}: constant force {text}"
    for i in sorted({*TIMES} & {*found.at_bound}):
        yield (
            f"the {TIMES[i]} ends at its bound: the times of commands and measurements do not fit together; "
            "what was found with them may be wrong by more than its sd"
        )
    if found.axes[2]:
        yield f"net buoyancy {-found.theta[model.WEIGHT]:.2f} N (sd {found.sigma[model.WEIGHT]:.2g})"
    if not found.tilt:
        yield (
            "roll and pitch: not identified; a better log moves their sticks; a manoeuvre needs a position, "
            "to push surge and sway"
        )


def _axis_words(found: Fit, before: Array, axis: int) -> str:
    if model.MASS + axis in found.doubtful:
        return f"{AXES[axis]}: its inertia is not known: the base's numbers stay; {_needs(axis)}"
    speed, unexplained, unit = found.speeds[axis], found.unexplained[axis], "rad/s" if axis == PSI else "m/s"
    drag, doubt = found.damping_at(axis)
    believed = before[model.LINEAR + axis] * speed + before[model.QUADRATIC + axis] * speed**2
    inertia, sigma = found.sum_of(model.MASS + axis)
    text = (
        f"{AXES[axis]}: inertia {inertia:.3g} (sd {sigma:.2g}, before {before[model.MASS + axis]:.3g}), "
        f"damping at {speed:.2f} {unit} {drag:.3g} (sd {doubt:.2g}, before {believed:.3g})"
    )
    if unexplained >= MAX_UNEXPLAINED:
        text += f"; {unexplained:.0%} of its change is not explained"
    elif not found.known(axis) or not found.apart(axis):
        text += f"; inertia and damping cannot be told apart well; {_needs(axis)}"
    elif found.manoeuvre and unexplained > CALM:
        text += (
            f"; {unexplained:.1%} of its change is not explained: waves and currents make inertia too large"
        )
    if not found.known(axis):
        left = f"the base leaves {found.unexplained_before[axis]:.1%} of its change"
        text += f"; taken all the same: {left}" if found.taken(axis) else "; the base's numbers stay"
    return text


def _needs(axis: int) -> str:
    if axis in (X, Y):
        return "surge and sway need a speed over ground, such as a DVL's, and a log that steers them"
    return (
        "heave and yaw need vehicle.steering_mode = manual and a calm place, and a log starts and stops them "
        "often, at several speeds"
    )


def _shared(axes: NDArray[np.bool_], *, manoeuvre: bool) -> list[int]:
    """Return which parameters of the vehicle are looked for."""
    shared = [
        i + axis
        for i in (model.MASS, model.LINEAR, model.QUADRATIC)
        for axis in np.flatnonzero(axes).tolist()
    ]
    if axes[[0, 1, 3]].all():
        shared.append(model.CORIOLIS)
    if axes[[1, 3]].all():
        shared.append(model.COUPLING)
    return [*shared, model.LAG, model.START, *model.times(axes), *([model.DEAD] if manoeuvre else [])]


def _starts(base: Array) -> Iterator[Array]:
    """Give parameters to begin with: slower and quicker than `base`, commands stamped late or not."""
    for size in START_SIZES:
        for delay_s in model.START_DELAYS_S:
            theta = base.copy()
            theta[model.MASS : model.MASS + 4] *= size
            theta[[model.LAG, model.START, model.DELAY]] = START_LAG_S, START_START_S, delay_s
            yield theta
