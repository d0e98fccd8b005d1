import numpy as np
import pytest

from companion.control.bounds import bounded, wrap
from companion.control.positioning import (
    Model,
    inertial_diagonal,
    jacobian,
    pose_error,
    to_body,
    to_inertial,
)

MODEL = Model(
    m=np.array([17.5, 21.0, 28.5, 0.5]),
    d1=np.array([8.0, 6.0, 19.0, 0.1]),
    d2=np.array([95.0, 130.0, 113.0, 1.0]),
)
ANGLES = (0.0, 0.3, np.pi / 2, 2.0, np.pi, -1.2, -np.pi, 7.0)


def rotation(psi):
    """R of the textbook (Fossen 2011, eq. 2.8), written out here once more."""
    return np.array([[np.cos(psi), -np.sin(psi)], [np.sin(psi), np.cos(psi)]])


@pytest.mark.parametrize(
    ("angle", "wrapped"),
    [
        (0.0, 0.0),
        (1.0, 1.0),
        (-1.0, -1.0),
        (np.pi + 0.1, -np.pi + 0.1),
        (-np.pi - 0.1, np.pi - 0.1),
        (np.pi, -np.pi),
        (-np.pi, -np.pi),
        (2 * np.pi, 0.0),
        (7.0, 7.0 - 2 * np.pi),
        (-20.0, -20.0 + 6 * np.pi),
    ],
)
def test_wrap(angle, wrapped):
    assert wrap(np.array(angle)) == pytest.approx(wrapped, abs=1e-12)


def test_bounded():
    x = np.array([-3.0, -0.5, 0.0, 0.5, 3.0, np.inf, -np.inf])
    np.testing.assert_array_equal(bounded(x, np.float64(1.0)), [-1.0, -0.5, 0.0, 0.5, 1.0, 1.0, -1.0])
    assert np.isnan(bounded(np.array(np.nan), np.array(1.0)))


def test_pose_error_is_measured_minus_desired_and_wraps_the_heading_alone():
    eta, eta_d = np.array([5.0, -5.0, 9.0, 3.0]), np.array([1.0, 2.0, 1.0, -3.0])
    np.testing.assert_allclose(pose_error(eta, eta_d), [4.0, -7.0, 8.0, 6.0 - 2 * np.pi])
    np.testing.assert_allclose(pose_error(eta_d, eta), [-4.0, 7.0, -8.0, 2 * np.pi - 6.0])
    np.testing.assert_array_equal(eta, [5.0, -5.0, 9.0, 3.0])


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


