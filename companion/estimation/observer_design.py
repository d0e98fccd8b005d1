"""Kalman gains of the observers, made at start-up: the Riccati equation.

`companion.core.observer` is the filter; its table of symbols holds here.
"""

import functools
import math
from typing import NamedTuple

import numpy as np

from companion.config import ConfigError
from companion.core.observer import ObserverParameters, ObserverState, ObserverTable
from companion.records import Array
from companion.steps import Steps, finish

DOUBLINGS = 40
LEAST_LAG_S = 0.02
"""Shortest thruster lag of a table."""


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


@functools.lru_cache(maxsize=2048)
def observer_parameters(
    m: float, c: float, thrust_lag_s: float, noise: Noise, dt_s: float, interval: int = 1
) -> ObserverParameters:
    """Return the parameters for inertia `m`, drag `c` and a measurement of each kind every `interval` ticks.

    A tick takes `dt_s`.

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


@functools.lru_cache(maxsize=128)
def observer_table(
    m: float,
    c: float,
    thrust_lag_s: float,
    noise: Noise,
    dt_s: float,
    most_log_gain: float,
    most_lag_s: float,
    interval: int = 1,
) -> ObserverTable:
    """Return the parameters for inertia `m`, drag `c` and vehicles unlike it, with it in the middle.

    Raises ConfigError as `observer_parameters` does.
    """
    return finish(table_in_steps(m, c, thrust_lag_s, noise, dt_s, most_log_gain, most_lag_s, interval))


def table_in_steps(
    m: float,
    c: float,
    thrust_lag_s: float,
    noise: Noise,
    dt_s: float,
    most_log_gain: float,
    most_lag_s: float,
    interval: int,
) -> Steps[ObserverTable]:
    """Return the same; whoever asks `observer_table` for it then does not wait."""
    least_s, most_s = min(LEAST_LAG_S, thrust_lag_s), max(most_lag_s, 2.0 * thrust_lag_s)
    lags_s = (
        least_s,
        0.5 * (least_s + thrust_lag_s),
        thrust_lag_s,
        0.5 * (thrust_lag_s + most_s),
        most_s,
    )
    half = 0.5 * most_log_gain
    log_gains = (-most_log_gain, -half, 0.0, half, most_log_gain)
    rows = []
    for log_gain in log_gains:
        g = math.exp(log_gain)
        for lag_s in lags_s:
            found = observer_parameters(m / g, c / g, lag_s, noise, dt_s, interval)
            rows.append((*found.by_position, *found.by_rate))
            yield 16
    return ObserverTable(log_gains, lags_s, noise.slow_time_s, tuple(rows))


def _stationary_gain(
    m: np.float64, c: np.float64, lag_s: float, noise: Noise, dt_s: float, interval: int
) -> Array:
    """Return the Kalman gain (6, 2) to which the Riccati recursion settles (Simon 2006, ch. 7.3)."""
    A = np.zeros((6, 6))
    A[0, 0] = A[3, 3] = 1.0
    A[0, 1] = dt_s
    A[1, 1] = m / (m + dt_s * c)
    A[1, 2] = dt_s / (m + dt_s * c)
    A[1, 3] = -dt_s / (m + dt_s * c)
    A[2, 2] = np.exp(-dt_s / lag_s)
    A[4, 4] = A[5, 5] = np.exp(-dt_s / noise.slow_time_s)
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
    C = np.zeros((2, 6))
    C[0, 0] = C[0, 4] = C[1, 1] = C[1, 5] = 1.0
    between, added = A, Q
    for _ in range(interval - 1):
        between, added = A @ between, A @ added @ A.T + Q
    P = stationary_covariance(between, C, added, R)
    return P @ C.T @ np.linalg.inv(C @ P @ C.T + R)


def stationary_covariance(A: Array, C: Array, Q: Array, R: Array) -> Array:
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
