# Arrays stand where the equations have numbers.
# mypy: disable-error-code="arg-type, var-annotated"

import math

import numpy as np
import pytest

from companion.core.bounds import clamped, limited, square_root, wrap
from companion.core.positioning import (
    Model,
    by_dof,
    coriolis_and_damping,
    drag_coefficient,
    inertia,
    inertial_diagonal,
    jacobian,
    to_body,
    to_inertial,
)

MODEL = Model(m=(17.5, 21.0, 28.5, 0.5), d1=(8.0, 6.0, 19.0, 0.1), d2=(95.0, 130.0, 113.0, 1.0))
ANGLES = (0.0, 0.3, np.pi / 2, 2.0, np.pi, -1.2, -np.pi, 7.0)


def rotation(psi):
    """R of the textbook (Fossen 2011, eq. 2.8), written out here once more."""
    return np.array([[np.cos(psi), -np.sin(psi)], [np.sin(psi), np.cos(psi)]])


def matrix(psi):
    """J (eq. veli), 4 x 4."""
    J = np.eye(4)
    J[:2, :2] = rotation(psi)
    return J


def test_an_angle_that_is_none_is_nan():
    assert all(map(math.isnan, (wrap(math.inf), wrap(math.nan), *jacobian(math.inf), *jacobian(math.nan))))


@pytest.mark.parametrize(
    ("x", "within"), [(-3.0, -1.0), (-0.5, -0.5), (0.0, 0.0), (3.0, 1.0), (math.inf, 1.0), (-math.inf, -1.0)]
)
def test_bounds(x, within):
    assert limited(x, 1.0) == clamped(x, -1.0, 1.0) == within
    assert math.isnan(limited(math.nan, 1.0))
    assert math.isnan(clamped(math.nan, -1.0, 1.0))


def test_what_math_refuses_is_a_number_here():
    assert square_root(4.0) == 2.0
    assert all(map(math.isnan, (square_root(-1.0), square_root(math.nan))))


@pytest.mark.parametrize("psi", ANGLES)
def test_rotation_against_the_matrix(psi):
    rng = np.random.default_rng(1)
    J = jacobian(psi)
    for _ in range(5):
        vector = rng.normal(size=4)
        turned = to_inertial(J, vector)
        np.testing.assert_allclose(turned[:2], rotation(psi) @ vector[:2], atol=1e-12)
        np.testing.assert_array_equal(turned[2:], vector[2:])
        np.testing.assert_allclose(to_body(J, turned), vector, atol=1e-12)


@pytest.mark.parametrize("psi", ANGLES)
def test_the_diagonal_is_that_of_r_diag_rt(psi):
    body = np.array([3.0, 8.0, 5.0, 0.7])
    full = rotation(psi) @ np.diag(body[:2]) @ rotation(psi).T
    turned = inertial_diagonal(jacobian(psi), body)
    np.testing.assert_allclose(turned[:2], np.diag(full), rtol=1e-12)
    np.testing.assert_array_equal(turned[2:], body[2:])
    np.testing.assert_allclose(sum(inertia(MODEL, jacobian(psi))[:2]), sum(MODEL.m[:2]), rtol=1e-12)


def skew_2d(r):
    return np.array([[0.0, -r], [r, 0.0]])


@pytest.mark.parametrize("share", [1.0, 0.4, 0.0])
@pytest.mark.parametrize("psi", ANGLES)
def test_k_and_h_against_fossens_matrices(psi, share):
    """M_bar x'' + k + h = tau from J^-T (C(nu) nu + M d(J^-1)/dt x' + D(nu) nu), with C of a diagonal M."""
    m_u, m_v = MODEL.m[:2]
    model = MODEL._replace(coriolis_share=share)
    rng = np.random.default_rng(2)
    for _ in range(10):
        nu = rng.normal(size=4)
        u, v, _, r = nu
        c_nu = np.array([-m_v * v * r, m_u * u * r, 0.0, (m_v - m_u) * u * v])
        assert nu @ c_nu == pytest.approx(0.0, abs=1e-12)
        turning = np.zeros(4)
        turning[:2] = np.diag(MODEL.m[:2]) @ (-skew_2d(r)) @ nu[:2]
        drag = np.array(MODEL.d1) * nu + np.array(MODEL.d2) * np.abs(nu) * nu
        expected = share * c_nu + turning + drag
        expected[:2] = rotation(psi) @ expected[:2]
        np.testing.assert_allclose(coriolis_and_damping(model, jacobian(psi), nu), expected, atol=1e-10)


def test_drag_coefficient_is_the_diagonal_of_the_damping_matrix():
    nu, psi = np.array([0.4, -0.7, 0.2, 0.3]), 0.6
    body = np.array(MODEL.d1) + np.array(MODEL.d2) * np.abs(nu)
    full = matrix(psi) @ np.diag(body) @ matrix(psi).T
    np.testing.assert_allclose(drag_coefficient(MODEL, jacobian(psi), nu), np.diag(full), rtol=1e-12)


def test_what_surge_or_sway_lacks_x_and_y_lack():
    assert by_dof((True, False, False, True)) == (True, True, False, True)
    assert by_dof((False, False, True, False)) == (False, False, True, False)
