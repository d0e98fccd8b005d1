"""Closed forms against integration: the plant may be trusted because algebra says the same."""

import math

import numpy as np
import pytest

from sim_bridge.physics.plant import (
    GRAVITY,
    body_of,
    derivative,
    disturbance,
    rotation,
    state_of,
    step,
)
from sim_bridge.sim_config import Hull

MASS, ADDED, LINEAR, QUADRATIC = 13.5, 18.68, 33.0, 190.0
STILL = (0.0,) * 6


def plant(**changes):
    return body_of(Hull(**({"net_buoyancy_n": 0.0} | changes)))


UNDAMPED = {"linear_damping": STILL, "quadratic_damping": STILL}


def at(eta=(0, 0, 5, 0, 0, 0), nu=STILL):
    return state_of(eta, nu)


def fall(model, state, seconds, tau=STILL, force=(0.0, 0.0, 0.0), flow=STILL, dt=0.005):
    for _ in range(round(seconds / dt)):
        state, _ = step(model, state, tau, force, flow, dt)
    return state


def test_terminal_velocity():
    w = fall(plant(), at(), 20.0, force=(0.0, 0.0, 20.0))[9]
    expected = (-LINEAR + math.sqrt(LINEAR**2 + 4 * QUADRATIC * 20.0)) / (2 * QUADRATIC)
    assert w == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_coriolis_and_centripetal_terms_do_no_work(seed):
    """nu' M nu = 0 of a neutral body without damping, righting moment and thrust, however it moves."""
    rng = np.random.default_rng(seed)
    model = plant(**UNDAMPED, centre_of_buoyancy_up_m=0.0)
    nu = rng.uniform(-2, 2, 6)
    nu_dot = np.array(
        derivative(model, at((0, 0, 5, *rng.uniform(-1, 1, 3)), nu), STILL, (0, 0, 0), STILL)[7:]
    )
    assert np.abs(nu_dot).max() > 0.1
    assert nu @ (np.array(model.M) * nu_dot) == pytest.approx(0.0, abs=1e-11)


def test_a_share_of_coriolis_scales_what_turning_does_to_surge_and_sway_and_the_munk_moment():
    def turning(share):
        still = plant(coriolis_share=share, **UNDAMPED)
        return np.array(derivative(still, at(nu=(0.4, 0.3, 0.0, 0.0, 0.0, 0.5)), STILL, (0, 0, 0), STILL)[7:])

    whole, part = turning((1.0, 1.0, 1.0)), turning((0.5, 0.25, 0.0))
    assert whole[[0, 1, 5]].all()
    np.testing.assert_allclose(part[[0, 1, 5]], whole[[0, 1, 5]] * (0.5, 0.25, 0.0), atol=1e-12)


def test_in_water_that_moves_as_a_whole_a_neutral_body_moves_as_in_still_water():
    """Water that surges to and fro everywhere alike: relative to it all is as if it stood still."""
    model, dt = plant(), 0.001
    start = (0, 0, 20, 0.4, -0.3, 0.9)

    def water(t):
        velocity = np.array([0.3, -0.2, 0.25]) * math.cos(2.0 * t)
        return (*velocity, *(-2.0 * np.array([0.3, -0.2, 0.25]) * math.sin(2.0 * t)))

    still = at(start, (0.5, 0.2, -0.3, 0.6, -0.4, 0.8))
    moved = at(
        start, np.add(still[7:], (*(np.array(rotation(still)).reshape(3, 3).T @ water(0.0)[:3]), 0, 0, 0))
    )
    for count in range(3000):
        still, _ = step(model, still, STILL, (0, 0, 0), STILL, dt)
        moved, _ = step(model, moved, STILL, (0, 0, 0), water((count + 0.5) * dt), dt)
    shift = np.array(water(0.0)[:3]) * math.sin(2.0 * 3.0) / 2.0
    assert np.subtract(moved[:3], still[:3]) == pytest.approx(shift, abs=2e-4)
    assert moved[3:7] == pytest.approx(still[3:7], abs=2e-4)


def test_a_floating_vehicle_bobs_with_the_period_of_its_waterplane():
    """z'' (m + Za) = -B / height z, about the place where it floats."""
    model = plant(**UNDAMPED, net_buoyancy_n=20.0)
    rest = -0.25 * 20.0 / model.B
    period = 2 * math.pi * math.sqrt((MASS + ADDED) * 0.25 / model.B)
    state = fall(model, at((0, 0, rest - 0.01, 0, 0, 0)), period, dt=period / 1000)
    assert state[2] == pytest.approx(rest - 0.01, abs=1e-5)
    half = fall(model, at((0, 0, rest - 0.01, 0, 0, 0)), period / 2, dt=period / 1000)
    assert half[2] == pytest.approx(rest + 0.01, abs=1e-5)


def test_energy_decays_with_damping_and_stays_without():
    def energy(model, state):
        nu = np.array(state[7:])
        tilt = 1 - 2 * (state[4] ** 2 + state[5] ** 2)
        return 0.5 * nu @ (np.array(model.M) * nu) - model.zb * model.B * tilt

    start = at((0, 0, 50, 0.5, 0.3, 0.2), (0.5, 0.2, 0.1, 0.4, -0.3, 0.6))
    free, damped = plant(**UNDAMPED), plant()
    assert energy(free, fall(free, start, 5.0)) == pytest.approx(energy(free, start), rel=1e-3)
    state, last = start, energy(damped, start)
    for _ in range(200):
        state = fall(damped, state, 0.05)
        assert energy(damped, state) <= last
        last = energy(damped, state)


def test_righting_moment_and_its_sign():
    model = plant(centre_of_buoyancy_up_m=0.02)
    roll, pitch = derivative(model, at((0, 0, 5, 0.1, 0.05, 0)), STILL, (0, 0, 0), STILL)[10:12]
    weight = MASS * GRAVITY
    assert roll == pytest.approx(-0.02 * weight * math.cos(0.05) * math.sin(0.1) / (0.26 + 0.189))
    assert pitch == pytest.approx(-0.02 * weight * math.sin(0.05) / (0.23 + 0.135))


def test_tumbling_through_the_vertical_stays_finite_and_normalised():
    state = fall(plant(), at(), 20.0, tau=(20.0, 5.0, 0.0, 1.0, 8.0, 0.5))
    assert np.isfinite(state).all()
    assert np.linalg.norm(state[3:7]) == pytest.approx(1.0)


def test_disturbance_is_what_the_still_water_model_lacks():
    """(m + Za) z'' = Z - (Zl + Zq|z'|) z' + disturbance, whatever the water does."""
    model = plant(net_buoyancy_n=3.0)
    state = at((0, 0, 4, 0, 0, 0.8), (0.0, 0.0, 0.2, 0, 0, 0))
    force, flow, Z = (1.0, -2.0, 7.0), (0.1, 0.0, -0.15, 0.2, 0.1, 0.3), -4.0
    acceleration = derivative(model, state, (0, 0, Z, 0, 0, 0), force, flow)[9]
    lacking = (MASS + ADDED) * acceleration - Z + (LINEAR + QUADRATIC * 0.2) * 0.2
    assert disturbance(model, state, force, flow)[2] == pytest.approx(lacking)
