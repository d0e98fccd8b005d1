"""Water, tether and load are as strong as they claim, and reproducible."""

import math

import numpy as np
import pytest
from sim_wire import CALM, CONFIG

from sim_bridge.physics.body import Physics
from sim_bridge.physics.environment import Environment, OrnsteinUhlenbeck
from sim_bridge.physics.plant import GRAVITY, state_of
from sim_bridge.physics.waves import Sea
from sim_bridge.sim_config import Waves, load_config

DT = 0.02


def sea(seed=0, depth_m=math.inf, **changes):
    return Sea(Waves(enabled=True, **changes), np.random.default_rng(seed), depth_m)


def at(z, nu=(0,) * 6):
    return state_of((0, 0, z, 0, 0, 0), nu)


def test_significant_height_is_four_standard_deviations():
    surface = sea(height_m=0.3)
    heights = [surface.elevation(t, 0.0, 0.0, 0.0) for t in np.arange(0, 2000, 0.5)]
    assert 4 * np.std(heights) == pytest.approx(0.3, rel=0.05)


def test_the_regular_wave_has_its_height_and_period_and_decays():
    wave = sea(spectrum="regular", height_m=0.4, period_s=5.0)
    k = (2 * math.pi / 5.0) ** 2 / GRAVITY
    assert wave.elevation(2.0, 0, 0, 0) == pytest.approx(wave.elevation(7.0, 0, 0, 0))
    for z, height in ((0.0, 0.4), (3.0, 0.4 * math.exp(-3.0 * k))):
        felt = [wave.elevation(t, 0, 0, z) for t in np.arange(0, 5, 0.01)]
        assert max(felt) - min(felt) == pytest.approx(height, rel=1e-4)
        speeds = [np.hypot(*np.array(wave.flow(t, 0, 0, z))[[0, 2]]) for t in (0.0, 0.7, 1.9)]
        assert speeds == pytest.approx([math.pi / 5.0 * height] * 3)


def test_over_a_seabed_waves_disperse_and_end_there():
    shallow = sea(depth_m=4.0, period_s=6.0, direction_deg=30.0)
    assert shallow.omega**2 == pytest.approx(GRAVITY * shallow.k * np.tanh(4.0 * shallow.k))
    assert shallow.flow(3.0, 1.0, 2.0, 4.0)[2] == pytest.approx(0.0, abs=1e-12)
    assert abs(shallow.flow(3.0, 1.0, 2.0, 4.0)[0]) > 1e-3
    rise = (shallow.elevation(5.001, 0, 0, 0) - shallow.elevation(4.999, 0, 0, 0)) / 0.002
    assert shallow.flow(5.0, 0, 0, 0)[2] == pytest.approx(-rise, abs=1e-5)


def test_over_a_seabed_water_is_conserved_and_its_pressure_moves_it():
    """The divergence of Airy's flow is zero, and the acceleration is -g times the slope of the pressure."""
    shallow, d = sea(depth_m=4.0, period_s=6.0, direction_deg=30.0), 1e-4
    place = np.array([1.0, 2.0, 1.5])
    slopes, divergence = [], 0.0
    for axis in np.eye(3):
        ahead, behind = place + d * axis, place - d * axis
        divergence += (np.subtract(shallow.flow(3.0, *ahead), shallow.flow(3.0, *behind))[:3] @ axis) / (
            2 * d
        )
        slopes.append((shallow.elevation(3.0, *ahead) - shallow.elevation(3.0, *behind)) / (2 * d))
    assert divergence == pytest.approx(0.0, abs=1e-8)
    assert shallow.flow(3.0, *place)[3:] == pytest.approx(-GRAVITY * np.array(slopes), abs=1e-6)


@pytest.mark.parametrize("depth_m", [math.inf, 6.0])
def test_the_pressure_beside_the_flow_is_that_of_the_elevation(depth_m):
    surface = sea(depth_m=depth_m, direction_deg=70.0)
    surface.flow(8.0, 2.0, -3.0, 2.5)
    assert surface.pressure_m == pytest.approx(surface.elevation(8.0, 2.0, -3.0, 2.5), abs=1e-12)


def test_ornstein_uhlenbeck_has_its_sigma_and_correlation_time():
    signal = OrnsteinUhlenbeck(5.0, 2.0, DT, np.random.default_rng(1))
    values = np.array([signal.step() for _ in range(200_000)])
    assert values.std() == pytest.approx(5.0, rel=0.06)
    lag = round(2.0 / DT)
    assert np.corrcoef(values[:-lag], values[lag:])[0, 1] == pytest.approx(math.exp(-1), abs=0.06)


def environment(*overrides, seed=0):
    return Environment(load_config(CONFIG, [*CALM, *overrides]), DT, np.random.default_rng(seed))


def test_current_follows_its_profile_and_turns():
    still = "sigma_m_s=0.0, speed_m_s=0.4, direction_deg=0"
    sheared = environment(f"current={{enabled=true, {still}, profile=[[2, 1.0], [6, 0.5], [10, -0.5]]}}")
    assert [sheared.step(0, 0, at(z))[1][0] for z in (0, 2, 4, 8, 30)] == pytest.approx(
        [0.4, 0.4, 0.3, 0, -0.2]
    )
    turning = environment(f"current={{enabled=true, {still}, turn_deg_s=2.0}}")
    assert turning.step(45.0, 0, at(5))[1][:2] == pytest.approx((0.0, 0.4))


def test_a_fall_on_the_seabed_creates_no_energy():
    overrides = ("hull.net_buoyancy_n=-30", "initial.eta=[0,0,3,0.3,0.2,0]")
    config = load_config(CONFIG, [*CALM, "seabed={enabled=true, depth_m=4.0}", *overrides])
    physics = Physics(config, 1)
    energies = []
    for _ in range(2000):
        physics.step([1500] * 8, -1.0)
        nu, z = np.array(physics.state[7:]), physics.state[2]
        tilt = 1 - 2 * (physics.state[4] ** 2 + physics.state[5] ** 2)
        energies.append(
            0.5 * nu @ (np.array(physics.body.M) * nu)
            - 30.0 * z
            - physics.body.zb * physics.body.B * tilt
            + 0.5 * config.seabed.stiffness_n_per_m * max(0.0, z - (4.0 - 0.125)) ** 2
        )
    assert physics.state[2] == pytest.approx(4.0 - 0.125 + 30.0 / 2000.0, abs=1e-3)
    assert np.diff(energies).max() < 1e-3 * (energies[0] - energies[-1])


def test_tether_pulls():
    water = environment("tether={enabled=true, sigma_n=[0,0,0], pull_n=[1,-2,3], tau_s=2}")
    assert water.step(0, 0, at(4))[0] == pytest.approx((1, -2, 3))
