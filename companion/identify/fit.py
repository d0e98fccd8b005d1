"""The model of one degree of freedom that explains a recorded stretch best, with its doubt. No clock.

A prediction-error fit (Ljung, System Identification, 1999, ch. 7): a Kalman filter runs along the record on
the model, and the parameters are those for which its innovations are smallest. Nothing is differentiated. The
disturbance is a state of the filter, so a swell or a tether is not taken for mass or damping, and so is the
slow noise that an EKF's depth and rate carry.

    q' = v     m v' = f − d1 v − d2 |v| v − k q + b + d     T f' = u(t − D) − f
    d' = −d/T_d     s' = −s/T_n     p' = −p/T_n

| symbol | meaning                                                                    | unit             |
|--------|----------------------------------------------------------------------------|------------------|
| q, v   | position and rate, measured as q + L v + s and v + p                         | m, m/s; rad      |
| m      | inertia with added mass                                                    | kg; kg m²        |
| d1, d2 | linear and quadratic damping                                               | N/(m/s)..., N m  |
| k      | righting moment, of roll and pitch alone                                   | N·m/rad          |
| ℓ      | lever: the horizontal thrusters' part of u, of roll and pitch alone        | m                |
| b      | steady force; in heave the weight in water, less buoyancy                  | N; N·m           |
| u, f   | force asked of the thrusters by their curve, and given after their lag     | N; N·m           |
| t₀     | a motor at rest, or that reverses, gives thrust so much later              | s                |
| D, T   | delay from sending to the rate's stamp, and thrust lag                     | s                |
| L      | how much later than a position's stamp the rate's is                       | s                |
| g      | half-width of the thrusters' dead band, of the T200's curve alone          | µs               |
| d      | disturbance: σ_d and T_d are its deviation and correlation time            | N; N·m           |

All forces are those of T200 thrusters. Motion tells forces only in proportion to inertia, so thrusters that
are stronger by a factor make m, d1, d2 and b smaller by that factor: just what the control law needs.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from companion.config import Config
from companion.control.allocation import FACTORS, PER_NEWTON, T200_N, T200_PWM_US, T200_VOLTAGE_V
from companion.control.bounds import clamped
from companion.estimation.observer import Noise, stationary_covariance
from companion.identify.least_squares import Found, Residuals, least_squares
from companion.identify.manoeuvre import Measured, Stretch
from companion.records import PSI, Array, X, Y

NAMES: Final = (
    "mass",
    "linear_damping",
    "quadratic_damping",
    "steady_force",
    "lag_s",
    "delay_s",
    "dead_band_us",
    "rate_later_s",
    "start_s",
    "righting_nm",
    "lever_m",
)
MASS, LINEAR, QUADRATIC, STEADY, LAG, DELAY, DEAD, LATER, START, RIGHTING, LEVER = range(len(NAMES))
ROLL, PITCH = 4, 5
"""Behind the four degrees of freedom, those that are levelled."""

LEAST: Final = np.array((0.01, 0.0, 0.0, -200.0, 0.003, 0.0, 5.0, -0.03, 0.0, 0.0, -0.5))
MOST: Final = np.array((1000.0, 500.0, 5000.0, 200.0, 1.0, 0.3, 55.0, 0.03, 0.5, 300.0, 0.5))
STEPS: Final = (1e-3, 1e-3, 1e-3, 1e-2, 1e-4, 1e-4, 1e-2, 1e-4, 2e-3, 1e-2, 1e-4)
"""Small changes of each, for the slope."""
CURVES: Final = ("t200", "quadratic")
DEAD_BAND_US, DEAD_BAND_DOUBT_US = 28.0, 5.0
"""What is known of the dead band beforehand; the pushes lie outside of it most of the time."""
LAG_DOUBT_S, START_DOUBT_S = 0.2, 0.1
SIMILAR_LAG, SIMILAR_DEAD_BAND_US, SIMILAR_START_S, SIMILAR_SIGMAS = 0.05, 1.5, 0.01, 3.0
"""How far the thrusters of two axes may differ: share of the lag, µs, s, multiple of the fit's own doubt."""
SIMILAR_DELAY_S = 0.005
LATER_DOUBT_S = 0.005
"""How much later than positions the rates may be."""

