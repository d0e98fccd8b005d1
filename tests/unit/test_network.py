"""The compensator: no help before it has learnt, the right sign, and bounds that hold."""

import numpy as np
import pytest
from learner import Learner, drawn, hidden, still

from companion.core import network
from companion.core.compensator import inputs

DT = 0.02
UNITS = 10


def net_of(seed=1, units=UNITS, **changes):
    values = {"learning_rate": 160.0, "hidden_learning_rate": 0.0, "max_disturbance": 60.0}
    values |= {"leak_per_s": 0.0, "dead_zone": 0.0, "hidden": hidden(units, seed)}
    return Learner(network, **network.parameters(values | changes)._asdict())


def weights(net):
    """W (units,) and V (inputs, units)."""
    return np.array(net.state.W), np.array(net.state.V).T


def output(W, V, theta):
    return W @ (1.0 / (1.0 + np.exp(-(np.array(theta) @ V))))


def test_output_is_w_sigma_of_v_theta():
    net, rng = net_of(hidden_learning_rate=2.0), np.random.default_rng(2)
    for _ in range(5):
        net.step(drawn(rng, 0.3))
    signals = drawn(rng, 0.3)
    W, V = weights(net)
    expected = output(W, V, inputs(signals))
    assert net.step(signals, adapt=False) == pytest.approx(expected, rel=1e-12)
    assert net.weight_norm == pytest.approx(np.linalg.norm(net.state.W), rel=1e-12)


def test_both_layers_follow_back_propagation_by_finite_differences():
    """A step is -dt eta eps d(d_hat)/dW and -dt eta_v eps d(d_hat)/dV, the gradients taken numerically."""
    net, rng = net_of(learning_rate=3.0, hidden_learning_rate=2.0), np.random.default_rng(5)
    for _ in range(30):
        net.step(drawn(rng, -1.0))
    signals, eps, h = drawn(rng, 0.7), 0.7, 1e-6
    theta, (W, V) = inputs(signals), weights(net)

    def gradient(of, at):
        result = np.zeros_like(at)
        for index in np.ndindex(at.shape):
            up, down = at.copy(), at.copy()
            up[index] += h
            down[index] -= h
            result[index] = (of(up) - of(down)) / (2 * h)
        return result

    net.step(signals)
    by_w = gradient(lambda w: output(w, V, theta), W)
    by_v = gradient(lambda v: output(W, v, theta), V)
    W_after, V_after = weights(net)
    np.testing.assert_allclose(W_after - W, -DT * 3.0 * eps * by_w, atol=1e-9)
    np.testing.assert_allclose(V_after - V, -DT * 2.0 * eps * by_v, atol=1e-9)
    assert np.abs(V_after - V).max() > 1e-6


def test_leak_brings_the_hidden_layer_back_to_its_start():
    net, rng = net_of(hidden_learning_rate=20.0, leak_per_s=1.0, dead_zone=1.0), np.random.default_rng(8)
    start = weights(net)[1]
    for _ in range(50):
        net.step(drawn(rng, -2.0))
    moved = np.abs(weights(net)[1] - start).max()
    for _ in range(400):
        net.step(drawn(rng))
    assert np.abs(weights(net)[1] - start).max() < 0.01 * moved


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_nothing_is_learnt_inside_the_dead_zone_and_no_step_at_its_edge(sign):
    signals, net = drawn(np.random.default_rng(9)), net_of(dead_zone=0.1)
    assert net.step(signals._replace(eps=sign * 0.1)) == 0.0
    little = net.step(signals._replace(eps=sign * 0.1001))
    assert np.sign(little) == -sign
    assert little == pytest.approx(net_of().step(signals._replace(eps=sign * 0.0001)), rel=1e-6)


def test_huge_inputs_saturate_and_do_not_overflow():
    net = net_of()
    for size in (1e3, 1e6, -1e6):
        net.step(still(eps=1.0, x_dot=size))
        assert np.isfinite(net.state.W).all()


def test_a_number_gone_bad_is_no_error_here_and_shows_in_d_hat():
    """It ends at the supervisor's guard."""
    net = net_of()
    net.step(still(eps=1.0))
    assert np.isnan(net.step(still(eps=0.0, x_dot=np.nan)))
