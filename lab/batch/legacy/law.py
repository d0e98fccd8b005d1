"""The Lyapunov-based law of the paper, for a system of any order and for one degree of freedom of an ROV.

Every function works over arrays of any leading shape: one vehicle's `(4,)` or a lab's `(dives, 4)`.

| symbol  | meaning                                          | unit (heave; yaw)    | source      |
|---------|--------------------------------------------------|----------------------|-------------|
| x_tilde | tracking error [x̃, x̃', …, x̃^(n-1)], measured − desired | m, m/s, …      | sec. 2      |
| lam     | λ, the slope of the error surface                | 1/s                  | eq. 2       |
| c       | binomial coefficients with powers of λ           | –                    | eqs. 2, 3   |
| eps     | ε = cᵀ x̃, the combined error                     | m/s; rad/s           | eq. 2       |
| kappa   | κ, how fast ε decays                             | 1/s                  | eq. 5       |
| f, b, d | drift, input gain, disturbance of x^(n) = f + b u + d |                 | eq. 1       |
| m       | m̄, inertia with added mass                      | kg; kg·m²            | eq. rov     |
| k, h    | Coriolis and damping forces                      | N; N·m               | eq. rov     |
| d_hat   | d̂, estimated disturbance, m ẍ = τ − k − h − d    | N; N·m               | eq. ann     |
| tau     | τ, the control force                             | N; N·m               | eq. lei2    |
"""

from math import comb
from typing import NamedTuple

import numpy as np

from lab.batch.legacy.records import Array


def error_coefficients(n: int, lam: float) -> Array:
    """Return c = [c_{n-1} λ^{n-1}, …, c_1 λ, c_0] (eqs. 2 and 3), shape (n,)."""
    return np.array([comb(n - 1, i) * lam**i for i in range(n - 1, -1, -1)])


def combined_error(x_tilde: Array, lam: float) -> Array:
    """Return ε = cᵀ x̃ (eq. 2) for `x_tilde` of shape (…, n)."""
    return x_tilde @ error_coefficients(x_tilde.shape[-1], lam)


def control_law(
    f: Array, b: Array, d: Array, x_d_n: Array, x_tilde: Array, lam: float, kappa: float
) -> Array:
    """Return u = (−f − d + x_d^(n) − c̄ᵀ x̃ − κ ε) / b (eq. 5) for `x_tilde` of shape (…, n).

    c̄ = [0, c_{n-1} λ^{n-1}, …, c_1 λ] (eq. 4). `b` must not be zero.
    """
    n = x_tilde.shape[-1]
    c_bar = np.concatenate(([0.0], error_coefficients(n, lam)[:-1]))
    return (-f - d + x_d_n - x_tilde @ c_bar - kappa * combined_error(x_tilde, lam)) / b


class RovTerms(NamedTuple):
    """The law of one degree of freedom, term by term; tau = feedforward + feedback + d_hat."""

    eps: Array
    feedforward: Array
    feedback: Array
    tau: Array


def rov_law(
    k_plus_h: Array, d_hat: Array, m: Array, x_d_ddot: Array, e: Array, e_dot: Array, lam: Array, kappa: Array
) -> RovTerms:
    """Return τ = k + h + d̂ + m (ẍ_d − λ ė) − m κ ε, with ε = ė + λ e (eqs. lei1, lei2).

    It is `control_law` for n = 2, f = −(k + h)/m, b = 1/m. The paper prints the last term as −κ ε; its own
    general law (eq. 5) divides by b and so gives −m κ ε, the only form with which its figures hold.
    """
    eps = e_dot + lam * e
    feedforward = k_plus_h + m * x_d_ddot
    feedback = -m * (lam * e_dot + kappa * eps)
    return RovTerms(eps, feedforward, feedback, feedforward + feedback + d_hat)
