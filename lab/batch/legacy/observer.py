"""The delay-compensating observer: position, rate, thrust and disturbance of every degree of freedom.

Each lives in the past, at the moment its newest measurement was true, runs there on the commands that were
then in force, and predicts forward through the commands on their way. A stationary Kalman filter per DOF on

    q' = v      v' = (f − c v − d)/m      f' = (u − f)/T      d' = 0      s' = −s/T_n      p' = −p/T_n

measured as q + s and v + p, where s and p are the slow noise that an EKF's depth and climb carry.

| symbol | meaning                                   | unit          | source                       |
|--------|-------------------------------------------|---------------|------------------------------|
| q, v   | position and rate (NED, heading)          | m, m/s; rad   |                              |
| f, u   | thrust now, thrust commanded (NED)        | N; N·m        | first-order lag T            |
| m, c   | inertia, drag coefficient at present rate | kg, N/(m/s)   | positioning.Model            |
| d      | disturbance, the paper's sign             | N; N·m        | eq. rov: m ẍ = τ − k − h − d |
| s, p   | slow noise of position and rate           | m, m/s; rad   | paper.md, measured telemetry |
"""

from dataclasses import dataclass

import numpy as np

from companion.config import ConfigError
from lab.batch.legacy.records import Array

DOUBLINGS = 40


@dataclass(frozen=True, slots=True)
class Noise:
    """Standard deviations, each (4,): what the Kalman gains are computed from.

    `position`, `rate`: white noise of one sample; `position_slow`, `rate_slow`: noise of `slow_time_s`
    correlation; `disturbance`: random walk of d, N/√s or N·m/√s.
    """

    position: Array
    rate: Array
    position_slow: Array
    rate_slow: Array
    disturbance: Array
    slow_time_s: float

    def of(self, dof: int, disturbance: float) -> "Noise":
        """Return one degree of freedom's, (1,) each, with another noise of the disturbance."""
        one = slice(dof, dof + 1)
        return Noise(
            self.position[one],
            self.rate[one],
            self.position_slow[one],
            self.rate_slow[one],
            np.array([disturbance]),
            self.slow_time_s,
        )


class Observer:
    """Six states for each of (…, 4) degrees of freedom; time and commands are handed in."""

    def __init__(self, m: Array, c: Array, thrust_lag_s: float, noise: Noise, dt_s: float) -> None:
        """Compute gains for inertia `m`, drag `c` (4,) and one measurement of each kind every `dt_s`."""
        self._lag_s = thrust_lag_s
        self._slow_time_s = noise.slow_time_s
        self._gain = _stationary_gain(m, c, thrust_lag_s, noise, dt_s)
        self.x = np.zeros((*m.shape, 6))

    def start(self, dof: int, position: float) -> None:
        """Begin one degree of freedom anew at a known place, knowing nothing else of it."""
        self.x[..., dof, :] = 0.0
        self.x[..., dof, 0] = position

    def advance(self, u: Array, m: Array, c: Array, dt_s: Array | float) -> None:
        """Run the model for `dt_s`, one or (…, 4), under commanded thrust `u`."""
        _, (self.x[..., 0], self.x[..., 1], self.x[..., 2]) = self.predict(u[None], m, c, dt_s)
        self.x[..., 4:6] *= np.exp(np.asarray(dt_s) / -self._slow_time_s)[..., None]

    def correct(self, innovation: Array) -> None:
        """Take in `innovation` (…, 4, 2): measured minus expected position and rate; zero where none came."""
        self.x = self.x + np.matvec(self._gain, innovation)

    @property
    def expected(self) -> Array:
        """What the sensors should show at the observer's time, (…, 4, 2)."""
        return self.x[..., 0:2] + self.x[..., 4:6]

    def rates(self, m: Array, c: Array) -> Array:
        """Return q' and v' at the observer's time, (…, 4, 2)."""
        rates = self.x[..., 1:3].copy()
        rates[..., 1] = (self.x[..., 2] - c * self.x[..., 1] - self.x[..., 3]) / m
        return rates

    @property
    def disturbance(self) -> Array:
        """Return d, (…, 4)."""
        return self.x[..., 3].copy()

    def predict(
        self, u: Array, m: Array, c: Array, dt_s: Array | float, d: Array | None = None
    ) -> list[tuple[Array, Array, Array]]:
        """Return q, v and f, (…, 4) each, at the start and after each of `u` (steps, …, 4).

        A step of `dt_s`, one or (…, 4), is exact in the thrust lag, implicit in the drag, trapezoidal in
        position. `d` takes the place of the estimated disturbance.
        """
        q, v, f = self.x[..., 0], self.x[..., 1], self.x[..., 2]
        d = self.x[..., 3] if d is None else d
        keep = np.exp(dt_s / -self._lag_s)
        half_s = 0.5 * dt_s
        push = half_s / (m + dt_s * c)
        coast = m / (m + dt_s * c)
        drift = 2.0 * d
        way = [(q.copy(), v.copy(), f)]
        for u_i in u:
            f_next = u_i + (f - u_i) * keep
            v_next = coast * v + push * (f + f_next - drift)
            q = q + half_s * (v + v_next)
            v, f = v_next, f_next
            way.append((q, v, f))
        return way