SUBSTEPS = 4
"""So many parts of a tick the thrusters' lag is followed in."""

DISTURBANCE_TIME_S = 1.0
DISTURBANCES: Final = (0.003, 0.01, 0.03, 0.1, 0.3)
"""σ_d over mass that are tried, m/s² or rad/s²; the likelihood chooses."""

FULL_US, FULL_N = 400.0, 51.5
BURN_IN_S = 1.0
"""So much of the start tells where it was, not how it moves."""

TINY = 1e-9
CORRELATED_S = 2.0
"""Innovations may be correlated for so long."""
START_SCALES, START_LAGS_S, START_STARTS_S = (0.25, 0.5, 1.0, 2.0, 4.0), (0.02, 0.15), (0.0, 0.15)
SIGMA_ROUNDS = 3


class Known(NamedTuple):
    """What is known of the thrusters before a stretch is looked at, with its doubt."""

    lag_s: float
    lag_doubt_s: float
    dead_band_us: float
    dead_band_doubt_us: float
    start_s: float
    start_doubt_s: float
    delay_s: float = 0.03
    delay_doubt_s: float = math.inf
    """Infinite where the measurements come in other messages than those that told the delay."""


class Value(NamedTuple):
    """A number and its standard deviation."""

    value: float
    sigma: float


@dataclass(frozen=True)
class Fit:
    """What a stretch tells of its degree of freedom; `curve` is "t200" or "quadratic", 51.5 N u|u|."""

    dof: int
    curve: str
    values: tuple[Value, ...]
    """By NAMES."""
    damping_at: tuple[tuple[float, Value], ...]
    """Speeds of the stretch, and the force of the damping there, which is known better than its parts."""
    disturbance: float
    """σ_d, N or N·m."""
    misfit: float
    """Root mean square of the innovations over what the noise explains: near 1 where the model is right."""
    late_s: Value
    """Lag and delay together, which are known better than their parts."""
    score: float
    """Twice the logarithm of the likelihood, less a constant."""
    t_s: Array
    measured: Array
    """(n, 2) position and rate at t_s."""
    predicted: Array
    """(n, 2) by the model alone, from where it began, without corrections and disturbance."""


@dataclass(frozen=True)
class Record:
    """A stretch on one grid: times (n,), measured positions and rates (n,), NaN where nothing came."""

    dof: int
    t_s: Array
    position: Array
    rate: Array
    demands: Array
    """(n, motors) from each time on."""
    shares: Array
    """(motors,) force or moment for a newton of each."""
    beside: Array
    """(motors,) what a lever of a metre adds to that."""
    strength: Array
    """(n,) of the voltage."""


class Task(NamedTuple):
    """What is fitted: a record, the noise of its measurements, a thruster curve, and what is known before."""

    record: Record
    noise: Noise
    curve: str
    known: Known


def record_of(stretch: Stretch, frame: str) -> Record:
    """Put a stretch on the grid of its commands."""
    t_s = np.array([sample.t_s for sample in stretch.sent])
    axes = np.array([sample.axes for sample in stretch.sent])
    voltage = np.array([sample.voltage_v for sample in stretch.sent])
    factors = np.array(FACTORS[frame])
    position = _gridded(t_s, stretch.positions)
    if stretch.dof == PSI:
        position = _gridded(t_s, _unwrapped(stretch.positions))
    return Record(
        stretch.dof,
        t_s,
        position,
        _gridded(t_s, stretch.rates),
        np.clip(axes @ factors.T, -1.0, 1.0),
        factors[:, stretch.dof] * PER_NEWTON[stretch.dof],
        np.zeros(len(factors)),
        (voltage / T200_VOLTAGE_V) ** 2,
    )


