"""Roll and pitch held at an angle, with depth, place and heading."""

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from virtual import Dive, Somebody, hold, shared

from companion.guidance.paths.shapes import build
from companion.guidance.paths.time_law import limits
from companion.records import Condition, Request, State
from companion.telemetry.operator_commands import Goto, SetPath
from companion.telemetry.plan import Circle, PathPlan

ROUGH = ("sensors.dvl=true", "sensors.dvl_drift_m=0.0", "current.speed_m_s=0.3", "waves.enabled=true")
WHERE = np.array((0.0, 0.0, 2.5, 0.3))


@shared
def held(*plant, **arguments):
    dive = Dive("initial.eta=[0,0,2.5,0,0,0.3]", *plant, setpoint=hold(z=2.5, x=0.0, y=0.0), **arguments)
    dive.tap.to_vehicle.append(Somebody().origin())
    dive.until(State.ACTIVE)
    dive.run(12.0)
    return dive


@shared
def level():
    """A dive of which eight seconds held level are known: it, and the RMS of its depth, mm."""
    dive = held(*ROUGH)
    return dive, depth_mm(dive.run(8.0))


def angles(steps):
    """Roll and pitch of the true vehicle in degrees, (n, 2)."""
    return np.degrees([step.truth.eta[3:5] for step in steps])


def depth_mm(steps):
    return 1e3 * float(np.sqrt(np.mean([(step.truth.eta[2] - 2.5) ** 2 for step in steps])))


@pytest.mark.parametrize("asked", [(0.0, -55.0), (55.0, 0.0), (-25.0, 35.0)], ids=str)
def test_depth_and_place_are_held_at_an_angle_as_level(asked):
    dive, level_mm = level()
    roll, pitch = asked
    dive.engine.guide(Goto(roll_deg=roll, pitch_deg=pitch))
    moving, steps = dive.run(5.0), dive.run(10.0)
    np.testing.assert_allclose(angles(steps).mean(axis=0), asked, atol=1.0)
    assert angles(steps).std(axis=0).max() < 3.5
    assert depth_mm(moving) < 8.0
    assert depth_mm(steps) < 1.6 * level_mm + 1.0
    places = np.array([step.truth.eta[:2] for step in steps])
    assert np.hypot(*places.T).max() < 0.1
    assert not any(step.sample.verdict.conditions & Condition.TILTED for step in [*moving, *steps])
    reported = dive.step.sample.angles_d
    np.testing.assert_allclose(np.degrees(reported), asked, atol=0.1)


def test_a_path_may_name_an_angle():
    dive = held(*ROUGH)
    circle = Circle(radius_m=1.0, depth_m=2.5)
    plan = PathPlan(circle=circle, speed_mps=0.2, pitch_deg=20.0, heading="along")
    dive.engine.guide(build(plan, limits(dive.engine.config)))
    dive.run(8.0)
    steps = dive.run(10.0)
    np.testing.assert_allclose(angles(steps).mean(axis=0), (0.0, 20.0), atol=1.5)
    e = np.array([step.sample.dofs.e for step in steps])
    assert np.abs(e[:, 2]).max() < 0.02
    assert np.hypot(e[:, 0], e[:, 1]).max() < 0.1
    assert np.abs(np.degrees(e[:, 3])).max() < 4.0


def test_engaged_again_it_is_level_and_a_path_that_goes_on_has_its_angle_again():
    dive = held(*ROUGH)
    plan = PathPlan(circle=Circle(radius_m=1.0, depth_m=2.5), speed_mps=0.2, pitch_deg=20.0)
    dive.engine.guide(build(plan, limits(dive.engine.config)))
    dive.run(5.0)
    dive.ask(Request.STOP)
    dive.run(3.0)
    assert dive.engine.verdict.authority == 0.0
    dive.ask(Request.ENGAGE)
    dive.until(State.ACTIVE)
    steps = dive.run(8.0)[-200:]
    assert np.abs(angles(steps)).max() < 8.0
    np.testing.assert_allclose(dive.step.sample.angles_d, 0.0)
    dive.engine.guide(SetPath(action="resume"))
    dive.run(4.0)
    np.testing.assert_allclose(np.degrees(dive.step.sample.angles_d), (0.0, 20.0), atol=0.5)


def quaternion(roll, pitch, heading):
    (sr, cr), (sp, cp), (sy, cy) = ((math.sin(a / 2.0), math.cos(a / 2.0)) for a in (roll, pitch, heading))
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def test_the_ground_station_sets_angles_heading_and_climb():
    dive = held(*ROUGH, pilot=True)
    dive.cockpit.push()
    passed = len(dive.cockpit.passed)

    def asks(mask, thrust, *euler):
        message = mavlink.MAVLink_set_attitude_target_message(
            0, 1, 1, mask, quaternion(*map(math.radians, euler)), 0.0, 0.0, 0.0, thrust
        )
        dive.cockpit.extra.append(dive.cockpit.frame(message))

    asks(0b0000_0111, 0.5, 10.0, 25.0, 40.0)
    dive.run(8.0)
    np.testing.assert_allclose(np.degrees(dive.step.sample.angles_d), (10.0, 25.0), atol=0.1)
    np.testing.assert_allclose(dive.engine.target[2:], (2.5, math.radians(40.0)), atol=1e-3)
    asks(0b1000_0111, 0.25, 0.0, 0.0, 0.0)
    sinks = dive.run(1.0)
    assert max(step.sample.dofs.x_d_dot[2] for step in sinks) > 0.05
    np.testing.assert_allclose(np.degrees(dive.step.sample.angles_d), (10.0, 25.0), atol=0.1)
    asks(0b0100_0111, 0.0, 0.0, 80.0, 40.0)
    dive.run(6.0)
    np.testing.assert_allclose(np.degrees(dive.step.sample.angles_d), (0.0, 55.0), atol=0.1)
    said = dive.cockpit.passed[passed:]
    assert all(said[i + 7] != 82 for i in range(len(said) - 9) if said[i] == 0xFD), "the vehicle got it, too"


def test_a_place_that_comes_with_velocity_and_acceleration_moves_on():
    dive = held(*ROUGH, pilot=True)
    dive.cockpit.push()

    def asks(place, velocity, acceleration):
        message = mavlink.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, mavlink.MAV_FRAME_LOCAL_NED, 0xC00, *place, *velocity, *acceleration, 0.0, 0.0
        )
        dive.cockpit.extra.append(dive.cockpit.frame(message))

    speed, errors = 0.1, []
    for k in range(60):
        t_s = 0.2 * k
        asks((speed * t_s, 0.0, 2.5), (speed, 0.0, 0.0), (0.0, 0.0, 0.0))
        errors += [step.sample.eta_d[0] - speed * t_s for step in dive.run(0.2)]
    assert np.ptp(errors[-200:]) < 0.03, "between the messages it moves on"
    assert abs(np.mean(errors[-200:]) - 0.1 * speed) < 0.03
    stops = dive.run(4.0)
    assert abs(stops[-1].sample.dofs.x_d_dot[0]) < 0.01
    assert stops[-1].sample.eta_d[0] < speed * (0.2 * 59 + 1.2)
