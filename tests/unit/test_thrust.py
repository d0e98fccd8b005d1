"""Newtons to axes and back. The vehicle that answers is the simulator's: it shares no line with `thrust`."""

import numpy as np
import pytest

from companion.control.allocation import T200_DEMAND, T200_N, Thrusters
from sim_bridge.config import load_config
from sim_bridge.firmware.mixer import mix, motor_pwm
from sim_bridge.physics.thrusters import HEALTHY, each_motor, static_thrust, thrusters_of, wrench

FRAMES = {"vectored_6dof": "config/sim.toml", "vectored": "config/sim-bluerov2.toml"}
UNBOUNDED = np.full(4, 1e6)
FULL = np.ones(4)
AXES = ("surge", "sway", "heave", "yaw")
ENVELOPE = np.array([40.0, 40.0, 60.0, 6.0])
"""What one axis gives alone on either frame at 16 V, with room to spare."""


@pytest.fixture(params=list(FRAMES))
def frame(request):
    return request.param


@pytest.fixture
def thrusters(frame):
    return Thrusters(frame, UNBOUNDED)


def true_wrench(frame, axes, voltage_v, pytestconfig):
    """Surge, sway, heave, yaw of what the stand-in vehicle makes of the axes, after its lag."""
    config = load_config(pytestconfig.rootpath / FRAMES[frame]).thrusters
    surge, sway, heave, yaw = axes
    pwm = motor_pwm(
        mix(frame, (0.0, 0.0, yaw, -heave, surge, sway)), [1.0] * 8 if "6" in frame else [1.0] * 6
    )
    vehicle = thrusters_of(config)
    pushed = wrench(vehicle, static_thrust(vehicle, HEALTHY, each_motor(pwm), voltage_v))
    return np.array(pushed)[[0, 1, 2, 5]]


def test_the_curve_is_that_of_the_facts():
    """T200 at 16 V: dead band 1472..1528 µs, 51.5 N forward, 39.9 N in reverse."""
    for us, newtons in ((1100, -39.9), (1472, 0.0), (1500, 0.0), (1528, 0.0), (1700, 17.9), (1900, 51.5)):
        assert np.interp((us - 1500) / 400, T200_DEMAND, T200_N) == newtons


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("axis", range(4), ids=AXES)
def test_each_axis_alone_has_its_sign_and_reaches_the_vehicle(frame, thrusters, axis, sign, pytestconfig):
    tau = np.zeros(4)
    tau[axis] = sign * 0.5 * ENVELOPE[axis]
    allocation = thrusters.allocate(tau, 16.0, FULL)
    assert np.sign(allocation.axes[axis]) == sign
    assert not allocation.saturated.any()
    for delivered in (
        thrusters.delivered(allocation.axes, 16.0),
        true_wrench(frame, allocation.axes, 16.0, pytestconfig),
    ):
        assert delivered[axis] == pytest.approx(tau[axis], rel=0.05)
        others = np.delete(delivered / ENVELOPE, axis)
        np.testing.assert_allclose(others, 0.0, atol=0.01)


def test_heave_is_exact_because_all_its_motors_do_the_same(thrusters):
    for newtons in (-50.0, -5.0, -0.5, 0.5, 5.0, 50.0):
        axes = thrusters.allocate(np.array([0.0, 0.0, newtons, 0.0]), 16.0, FULL).axes
        assert thrusters.delivered(axes, 16.0)[2] == pytest.approx(newtons, rel=0.02, abs=0.1)


def test_up_takes_more_demand_than_down(thrusters):
    """A T200 pushes less in reverse; the vertical ones push down when driven forward."""
    down = thrusters.allocate(np.array([0.0, 0.0, 60.0, 0.0]), 16.0, FULL).axes[2]
    up = thrusters.allocate(np.array([0.0, 0.0, -60.0, 0.0]), 16.0, FULL).axes[2]
    assert down > 0.0 > up
    assert -up > 1.1 * down


def test_the_dead_band_is_jumped(thrusters):
    """A small force asks for more than the dead band's edge; none asks for nothing."""
    np.testing.assert_array_equal(thrusters.allocate(np.zeros(4), 16.0, FULL).axes, np.zeros(4))
    axes = thrusters.allocate(np.array([0.0, 0.0, 1.0, 0.0]), 16.0, FULL).axes
    assert axes[2] >= 28.0 / 400.0
    np.testing.assert_array_equal(thrusters.delivered(np.array([0.0, 0.0, 0.06, 0.0]), 16.0), np.zeros(4))


