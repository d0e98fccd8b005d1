"""Curve, lag and geometry of the thrusters; with the mixer, one test per axis pins the signs."""

import math

import numpy as np
import pytest
from sim_wire import CONFIG, Station, override, vehicle

from sim_bridge.firmware.mixer import mix
from sim_bridge.physics.body import Physics
from sim_bridge.physics.thrusters import (
    FULL_N,
    HEALTHY,
    NO_THRUST,
    each_motor,
    in_water,
    inflow,
    static_thrust,
    thrusters_of,
    wrench,
)
from sim_bridge.sim_config import load_config

CONFIGS = {"vectored_6dof": CONFIG, "vectored": CONFIG.with_name("sim-bluerov2.toml")}


def thrusters(frame="vectored_6dof", *overrides):
    return thrusters_of(load_config(CONFIGS[frame], overrides).thrusters)


def steady(set_, pwm, voltage_v=16.0, health=HEALTHY):
    return np.array(static_thrust(set_, health, each_motor(pwm), voltage_v))


def test_dead_band_is_dead_to_its_edges_and_configurable():
    assert not steady(thrusters(), [1472, 1528, 1473, 1527, 1490, 1510, 1500, 1500]).any()
    narrow = thrusters("vectored_6dof", "thrusters.dead_band_us=10.0")
    assert (steady(narrow, [1511] * 8) > 0).all()
    assert not steady(narrow, [1510] * 8).any()


def turned_on(start_s, delay_s=0.0, pwm=(1600,), each_s=0.5):
    """Return the thrust (N) of the first motor every 5 ms, driven by each PWM for `each_s`; no lag."""
    body = Physics(
        load_config(
            CONFIG, ["thrusters.lag_s=0", f"thrusters.start_s={start_s}", f"thrusters.delay_s={delay_s}"]
        ),
        1,
    )
    given = []
    for us in pwm:
        for _ in range(round(each_s / 0.005)):
            body.step([us] * 8, 0.0, 0.005)
            given.append(body.thrust_n[0])
    return np.array(given)


def since_s(thrust, newtons):
    return 0.005 * (np.flatnonzero(np.isclose(thrust, newtons))[0] + 1)


def test_a_motor_at_rest_and_one_that_reverses_start_late_and_stop_at_once():
    thrust = turned_on(0.16, pwm=(1600, 1500, 1600, 1400, 1700, 1600))
    ahead, off, again, back, reversed_again, less = np.split(thrust, 6)
    for part, newtons in ((ahead, 5.9), (again, 5.9), (back, -4.7), (reversed_again, 17.9)):
        assert not part[:31].any()
        assert since_s(part, newtons) == pytest.approx(0.16)
    assert not off.any()
    assert less == pytest.approx(5.9)


def test_a_command_reaches_the_motors_late():
    thrust = turned_on(0.0, delay_s=0.1, pwm=(1600, 1500))
    assert since_s(thrust, 5.9) == pytest.approx(0.105)
    assert np.flatnonzero(thrust)[-1] == pytest.approx(np.flatnonzero(thrust)[0] + 99)


@pytest.mark.parametrize("frame", CONFIGS)
def test_the_wrench_is_that_of_forces_at_their_places(frame):
    """Sum of directions, and of positions × directions."""
    set_ = thrusters(frame)
    (hx, hy, hz), (vx, vy, vz), c = set_.horizontal_m, set_.vertical_m, math.sqrt(0.5)
    places = [(hx, hy, hz), (hx, -hy, hz), (-hx, hy, hz), (-hx, -hy, hz)]
    places += [(vx, vy, vz), (vx, -vy, vz), (-vx, vy, vz), (-vx, -vy, vz)]
    ways = [(-c, c, 0.0), (-c, -c, 0.0), (c, c, 0.0), (c, -c, 0.0), *[(0.0, 0.0, 1.0)] * 4]
    thrust = np.arange(1.0, 9.0) ** 2 * (1, 1, 1, 1, 1, 1, set_.number == 8, set_.number == 8)
    expected = thrust @ np.concatenate([ways, np.cross(places, ways)], axis=1)
    assert wrench(set_, tuple(thrust)) == pytest.approx(expected)


@pytest.mark.parametrize("frame", CONFIGS)
def test_inflow_is_the_transpose_of_the_wrench(frame):
    """The power of thrust on the vehicle is that of each thruster on the water that it meets."""
    rng = np.random.default_rng(1)
    set_ = thrusters(frame)
    thrust = rng.uniform(-50, 50, 8) * (1, 1, 1, 1, 1, 1, set_.number == 8, set_.number == 8)
    nu = rng.uniform(-1, 1, 6)
    assert thrust @ inflow(set_, tuple(nu)) == pytest.approx(np.array(wrench(set_, tuple(thrust))) @ nu)


def test_inflow_takes_thrust_ahead_and_adds_to_it_in_braking():
    full, quarter = (FULL_N,) * 8, (FULL_N / 4,) * 8
    assert in_water(full, (4.0,) * 8, 4.0, 1.0) == pytest.approx(NO_THRUST)
    assert in_water(quarter, (2.0,) * 8, 4.0, 1.0) == pytest.approx(NO_THRUST)
    assert in_water(full, (1.0,) * 8, 4.0, 1.0)[0] == pytest.approx(0.75 * FULL_N)
    assert in_water((-FULL_N,) * 8, (1.0,) * 8, 4.0, 1.0)[0] == pytest.approx(-1.25 * FULL_N)
    assert in_water(full, (1.0,) * 8, 0.0, 0.5) == pytest.approx([FULL_N / 2] * 8)


def test_a_vehicle_ahead_is_slower_with_inflow_and_helpless_out_of_the_water():
    def speed(*overrides):
        rov = vehicle("initial.eta=[0,0,5,0,0,0]", *overrides)
        Station(rov).arm().run(6.0, override(forward=400))
        return rov.truth()

    bollard, real = speed(), speed("thrusters.free_speed_m_s=4.0")
    assert 0.75 < real.nu[0] / bollard.nu[0] < 0.95
    dry = vehicle("thrusters.dry_height_m=0.1", "initial.eta=[0,0,-0.2,0,0,0]", "hull.net_buoyancy_n=200")
    Station(dry).arm().run(1.0, override(forward=400))
    assert max(np.abs(dry.truth().thrust_n)) < 1.0


def test_six_dof_groups_share_saturation_by_their_own_largest():
    outputs = np.array(mix("vectored_6dof", (1, 1, 0.25, 1, 0, 0.5)))
    assert outputs[4:] == pytest.approx(np.array([-1.0, -3.0, 1.0, -1.0]) / 3.0)
    assert outputs[:4] == pytest.approx([0.75, -0.75, 0.25, -0.25])


def test_vectored_clips_each_motor_and_heave_takes_surge_from_the_rear_pair():
    assert max(map(abs, mix("vectored", (1, 0, 1, 1, 1, 1)))) == 1.0
    outputs = mix("vectored", (0, 0, 0, 1.0, 0.8, 0))
    assert outputs[:4] == pytest.approx([-0.8, -0.8, 0.0, 0.0])
    backwards = mix("vectored", (0, 0, 0, 1.0, -0.8, 0))
    assert backwards[:4] == pytest.approx([0.0, 0.0, -0.8, -0.8])
