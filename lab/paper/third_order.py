"""The n-th order law on a system that is no ROV: an iron ball held under an electromagnet, n = 3.

    m ẍ = m g − C i²/x²        gap x below the magnet, positive down
    L i' = u − R i             the coil, driven by the voltage u

With p = C i²/(m x²) = g − ẍ, the pull per mass, this is eq. 1 of the paper:

    x''' = f + b u + d,    f = 2 p (R/L + ẋ/x),    b = −(2/(L x)) √(C p/m)

b is negative, changes with the state and vanishes where the ball falls freely (p = 0). The theorem takes d as
known, and then says exactly how the error dies: ε(t) = ε(0) e^(−κt).
"""

from dataclasses import dataclass
from functools import cache
from math import pi

import numpy as np

from companion.control.law import combined_error, control_law
from companion.records import Array

BALL_KG = 0.05
PULL = 1e-4  # C, N m²/A²
COIL_H, COIL_OHM = 0.05, 4.0  # L, R
GRAVITY = 9.81
LAM, KAPPA = 40.0, 30.0
DURATION_S, STEP_S = 0.4, 1e-4


@dataclass(frozen=True, slots=True)
class Convergence:
    """All starts at once: t_s, x_d of shape (steps,), x_tilde (steps, starts, 3), the rest (steps, starts).

    Units: t s; x_d m; x_tilde m, m/s, m/s²; eps m/s²; b m/(s³ V).
    """

    t_s: Array
    x_d: Array
    x_tilde: Array
    eps: Array
    b: Array

    @property
    def rate(self) -> float:
        """How fast |ε| falls, 1/s: what the theorem says is κ."""
        return float(np.mean(np.log(np.abs(self.eps[0] / self.eps[-1])) / self.t_s[-1]))


def system(x: Array) -> tuple[Array, Array]:
    """Return f and b (eq. 1) at states `x` of shape (…, 3)."""
    gap, gap_dot = x[..., 0], x[..., 1]
    p = GRAVITY - x[..., 2]
    f = 2.0 * p * (COIL_OHM / COIL_H + gap_dot / gap)
    b = -2.0 / (COIL_H * gap) * np.sqrt(PULL * p / BALL_KG)
    return f, b


def path(t_s: float) -> Array:
    """Return [x_d, x_d', x_d'', x_d''']: 10 ± 3 mm, once in 0.4 s."""
    omega = 2.0 * pi / 0.4
    turn = omega * t_s + np.arange(4) * pi / 2.0
    return np.asarray(np.array([0.01, 0.0, 0.0, 0.0]) + 0.003 * omega ** np.arange(4) * np.sin(turn))


@cache
def converge(starts: int = 12, seed: int = 0) -> Convergence:
    """Let the ball start off the path in all three states, `starts` times."""
    spread = np.array([1e-3, 2e-2, 1.0])
    x = path(0.0)[:3] + spread * np.random.default_rng(seed).uniform(-1.0, 1.0, (starts, 3))
    t_s: Array = np.arange(round(DURATION_S / STEP_S) + 1, dtype=np.float64) * STEP_S
    errors, gains = [], []
    for t in t_s:
        errors.append(x - path(t)[:3])
        gains.append(system(x)[1])
        k1 = _rate(t, x)
        k2 = _rate(t + STEP_S / 2, x + STEP_S / 2 * k1)
        k3 = _rate(t + STEP_S / 2, x + STEP_S / 2 * k2)
        k4 = _rate(t + STEP_S, x + STEP_S * k3)
        x = x + STEP_S / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    x_tilde = np.array(errors)
    x_d = np.array([path(t)[0] for t in t_s])
    return Convergence(
        t_s, x_d, x_tilde, combined_error(list(np.moveaxis(x_tilde, -1, 0)), LAM), np.array(gains)
    )


def _disturbance(t_s: float) -> Array:
    return np.asarray(200.0 * np.sin(2.0 * pi * 8.0 * t_s))


def _voltage(t_s: float, x: Array) -> Array:
    f, b = system(x)
    desired = path(t_s)
    return control_law(f, b, _disturbance(t_s), desired[3], list((x - desired[:3]).T), LAM, KAPPA)


def _rate(t_s: float, x: Array) -> Array:
    f, b = system(x)
    highest = f + b * _voltage(t_s, x) + _disturbance(t_s)
    return np.stack((x[:, 1], x[:, 2], highest), axis=-1)
