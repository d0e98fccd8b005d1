"""One law goes on where another was: its thrust, its reference, what was learnt."""

from dataclasses import replace

import numpy as np
import pytest
from test_controller import ALL, HEAVE_ONLY, TICK_S, at_rest, controller, state, tick

from companion.control.controller import BLEND_S
from companion.control.integrator import Integration, Integrator
from companion.control.network import Learning, Network
from companion.control.regressor import Regressor
from companion.records import Setpoint

LEARNERS = ("network", "integrator", "regressor")
PUSHED = state((0.0, 0.0, 0.02, 0.0), (0.0, 0.0, 0.01, 0.0), (0.0, 0.0, -7.0, 0.2))
TARGET = Setpoint(np.zeros(4))


def heave(compensator, *more):
    rate = 160.0 if compensator in (*LEARNERS, "network+observer") else 0.0
    return (f'heave.compensator="{compensator}"', f"heave.learning_rate={rate}", *more)


def learnt(compensator, ticks=400):
    """A controller that has been pushed for a while."""
    c = at_rest(*heave(compensator))
    for _ in range(ticks):
        sample = tick(c, PUSHED, TARGET)
    return c, sample


def after(old, *overrides):
    new = controller(*overrides)
    new.transfer_from(old)
    return new


@pytest.mark.parametrize("old", [*LEARNERS, "none", "observer", "network+observer"])
@pytest.mark.parametrize("new", [*LEARNERS, "none", "observer", "network+observer"])
def test_the_first_thrust_is_what_the_old_law_would_have_asked(old, new):
    before, last = learnt(old)
    twin, _ = learnt(old)
    sample = tick(after(before, *heave(new)), PUSHED, TARGET)
    expected = tick(twin, PUSHED, TARGET)
    np.testing.assert_allclose(sample.tau, expected.tau, atol=1e-9)
    np.testing.assert_allclose(sample.tau, sample.feedforward + sample.feedback + sample.d_hat, atol=1e-9)
    np.testing.assert_allclose(sample.x_d, expected.x_d, atol=1e-12)
    assert abs(last.d_hat[2]) > 1.0 or old == "none"


def test_what_is_left_over_is_let_go_exponentially():
    before, last = learnt("network")
    new = after(before, *heave("none"))
    still = replace(PUSHED, eta_dot_ahead=np.zeros(4))
    carried = [tick(new, still, TARGET).d_hat[2] for _ in range(round(2 * BLEND_S / TICK_S))]
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


def test_the_same_kind_inherits_and_goes_on_learning_at_once():
    before, last = learnt("network", 110)
    new = after(before, *heave("network", "heave.kappa_per_s=5"))
    sample = tick(new, PUSHED, TARGET)
    assert sample.weight_norm[2] == pytest.approx(last.weight_norm[2], rel=0.2)
    assert sample.adapting[2]


def test_frozen_nothing_is_learnt():
    c, last = learnt("network")
    c.frozen = True
    sample = tick(c, PUSHED, TARGET)
    assert not sample.adapting.any()
    np.testing.assert_array_equal(sample.weight_norm, last.weight_norm)


LEARNING = Learning(
    eta=np.full(4, 5.0),
    eta_v=np.full(4, 1.0),
    leak=np.full(4, 0.002),
    dead_zone=np.zeros(4),
    d_max=np.full(4, 20.0),
)
KINDS = {
    "network": lambda: Network(LEARNING, (4,), 6, 10, 1),
    "regressor": lambda: Regressor(LEARNING, (4,)),
    "integrator": lambda: Integrator(
        Integration(LEARNING.eta, LEARNING.leak, LEARNING.dead_zone, LEARNING.d_max), (4,)
    ),
}
THETA = np.random.default_rng(3).normal(0.0, 0.7, (4, 6)) + np.array([1.0, 0, 0, 0, 0, 0])
NOT_LEARNING = np.zeros(4, bool)


