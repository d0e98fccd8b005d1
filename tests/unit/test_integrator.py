"""The integrator: a closed form for each of its conventions, which are the network's."""

import numpy as np
import pytest

from companion.control.integrator import Integration, Integrator
from companion.control.network import Learning, Network

DT = 0.01
YES = np.ones(1, bool)
THETA = np.zeros((1, 3))


def one(k=100.0, leak=0.0, dead_zone=0.0, d_max=np.inf):
    return Integrator(Integration(*map(np.array, (k, leak, dead_zone, d_max))), (1,))


def steps(integrator, eps, n, adapt=YES):
    for _ in range(n):
        d_hat = integrator.step(THETA, np.array([eps]), DT, adapt)
    return d_hat[0]


def test_a_positive_error_asks_for_a_smaller_d_hat():
    assert steps(one(), 0.02, 50) == pytest.approx(-100.0 * 0.02 * 0.5)


def test_it_starts_as_the_plain_law_and_forgets():
    integrator = one()
    assert steps(integrator, 0.0, 1) == 0.0
    steps(integrator, 0.1, 10)
    assert integrator.weight_norm[0] == pytest.approx(1.0)
    integrator.reset()
    assert integrator.weight_norm[0] == 0.0
    assert not integrator.learning_now.any()


def test_leak_ends_where_it_balances_the_error():
    assert steps(one(leak=2.0), -0.1, 2000) == pytest.approx(100.0 * 0.1 / 2.0)


def test_inside_the_dead_zone_only_the_leak_works():
    integrator = one(leak=0.5, dead_zone=0.01)
    steps(integrator, -0.11, 100)
    kept = integrator.d_hat[0]
    assert steps(integrator, 0.01, 100) == pytest.approx(kept * (1.0 - 0.5 * DT) ** 100)


def test_the_projection_holds_and_lets_go():
    integrator = one(d_max=3.0)
    assert steps(integrator, -0.1, 1000) == 3.0
    assert not integrator.learning_now[0]
    assert steps(integrator, 0.1, 1) == pytest.approx(3.0 - 100.0 * 0.1 * DT)
    assert integrator.learning_now[0]


def test_frozen_it_neither_learns_nor_leaks():
    integrator = one(leak=1.0)
    kept = steps(integrator, -0.1, 10)
    assert steps(integrator, -0.1, 100, ~YES) == kept
    assert not integrator.learning_now[0]


def test_a_batch_is_what_single_dives_are():
    rng = np.random.default_rng(4)
    k, leak, dead_zone, d_max = (
        rng.uniform(0.1, 1.0, (4, 30, 4)) * np.array([300.0, 1.0, 0.02, 2.0])[:, None, None]
    )
    together = Integrator(Integration(k, leak, dead_zone, d_max), (30, 4))
    alone = [Integrator(Integration(k[i], leak[i], dead_zone[i], d_max[i]), (4,)) for i in range(30)]
    for _ in range(50):
        eps, adapt = rng.normal(size=(30, 4)) * 0.1, rng.random((30, 4)) < 0.8
        batch = together.step(np.zeros((30, 4, 3)), eps, DT, adapt)
        for i in range(30):
            np.testing.assert_array_equal(batch[i], alone[i].step(np.zeros((4, 3)), eps[i], DT, adapt[i]))


def test_a_network_whose_units_rest_at_one_half_is_an_integrator_of_eta_n_over_4():
    eta, units = 200.0, 5
    zero, endless = np.zeros(()), np.array(np.inf)
    network = Network(Learning(np.array(eta), zero, zero, zero, endless), (1,), 3, units, seed=0)
    integrator = one(k=eta * units / 4.0)
    rng = np.random.default_rng(1)
    for _ in range(100):
        eps = rng.normal(size=1)
        learnt = network.step(THETA, eps, DT, YES)
        np.testing.assert_allclose(learnt, integrator.step(THETA, eps, DT, YES), atol=1e-12)