def tilt_record_of(stretch: Stretch, frame: str, dof: int) -> Record:
    """Put roll or pitch of a stretch on the grid of its commands."""
    record, factors = record_of(stretch, frame), np.array(FACTORS[frame])
    pushed, sign = (Y, -1.0) if dof == ROLL else (X, 1.0)
    return replace(
        record,
        dof=dof,
        position=_gridded(
            record.t_s, [Measured(tilt.t_s, tilt.angles[dof - ROLL]) for tilt in stretch.tilts]
        ),
        rate=_gridded(record.t_s, [Measured(tilt.t_s, tilt.rates[dof - ROLL]) for tilt in stretch.tilts]),
        shares=factors[:, dof] * PER_NEWTON[dof],
        beside=sign * factors[:, pushed] * PER_NEWTON[pushed],
    )


def fit_tilts(stretches: Sequence[Stretch], config: Config, fits: Sequence[Fit]) -> list[Fit]:
    """Return fits of roll and pitch, from the stretches that push the vehicle sideways and ahead.

    Lag and delay are those of yaw among `fits`, which is measured by the same messages.
    """
    yaw = next((one for one in fits if one.dof == PSI), None)
    if yaw is None or not config.levels:
        return []
    known = similar(yaw)._replace(delay_s=yaw.values[DELAY].value, delay_doubt_s=SIMILAR_DELAY_S)
    tilts = []
    for dof, pushed, inertia in (
        (ROLL, Y, config.levelling.roll_inertia),
        (PITCH, X, config.levelling.pitch_inertia),
    ):
        for stretch in stretches:
            if stretch.dof == pushed:
                record = tilt_record_of(stretch, config.vehicle.frame, dof)
                task = Task(record, noise_of(config, PSI), yaw.curve, known)
                tilts.append(_fit(task, (inertia, inertia, inertia)))
    return tilts


def fit(stretches: Sequence[Stretch], config: Config) -> dict[str, list[Fit]]:
    """Return fits of the stretches by thruster curve, the curve that explains them better first.

    The heading is measured best, so its stretch comes first: the other axes have thrusters of the same kind,
    and begin with what it told of lag and dead band.
    """
    ordered = sorted(stretches, key=lambda stretch: stretch.dof != PSI)
    found = {curve: _fit_all(ordered, config, curve) for curve in CURVES}
    return dict(sorted(found.items(), key=lambda item: -sum(fit.score for fit in item[1])))


def _fit_all(stretches: Sequence[Stretch], config: Config, curve: str) -> list[Fit]:
    thrusters = config.thrusters
    known = Known(
        thrusters.lag_s, LAG_DOUBT_S, DEAD_BAND_US, DEAD_BAND_DOUBT_US, thrusters.start_s, START_DOUBT_S
    )
    fits = []
    for stretch in stretches:
        axis = config.axes[stretch.dof]
        start = (axis.mass, axis.linear_damping, axis.quadratic_damping)
        task = Task(record_of(stretch, config.vehicle.frame), noise_of(config, stretch.dof), curve, known)
        fits.append(_fit(task, start))
        if stretch.dof == PSI:
            known = similar(fits[-1])
    return sorted(fits, key=lambda fit: fit.dof)


def similar(fit: Fit) -> Known:
    """Return what is known of thrusters of the same kind."""
    lag, dead, start = (fit.values[number] for number in (LAG, DEAD, START))
    return Known(
        lag.value,
        max(SIMILAR_SIGMAS * lag.sigma, SIMILAR_LAG * lag.value, LEAST[LAG]),
        dead.value,
        max(SIMILAR_SIGMAS * dead.sigma, SIMILAR_DEAD_BAND_US),
        start.value,
        max(SIMILAR_SIGMAS * start.sigma, SIMILAR_START_S),
    )


def noise_of(config: Config, dof: int) -> Noise:
    """Return the noise of a degree of freedom's measurements."""
    axis = config.axes[dof]
    return Noise(
        axis.position_noise,
        axis.rate_noise,
        axis.position_noise_slow,
        axis.rate_noise_slow,
        axis.disturbance_noise,
        config.delays.slow_noise_s,
    )