def test_heading_east_forward_is_east_and_right_is_south():
    J = jacobian(np.pi / 2)
    np.testing.assert_allclose(to_inertial(J, np.array([1.0, 0.0, 0.0, 0.0])), [0, 1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(to_inertial(J, np.array([0.0, 1.0, 0.0, 0.0])), [-1, 0, 0, 0], atol=1e-12)


@pytest.mark.parametrize("psi", ANGLES)
def test_the_diagonal_is_that_of_r_diag_rt(psi):
    body = np.array([3.0, 8.0, 5.0, 0.7])
    full = rotation(psi) @ np.diag(body[:2]) @ rotation(psi).T
    turned = inertial_diagonal(jacobian(psi), body)
    np.testing.assert_allclose(turned[:2], np.diag(full), rtol=1e-12)
    np.testing.assert_array_equal(turned[2:], body[2:])
    np.testing.assert_allclose(MODEL.inertia(jacobian(psi))[:2].sum(), MODEL.m[:2].sum(), rtol=1e-12)


def skew_2d(r):
    return np.array([[0.0, -r], [r, 0.0]])


@pytest.mark.parametrize("psi", ANGLES)
def test_k_and_h_against_fossens_matrices(psi):
    """M_bar x'' + k + h = tau from J^-T (C(nu) nu + M d(J^-1)/dt x' + D(nu) nu), with C of a diagonal M."""
    m_u, m_v = MODEL.m[:2]
    rng = np.random.default_rng(2)
    for _ in range(10):
        nu = rng.normal(size=4)
        u, v, _, r = nu
        c_nu = np.array([-m_v * v * r, m_u * u * r, 0.0, (m_v - m_u) * u * v])
        assert nu @ c_nu == pytest.approx(0.0, abs=1e-12)
        turning = np.zeros(4)
        turning[:2] = np.diag(MODEL.m[:2]) @ (-skew_2d(r)) @ nu[:2]
        drag = MODEL.d1 * nu + MODEL.d2 * np.abs(nu) * nu
        expected = c_nu + turning + drag
        expected[:2] = rotation(psi) @ expected[:2]
        np.testing.assert_allclose(MODEL.coriolis_and_damping(jacobian(psi), nu), expected, atol=1e-10)


def test_coriolis_does_no_work():
    """Without damping only the change of M_bar takes or gives energy: x'k = x' dM_bar/dt x' / 2."""
    still = Model(MODEL.m, np.zeros(4), np.zeros(4))
    rng = np.random.default_rng(3)
    for _ in range(20):
        nu, psi = rng.normal(size=4), rng.uniform(-np.pi, np.pi)
        J = jacobian(psi)
        power = to_inertial(J, nu) @ still.coriolis_and_damping(J, nu)
        h = 1e-6
        before, after = (
            rotation(angle) @ np.diag(MODEL.m[:2]) @ rotation(angle).T for angle in (psi - h, psi + h)
        )
        inertia_rate = (after - before) / (2 * h) * nu[3]
        way = to_inertial(J, nu)[:2]
        assert power == pytest.approx(0.5 * way @ inertia_rate @ way, abs=1e-6)


def test_free_motion_keeps_its_energy_and_its_momentum():
    """No thrust, no damping: a turning body of unequal inertia, integrated in the inertial frame."""
    model = Model(np.array([10.0, 25.0, 30.0, 2.0]), np.zeros(4), np.zeros(4))

    def acceleration(psi, x_dot):
        J = jacobian(psi)
        full = J @ np.diag(model.m) @ J.T
        return np.linalg.solve(full, -model.coriolis_and_damping(J, to_body(J, x_dot)))

    def energy_and_momentum(psi, x_dot):
        full = jacobian(psi) @ np.diag(model.m) @ jacobian(psi).T
        return 0.5 * x_dot @ full @ x_dot, (full @ x_dot)[:2]

    psi, x_dot, dt = 0.3, np.array([0.4, -0.3, 0.2, 0.8]), 1e-3
    before = energy_and_momentum(psi, x_dot)
    for _ in range(3000):
        k1 = acceleration(psi, x_dot)
        middle = x_dot + 0.5 * dt * k1
        k2 = acceleration(psi + 0.5 * dt * x_dot[3], middle)
        psi, x_dot = psi + dt * middle[3], x_dot + dt * k2
    after = energy_and_momentum(psi, x_dot)
    assert after[0] == pytest.approx(before[0], rel=1e-5)
    np.testing.assert_allclose(after[1], before[1], atol=1e-4)


def test_damping_is_odd_and_always_brakes():
    rng = np.random.default_rng(4)
    equal = Model(np.array([20.0, 20.0, 30.0, 1.0]), MODEL.d1, MODEL.d2)
    for _ in range(20):
        nu, J = rng.normal(size=4), jacobian(rng.uniform(-np.pi, np.pi))
        force = equal.coriolis_and_damping(J, nu)
        np.testing.assert_allclose(equal.coriolis_and_damping(J, -nu), -force, rtol=1e-12)
        assert to_inertial(J, nu) @ force > 0.0


def test_port_and_starboard_are_mirror_images():
    """Mirrored motion gives mirrored force: sway, yaw and heading change sign, the rest does not."""
    mirror = np.array([1.0, -1.0, 1.0, -1.0])
    rng = np.random.default_rng(5)
    for _ in range(20):
        nu, psi = rng.normal(size=4), rng.uniform(-np.pi, np.pi)
        force = MODEL.coriolis_and_damping(jacobian(psi), nu)
        np.testing.assert_allclose(
            MODEL.coriolis_and_damping(jacobian(-psi), mirror * nu), mirror * force, atol=1e-10
        )


def test_a_common_turn_turns_all():
    """No direction of the compass is special."""
    rng = np.random.default_rng(6)
    for _ in range(20):
        nu, psi, turn = rng.normal(size=4), rng.uniform(-3.0, 3.0), rng.uniform(-3.0, 3.0)
        turned = to_inertial(jacobian(turn), MODEL.coriolis_and_damping(jacobian(psi), nu))
        np.testing.assert_allclose(MODEL.coriolis_and_damping(jacobian(psi + turn), nu), turned, atol=1e-9)


def test_drag_coefficient_is_the_diagonal_of_the_damping_matrix():
    nu, psi = np.array([0.4, -0.7, 0.2, 0.3]), 0.6
    body = MODEL.d1 + MODEL.d2 * np.abs(nu)
    full = jacobian(psi) @ np.diag(body) @ jacobian(psi).T
    np.testing.assert_allclose(MODEL.drag_coefficient(jacobian(psi), nu), np.diag(full), rtol=1e-12)


def test_a_batch_of_dives_is_what_single_dives_are():
    rng = np.random.default_rng(7)
    nu, psi = rng.normal(size=(6, 4)), rng.uniform(-3.0, 3.0, 6)
    J = jacobian(psi)
    together = (
        to_inertial(J, nu),
        to_body(J, nu),
        MODEL.inertia(J),
        MODEL.drag_coefficient(J, nu),
        MODEL.coriolis_and_damping(J, nu),
    )
    for i in range(6):
        alone = (
            to_inertial(J[i], nu[i]),
            to_body(J[i], nu[i]),
            MODEL.inertia(J[i]),
            MODEL.drag_coefficient(J[i], nu[i]),
            MODEL.coriolis_and_damping(J[i], nu[i]),
        )
        for a, b in zip(together, alone, strict=True):
            np.testing.assert_allclose(a[i], b, rtol=1e-13, atol=1e-15)
