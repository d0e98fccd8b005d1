"""Kalman gains of the observers, made at start-up: the Riccati equation.

`companion.core.observer` is the filter; its table of symbols holds here.
"""

import functools
import math
from itertools import product
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from companion.arrays import Array
from companion.config import Config, ConfigError
from companion.core.model_learner import Tables
from companion.core.observer import INTERVALS, FiveNodes, ObserverParameters, ObserverState, ObserverTable
from companion.core.positioning import Model
from companion.core.vehicle_model import DISTURBANCE_RATIO, LEAST_LAG_S, MOST_LAG_S, MOST_LOG_GAIN
from companion.records import Z, vector
from companion.steps import Steps

DOUBLINGS = 40
"""2^40 ticks: the recursion has settled long before."""

TYPICAL_RATE = 0.1
"""m/s, rad/s: the rate at which the drag is taken for the Kalman gain."""

QUIET_N = 1.0
"""Disturbance noise, N/√s, of the observer that looks for hidden delay: it leans on the model."""


MEASURED: Array = np.array(((1.0, 0.0, 0.0, 0.0, 1.0, 0.0), (0.0, 1.0, 0.0, 0.0, 0.0, 1.0)))
"""Position and rate of the observer's state, with their slow noise."""


class Noise(NamedTuple):
    """Standard deviations from which the Kalman gain is computed.

    `position`, `rate`: white noise of one sample; `position_slow`, `rate_slow`: noise of `slow_time_s`
    correlation; `disturbance`: random walk of d, N/√s or N·m/√s.
    """

    position: float
    rate: float
    position_slow: float
    rate_slow: float
    disturbance: float
    slow_time_s: float


def noise_of(config: Config) -> tuple[float, float]:
    """Return the white noise of depth (m) and heading (rad)."""
    return config.heave.position_noise, config.yaw.position_noise


def with_noise(config: Config, depth: float, heading: float) -> Config:
    """Return the configuration with other white noise of depth (m) and heading (rad)."""
    heave, yaw = config.heave, config.yaw
    return replace(
        config, heave=replace(heave, position_noise=depth), yaw=replace(yaw, position_noise=heading)
    )


class DesignVehicle(NamedTuple):
    """A nominal degree of freedom and its sensors: inertia, drag, thruster lag (s), noise, tick (s)."""

    m: float
    c: float
    lag_s: float
    noise: Noise
    dt_s: float

    def like(self, log_gain: float, lag_s: float, interval: int) -> ObserverParameters:
        """Return the parameters for a vehicle of other gain and lag."""
        g = math.exp(log_gain)
        return observer_parameters(self.m / g, self.c / g, lag_s, self.noise, self.dt_s, interval)

    def nodes(self) -> tuple[FiveNodes, FiveNodes]:
        """Return log gains and lags (s) of the table; the nominal vehicle stands in the middle."""
        least_s, most_s = min(LEAST_LAG_S, self.lag_s), max(MOST_LAG_S, 2.0 * self.lag_s)
        half = 0.5 * MOST_LOG_GAIN
        return (
            (-MOST_LOG_GAIN, -half, 0.0, half, MOST_LOG_GAIN),
            (least_s, 0.5 * (least_s + self.lag_s), self.lag_s, 0.5 * (self.lag_s + most_s), most_s),
        )


def vehicle(config: Config, model: Model, dof: int, disturbance: float) -> DesignVehicle:
    """Return a degree of freedom that expects this `disturbance` noise."""
    axis = config.axes[dof]
    noise = Noise(
        position=axis.position_noise,
        rate=axis.rate_noise,
        position_slow=axis.position_noise_slow,
        rate_slow=axis.rate_noise_slow,
        disturbance=disturbance,
        slow_time_s=config.delays.slow_noise_s,
    )
    drag = model.d1[dof] + TYPICAL_RATE * model.d2[dof]
    return DesignVehicle(model.m[dof], drag, config.thrusters.lag_s, noise, 1.0 / config.loop.rate_hz)


def hidden_delay_parameters(config: Config, model: Model) -> ObserverParameters:
    """Return the parameters of the observer that looks for hidden delay."""
    return vehicle(config, model, Z, QUIET_N).like(0.0, config.thrusters.lag_s, 1)


def model_tables(config: Config, model: Model) -> list[Tables]:
    """Return the observers of each degree of freedom, by gain and lag."""
    return [
        Tables(control=vector([_table(known, interval) for interval in INTERVALS]), here=_table(here, 1))
        for known, here in (_vehicles(config, model, dof) for dof in range(len(config.axes)))
    ]


def tables_in_steps(config: Config, model: Model, dof: int) -> Steps[None]:
    """Compute a degree of freedom's observers; `model_tables` then takes no time."""
    known, here = _vehicles(config, model, dof)
    for one, interval in ((here, 1), *((known, interval) for interval in INTERVALS)):
        log_gains, lags_s = one.nodes()
        for log_gain, lag_s in product(log_gains, lags_s):
            one.like(log_gain, lag_s, interval)
            yield 16
        _table(one, interval)
        yield 16