def thrust(
    record: Record, dead_band_us: float, curve: str, start_s: float = 0.0, lever_m: float = 0.0
) -> Array:
    """Return the force (n,) that the running thrusters are asked for from each time on, N or N·m."""
    shares = record.shares + lever_m * record.beside
    pushes = _push(record.demands, dead_band_us, curve)
    if start_s > 0.0:
        pushes = pushes * _running(record.t_s, pushes, start_s)
    return np.asarray(record.strength * (pushes @ shares))


def _running(t_s: Array, pushes: Array, start_s: float) -> Array:
    """Return the share (n, motors) of each interval in which a motor runs: `start_s` after it was asked."""
    turns = np.sign(pushes)
    begins = turns != np.vstack((np.zeros_like(turns[:1]), turns[:-1]))
    since_s = t_s[np.maximum.accumulate(np.where(begins, np.arange(t_s.size)[:, None], 0), axis=0)]
    ends_s = np.append(t_s[1:], t_s[-1])[:, None]
    length_s = np.maximum(ends_s - t_s[:, None], TINY)
    return np.clip((ends_s - since_s - start_s) / length_s, 0.0, 1.0)


def _push(demands: Array, dead_band_us: float, curve: str) -> Array:
    if curve == "quadratic":
        return np.asarray(FULL_N * demands * np.abs(demands))
    offset_us = np.array(T200_PWM_US, float) - 1500.0
    offset_us[5], offset_us[6] = -dead_band_us, dead_band_us
    return np.asarray(np.interp(demands * FULL_US, offset_us, T200_N))


def _fit(task: Task, start: Sequence[float]) -> Fit:
    record, sigma = task.record, DISTURBANCES[2]
    theta = _start(task, start, sigma)
    theta, J, _ = _least(task, theta, sigma)
    for _ in range(SIGMA_ROUNDS):
        likeliest = max([(_score(task, theta, share), share) for share in DISTURBANCES])[1]
        if likeliest == sigma:
            break
        sigma = likeliest
        theta, J, _ = _least(task, theta, sigma)
    gain = _gain(task, theta, sigma)
    innovations = _filtered(task, theta, gain).innovations @ gain.whiten.T
    whitened = innovations[after_burn_in(record)]
    covariance = parameter_covariance(record, J, innovations)
    deviations = np.zeros(len(NAMES))
    deviations[_free(task)] = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    damping, doubt = theta[LINEAR : QUADRATIC + 1], covariance[LINEAR : QUADRATIC + 1, LINEAR : QUADRATIC + 1]
    at = []
    for speed in np.nanquantile(np.abs(record.rate), (0.5, 0.95)).tolist():
        powers = np.array((speed, speed**2))
        at.append(
            (speed, Value(float(powers @ damping), math.sqrt(max(float(powers @ doubt @ powers), 0.0))))
        )
    alone = _filtered(task, theta, gain._replace(K=np.zeros_like(gain.K)))
    return Fit(
        dof=record.dof,
        curve=task.curve,
        values=tuple(Value(*pair) for pair in zip(theta.tolist(), deviations.tolist(), strict=True)),
        damping_at=tuple(at),
        disturbance=sigma * float(theta[MASS]),
        misfit=math.sqrt(float(np.mean(whitened**2))),
        late_s=Value(float(theta[LAG] + theta[DELAY]), _sigma(covariance, (LAG, DELAY))),
        score=_score(task, theta, sigma),
        t_s=record.t_s,
        measured=np.column_stack((record.position, record.rate)),
        predicted=alone.predicted,
    )