def _stationary_gain(m: Array, c: Array, lag_s: float, noise: Noise, dt_s: float) -> Array:
    """Return the Kalman gain (4, 6, 2) of `_riccati`.

    Raises ConfigError where it is not finite: no estimate would be from then on.
    """
    try:
        with np.errstate(all="ignore"):
            gain = _riccati(m, c, lag_s, noise, dt_s)
    except np.linalg.LinAlgError:
        gain = np.full((1, 1, 1), np.nan)
    if not np.isfinite(gain).all():
        raise ConfigError(
            "the observer: no finite Kalman gain follows from these noises, masses and damping: "
            f"position {noise.position}, rate {noise.rate}, disturbance {noise.disturbance}, mass {m}"
        )
    return gain


def _riccati(m: Array, c: Array, lag_s: float, noise: Noise, dt_s: float) -> Array:
    """Return the Kalman gain (4, 6, 2) to which the Riccati recursion settles (Simon 2006, ch. 7.3); 1 ms."""
    A = np.zeros((len(m), 6, 6))
    A[:, 0, 0] = A[:, 3, 3] = 1.0
    A[:, 0, 1] = dt_s
    A[:, 1, 1] = m / (m + dt_s * c)
    A[:, 1, 2] = dt_s / (m + dt_s * c)
    A[:, 1, 3] = -dt_s / (m + dt_s * c)
    A[:, 2, 2] = np.exp(-dt_s / lag_s)
    A[:, 4, 4] = A[:, 5, 5] = np.exp(-dt_s / noise.slow_time_s)
    slow = 2.0 * dt_s / noise.slow_time_s
    Q = np.zeros_like(A)
    Q[:, 0, 0] = 1e-9 * dt_s
    Q[:, 1, 1] = (0.002 * noise.disturbance / m) ** 2 * dt_s + 1e-9 * dt_s
    Q[:, 2, 2] = (0.05 * noise.disturbance) ** 2 * dt_s
    Q[:, 3, 3] = noise.disturbance**2 * dt_s
    Q[:, 4, 4] = noise.position_slow**2 * slow
    Q[:, 5, 5] = noise.rate_slow**2 * slow
    R = np.zeros((len(m), 2, 2))
    R[:, 0, 0], R[:, 1, 1] = noise.position**2, noise.rate**2
    C = np.zeros((len(m), 2, 6))
    C[:, 0, 0] = C[:, 0, 4] = C[:, 1, 1] = C[:, 1, 5] = 1.0
    # P doubles its horizon with each step: 2^n samples after n (Chu, Fan, Lin 2004, the algorithm SDA).
    Ct = C.swapaxes(1, 2)
    reach, doubt, P = A.swapaxes(1, 2), Ct @ np.linalg.solve(R, C), Q
    for _ in range(DOUBLINGS):
        turned = np.linalg.inv(np.eye(6) + doubt @ P)
        step = reach.swapaxes(1, 2) @ P @ turned @ reach
        doubt = doubt + reach @ turned @ doubt @ reach.swapaxes(1, 2)
        reach = reach @ turned @ reach
        P = P + step
        if np.abs(step).max() <= 1e-12 * np.abs(P).max():
            break
    return P @ Ct @ np.linalg.inv(C @ P @ Ct + R)
