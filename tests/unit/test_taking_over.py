"""One law goes on where another was: its thrust, its reference, what was learnt."""

from copy import copy
from functools import cache

import numpy as np
import pytest
from alone import HOLDS, TICK_S
from learner import Learner, drawn, hidden
from msgspec.structs import replace
from test_controller import at_rest, state, tick

from companion.core import integrator, network
from companion.core.axis import BLEND_S
from companion.core.schedule import Gains, scheduled
from companion.records import Setpoint

LEARNERS = ("network", "integrator")
PUSHED = state((0.0, 0.0, 0.02, 0.0), (0.0, 0.0, 0.01, 0.0), (0.0, 0.0, -7.0, 0.2))
TARGET = Setpoint((0.0,) * 4)


def heave(compensator, *more):
    rate = 160.0 if compensator in (*LEARNERS, "predictor") else 0.0
    return (f'heave.compensator="{compensator}"', f"heave.learning_rate={rate}", *more)


@cache
def pushed(compensator, *more):
    c = at_rest(*heave(compensator, *more))
    for _ in range(400):
        sample = tick(c, PUSHED, TARGET)
    return c, sample


def learnt(compensator, *more):
    """A controller that has been pushed for a while."""
    c, sample = pushed(compensator, *more)
    return copy(c), sample


def after(old, *overrides):
    return old.taken_over(*overrides)


@pytest.mark.parametrize("old", [*LEARNERS, "none", "observer", "predictor"])
@pytest.mark.parametrize("new", [*LEARNERS, "none", "observer", "predictor"])
def test_the_first_thrust_is_what_the_old_law_asked_last(old, new):
    before, last = learnt(old)
    twin, _ = learnt(old)
    sample = tick(after(before, *heave(new)), PUSHED, TARGET)
    expected = tick(twin, PUSHED, TARGET)
    np.testing.assert_allclose(sample.tau, last.tau, atol=0.04 * np.abs(last.tau).max())
    parts = np.sum((sample.feedforward, sample.feedback, sample.d_hat), axis=0)
    np.testing.assert_allclose(sample.tau, parts, atol=1e-9)
    np.testing.assert_allclose(sample.x_d, expected.x_d, atol=1e-12)
    assert abs(last.d_hat[2]) > 1.0 or old == "none"


def test_what_is_left_over_is_let_go_exponentially():
    before, last = learnt("network")
    new = after(before, *heave("none"))
    carried = [tick(new, PUSHED, TARGET).d_hat[2] for _ in range(round(2 * BLEND_S / TICK_S))]
    assert carried[0] == pytest.approx(last.d_hat[2], rel=0.02)
    np.testing.assert_allclose(np.diff(np.log(np.abs(carried))), -TICK_S / BLEND_S, rtol=1e-6)


def test_at_rest_nothing_is_carried():
    before, _ = learnt("network")
    new = after(before, *heave("none"))
    tick(new, PUSHED, TARGET)
    new.rest(PUSHED)
    assert tick(new, PUSHED, Setpoint(PUSHED.eta)).d_hat[2] == 0.0
    waiting = after(learnt("network")[0], *heave("none"))
    waiting.rest(PUSHED)
    assert tick(waiting, PUSHED, Setpoint(PUSHED.eta)).d_hat[2] == 0.0


def test_frozen_nothing_is_learnt():
    c, last = learnt("network")
    sample = tick(c, PUSHED, TARGET, verdict=replace(HOLDS, freeze=True))
    assert not any(sample.adapting)
    np.testing.assert_array_equal(sample.weight_norm, last.weight_norm)


def one_of(kind):
    values = {"learning_rate": 5.0, "hidden_learning_rate": 1.0, "leak_per_s": 0.002, "dead_zone": 0.0}
    values |= {"max_disturbance": 20.0, "hidden": hidden(10)}
    if kind == "network":
        return Learner(network, **network.parameters(values)._asdict())
    return Learner(integrator, **{key: values[key] for key in integrator.Parameters._fields})


@pytest.mark.parametrize("kind", LEARNERS)
@pytest.mark.parametrize(("asked", "given"), [(5.0, 5.0), (-3.0, -3.0), (50.0, 20.0)])
def test_seeded_it_answers_so(kind, asked, given):
    rng = np.random.default_rng(3)
    signals, one = drawn(rng), one_of(kind)
    for eps in (0.3, -0.5, 0.2):
        one.step(drawn(rng, eps))
    one.seed(signals, asked)
    assert one.step(signals, adapt=False) == pytest.approx(given, abs=1e-9)


def test_a_degree_of_freedom_that_this_kind_did_not_serve_is_seeded():
    """Heave was the network's, yaw the observer's; now both are the network's."""
    before, last = learnt("network", 'yaw.compensator="observer"', "yaw.learning_rate=0")
    new = after(before, *heave("network", 'yaw.compensator="network"', "yaw.learning_rate=1"))
    sample = tick(new, PUSHED, TARGET)
    assert abs(last.d_hat[3]) > 0.1
    assert sample.weight_norm[3] > 0.01
    for _ in range(round(6 * BLEND_S / TICK_S)):
        sample = tick(new, replace(PUSHED, eta_ahead=sample.x_d, eta_dot_ahead=sample.x_d_dot), TARGET)
    assert sample.d_hat[3] == pytest.approx(last.d_hat[3], rel=0.2)


def left(gains, delay_s, gain_scale):
    """λ, κ, and the shares that `scheduled` leaves."""
    found = scheduled(gains, delay_s, gain_scale)
    return (found.gains.lam, found.gains.kappa, found.share, found.d_share)


def test_gains_are_drawn_back_by_their_powers_and_never_drawn_out():
    gains = Gains(lam=4.0, kappa=8.0, tolerated_s=0.1)
    half = (4.0 * 0.5**0.6, 8.0 * 0.5**1.4, 0.5)
    assert left(gains, 0.2, 1.0) == pytest.approx((*half, 1.0))
    assert left(gains, 0.1, 0.5) == pytest.approx((*half, 0.5))
    assert left(gains, 0.0, 1.0) == pytest.approx((4.0, 8.0, 1.0, 1.0))
    assert np.isnan(left(gains, np.nan, 1.0)).all()


def test_a_delay_that_the_gains_bear_draws_back_the_disturbance_alone():
    gains = Gains(lam=4.0, kappa=8.0, tolerated_s=0.5)
    assert left(gains, 0.4, 1.0) == pytest.approx((4.0, 8.0, 1.0, 0.5))
    assert scheduled(gains, 0.4, 0.8).d_share == pytest.approx(0.4)