def parameter_covariance(record: Record, J: Array, whitened: Array) -> Array:
    """Return the parameters' covariance: correlated innovations (n, 2) tell less than independent ones.

    `_spread` takes the correlation from sample to sample. A longer correlation, such as a wave that the
    disturbance's model does not foresee, shows in the gradient: its sums over CORRELATED_S vary more than
    those of white innovations do (Newey and West, Econometrica, 1987). The larger of the two counts.
    """
    n, counting = len(whitened), after_burn_in(record)
    inverse = np.linalg.pinv(J.T @ J, hermitian=True)
    covariance = max(map(_spread, whitened[counting].T)) * inverse
    counted = np.where(counting[:, None], whitened, 0.0)
    gradient = np.einsum("nij,ni->nj", J[: 2 * n].reshape(n, 2, -1), counted)
    sums = np.vstack((np.zeros_like(gradient[:1]), np.cumsum(gradient, axis=0)))
    length = max(1, round(CORRELATED_S / float(np.median(np.diff(record.t_s)))))
    padded = np.pad(sums, ((length, length), (0, 0)), mode="edge")
    blocks = padded[length:] - padded[:-length]
    wide = inverse @ (blocks.T @ blocks / length + J[2 * n :].T @ J[2 * n :]) @ inverse
    ratio = np.sqrt(np.maximum(np.diag(wide) / np.maximum(np.diag(covariance), TINY), 1.0))
    return np.asarray(covariance * np.outer(ratio, ratio))


def _sigma(covariance: Array, together: Sequence[int]) -> float:
    """Return the standard deviation of a sum of parameters."""
    return math.sqrt(max(float(covariance[np.ix_(together, together)].sum()), 0.0))


def after_burn_in(record: Record) -> NDArray[np.bool_]:
    """Return where the record tells how the vehicle moves (n,)."""
    return np.asarray(record.t_s - record.t_s[0] >= BURN_IN_S)


def _free(task: Task) -> list[int]:
    """Return which parameters are looked for."""
    return [*range(len(NAMES) if task.record.dof in (ROLL, PITCH) else RIGHTING)]


def _start(task: Task, nominal: Sequence[float], sigma: float) -> Array:
    """Return the parameters to begin with: the nominal vehicle, or a stronger, weaker or quicker one."""
    known, starts = task.known, []
    lags_s, starts_s = {known.lag_s, *START_LAGS_S}, {known.start_s, *START_STARTS_S}
    if math.isfinite(known.delay_doubt_s):
        lags_s, starts_s = {known.lag_s}, {known.start_s}
    for scale, lag_s, start_s in product(START_SCALES, lags_s, starts_s):
        model = [scale * parameter for parameter in nominal]
        others = (0.0, lag_s, known.delay_s, known.dead_band_us, 0.0, start_s, 0.0, 0.0)
        starts.append(np.clip((*model, *others), LEAST, MOST))
    scores = [_score(task, theta, sigma) for theta in starts]
    return starts[int(np.argmax(scores))]


def _least(task: Task, theta: Array, sigma: float) -> Found:
    """Return parameters and Jacobian where the residuals are smallest."""

    def residuals_at(theta: Array) -> Residuals:
        return partial(_residuals, task, gain=_gain(task, theta, sigma))

    def bounds_at(theta: Array) -> tuple[Array, Array]:
        least, most = LEAST.copy(), MOST.copy()
        least[MASS], most[MASS] = max(least[MASS], 0.5 * theta[MASS]), min(most[MASS], 2.0 * theta[MASS])
        return least, most

    steps = np.array(STEPS)
    steps[:STEADY] *= np.maximum(1.0, np.abs(theta[:STEADY]))
    return least_squares(residuals_at, theta, _free(task), steps, bounds_at)


class Gain(NamedTuple):
    """The filter: gain (5, 2) of q, v, d, s, p, and what whitens the innovations of position and rate."""

    K: Array
    whiten: Array
    log_determinant: float


