"""The law against closed forms: the theorem says exactly how the error dies."""

# Arrays stand where the equations have numbers.
# mypy: disable-error-code="arg-type"

import numpy as np
import pytest

from companion.core import law
from companion.core.law import Motion, combined_error, control_law, error_coefficients, rov_law

LAM, KAPPA = 1.7, 4.0


@pytest.mark.parametrize(
    ("n", "expected"),
    [
        (1, [1.0]),
        (2, [LAM, 1.0]),
        (3, [LAM**2, 2.0 * LAM, 1.0]),
        (4, [LAM**3, 3.0 * LAM**2, 3.0 * LAM, 1.0]),
    ],
)
def test_coefficients_of_eq_2_written_out(n, expected):
    np.testing.assert_allclose(error_coefficients(n, LAM), expected, rtol=1e-14)


def test_combined_error_written_out_for_numbers_and_for_arrays():
    x_tilde = np.array([[0.3, -0.2, 0.5], [-1.0, 2.0, 0.25]])
    expected = LAM**2 * x_tilde[:, 0] + 2.0 * LAM * x_tilde[:, 1] + x_tilde[:, 2]
    np.testing.assert_allclose(combined_error(x_tilde.T, LAM), expected, rtol=1e-14)
    assert combined_error((0.3, -0.2, 0.5), LAM) == pytest.approx(expected[0], rel=1e-14)


F, B, D, X_D_N = 0.7, -2.5, 0.4, 1.3
E0, E1, E2 = 0.3, -0.2, 0.5


@pytest.mark.parametrize(
    ("x_tilde", "u"),
    [
        ([E0], (-F - D + X_D_N - KAPPA * E0) / B),
        ([E0, E1], (-F - D + X_D_N - LAM * E1 - KAPPA * (LAM * E0 + E1)) / B),
        (
            [E0, E1, E2],
            (-F - D + X_D_N - LAM**2 * E1 - 2 * LAM * E2 - KAPPA * (LAM**2 * E0 + 2 * LAM * E1 + E2)) / B,
        ),
    ],
)
def test_eq_5_written_out(x_tilde, u):
    assert control_law(F, B, D, X_D_N, x_tilde, LAM, KAPPA) == pytest.approx(u, rel=1e-12)


def nonlinear_third_order(duration_s=3.0, dt=0.002):
    """Simulate x''' = f(x) + b(x) u + d(t) under the law and return t, x_tilde (steps, 3)."""

    def path(t):
        return np.array([np.sin(t), np.cos(t), -np.sin(t), -np.cos(t)])

    def rate(t, x):
        f = -(x[0] ** 3) - x[1] * abs(x[1]) + np.sin(x[2])
        b = -(2.0 + np.cos(x[0]) + 0.3 * x[1] ** 2)
        d = 0.8 * np.sin(3.0 * t)
        desired = path(t)
        u = control_law(f, b, d, desired[3], x - desired[:3], LAM, KAPPA)
        return np.array([x[1], x[2], f + b * u + d])

    x = path(0.0)[:3] + np.array([0.5, -1.0, 2.0])
    times = np.arange(round(duration_s / dt) + 1) * dt
    errors = []
    for t in times:
        errors.append(x - path(t)[:3])
        k1 = rate(t, x)
        k2 = rate(t + dt / 2, x + dt / 2 * k1)
        k3 = rate(t + dt / 2, x + dt / 2 * k2)
        k4 = rate(t + dt, x + dt * k3)
        x = x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return times, np.array(errors)


def test_theorem_on_a_nonlinear_third_order_system():
    """The proof integrates d^2/dt^2 (x~ e^(lam t)) = eps(0) e^((lam - kappa) t): so does this."""
    t, x_tilde = nonlinear_third_order()
    eps = combined_error(x_tilde.T, LAM)
    np.testing.assert_allclose(eps, eps[0] * np.exp(-KAPPA * t), atol=1e-7)
    gap = LAM - KAPPA
    start = x_tilde[0, 0] - eps[0] / gap**2
    slope = x_tilde[0, 1] + LAM * x_tilde[0, 0] - eps[0] / gap
    expected = (start + slope * t + eps[0] * np.exp(gap * t) / gap**2) * np.exp(-LAM * t)
    np.testing.assert_allclose(x_tilde[:, 0], expected, atol=1e-7)
    assert np.abs(x_tilde[-1]).max() < 0.02 * np.abs(x_tilde[0]).max()


def random_terms(rng):
    names = ("k_plus_h", "d_hat", "x_d_ddot", "e", "e_dot")
    terms = {name: rng.normal() * 3.0 for name in names}
    m, lam, kappa = rng.uniform(0.2, 60.0), rng.uniform(0.5, 6.0), rng.uniform(0.5, 12.0)
    return terms | {"m": m, "lam": lam, "kappa": kappa}


def test_rov_form_is_the_general_law_of_second_order():
    """n = 2, f = -(k + h)/m, b = 1/m, and a force d_hat is met by d = -d_hat/m."""
    rng = np.random.default_rng(3)
    for _ in range(200):
        terms = random_terms(rng)
        m = terms["m"]
        general = control_law(
            f=-terms["k_plus_h"] / m,
            b=1.0 / m,
            d=-terms["d_hat"] / m,
            x_d_n=terms["x_d_ddot"],
            x_tilde=(terms["e"], terms["e_dot"]),
            lam=terms["lam"],
            kappa=terms["kappa"],
        )
        assert sum(rov_law(**terms)) == pytest.approx(general, rel=1e-10, abs=1e-10)


def one(**changes):
    zero = dict.fromkeys(("k_plus_h", "d_hat", "x_d_ddot", "e", "e_dot"), 0.0)
    return rov_law(**(zero | {"m": 50.0, "lam": 2.0, "kappa": 3.0} | changes))


@pytest.mark.parametrize(
    ("changed", "tau"),
    [
        ({"k_plus_h": 7.0}, 7.0),
        ({"d_hat": 7.0}, 7.0),
        ({"x_d_ddot": 0.1}, 50.0 * 0.1),
        ({"e": 0.1}, -50.0 * 3.0 * 2.0 * 0.1),
        ({"e_dot": 0.1}, -50.0 * (2.0 + 3.0) * 0.1),
    ],
)
def test_each_term_alone_sign_and_inertia(changed, tau):
    """The gain is m kappa, not the kappa that lei1 and lei2 print."""
    assert sum(one(**changed)) == pytest.approx(tau, rel=1e-12)


def test_the_shipped_law_by_the_protocol_is_rov_law():
    terms = random_terms(np.random.default_rng(9))
    motion = Motion(x_dot=0.3, share=1.0, free=True, **terms)
    parameters = law.Parameters()
    _, found = law.step(parameters, law.initial(parameters), motion, 0.02)
    assert found == rov_law(**terms)
