"""The integrator: a closed form for each of its conventions, which are the network's."""

import numpy as np
import pytest
from learner import Learner, drawn, hidden, still

from companion.core import integrator, network

DT_S = 0.01


def one(k=100.0, **changes):
    return Learner(integrator, learning_rate=k, **{"max_disturbance": np.inf} | changes)


def steps(learner, eps, n, adapt=True):
    for _ in range(n):
        d_hat = learner.step(still(eps), adapt, DT_S)
    return d_hat


def test_a_positive_error_asks_for_a_smaller_d_hat():
    assert steps(one(), 0.02, 50) == pytest.approx(-100.0 * 0.02 * 0.5)


def test_leak_ends_where_it_balances_the_error():
    assert steps(one(leak_per_s=2.0), -0.1, 2000) == pytest.approx(100.0 * 0.1 / 2.0)


def test_inside_the_dead_zone_only_the_leak_works():
    learner = one(leak_per_s=0.5, dead_zone=0.01)
    kept = steps(learner, -0.11, 100)
    assert steps(learner, 0.01, 100) == pytest.approx(kept * (1.0 - 0.5 * DT_S) ** 100)


def test_the_projection_holds_and_lets_go():
    learner = one(max_disturbance=3.0)
    assert steps(learner, -0.1, 1000) == 3.0
    assert not learner.learning
    assert steps(learner, 0.1, 1) == pytest.approx(3.0 - 100.0 * 0.1 * DT_S)
    assert learner.learning


def test_a_network_whose_units_rest_at_one_half_is_an_integrator_of_eta_n_over_4():
    """No inputs are weighted, so that each unit rests."""
    learner = Learner(
        network,
        learning_rate=200.0,
        hidden_learning_rate=0.0,
        max_disturbance=np.inf,
        hidden=hidden(5, inputs=0),
    )
    gain = network.integral_gain(learner.parameters)
    assert gain == 200.0 * 5 / 4.0
    plain, rng = one(k=gain), np.random.default_rng(1)
    for _ in range(100):
        signals = drawn(rng, eps=rng.normal())
        assert learner.step(signals) == pytest.approx(plain.step(signals), abs=1e-11)
