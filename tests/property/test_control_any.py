"""For any finite numbers: bounded, symmetric, and the plain law where nothing was learnt."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from companion.control.bounds import bounded, wrap
from companion.control.compensator import INPUTS, inputs
from companion.control.law import combined_error, control_law, rov_law
from companion.control.network import Learning, Network
from companion.control.positioning import Model, jacobian, pose_error, to_body, to_inertial

finite = st.floats(-1e6, 1e6)
four = arrays(float, 4, elements=st.floats(-100.0, 100.0))
angles = st.floats(-1e4, 1e4)
gains = arrays(float, 4, elements=st.floats(0.01, 50.0))
NO_GAINS = dict.fromkeys(("eta_v", "leak", "dead_zone"), np.float64(0.0))


@settings(deadline=None)
@given(angles)
def test_wrap_gives_the_same_direction_within_one_turn(angle):
    wrapped = float(wrap(np.array(angle)))
    assert -math.pi <= wrapped <= math.pi
    assert math.isclose(math.cos(wrapped), math.cos(angle), abs_tol=1e-7)
    assert math.isclose(math.sin(wrapped), math.sin(angle), abs_tol=1e-7)


@settings(deadline=None)
@given(arrays(float, 4, elements=finite), arrays(float, 4, elements=finite))
def test_the_heading_error_is_never_more_than_half_a_turn(eta, eta_d):
    e = pose_error(eta, eta_d)
    assert abs(e[3]) <= math.pi
    np.testing.assert_array_equal(e[:3], (eta - eta_d)[:3])


@settings(deadline=None)
@given(st.floats(), st.floats(0.0, 1e6))
def test_bounded_never_leaves_its_limit(x, limit):
    got = bounded(np.array(x), np.array(limit))
    assert math.isnan(got) if math.isnan(x) else abs(got) <= limit


@settings(deadline=None)
@given(four, angles)
def test_turning_there_and_back_is_no_turn_and_keeps_lengths(vector, psi):
    J = jacobian(psi)
    turned = to_inertial(J, vector)
    np.testing.assert_allclose(to_body(J, turned), vector, atol=1e-10)
    assert math.isclose(np.hypot(*turned[:2]), np.hypot(*vector[:2]), abs_tol=1e-9)


@settings(deadline=None)
@given(gains, four, angles)
def test_the_inertia_lies_between_that_of_surge_and_of_sway(m, nu, psi):
    model = Model(m, np.abs(nu), np.abs(nu))
    bar = model.inertia(jacobian(psi))
    low, high = min(m[:2]), max(m[:2])
    assert (bar[:2] >= low - 1e-9).all()
    assert (bar[:2] <= high + 1e-9).all()
    np.testing.assert_allclose(bar[2:], m[2:])


@settings(max_examples=40, deadline=None)
@given(four, four, four, four, four, gains, gains, gains)
def test_the_law_is_odd_and_linear_in_what_it_is_given(k, d_hat, a_d, e, e_dot, m, lam, kappa):
    law = rov_law(k, d_hat, m, a_d, e, e_dot, lam, kappa)
    mirrored = rov_law(-k, -d_hat, m, -a_d, -e, -e_dot, lam, kappa)
    np.testing.assert_array_equal(mirrored.tau, -law.tau)
    half = rov_law(0.5 * k, 0.5 * d_hat, m, 0.5 * a_d, 0.5 * e, 0.5 * e_dot, lam, kappa)
    np.testing.assert_allclose(2.0 * half.tau, law.tau, rtol=1e-12, atol=1e-300)
    pulls_back = np.sign(rov_law(0.0, 0.0, m, 0.0, e, 0.0, lam, kappa).tau)
    np.testing.assert_array_equal(pulls_back, -np.sign(e))


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 6), st.floats(0.1, 5.0), st.floats(0.1, 5.0), st.data())
def test_the_general_law_gives_minus_kappa_eps_for_any_order(n, lam, kappa, data):
    x_tilde = data.draw(arrays(float, n, elements=st.floats(-10.0, 10.0)))
    f, d, x_d_n = (np.float64(data.draw(st.floats(-100.0, 100.0))) for _ in range(3))
    b = np.float64(data.draw(st.sampled_from([-1.0, 1.0])) * data.draw(st.floats(0.1, 10.0)))
    u = control_law(f, b, d, x_d_n, x_tilde, lam, kappa)
    eps_dot = combined_error(np.append(x_tilde[1:], f + b * u + d - x_d_n), lam)
    wanted = -kappa * combined_error(x_tilde, lam)
    assert math.isclose(eps_dot, wanted, rel_tol=1e-7, abs_tol=1e-6)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(four, four, four, st.booleans()), min_size=1, max_size=30), st.floats(0.01, 100.0))
def test_the_networks_output_never_leaves_its_bound(steps, d_max):
    learning = Learning(**NO_GAINS | {"eta": np.float64(300.0), "d_max": np.float64(d_max)})
    net = Network(learning, (4,), INPUTS, 10, seed=1)
    for e, e_dot, x_dot, adapt in steps:
        theta = inputs(e, e_dot, x_dot, x_dot, x_dot)
        before = net.weight_norm
        d_hat = net.step(theta, e_dot + e, 0.02, np.full(4, adapt))
        assert (np.abs(d_hat) <= d_max).all()
        assert np.isfinite(net.W).all()
        held = ~net.learning_now
        np.testing.assert_array_equal(net.weight_norm[held], before[held])
        assert adapt or not net.learning_now.any()


@settings(max_examples=40, deadline=None)
@given(four, four, four)
def test_zero_weights_are_the_plain_law(e, e_dot, x_dot):
    learning = Learning(**NO_GAINS | {"eta": np.float64(300.0), "d_max": np.float64(60.0)})
    net = Network(learning, (4,), INPUTS, 10, seed=1)
    theta = inputs(e, e_dot, x_dot, x_dot, x_dot)
    np.testing.assert_array_equal(net.step(theta, e, 0.02, np.zeros(4, bool)), 0.0)
