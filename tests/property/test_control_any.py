"""For any finite numbers: bounded, symmetric, and the plain law where nothing was learnt."""

import math

from hypothesis import given
from hypothesis import strategies as st
from learner import hidden

from companion.core import integrator, network
from companion.core.bounds import wrap
from companion.core.compensator import Signals

some = st.floats(-100.0, 100.0)
angles = st.floats(-1e4, 1e4)


@given(angles)
def test_wrap_gives_the_same_direction_within_one_turn(angle):
    wrapped = wrap(angle)
    assert -math.pi <= wrapped <= math.pi
    assert math.isclose(math.cos(wrapped), math.cos(angle), abs_tol=1e-7)
    assert math.isclose(math.sin(wrapped), math.sin(angle), abs_tol=1e-7)


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
