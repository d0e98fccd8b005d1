"""The compensator: no help before it has learnt, the right sign, and bounds that hold."""

import numpy as np
import pytest

from companion.control.compensator import INPUTS, inputs
from companion.control.law import rov_law
from companion.control.network import Learning, Network

DT = 0.02
UNITS = 10


def learning(**changes):
    defaults = {"eta": 160.0, "eta_v": 0.0, "leak": 0.0, "dead_zone": 0.0, "d_max": 60.0}
    return Learning(**{key: np.float64(value) for key, value in (defaults | changes).items()})


def network(shape=(), seed=1, units=UNITS, **changes):
    return Network(learning(**changes), shape, INPUTS, units, seed)


def theta_of(rng, shape=()):
    return inputs(*(rng.normal(size=shape) * 0.2 for _ in range(5)))


YES, NO = np.True_, np.False_


def test_inputs_in_their_order_and_scale():
    theta = inputs(*map(np.float64, (0.1, 0.2, 0.3, 0.4, 0.5)))
    np.testing.assert_allclose(theta, [1.0, 1.0, 1.0, 1.5, 2.0, 2.5], rtol=1e-12)
    assert len(theta) == INPUTS


def test_untrained_it_is_the_plain_law():
    net, rng = network((4,)), np.random.default_rng(0)
    for _ in range(20):
        d_hat = net.step(theta_of(rng, (4,)), rng.normal(size=4), DT, np.zeros(4, bool))
        np.testing.assert_array_equal(d_hat, 0.0)
    np.testing.assert_array_equal(net.weight_norm, 0.0)


def test_output_is_w_sigma_of_v_theta_written_out():
    net, rng = network(eta_v=2.0), np.random.default_rng(2)
    for _ in range(5):
        net.step(theta_of(rng), np.float64(0.3), DT, YES)
    theta = theta_of(rng)
    hidden = [sum(net.V[i, j] * theta[i] for i in range(INPUTS)) for j in range(UNITS)]
    expected = sum(w / (1.0 + np.exp(-s)) for w, s in zip(net.W, hidden, strict=True))
    assert net.step(theta, np.float64(0.3), DT, NO) == pytest.approx(expected, rel=1e-12)
    assert net.weight_norm == pytest.approx(np.linalg.norm(net.W), rel=1e-12)


@pytest.mark.parametrize("eps", [-0.2, 0.2])
def test_a_positive_error_asks_for_a_smaller_d_hat(eps):
    net, theta = network(), theta_of(np.random.default_rng(3))
    d_hat = net.step(theta, np.float64(eps), DT, YES)
    assert np.sign(d_hat) == -np.sign(eps)


def hold(d, *, flip=1.0, seconds=30.0, **changes):
    """The paper's plant m z'' = tau - d held at z = 0 by law and network; return eps and d_hat over time."""
    m, lam, kappa = 28.5, 4.7, 8.0
    net = network(**changes)
    z = w = np.float64(0.0)
    seen = []
    for _ in range(round(seconds / DT)):
        theta = inputs(z, w, w, np.float64(0.0), np.float64(0.0))
        eps = w + lam * z
        d_hat = net.step(theta, flip * eps, DT, YES)
        tau = rov_law(0.0, d_hat, m, 0.0, z, w, lam, kappa).tau
        w = w + DT * (tau - d) / m
        z = z + DT * w
        seen.append((eps, d_hat))
    return np.array(seen).T


@pytest.mark.parametrize("d", [-20.0, 5.0, 20.0])
def test_a_constant_disturbance_is_learnt_until_the_error_is_gone(d):
    """m eps' = -m kappa eps + d_hat - d: at rest d_hat is d, in the paper's own sign."""
    eps, d_hat = hold(d)
    untrained = abs(d) / (28.5 * 8.0)
    assert np.abs(eps[:10]).max() > 0.1 * untrained
    assert np.abs(eps[-250:]).max() < 1e-3 * untrained
    assert d_hat[-1] == pytest.approx(d, rel=1e-3)


