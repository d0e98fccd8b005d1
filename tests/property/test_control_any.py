"""For any finite numbers: bounded, symmetric, and the plain law where nothing was learnt."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from learner import hidden

from companion.core import integrator, network
from companion.core.bounds import limited, wrap
from companion.core.compensator import Signals
from companion.core.law import rov_law

some = st.floats(-100.0, 100.0)
angles = st.floats(-1e4, 1e4)
gains = st.floats(0.01, 50.0)


@given(angles)
def test_wrap_gives_the_same_direction_within_one_turn(angle):
    wrapped = wrap(angle)
    assert -math.pi <= wrapped <= math.pi
    assert math.isclose(math.cos(wrapped), math.cos(angle), abs_tol=1e-7)
    assert math.isclose(math.sin(wrapped), math.sin(angle), abs_tol=1e-7)


@given(st.floats(), st.floats(0.0, 1e6))
def test_limited_never_leaves_its_limit(x, limit):
    got = limited(x, limit)
    assert math.isnan(got) if math.isnan(x) else abs(got) <= limit


@given(some, some, some, some, some, gains, gains, gains)
def test_the_law_is_odd_and_linear_in_what_it_is_given(k, d_hat, a_d, e, e_dot, m, lam, kappa):
    tau = sum(rov_law(k, d_hat, m, a_d, e, e_dot, lam, kappa))
    mirrored = sum(rov_law(-k, -d_hat, m, -a_d, -e, -e_dot, lam, kappa))
    assert mirrored == -tau
    half = sum(rov_law(0.5 * k, 0.5 * d_hat, m, 0.5 * a_d, 0.5 * e, 0.5 * e_dot, lam, kappa))
    assert math.isclose(2.0 * half, tau, rel_tol=1e-12, abs_tol=1e-300)
    pulls_back = sum(rov_law(0.0, 0.0, m, 0.0, e, 0.0, lam, kappa))
    assert np.sign(pulls_back) == -np.sign(e)


def learners(d_max):
    """Every shipped compensator that learns, quickly."""
    values = {"learning_rate": 300.0, "hidden_learning_rate": 0.0, "leak_per_s": 0.0, "dead_zone": 0.0}
    values |= {"max_disturbance": d_max, "hidden": hidden(10)}
    yield network, network.parameters(values)
    yield integrator, integrator.Parameters(*(values[key] for key in integrator.Parameters._fields))


signals = st.builds(Signals, some, some, some, some, some, some)


@given(st.lists(st.tuples(signals, st.booleans()), min_size=1, max_size=30), st.floats(0.01, 100.0))
def test_what_is_learnt_never_leaves_its_bound(steps, d_max):
    for module, parameters in learners(d_max):
        state = module.initial(parameters)
        for seen, adapt in steps:
            before = state
            state, d_hat, learning = module.step(parameters, state, seen, 0.02, adapt)
            assert abs(d_hat) <= d_max
            assert math.isfinite(module.weight_norm(state))
            assert learning or module.weight_norm(state) == module.weight_norm(before)
            assert adapt or (not learning and state == before)


@given(signals)
def test_before_it_learns_it_is_the_plain_law(seen):
    for module, parameters in learners(60.0):
        assert module.step(parameters, module.initial(parameters), seen, 0.02, False)[1] == 0.0
