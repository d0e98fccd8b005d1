"""The law against closed forms: the theorem says exactly how the error dies."""

import numpy as np
import pytest

from companion.core.law import rov_law

LAM, KAPPA = 1.7, 4.0


def random_terms(rng):
    names = ("k_plus_h", "d_hat", "x_d_ddot", "e", "e_dot")
    terms = {name: rng.normal() * 3.0 for name in names}
    m, lam, kappa = rng.uniform(0.2, 60.0), rng.uniform(0.5, 6.0), rng.uniform(0.5, 12.0)
    return terms | {"m": m, "lam": lam, "kappa": kappa}


def test_it_is_the_general_law_of_second_order():
    """Eq. 5 for n = 2, with f = -(k + h)/m and b = 1/m; a force d_hat is met by d = -d_hat/m."""
    rng = np.random.default_rng(3)
    for _ in range(200):
        terms = random_terms(rng)
        m, e, e_dot, lam = (terms[name] for name in ("m", "e", "e_dot", "lam"))
        f, b, d = -terms["k_plus_h"] / m, 1.0 / m, -terms["d_hat"] / m
        general = (-f - d + terms["x_d_ddot"] - lam * e_dot - terms["kappa"] * (e_dot + lam * e)) / b
        eps = e_dot + lam * terms.pop("e")
        assert rov_law(**terms, eps=eps) == pytest.approx(general, rel=1e-10, abs=1e-10)


def test_theorem_on_a_nonlinear_vehicle():
    """With all known, ε falls as e^(-κ t) and d/dt (e e^(λ t)) = ε(0) e^((λ - κ) t): so does this."""
    m, dt = 30.0, 1e-4
    times = np.arange(0.0, 3.0, dt)
    x, x_dot, errors = 0.5, 0.0, []
    for t in times:
        e, e_dot = x - np.sin(t), x_dot - np.cos(t)
        errors.append((e, e_dot))
        drag, d = 20.0 * x_dot * abs(x_dot) + 3.0 * np.sin(x), 8.0 * np.sin(3.0 * t)
        tau = rov_law(drag, d, m, -np.sin(t), e_dot, e_dot + LAM * e, LAM, KAPPA)
        acceleration = (tau - drag - d) / m
        x, x_dot = x + dt * (x_dot + 0.5 * dt * acceleration), x_dot + dt * acceleration
    e, e_dot = np.array(errors).T
    eps = e_dot + LAM * e
    np.testing.assert_allclose(eps, eps[0] * np.exp(-KAPPA * times), atol=1e-3)
    expected = (e[0] + eps[0] * (np.exp((LAM - KAPPA) * times) - 1.0) / (LAM - KAPPA)) * np.exp(-LAM * times)
    np.testing.assert_allclose(e, expected, atol=1e-3)
