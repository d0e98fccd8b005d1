"""Any operator: random targets at random times, fixed ones and paths, also while moving."""

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from companion.core import reference
from companion.core.bounds import wrap
from companion.core.reference import Parameters

TICK_S = 0.02
RATE, ACCELERATION = 0.45, 0.4
PATH_RATE, PATH_ACCELERATION = 0.3, 0.3
JERK_TICK = 3.0 * ACCELERATION
"""Largest change of x_d'' in a tick that is stated: a quarter of the way from -a to +a, and a path's own."""

fixed = st.tuples(st.just("fixed"), st.floats(-20.0, 20.0), st.floats(0.1, 3.0), st.just(0.0))
path = st.tuples(st.just("path"), st.floats(-20.0, 20.0), st.floats(0.1, 3.0), st.floats(0.2, 1.0))
orders = st.lists(st.one_of(fixed, path), min_size=1, max_size=8)
FEW = settings(max_examples=settings().max_examples // 10)


def targets(order, t):
    """Target, its rate and acceleration at time t of one order."""
    kind, place, _, w = order
    if kind == "fixed":
        return place, 0.0, 0.0
    size = min(PATH_RATE / w, PATH_ACCELERATION / w**2)
    return place + size * np.sin(w * t), size * w * np.cos(w * t), -size * w**2 * np.sin(w * t)


def drive(orders, angular, tail_s=0.0):
    """Run through the orders; return target, x, x_dot, x_ddot over time."""
    parameters = Parameters(RATE, ACCELERATION, angular)
    state = reference.start(parameters, 0.0, 0.0)
    seen, t = [], 0.0
    for number, order in enumerate(orders):
        more = tail_s if number == len(orders) - 1 else 0.0
        for _ in range(round((order[2] + more) / TICK_S)):
            t += TICK_S
            place, rate, acceleration = targets(order, t)
            state = reference.advance(parameters, state, place, rate, acceleration, 1.0, TICK_S)
            seen.append([place, state.x_d, state.x_d_dot, state.x_d_ddot])
    return np.array(seen).T


@given(orders, st.booleans())
@example([("fixed", 5.0, 3.0, 0.0), ("fixed", -5.0, 3.0, 0.0), ("fixed", 5.0, 0.1, 0.0)], False)
@example([("path", 5.0, 3.0, 0.5), ("fixed", 1.0, 3.0, 0.0), ("path", -5.0, 3.0, 1.0)], True)
def test_bounded_and_continuous_whatever_is_asked(orders, angular):
    _, x, x_dot, x_ddot = drive(orders, angular)
    assert np.isfinite([x, x_dot, x_ddot]).all()
    assert np.abs(x_dot).max() <= RATE + 2 * PATH_RATE + 1e-9
    assert np.abs(x_ddot).max() <= ACCELERATION + 3 * PATH_ACCELERATION + 1e-9
    start = np.zeros(1)
    step = np.abs(np.diff(x, prepend=start)).max()
    assert step <= (RATE + 2 * PATH_RATE) * TICK_S + 1e-9
    jump = np.abs(np.diff(x_dot, prepend=start)).max()
    assert jump <= (ACCELERATION + 3 * PATH_ACCELERATION) * TICK_S + 1e-9
    assert np.abs(np.diff(x_ddot, prepend=start)).max() <= JERK_TICK


@given(st.lists(fixed, min_size=1, max_size=6), st.booleans())
def test_fixed_targets_keep_the_limits_themselves(orders, angular):
    _, _, x_dot, x_ddot = drive(orders, angular)
    assert np.abs(x_dot).max() <= RATE + 1e-9
    assert np.abs(x_ddot).max() <= ACCELERATION + 1e-9
    assert np.abs(np.diff(x_ddot, prepend=0.0)).max() <= 0.5 * ACCELERATION + 1e-9


@FEW
@given(orders, st.booleans())
def test_it_arrives_at_the_last_target(orders, angular):
    """Within 110 s from anywhere: 40 m at 0.45 m/s, and the last centimetres."""
    target, x, _, _ = drive(orders, angular, tail_s=110.0)
    missed = target[-1] - x[-1]
    assert abs(wrap(missed) if angular else missed) < 2e-3


@given(st.floats(-1.0, 1.0), st.sampled_from([0.01, 0.3, 5.0, 20.0]), st.just(0.0) | st.floats(-RATE, RATE))
def test_no_overshoot_from_rest_and_little_when_it_was_moving(target, reach, rate):
    target *= reach
    parameters = Parameters(RATE, ACCELERATION, False)
    state, over = reference.start(parameters, 0.0, rate), 0.0
    for _ in range(3000):
        state = reference.advance(parameters, state, target, 0.0, 0.0, 1.0, TICK_S)
        over = max(over, np.sign(target) * (state.x_d - target))
    unavoidable = rate**2 / ACCELERATION + 0.15 * abs(rate)
    assert over <= 1e-3 + 0.005 * abs(target) + unavoidable
