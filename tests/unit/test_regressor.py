"""The linear regressor: learns what is linear in its terms, by the conventions of all compensators."""

import numpy as np
from learner import DT_S, Learner, still

from companion.core import regressor


def one(**changes):
    return Learner(regressor, learning_rate=200.0, **changes)


def test_nothing_is_learnt_inside_the_dead_zone():
    assert one(dead_zone=0.01).step(still(0.009)) == 0.0


def test_it_learns_a_quadratic_drag_that_the_model_lacks():
    """m ε̇ = −m κ ε + d̂ − d* with d* = 80 w|w|: after a while d̂ follows it at speeds it was not told of."""
    learner = one()
    m, kappa, eps = 30.0, 5.0, 0.0
    errors = []
    for k in range(30_000):
        w = 0.4 * np.sin(0.3 * k * DT_S) + 0.1 * np.sin(1.1 * k * DT_S)
        wanted = 80.0 * w * abs(w)
        d_hat = learner.step(still(eps, x_dot=w)._replace(e_dot=0.0))
        eps += DT_S * (-kappa * eps + (d_hat - wanted) / m)
        errors.append(d_hat - wanted)
    assert np.abs(errors[-3000:]).max() < 0.1 * np.abs(errors[:3000]).max()


def test_beside_the_observer_it_learns_what_depends_on_the_motion_alone():
    beside = one(beside_observer=True)
    for _ in range(50):
        beside.step(still(0.3)._replace(e_dot=0.0))
    assert beside.step(still(0.0), adapt=False) == 0.0
    for _ in range(50):
        beside.step(still(0.3, x_dot=0.2))
    assert beside.step(still(0.3, x_dot=0.2), adapt=False) < -1.0
    assert beside.step(still(0.0), adapt=False) == 0.0
    kept = beside.state
    beside.seed(still(0.3), 5.0)
    assert beside.state == kept