def test_the_other_sign_fails():
    eps, d_hat = hold(20.0, flip=-1.0)
    assert np.abs(eps[-250:]).min() > 20.0 / (28.5 * 8.0)
    assert d_hat[-1] < 0.0


def test_the_update_follows_eq_w_dot():
    net, theta, eps = network(leak=0.5), theta_of(np.random.default_rng(4)), 0.3
    net.step(theta, np.float64(-0.5), DT, YES)
    before, sigma = net.W.copy(), 1.0 / (1.0 + np.exp(-(theta @ net.V)))
    net.step(theta, np.float64(eps), DT, YES)
    np.testing.assert_allclose(net.W, before + DT * (-160.0 * eps * sigma - 0.5 * before), rtol=1e-12)


def test_both_layers_follow_back_propagation_by_finite_differences():
    """A step is -dt eta eps d(d_hat)/dW and -dt eta_v eps d(d_hat)/dV, the gradients taken numerically."""
    net, rng = network(eta=3.0, eta_v=2.0), np.random.default_rng(5)
    for _ in range(30):
        net.step(theta_of(rng), np.float64(-1.0), DT, YES)
    theta, eps, h = theta_of(rng), 0.7, 1e-6
    W, V = net.W.copy(), net.V.copy()

    def output(W, V):
        return W @ (1.0 / (1.0 + np.exp(-(theta @ V))))

    def gradient(of, at):
        result = np.zeros_like(at)
        for index in np.ndindex(at.shape):
            up, down = at.copy(), at.copy()
            up[index] += h
            down[index] -= h
            result[index] = (of(up) - of(down)) / (2 * h)
        return result

    net.step(theta, np.float64(eps), DT, YES)
    np.testing.assert_allclose(net.W - W, -DT * 3.0 * eps * gradient(lambda w: output(w, V), W), atol=1e-9)
    np.testing.assert_allclose(net.V - V, -DT * 2.0 * eps * gradient(lambda v: output(W, v), V), atol=1e-9)
    assert np.abs(net.V - V).max() > 1e-6


def test_a_frozen_hidden_layer_stays():
    net, rng = network((3,), eta_v=0.0), np.random.default_rng(6)
    before = np.array(net.V)
    for _ in range(50):
        net.step(theta_of(rng, (3,)), rng.normal(size=3), DT, np.ones(3, bool))
    np.testing.assert_array_equal(net.V, before)


def test_leak_forgets_at_its_rate_and_only_while_learning():
    net, theta = network(leak=0.5, dead_zone=1.0), theta_of(np.random.default_rng(7))
    net.step(theta, np.float64(-1.5), DT, YES)
    start = net.weight_norm
    for _ in range(100):
        net.step(theta, np.float64(0.0), DT, NO)
    assert net.weight_norm == start
    for _ in range(100):
        net.step(theta, np.float64(0.0), DT, YES)
    assert net.weight_norm == pytest.approx(start * np.exp(-0.5 * 100 * DT), rel=0.01)


def test_leak_brings_the_hidden_layer_back_to_its_start():
    net, rng = network(eta_v=20.0, leak=1.0, dead_zone=1.0), np.random.default_rng(8)
    start = np.array(net.V)
    for _ in range(50):
        net.step(theta_of(rng), np.float64(-2.0), DT, YES)
    moved = np.abs(net.V - start).max()
    for _ in range(400):
        net.step(theta_of(rng), np.float64(0.0), DT, YES)
    assert np.abs(net.V - start).max() < 0.01 * moved


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_nothing_is_learnt_inside_the_dead_zone_and_no_step_at_its_edge(sign):
    theta = theta_of(np.random.default_rng(9))
    net = network(dead_zone=0.1)
    assert net.step(theta, np.float64(sign * 0.1), DT, YES) == 0.0
    little = net.step(theta, np.float64(sign * 0.1001), DT, YES)
    assert np.sign(little) == -sign
    plain = network().step(theta, np.float64(sign * 0.0001), DT, YES)
    assert little == pytest.approx(plain, rel=1e-6)