def _vehicles(config: Config, model: Model, dof: int) -> tuple[DesignVehicle, DesignVehicle]:
    """Return a degree of freedom as control takes it, and as the search for its gain and lag does."""
    noise = config.axes[dof].disturbance_noise
    return vehicle(config, model, dof, noise), vehicle(config, model, dof, DISTURBANCE_RATIO[dof] * noise)


@functools.lru_cache(maxsize=128)
def _table(known: DesignVehicle, interval: int) -> ObserverTable:
    log_gains, lags_s = known.nodes()
    found = (known.like(log_gain, lag_s, interval) for log_gain, lag_s in product(log_gains, lags_s))
    rows = tuple((*one.by_position, *one.by_rate) for one in found)
    return ObserverTable(log_gains, lags_s, known.noise.slow_time_s, rows)


@functools.lru_cache(maxsize=2048)
def observer_parameters(
    m: float, c: float, thrust_lag_s: float, noise: Noise, dt_s: float, interval: int = 1
) -> ObserverParameters:
    """Return the parameters for inertia `m`, drag `c` and a measurement of each kind every `interval` ticks.

    Raises ConfigError where no finite gain follows: no estimate would be finite from then on.
    """
    try:
        with np.errstate(all="ignore"):
            gain = _stationary_gain(
                np.float64(m), np.float64(c), thrust_lag_s, Noise(*np.array(noise)), dt_s, interval
            )
    except np.linalg.LinAlgError:
        gain = np.full((6, 2), np.nan)
    if not np.isfinite(gain).all():
        raise ConfigError(
            "the observer: no finite Kalman gain follows from these noises, mass and damping: "
            f"position {noise.position:g}, rate {noise.rate:g}, disturbance {noise.disturbance:g}, "
            f"mass {m:g}, damping {c:g}"
        )
    by_position, by_rate = (ObserverState(*column) for column in gain.T.tolist())
    return ObserverParameters(thrust_lag_s, noise.slow_time_s, by_position, by_rate)


def disturbance_lag_s(config: Config, model: Model, dof: int) -> float:
    """Return by how much the nominal vehicle's estimate of a disturbance that rises steadily is late, s."""
    known = vehicle(config, model, dof, config.axes[dof].disturbance_noise)
    gains = known.like(0.0, known.lag_s, 1)
    A = _transition(known.m, known.c, known.lag_s, known.noise.slow_time_s, known.dt_s)
    keeps = np.eye(6) - np.array((gains.by_position, gains.by_rate)).T @ MEASURED
    rises = known.dt_s * np.eye(6)[3]
    return float(np.linalg.solve(np.eye(6) - keeps @ A, keeps @ rises)[3])


def _transition(m: float, c: float, lag_s: float, slow_time_s: float, dt_s: float) -> Array:
    """Return what a tick makes of the observer's state (6, 6)."""
    A: Array = np.eye(6)
    A[0, 1] = dt_s
    A[1, 1:4] = np.array([m, dt_s, -dt_s]) / (m + dt_s * c)
    A[2, 2] = np.exp(-dt_s / lag_s)
    A[4, 4] = A[5, 5] = np.exp(-dt_s / slow_time_s)
    return A


def _stationary_gain(
    m: np.float64, c: np.float64, lag_s: float, noise: Noise, dt_s: float, interval: int
) -> Array:
    """Return the Kalman gain (6, 2) to which the Riccati recursion settles (Simon 2006, ch. 7.3)."""
    A = _transition(m, c, lag_s, noise.slow_time_s, dt_s)
    slow = 2.0 * dt_s / noise.slow_time_s
    Q = np.diag(
        (
            1e-9 * dt_s,
            (0.002 * noise.disturbance / m) ** 2 * dt_s + 1e-9 * dt_s,
            (0.05 * noise.disturbance) ** 2 * dt_s,
            noise.disturbance**2 * dt_s,
            noise.position_slow**2 * slow,
            noise.rate_slow**2 * slow,
        )
    )
    R = np.diag((noise.position**2, noise.rate**2))
    C = MEASURED
    between, added = A, Q
    for _ in range(interval - 1):
        between, added = A @ between, A @ added @ A.T + Q
    P = _stationary_covariance(between, C, added, R)
    return P @ C.T @ np.linalg.inv(C @ P @ C.T + R)


def _stationary_covariance(A: Array, C: Array, Q: Array, R: Array) -> Array:
    """Return the covariance P (n, n) of the prediction to which the Riccati recursion settles.

    P doubles its horizon with each step: 2^n samples after n (Chu, Fan, Lin 2004, the algorithm SDA).
    """
    identity = np.eye(len(A))
    reach, information, P = A.T, C.T @ np.linalg.solve(R, C), Q
    for _ in range(DOUBLINGS):
        shrunk = np.linalg.inv(identity + information @ P)
        growth = reach.T @ P @ shrunk @ reach
        information = information + reach @ shrunk @ information @ reach.T
        reach = reach @ shrunk @ reach
        P = P + growth
        if np.abs(growth).max() <= 1e-12 * np.abs(P).max():
            break
    return P