def _gain(task: Task, theta: Array, sigma: float) -> Gain:
    record, noise = task.record, task.noise
    h, m = float(np.median(np.diff(record.t_s))), float(theta[MASS])
    typical = float(np.nanmean(np.abs(record.rate)))
    c = float(theta[LINEAR] + 2.0 * theta[QUADRATIC] * typical)
    A = np.zeros((5, 5))
    A[0, 0], A[0, 1] = 1.0, h
    A[1, 1], A[1, 2] = m / (m + h * c), h / (m + h * c)
    A[1, 0] = -float(theta[RIGHTING]) * A[1, 2]
    A[2, 2] = math.exp(-h / DISTURBANCE_TIME_S)
    A[3, 3] = A[4, 4] = math.exp(-h / noise.slow_time_s)
    slow = 2.0 * h / noise.slow_time_s
    Q = np.diag(
        (
            1e-9 * h,
            1e-9 * h,
            (sigma * m) ** 2 * 2.0 * h / DISTURBANCE_TIME_S,
            noise.position_slow**2 * slow,
            noise.rate_slow**2 * slow,
        )
    )
    R = np.diag((noise.position**2, noise.rate**2))
    C = np.zeros((2, 5))
    C[0, 0] = C[0, 3] = C[1, 1] = C[1, 4] = 1.0
    P = stationary_covariance(A, C, Q, R)
    S = C @ P @ C.T + R
    return Gain(
        P @ C.T @ np.linalg.inv(S), np.linalg.inv(np.linalg.cholesky(S)), float(np.linalg.slogdet(S)[1])
    )


class Run(NamedTuple):
    """Innovations (n, 2), and what was predicted of position and rate (n, 2)."""

    innovations: Array
    predicted: Array


def _residuals(task: Task, theta: Array, gain: Gain) -> Array:
    """Return the whitened innovations, and how far lag, dead band and lateness are from what is known."""
    run = _filtered(task, theta, gain)
    whitened = run.innovations @ gain.whiten.T
    whitened[~after_burn_in(task.record)] = 0.0
    beforehand = (
        (theta[LAG] - task.known.lag_s) / task.known.lag_doubt_s,
        (theta[DEAD] - task.known.dead_band_us) / task.known.dead_band_doubt_us,
        theta[LATER] / LATER_DOUBT_S,
        (theta[START] - task.known.start_s) / task.known.start_doubt_s,
        (theta[DELAY] - task.known.delay_s) / task.known.delay_doubt_s,
    )
    return np.concatenate((whitened.ravel(), beforehand))


def _score(task: Task, theta: Array, sigma: float) -> float:
    gain = _gain(task, theta, sigma)
    r = _residuals(task, theta, gain)
    return -float(r @ r) - gain.log_determinant * np.count_nonzero(after_burn_in(task.record))


def _spread(innovations: Array) -> float:
    """Return by what the parameters' variance exceeds that for white innovations of variance 1.

    Samples that a stream's interpolation correlated count less: first-order correlation.
    """
    variance = float(np.mean(innovations**2))
    if not variance > 0.0:
        return 0.0
    correlation = clamped(float(np.mean(innovations[1:] * innovations[:-1])) / variance, 0.0, 0.95)
    return variance * (1.0 + correlation) / (1.0 - correlation)


