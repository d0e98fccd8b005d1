"""Reference, law and compensators joined: the right numbers at the right place, and no step on engaging."""

import numpy as np
import pytest
from alone import ALL, TICK_S, Law
from builders import RESTING
from msgspec import structs

from companion.config import load_config
from companion.core.actuation import NONE
from companion.records import ZERO, Setpoint


def state(eta=ZERO, eta_dot=ZERO, disturbance=ZERO):
    return structs.replace(
        RESTING, eta=eta, eta_dot=eta_dot, eta_ahead=eta, eta_dot_ahead=eta_dot, disturbance=disturbance
    )


HEAVE_ONLY = (False, False, True, True)


def tick(c, s, target, *rest, **more):
    return c.tick(s, target, *rest, **more)


def at_rest(*overrides, where=None):
    c = Law(*overrides)
    c.rest(where or state())
    c.set_gain_scale(1.0)
    return c


@pytest.mark.parametrize("dof", range(4))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_every_degree_of_freedom_is_pulled_back(dof, sign):
    """Moved off its place: tau = -m kappa lambda e there, and nothing elsewhere (heading north)."""
    config = load_config()
    c = at_rest()
    moved = [0.0] * 4
    moved[dof] = sign * 0.05
    sample = tick(c, state(moved), Setpoint((0.0,) * 4))
    axis = config.axes[dof]
    expected = -axis.mass * axis.kappa_per_s * axis.lambda_per_s * moved[dof]
    assert sample.tau[dof] == pytest.approx(expected, rel=1e-9)
    assert sample.e[dof] == pytest.approx(moved[dof])
    np.testing.assert_allclose(np.delete(sample.tau, dof), 0.0, atol=1e-9)


def test_a_heading_error_across_south_is_small():
    c = at_rest(where=state((0.0, 0.0, 0.0, 3.1)))
    s = state((0.0, 0.0, 0.0, -3.1))
    sample = tick(c, s, Setpoint((0.0, 0.0, 0.0, 3.1)))
    assert sample.e[3] == pytest.approx(2 * np.pi - 6.2, abs=1e-6)
    assert sample.tau[3] < 0.0


def each(name):
    return [f"{axis}.compensator={name}" for axis in ("surge", "sway", "heave", "yaw")]


def test_the_observers_disturbance_is_met_where_it_is_chosen_and_bounded():
    d = (5.0, -3.0, 900.0, -900.0)
    sample = tick(at_rest(*each("observer")), state(disturbance=d), Setpoint((0.0,) * 4))
    np.testing.assert_allclose(sample.d_hat, [5.0, -3.0, 100.0, -6.0])
    np.testing.assert_allclose(sample.tau, sample.d_hat, atol=1e-9)
    np.testing.assert_array_equal(sample.d_observer, d)


def test_while_the_loop_swings_an_estimate_becomes_thrust_slowly_and_in_the_end_wholly():
    """Its oscillation is reduced; its mean stays compensated, or a load would sink the vehicle."""
    c = at_rest(*each("observer"))
    load = np.array([5.0, -3.0, 15.0, 2.0])
    swinging = []
    for i in range(1000):
        c.set_gain_scale(0.2)
        swing = 0.5 * load * np.sin(2.0 * np.pi * 1.5 * i * TICK_S)
        swinging.append(tick(c, state(disturbance=load + swing), Setpoint((0.0,) * 4)).d_hat)
    settled = np.array(swinging)[-500:]
    assert (np.ptp(settled, axis=0) < 0.25 * np.abs(load)).all()
    np.testing.assert_allclose(settled.mean(0), load, rtol=0.02)
    c.set_gain_scale(1.0)
    np.testing.assert_allclose(tick(c, state(disturbance=-load), Setpoint((0.0,) * 4)).d_hat, -load)


NETWORK = [*each("network"), *[f"{axis}.learning_rate=5" for axis in ("surge", "sway", "heave", "yaw")]]


def learn(c, seconds, engaged=ALL, saturated=NONE):
    sample = None
    for _ in range(round(seconds / TICK_S)):
        sample = tick(c, state((0.1,) * 4), Setpoint((0.0,) * 4), engaged, saturated)
    return sample


def test_the_network_waits_then_learns_against_the_error():
    c = at_rest(*NETWORK)
    sample = learn(c, 1.9)
    assert not any(sample.adapting)
    np.testing.assert_array_equal(sample.d_hat, 0.0)
    sample = learn(c, 0.5)
    assert all(sample.adapting)
    assert max(sample.d_hat) < 0.0
    assert min(sample.weight_norm) > 0.0


def test_the_network_learns_only_where_engaged_and_free_of_saturation():
    c = at_rest(*NETWORK)
    saturated = (False, False, True, False)
    sample = learn(c, 2.5, HEAVE_ONLY, saturated)
    assert sample.adapting == (False, False, False, True)
    assert sample.saturated == saturated
    assert sample.weight_norm[:3] == (0.0, 0.0, 0.0)


def test_what_is_idle_keeps_what_it_learnt_and_asks_nothing():
    """Its position was lost: nothing is computed of a motion that nobody knows."""
    c = at_rest('surge.compensator="network"')
    off = Setpoint((0.2, 0.0, 0.0, 0.0))
    for _ in range(400):
        held = tick(c, state(), off)
    lost = tick(c, state((5.0, 0.0, 0.0, 0.0)), off, HEAVE_ONLY, idle=(True, True, False, False))
    assert held.weight_norm[0] > 0.1
    assert (lost.tau[0], lost.e[0], lost.x_d[0]) == (0.0, 0.0, held.x_d[0])
    assert lost.weight_norm[0] == held.weight_norm[0]


def test_resting_forgets_what_was_learnt_and_starts_the_wait_anew():
    c = at_rest(*NETWORK)
    learn(c, 3.0)
    c.rest(state())
    sample = learn(c, 0.1)
    np.testing.assert_array_equal(sample.weight_norm, 0.0)
    assert not any(sample.adapting)


def test_engaging_on_the_move_is_no_step():
    """The reference starts where the vehicle is, moving as it does: what is asked is the model's own drag."""
    s = state((0.0, 0.0, 3.0, 0.2), (0.1, -0.1, 0.3, 0.2))
    sample = tick(at_rest(where=s), s, Setpoint((0.0, 0.0, 9.0, -2.0)))
    assert np.abs(sample.e).max() <= 0.8 * TICK_S
    assert np.abs(sample.e_dot).max() <= 0.02


def test_a_path_is_looked_ahead_along_by_as_much_as_the_state_is():
    """The law compares what will be with what will be wanted then."""
    c = at_rest(where=state((0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.2, 0.0)))
    rate = (0.0, 0.0, 0.2, 0.0)
    for k in range(500):
        s = structs.replace(state((0.0, 0.0, 0.2 * (k * TICK_S + 0.1), 0.0), rate), ahead_s=0.1)
        sample = tick(c, s, Setpoint((0.0, 0.0, 0.2 * (k * TICK_S), 0.0), rate))
    assert sample.e[2] == pytest.approx(0.0, abs=1e-3)
    assert sample.x_d_dot[2] == pytest.approx(0.2, abs=1e-3)
