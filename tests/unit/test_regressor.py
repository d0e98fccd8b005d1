"""The linear regressor: learns what is linear in its terms, by the conventions of all compensators."""

import numpy as np
import pytest

from companion.control.compensator import INPUTS, inputs
from companion.control.network import Learning
from companion.control.regressor import Regressor

DT_S = 0.02
YES = np.ones(1, bool)


def learning(eta=200.0, leak=0.0, dead_zone=0.0, d_max=60.0):
    return Learning(*map(np.array, (eta, 0.0, leak, dead_zone, d_max)))


def theta(x_dot=0.0, x_d_ddot=0.0):
    zero, one = np.zeros(1), np.ones(1)
    return inputs(zero, zero, x_dot * one, x_dot * one, x_d_ddot * one)


def test_it_starts_as_the_plain_law_and_a_positive_error_asks_for_less() -> None:
    regressor = Regressor(learning(), (1,))
    assert regressor.step(theta(), np.zeros(1), DT_S, YES)[0] == 0.0
    assert regressor.step(theta(), np.full(1, 0.1), DT_S, YES)[0] == pytest.approx(-200.0 * 0.1 * DT_S)
    regressor.reset()
    assert regressor.weight_norm[0] == 0.0


def test_it_learns_a_quadratic_drag_that_the_model_lacks() -> None:
    """m ε̇ = −m κ ε + d̂ − d* with d* = 80 w|w|: after a while d̂ follows it at speeds it was not told of."""
    regressor = Regressor(learning(), (1,))
    m, kappa, eps = 30.0, 5.0, 0.0
    errors = []
    for k in range(30_000):
        w = 0.4 * np.sin(0.3 * k * DT_S) + 0.1 * np.sin(1.1 * k * DT_S)
        wanted = 80.0 * w * abs(w)
        d_hat = float(regressor.step(theta(x_dot=w), np.array([eps]), DT_S, YES)[0])
        eps += DT_S * (-kappa * eps + (d_hat - wanted) / m)
        errors.append(d_hat - wanted)
    assert np.abs(errors[-3000:]).max() < 0.1 * np.abs(errors[:3000]).max()


def test_projection_freeze_and_dead_zone() -> None:
    regressor = Regressor(learning(d_max=2.0), (1,))
    for _ in range(500):
        d_hat = regressor.step(theta(), np.full(1, -0.1), DT_S, YES)
    assert d_hat[0] <= 2.0
    assert not regressor.learning_now[0]
    kept = regressor.W.copy()
    regressor.step(theta(), np.full(1, 0.1), DT_S, ~YES)
    np.testing.assert_array_equal(regressor.W, kept)
    still = Regressor(learning(dead_zone=0.01), (1,))
    assert still.step(theta(), np.full(1, 0.009), DT_S, YES)[0] == 0.0


def test_a_batch_is_its_singles() -> None:
    rng = np.random.default_rng(1)
    together = Regressor(learning(), (5,))
    alone = [Regressor(learning(), (1,)) for _ in range(5)]
    for _ in range(50):
        x, eps = rng.standard_normal((5, INPUTS)), 0.1 * rng.standard_normal(5)
        got = together.step(x, eps, DT_S, np.ones(5, bool))
        for i, one in enumerate(alone):
            assert one.step(x[i : i + 1], eps[i : i + 1], DT_S, YES)[0] == got[i]