def answer(compensator, theta=THETA):
    return compensator.step(theta, np.zeros(4), TICK_S, NOT_LEARNING)


@pytest.mark.parametrize("kind", KINDS)
def test_seeded_it_answers_so_where_asked_and_elsewhere_as_before(kind):
    one = KINDS[kind]()
    for eps in (0.3, -0.5, 0.2):
        one.step(THETA, np.full(4, eps), TICK_S, ALL)
    was = answer(one).copy()
    one.seed(THETA, np.array([3.0, -4.0, 5.0, 50.0]), HEAVE_ONLY)
    np.testing.assert_allclose(answer(one), [was[0], was[1], 5.0, 20.0], atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_an_heir_answers_anything_as_its_predecessor_did_where_it_served(kind):
    old, heir = KINDS[kind](), KINDS[kind]()
    for eps in (0.3, -0.5, 0.2):
        old.step(THETA, np.full(4, eps), TICK_S, ALL)
    heir.inherit(old, HEAVE_ONLY)
    other = THETA[::-1] * 0.5
    np.testing.assert_allclose(answer(heir, other)[2:], answer(old, other)[2:], atol=1e-12)
    np.testing.assert_array_equal(answer(heir, other)[:2], 0.0)


@pytest.mark.parametrize("kind", ["network", "regressor"])
def test_a_seed_changes_the_weights_no_more_than_it_must(kind):
    one = KINDS[kind]()
    one.seed(THETA, np.full(4, 6.0), ALL)
    least = one.W.copy()
    rng = np.random.default_rng(1)
    for _ in range(20):
        other = least + rng.normal(size=least.shape)
        direction = least / np.linalg.norm(least, axis=-1, keepdims=True)
        along = np.vecdot(other, direction)[:, None] * direction
        on_the_plane = other - along + least
        assert (np.linalg.norm(on_the_plane, axis=-1) >= np.linalg.norm(least, axis=-1) - 1e-9).all()


def test_a_degree_of_freedom_that_this_kind_did_not_serve_is_seeded():
    """Heave was the network's, yaw the observer's; now both are the network's."""
    before, last = learnt("network")
    new = after(before, *heave("network", 'yaw.compensator="network"', "yaw.learning_rate=1"))
    sample = tick(new, PUSHED, TARGET)
    assert abs(last.d_hat[3]) > 0.1
    assert sample.weight_norm[3] > 0.01
    for _ in range(round(6 * BLEND_S / TICK_S)):
        sample = tick(new, replace(PUSHED, eta_ahead=sample.x_d, eta_dot_ahead=sample.x_d_dot), TARGET)
    assert sample.d_hat[3] == pytest.approx(last.d_hat[3], rel=0.2)


def test_an_accelerating_path_is_met_where_the_command_acts():
    c = at_rest()
    a = np.array([0.0, 0.0, 0.1, 0.0])
    for k in range(200):
        t_s = k * TICK_S
        sample = tick(c, state(), Setpoint(0.5 * a * t_s**2, a * t_s, a))
    ahead_s = t_s + state().ahead_s
    assert sample.x_d_dot[2] == pytest.approx(0.1 * ahead_s, abs=2e-3)
    assert sample.x_d[2] == pytest.approx(0.05 * ahead_s**2, abs=2e-3)


def test_gains_are_drawn_back_by_their_powers_and_never_drawn_out():
    gains = controller()._gains
    lam, kappa, learning_scale = gains.scheduled(2.0 * gains.delay_s)
    np.testing.assert_allclose(lam, gains.lam * 0.5**0.6)
    np.testing.assert_allclose(kappa, gains.kappa * 0.5**1.4)
    assert learning_scale == pytest.approx(0.25)
    lam, kappa, learning_scale = gains.scheduled(0.0)
    np.testing.assert_array_equal((lam, kappa), (gains.lam, gains.kappa))
    assert learning_scale == 1.0