def _filtered(task: Task, theta: Array, gain: Gain) -> Run:
    record, noise = task.record, task.noise
    m, d1, d2, b, lag_s, delay_s, dead, later_s, start_s, k, lever_m = theta.tolist()
    asked = thrust(record, dead, task.curve, start_s, lever_m)
    force = _acting(record.t_s, asked, delay_s, lag_s).tolist()
    dt_s = np.diff(record.t_s)
    steps = list(
        zip(
            dt_s.tolist(),
            record.position[1:].tolist(),
            record.rate[1:].tolist(),
            force,
            strict=True,
        )
    )
    h_typical = float(np.median(dt_s))
    calm, slow = math.exp(-h_typical / DISTURBANCE_TIME_S), math.exp(-h_typical / noise.slow_time_s)
    (q_q, q_v), (v_q, v_v), (d_q, d_v), (s_q, s_v), (p_q, p_v) = gain.K.tolist()
    q, v = _first(record.position), _first(record.rate)
    d = s = p = 0.0
    innovations, predicted = [(0.0, 0.0)], [(q, v)]
    for h, y_q, y_v, f in steps:
        half = 0.5 * h * d1
        v_1 = ((m - half) * v + h * (f + b + d - k * q)) / (m + half + h * d2 * abs(v))
        q += 0.5 * h * (v + v_1)
        v = v_1
        shown = q + later_s * v
        d *= calm
        s *= slow
        p *= slow
        e_q, e_v = y_q - shown - s, y_v - v - p
        if e_q != e_q:
            e_q = 0.0
        if e_v != e_v:
            e_v = 0.0
        innovations.append((e_q, e_v))
        predicted.append((shown + s, v + p))
        q += q_q * e_q + q_v * e_v
        v += v_q * e_q + v_v * e_v
        d += d_q * e_q + d_v * e_v
        s += s_q * e_q + s_v * e_v
        p += p_q * e_q + p_v * e_v
    return Run(np.array(innovations), np.array(predicted))


def _acting(t_s: Array, asked: Array, delay_s: float, lag_s: float) -> Array:
    """Return the mean force (n - 1,) that acts in each step: `asked` from each time on, then delay and lag.

    The lag is followed in SUBSTEPS of a step: a command arrives within a step, and half a step is as long as
    some delays.
    """
    dt_s = np.repeat(np.diff(t_s) / SUBSTEPS, SUBSTEPS)
    fine_s = t_s[0] + np.concatenate(((0.0,), np.cumsum(dt_s)))
    impulse = np.concatenate(((0.0,), np.cumsum(asked[:-1] * np.diff(t_s))))
    at_s = fine_s - delay_s
    impulses = np.interp(at_s, t_s, impulse) + asked[0] * np.minimum(at_s - t_s[0], 0.0)
    means = (np.diff(impulses) / dt_s).tolist()
    keeps = np.exp(-dt_s / lag_s).tolist()
    f = means[0]
    acting = [f]
    for u, keep in zip(means, keeps, strict=True):
        f = u + (f - u) * keep
        acting.append(f)
    nodes = np.array(acting)
    return np.asarray((0.5 * (nodes[1:] + nodes[:-1])).reshape(-1, SUBSTEPS).mean(axis=1))


def _gridded(t_s: Array, measured: Sequence[Measured]) -> Array:
    """Return samples interpolated to the grid (n,), NaN where none came within a step of it.

    A cubic through neighbouring samples (Catmull, Rom): a chord would cut the corners of the pushes.
    """
    if len(measured) < 2:
        return np.full(t_s.size, np.nan)
    times, values = np.array(sorted(measured)).T
    step_s = float(np.median(np.diff(t_s)))
    i = np.clip(np.searchsorted(times, t_s) - 1, 0, times.size - 2)
    gap_s = np.maximum(np.diff(times), TINY)[i]
    previous, following = (
        np.maximum(np.arange(times.size) - 1, 0),
        np.minimum(np.arange(times.size) + 1, times.size - 1),
    )
    slopes = (values[following] - values[previous]) / np.maximum(times[following] - times[previous], TINY)
    x = (t_s - times[i]) / gap_s
    rise = values[i + 1] - values[i]
    bends = (1.0 - x) * (slopes[i] * gap_s - rise) - x * (slopes[i + 1] * gap_s - rise)
    on_grid = values[i] + x * rise + x * (1.0 - x) * bends
    fresh = np.searchsorted(times, t_s) > np.searchsorted(times, t_s - max(step_s, TINY))
    within = (times[0] <= t_s) & (t_s <= times[-1])
    return np.where(within & fresh & (gap_s < 0.5), on_grid, np.nan)


def _unwrapped(measured: Sequence[Measured]) -> list[Measured]:
    values = np.unwrap([sample.value for sample in measured]).tolist()
    return [Measured(sample.t_s, value) for sample, value in zip(measured, values, strict=True)]


def _first(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(known[0]) if known.size else 0.0