def test_a_weak_battery_is_made_up_for(thrusters):
    tau = np.array([10.0, -5.0, 30.0, 1.0])
    strong, weak = (thrusters.allocate(tau, volts, FULL).axes for volts in (16.0, 13.0))
    assert abs(weak[2]) > abs(strong[2])
    np.testing.assert_allclose(thrusters.delivered(weak, 13.0) / ENVELOPE, tau / ENVELOPE, atol=0.03)
    np.testing.assert_allclose(
        thrusters.delivered(strong, 13.0), thrusters.delivered(strong, 16.0) * (13.0 / 16.0) ** 2, rtol=1e-12
    )


def test_delivered_is_what_the_vehicle_gives(frame, thrusters, pytestconfig):
    rng = np.random.default_rng(1)
    for _ in range(30):
        axes = rng.uniform(-1.0, 1.0, 4) * np.array([0.3, 0.3, 0.4, 0.3])
        expected = true_wrench(frame, axes, 15.0, pytestconfig)
        np.testing.assert_allclose(thrusters.delivered(axes, 15.0) / ENVELOPE, expected / ENVELOPE, atol=0.02)


def test_more_than_the_configured_force_is_cut_and_reported(frame):
    thrusters = Thrusters(frame, np.array([10.0, 10.0, 20.0, 2.0]))
    allocation = thrusters.allocate(np.array([5.0, 0.0, 50.0, 0.0]), 16.0, FULL)
    np.testing.assert_array_equal(allocation.saturated, [False, False, True, False])
    assert thrusters.delivered(allocation.axes, 16.0)[2] == pytest.approx(20.0, rel=0.02)


def test_beyond_its_reach_the_horizontal_group_is_scaled_as_one_and_heave_is_not(thrusters):
    tau = np.array([20.0, 10.0, 30.0, 2.0])
    free = thrusters.allocate(tau, 16.0, FULL)
    assert not free.saturated.any()
    reach = np.array([0.5 * free.axes[0], 1.0, 1.0, 1.0])
    short = thrusters.allocate(tau, 16.0, reach)
    np.testing.assert_array_equal(short.saturated, [True, True, False, True])
    np.testing.assert_allclose(short.axes[[0, 1, 3]], 0.5 * free.axes[[0, 1, 3]], rtol=1e-12)
    assert short.axes[2] == free.axes[2]


def test_beyond_its_reach_heave_alone_is_scaled(thrusters):
    free = thrusters.allocate(np.array([20.0, 10.0, 30.0, 2.0]), 16.0, FULL)
    short = thrusters.allocate(np.array([20.0, 10.0, 30.0, 2.0]), 16.0, np.array([1.0, 1.0, 0.1, 1.0]))
    np.testing.assert_array_equal(short.saturated, [False, False, True, False])
    assert short.axes[2] == pytest.approx(0.1)
    np.testing.assert_array_equal(short.axes[[0, 1, 3]], free.axes[[0, 1, 3]])


def test_no_horizontal_motor_is_asked_for_more_than_it_has(thrusters):
    """Three axes share four motors: their sum counts."""
    allocation = thrusters.allocate(np.array([60.0, 60.0, 0.0, 10.0]), 16.0, FULL)
    np.testing.assert_array_equal(allocation.saturated, [True, True, False, True])
    assert np.abs(allocation.axes[[0, 1, 3]]).sum() <= 1.0 + 1e-9


def test_axes_from_motors_undoes_the_firmwares_mixing(frame, thrusters):
    """From PWM as the stand-in autopilot mixes it, so neither side can cheat."""
    rng = np.random.default_rng(2)
    assert thrusters.count == (8 if frame == "vectored_6dof" else 6)
    for _ in range(20):
        surge, sway, heave, yaw = axes = rng.uniform(-0.2, 0.2, 4)
        pwm = motor_pwm(mix(frame, (0.0, 0.0, yaw, -heave, surge, sway)), [1.0] * thrusters.count)
        motors = (np.array(pwm) - 1500.0) / 400.0
        np.testing.assert_allclose(thrusters.axes_from_motors(motors), axes, atol=2.0 / 400.0)


def test_a_batch_of_dives_is_what_single_dives_are(thrusters):
    rng = np.random.default_rng(3)
    tau = rng.normal(size=(40, 4)) * ENVELOPE
    together = thrusters.allocate(tau, 15.0, FULL)
    wrench = thrusters.delivered(together.axes, 15.0)
    for i in range(40):
        alone = thrusters.allocate(tau[i], 15.0, FULL)
        np.testing.assert_allclose(together.axes[i], alone.axes, rtol=1e-12, atol=1e-14)
        np.testing.assert_array_equal(together.saturated[i], alone.saturated)
        np.testing.assert_allclose(wrench[i], thrusters.delivered(alone.axes, 15.0), rtol=1e-11, atol=1e-12)