def test_d_hat_stays_within_d_max_and_comes_back_at_once():
    net, theta = network(d_max=5.0), theta_of(np.random.default_rng(10))
    for _ in range(500):
        assert abs(net.step(theta, np.float64(-1.0), DT, YES)) <= 5.0
    norm = net.weight_norm
    net.step(theta, np.float64(-1.0), DT, YES)
    assert not net.learning_now
    assert net.weight_norm == norm
    below = net.step(theta, np.float64(1.0), DT, YES)
    assert net.learning_now
    assert net.step(theta, np.float64(1.0), DT, YES) < min(below, 5.0)


def test_the_projection_holds_on_the_other_side_too():
    net, theta = network(d_max=5.0), theta_of(np.random.default_rng(10))
    for _ in range(100):
        d_hat = net.step(theta, np.float64(1.0), DT, YES)
    assert d_hat == -5.0
    assert not net.learning_now


def test_frozen_it_keeps_what_it_knows_and_says_so():
    net, rng = network((2,)), np.random.default_rng(11)
    both = np.array([True, True])
    net.step(theta_of(rng, (2,)), np.array([0.5, 0.5]), DT, both)
    np.testing.assert_array_equal(net.learning_now, both)
    W = net.W.copy()
    net.step(theta_of(rng, (2,)), np.array([0.5, 0.5]), DT, np.array([True, False]))
    np.testing.assert_array_equal(net.learning_now, [True, False])
    np.testing.assert_array_equal(net.W[1], W[1])
    assert (net.W[0] != W[0]).any()


def test_reset_forgets_everything():
    net, rng = network((4,), eta_v=5.0), np.random.default_rng(12)
    fresh = network((4,), eta_v=5.0)
    for _ in range(20):
        net.step(theta_of(rng, (4,)), rng.normal(size=4), DT, np.ones(4, bool))
    net.reset()
    np.testing.assert_array_equal(net.V, fresh.V)
    np.testing.assert_array_equal(net.W, fresh.W)
    assert not net.learning_now.any()


def test_seeds_make_the_hidden_layer():
    np.testing.assert_array_equal(network(seed=3).V, network(seed=3).V)
    assert (network(seed=3).V != network(seed=4).V).any()


def test_huge_inputs_saturate_and_do_not_overflow():
    net = network()
    for size in (1e3, 1e6, -1e6):
        net.step(np.full(INPUTS, size), np.float64(1.0), DT, YES)
        assert np.isfinite(net.W).all()


@pytest.mark.parametrize("eta_v", [0.0, 2.0])
def test_a_batch_of_dives_is_what_single_dives_are_bit_for_bit(eta_v):
    rng = np.random.default_rng(13)
    gains = Learning(
        eta=np.array([0.0, 20.0, 160.0, 5.0]),
        eta_v=np.full(4, eta_v),
        leak=np.full(4, 0.01),
        dead_zone=np.full(4, 0.001),
        d_max=np.array([1.0, 2.0, 3.0, 0.5]),
    )
    batch = Network(gains, (7, 4), INPUTS, UNITS, seed=1)
    singles = [Network(gains, (4,), INPUTS, UNITS, seed=1) for _ in range(7)]
    for _ in range(60):
        theta, eps = theta_of(rng, (7, 4)), rng.normal(size=(7, 4)) * 0.3
        adapt = rng.random((7, 4)) < 0.8
        together = batch.step(theta, eps, DT, adapt)
        for i, single in enumerate(singles):
            np.testing.assert_array_equal(together[i], single.step(theta[i], eps[i], DT, adapt[i]))
            np.testing.assert_array_equal(batch.learning_now[i], single.learning_now)
