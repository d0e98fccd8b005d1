"""Newtons to axes and back. The simulator's vehicle answers: it shares no line with `allocation`."""

import math

import numpy as np
import pytest
from true_thrust import FRAMES, true_wrench

from companion.core.allocation import (
    allocate,
    axes_from_motors,
    delivered,
    thrusters,
)
from sim_bridge.firmware.mixer import mix, motor_pwm

UNBOUNDED = (1e6,) * 6
FULL = np.ones(4)
AXES = ("surge", "sway", "heave", "yaw")
ENVELOPE = np.array([40.0, 40.0, 60.0, 6.0])
"""What one axis gives alone on either frame at 16 V, with room to spare."""


@pytest.fixture(params=list(FRAMES))
def frame(request):
    return request.param


class Frame:
    """The first four axes of a frame, as arrays."""

    def __init__(self, frame, max_tau=UNBOUNDED):
        self.thrusters = thrusters(frame, max_tau, True)

    def allocate(self, tau, voltage_v=16.0, reach=FULL):
        """Return the axes and which are saturated."""
        axes, saturated = allocate(self.thrusters, (*tau, 0.0, 0.0), voltage_v, (*reach, 1.0, 1.0))
        return np.array(axes[:4]), np.array(saturated[:4])

    def delivered(self, axes, voltage_v=16.0):
        return np.array(delivered(self.thrusters, (*axes, 0.0, 0.0), voltage_v)[:4])


@pytest.fixture
def vehicle(frame):
    return Frame(frame)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("axis", range(4), ids=AXES)
def test_each_axis_alone_has_its_sign_and_reaches_the_vehicle(frame, vehicle, axis, sign):
    tau = np.zeros(4)
    tau[axis] = sign * 0.5 * ENVELOPE[axis]
    axes, saturated = vehicle.allocate(tau)
    assert np.sign(axes[axis]) == sign
    assert not saturated.any()
    for given in (vehicle.delivered(axes), true_wrench(frame, axes)[:4]):
        assert given[axis] == pytest.approx(tau[axis], rel=0.05)
        others = np.delete(given / ENVELOPE, axis)
        np.testing.assert_allclose(others, 0.0, atol=0.01)


def test_the_dead_band_is_jumped(vehicle):
    """A small force asks for more than the dead band's edge; none asks for nothing."""
    assert not vehicle.allocate([0.0] * 4)[0].any()
    assert vehicle.allocate([0.0, 0.0, 1.0, 0.0])[0][2] >= 28.0 / 400.0
    assert not vehicle.delivered([0.0, 0.0, 0.06, 0.0]).any()


def test_delivered_is_what_the_vehicle_gives(frame, vehicle):
    rng = np.random.default_rng(1)
    for _ in range(30):
        axes = rng.uniform(-1.0, 1.0, 4) * np.array([0.3, 0.3, 0.4, 0.3])
        expected = true_wrench(frame, axes, 15.0)[:4]
        np.testing.assert_allclose(vehicle.delivered(axes, 15.0) / ENVELOPE, expected / ENVELOPE, atol=0.02)


def test_beyond_its_reach_the_place_gives_way_to_the_heading_and_heave_is_as_it_was(vehicle):
    tau = [20.0, 10.0, 30.0, 2.0]
    free, saturated = vehicle.allocate(tau)
    assert not saturated.any()
    short, saturated = vehicle.allocate(tau, 16.0, [0.5 * free[0], 1.0, 1.0, 1.0])
    np.testing.assert_array_equal(saturated, [True, True, False, False])
    forward_n, right_n, _, turning_nm = vehicle.delivered(short)
    assert turning_nm == pytest.approx(2.0, abs=0.3)
    assert 2.0 < forward_n < 10.0
    assert right_n == pytest.approx(0.5 * forward_n, abs=0.6)
    assert 0.4 * free[0] < short[0] <= 0.5 * free[0]
    assert short[2] == free[2]


@pytest.mark.parametrize("heading_nm", [-10.0, 4.0])
@pytest.mark.parametrize("force", [(75.0, 30.0), (-75.0, -30.0), (70.0, 70.0), (-50.0, 60.0)])
def test_a_force_that_saturates_leaves_the_heading_its_moment(vehicle, force, heading_nm):
    axes, saturated = vehicle.allocate([*force, 0.0, heading_nm], 13.5)
    np.testing.assert_array_equal(saturated, [True, True, False, False])
    forward_n, right_n, _, turning_nm = vehicle.delivered(axes, 13.5)
    assert turning_nm == pytest.approx(heading_nm, abs=0.5)
    assert math.hypot(forward_n, right_n) > 24.0
    turned = math.atan2(right_n, forward_n) - math.atan2(force[1], force[0])
    assert abs(math.remainder(turned, math.tau)) < 0.1


def test_beyond_its_reach_heave_alone_is_scaled(vehicle):
    tau = [20.0, 10.0, 30.0, 2.0]
    free, _ = vehicle.allocate(tau)
    short, saturated = vehicle.allocate(tau, 16.0, [1.0, 1.0, 0.1, 1.0])
    np.testing.assert_array_equal(saturated, [False, False, True, False])
    assert short[2] == pytest.approx(0.1)
    np.testing.assert_array_equal(short[[0, 1, 3]], free[[0, 1, 3]])


def test_axes_from_motors_undoes_the_firmwares_mixing(frame, vehicle):
    """From PWM as the stand-in autopilot mixes it, so neither side can cheat."""
    rng = np.random.default_rng(2)
    count = vehicle.thrusters.motor_count
    assert count == (8 if frame == "vectored_6dof" else 6)
    for _ in range(20):
        surge, sway, heave, yaw = axes = rng.uniform(-0.2, 0.2, 4)
        pwm = motor_pwm(mix(frame, (0.0, 0.0, yaw, -heave, surge, sway)), [1.0] * count)
        motors = tuple((us - 1500.0) / 400.0 for us in pwm)
        np.testing.assert_allclose(axes_from_motors(vehicle.thrusters, motors)[:4], axes, atol=2.0 / 400.0)


def test_a_wrench_that_is_no_number_gives_no_number_on_its_axes(vehicle):
    """The supervisor's guard then sends neutral."""
    axes, saturated = vehicle.allocate([math.nan, 0.0, 5.0, 0.0])
    assert np.isnan(axes[[0, 1, 3]]).all()
    assert np.isfinite(axes[2])
    assert saturated[0]
