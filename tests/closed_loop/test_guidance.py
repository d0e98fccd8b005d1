"""Places and paths through the whole loop: held, followed, paused, and without a position for a while."""

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from virtual import Dive, Somebody, active, hold, shared

from companion.core.bounds import wrap
from companion.guidance.paths.shapes import build
from companion.guidance.paths.time_law import limits
from companion.records import Condition, State, X
from companion.telemetry.operator_commands import Goto, SetPath, SetVelocity
from companion.telemetry.plan import Circle, Lemniscate, PathPlan, Waypoint

DVL = ("sensors.dvl=true", "initial.eta=[0,0,2,0,0,0]", "current.enabled=true")
CALM = (*DVL, "current.speed_m_s=0.0")
PLACE = hold(x=0.0, y=0.0, z=2.0)
FENCED = (
    "fence.enabled=true",
    "fence.north_m=[-1.5,1.5]",
    "fence.east_m=[-1.5,1.5]",
    "fence.depth_m=[0.5,4]",
)


@shared
def held(*plant, setpoint=PLACE, seconds=3.0, **arguments):
    dive = Dive(*plant, setpoint=setpoint, **arguments)
    dive.tap.to_vehicle.append(Somebody().origin())
    dive.until(State.ACTIVE)
    dive.run(seconds)
    return dive


def path(dive, **keys):
    return build(PathPlan(**keys), limits(dive.engine.config))


def errors_mm(steps):
    return 1e3 * np.array([math.dist(step.truth.eta[:2], step.sample.eta_d[:2]) for step in steps])


def reference(steps):
    """References of the law: places, rates and accelerations, (n, 3, 4)."""
    return np.array([[s.sample.dofs.x_d, s.sample.dofs.x_d_dot, s.sample.dofs.x_d_ddot] for s in steps])


def smooth(steps, max_step_mps2=0.2):
    """The reference's rate is that of its place, within 2 mm where the target stops, and does not jump."""
    x_d = reference(steps)
    np.testing.assert_allclose(np.diff(x_d[:, 0, :3], axis=0) / 0.02, x_d[1:, 1, :3], atol=0.1)
    assert np.abs(np.diff(x_d[:, 1, :3], axis=0)).max() < 0.02 * 0.5
    assert np.abs(np.diff(x_d[:, 2, :3], axis=0)).max() < max_step_mps2


def test_a_lemniscate_of_4_by_2_m_in_a_minute_against_0_3_mps():
    dive = held(*DVL, "current.speed_m_s=0.3", seconds=8.0)
    shape = Lemniscate(length_m=4.0, width_m=2.0, depth_m=2.0)
    eight = path(dive, name="eight", lemniscate=shape, speed_mps=0.22, acceleration_mps2=0.2)
    dive.engine.guide(eight)
    steps = dive.run(32.0)
    under_way = [step for step in steps if 0.05 < step.sample.guided.progress_m < eight.length_m - 0.05]
    error = errors_mm(under_way)
    heading = [wrap(step.truth.eta[5] - step.sample.eta_d[3]) for step in under_way]
    assert np.sqrt(np.mean(error**2)) <= 45.0
    assert np.degrees(np.sqrt(np.mean(np.square(heading)))) <= 0.6
    assert steps[-1].sample.guided.progress_m > 0.45 * eight.length_m
    assert {step.sample.verdict.state for step in steps} == {State.ACTIVE}
    smooth(steps)


def test_it_goes_to_a_place_in_a_straight_line_and_holds_it():
    dive = held(*CALM)
    dive.engine.guide(Goto(x_m=1.2, y_m=0.8, heading_deg=90.0, speed_mps=0.3))
    steps = dive.run(11.0)
    smooth(steps)
    x_d = reference(steps)[:, 0]
    across = (x_d[:, 0] * 0.8 - x_d[:, 1] * 1.2) / math.hypot(1.2, 0.8)
    assert np.abs(across).max() < 0.08
    np.testing.assert_allclose(x_d[-1], [1.2, 0.8, 2.0, math.pi / 2], atol=0.01)
    dive.engine.guide(Goto(x_m=-0.5, frame="body"))
    dive.run(7.0)
    np.testing.assert_allclose(dive.step.sample.dofs.x_d, [1.2, 0.3, 2.0, math.pi / 2], atol=0.02)


def test_a_path_is_paused_resumed_and_stopped_without_a_jump():
    dive = held(*CALM)
    eight = Lemniscate(length_m=3.0, width_m=1.5)
    dive.engine.guide(
        path(dive, lemniscate=eight, heading="keep", relative=True, laps=0, acceleration_mps2=0.25)
    )
    begun = dive.run(5.0)
    dive.engine.guide(SetPath(action="pause"))
    paused = dive.run(2.5)
    assert paused[-1].sample.guided.kind == "paused"
    assert paused[-1].sample.guided.speed_mps == pytest.approx(0.0, abs=0.005)
    dive.engine.guide(SetPath(action="resume"))
    resumed = dive.run(3.0)
    assert resumed[-1].sample.guided.speed_mps > 0.1
    dive.engine.guide(SetPath(action="hold"))
    stopped = dive.run(4.0)
    assert stopped[-1].sample.guided.kind == "paused"
    assert np.abs(reference(stopped)[-1, 1]).max() < 0.01
    was_m = stopped[-1].sample.guided.progress_m
    dive.engine.guide(SetPath(action="resume"))
    goes_on = dive.run(1.0)
    assert goes_on[5].sample.guided.kind == "path"
    assert goes_on[5].sample.guided.progress_m == pytest.approx(was_m, abs=0.05)
    smooth([*begun, *paused, *resumed, *stopped, *goes_on])
    with pytest.raises(ValueError, match="above the surface"):
        dive.engine.guide(Goto(depth_m=-3.0, frame="offset"))


def test_without_a_position_a_place_is_refused_and_a_depth_is_not():
    dive = active()
    before = dive.engine.target
    for order in (Goto(x_m=3.0), Goto(y_m=1.0, frame="offset"), Goto(x_m=1.0, frame="body")):
        with pytest.raises(ValueError, match="there is no position"):
            dive.engine.guide(order)
    assert dive.engine.target == before
    dive.engine.guide(Goto(depth_m=2.0))


def test_the_pilots_stick_pauses_a_path_which_goes_back_to_its_place_when_resumed():
    dive = held(*CALM, pilot=True)
    dive.cockpit.push()
    dive.engine.guide(
        path(
            dive,
            waypoint=(Waypoint(x_m=0.0, y_m=0.0), Waypoint(x_m=1.6, y_m=0.0)),
            heading="keep",
            acceleration_mps2=0.25,
        )
    )
    dive.run(4.0)
    reached_m = dive.step.sample.guided.progress_m
    dive.cockpit.push(sway=0.5)
    dive.run(2.0)
    dive.cockpit.push()
    waiting = dive.run(2.0)
    assert waiting[-1].sample.guided.kind == "paused"
    assert waiting[-1].sample.eta_d[1] > 0.2
    dive.engine.guide(SetPath(action="resume"))
    dive.run(12.0)
    assert dive.step.sample.guided.kind == "hold", "it has arrived"
    assert dive.step.sample.guided.progress_m == pytest.approx(1.6, abs=0.01)
    assert reached_m < 1.2
    assert dive.step.sample.eta_d[1] == pytest.approx(0.0, abs=0.02)


def test_a_lost_position_releases_x_and_y_holds_the_rest_and_is_regained_without_a_bump():
    dive = held(*DVL, "current.speed_m_s=0.15")
    before = dive.step
    dive.fault("message_stopped", 6.0, message="LOCAL_POSITION_NED")
    steps = dive.run(6.0)
    lost = [step for step in steps if not step.sample.dofs.engaged[X]]
    assert lost[0].t_s - before.t_s <= 1.1, "position_timeout_s"
    assert {step.sample.verdict.state for step in steps} == {State.ACTIVE}
    assert all(Condition.POSITION_STALE in step.sample.verdict.warnings for step in lost[5:])
    for step in lost[25:]:
        assert step.sample.command[:2] == pytest.approx((0.0, 0.0), abs=1e-6), "neutral within 0.5 s"
    assert max(abs(step.truth.eta[2] - 2.0) for step in steps) < 0.05
    assert max(abs(math.degrees(step.truth.eta[5] - step.sample.eta_d[3])) for step in steps) < 3.0
    drifted_m = math.dist(dive.step.truth.eta[:2], (0.0, 0.0))
    assert drifted_m > 0.25
    regained = dive.run(8.0)
    assert regained[-1].sample.dofs.engaged == (True,) * 4
    assert math.dist(regained[-1].truth.eta[:2], (0.0, 0.0)) < 0.1, "back where it was held"
    first = next(i for i, step in enumerate(regained) if step.sample.dofs.engaged[X])
    force = np.array([step.sample.requested[:2] for step in regained[first : first + 5]])
    assert np.abs(force).max() < 12.0
    x_d = reference(regained[first:])
    assert np.abs(np.diff(x_d[:, 1, :2], axis=0)).max() < 0.02


def test_what_the_pilot_chose_meanwhile_is_held_when_the_position_returns():
    dive = held(*CALM, pilot=True)
    dive.cockpit.push()
    dive.fault("message_stopped", 6.0, message="LOCAL_POSITION_NED")
    dive.run(2.0)
    dive.cockpit.push(surge=0.5)
    dive.run(3.0)
    dive.cockpit.push()
    dive.run(6.0)
    assert dive.step.sample.dofs.engaged == (True,) * 4
    assert dive.step.truth.eta[0] > 0.4
    assert dive.step.sample.eta_d[0] == pytest.approx(dive.step.truth.eta[0], abs=0.1)


def test_a_path_waits_for_its_position_and_for_the_vehicle():
    dive = held(*CALM)
    dive.engine.guide(
        path(dive, waypoint=(Waypoint(x_m=0.0, y_m=0.0), Waypoint(x_m=6.0, y_m=0.0)), speed_mps=0.3)
    )
    dive.run(6.0)
    dive.fault("message_stopped", 4.0, message="LOCAL_POSITION_NED")
    steps = dive.run(4.0)
    assert steps[-1].sample.guided.kind == "waiting"
    assert steps[-1].sample.guided.progress_m == pytest.approx(steps[-60].sample.guided.progress_m, abs=0.1)
    dive.run(6.0)
    assert dive.step.sample.guided.kind == "path"
    assert errors_mm([dive.step])[0] < 150.0


@pytest.mark.parametrize(
    ("plan", "said"),
    [
        (PathPlan(circle=Circle(radius_m=2.0), heading="keep"), "leaves the fence at x -2.00, y 0.00"),
        (
            PathPlan(lemniscate=Lemniscate(length_m=2.0, width_m=1.0, depth_m=5.0)),
            r"depth_m = 5.00: must be 0.6 to 3.9 \(0.1 m inside the fence\)",
        ),
    ],
)
def test_a_path_that_leaves_the_fence_is_refused_with_the_point(plan, said):
    dive = held(*CALM, companion=FENCED, seconds=1.0)
    with pytest.raises(ValueError, match=said):
        dive.engine.guide(build(plan, limits(dive.engine.config)))
    with pytest.raises(ValueError, match=r"beyond the fence: y_m = 2\.00"):
        dive.engine.guide(Goto(y_m=2.0))
    with pytest.raises(ValueError, match="beyond the fence"):
        dive.engine.aim(hold(x=-2.0))


def test_where_thrust_saturates_a_path_is_slowed_and_keeps_its_shape():
    """Half of the thrust, and a current abeam: the whole speed is not to be had."""
    dive = held(*CALM, "thrusters.gain=[0.35]", "current.speed_m_s=0.3", "current.direction_deg=90")
    line = (Waypoint(x_m=0.0, y_m=0.0), Waypoint(x_m=0.0, y_m=-6.0))
    dive.engine.guide(path(dive, waypoint=line, heading="keep", speed_mps=0.4, acceleration_mps2=0.25))
    steps = dive.run(12.0)
    assert any(step.sample.dofs.saturated[1] for step in steps)
    assert max(step.sample.guided.speed_mps for step in steps[-200:]) < 0.3
    assert {step.sample.verdict.state for step in steps} == {State.ACTIVE}
    assert errors_mm(steps).max() < 600.0
    assert max(abs(step.truth.eta[0]) for step in steps) < 0.2, "across the path"


def test_the_vehicle_stays_inside_the_fence():
    """Fast, along the fence and into its corners, in 0.3 m/s of current."""
    current = ("current.speed_m_s=0.3", "current.direction_deg=135")
    dive = held(*DVL, *current, companion=FENCED, pilot=True)
    dive.cockpit.push(heave=-0.6, sway=0.6)
    steps = dive.run(9.0)
    dive.cockpit.push()
    steps += dive.run(1.0)
    dive.engine.guide(SetVelocity(forward_mps=0.8, right_mps=-0.5, lasts_s=8.0))
    steps += dive.run(9.0)
    circle = Circle(radius_m=1.4, depth_m=3.9)
    dive.engine.guide(path(dive, circle=circle, speed_mps=0.5, acceleration_mps2=0.3))
    steps += dive.run(15.0)
    dive.engine.guide(Goto(x_m=-1.4, y_m=1.4, depth_m=0.6, speed_mps=1.0, acceleration_mps2=0.5))
    steps += dive.run(12.0)
    assert dive.step.sample.eta_d[:3] == pytest.approx((-1.4, 1.4, 0.6), abs=0.03)
    places = np.array([step.truth.eta[:3] for step in steps])
    assert np.abs(places[:, :2]).max() < 1.5
    assert places[:, 2].min() > 0.5
    assert places[:, 2].max() < 4.0


def test_a_velocity_that_is_commanded_ends_and_the_place_is_held():
    dive = held(*CALM, seconds=1.0)
    with pytest.raises(ValueError, match="engage first"):
        Dive(*CALM).engine.guide(SetVelocity(forward_mps=0.2))
    for _ in range(3):
        dive.engine.guide(SetVelocity(forward_mps=0.2, right_mps=-0.1, heading_rate_degps=5.0))
        moving = dive.run(0.8)
    assert moving[-1].sample.dofs.x_d_dot[:2] == pytest.approx((0.2, -0.1), abs=0.08)
    stopped = dive.run(4.5)
    assert np.abs(stopped[-1].sample.dofs.x_d_dot).max() < 0.01
    assert stopped[-1].sample.eta_d[0] > 0.3
    smooth([*moving, *stopped])


def asks(dive, frame, place=None, yaw=None, velocity=None, yaw_rate=None):
    """Let the ground station send one SET_POSITION_TARGET_LOCAL_NED, its mask saying what is in it."""
    given = ((0x007, place), (0x038, velocity), (0x400, yaw), (0x800, yaw_rate))
    mask = 0x1C0 | sum(bits for bits, value in given if value is None)
    numbers = (*(place or (0.0,) * 3), *(velocity or (0.0,) * 3), 0.0, 0.0, 0.0, yaw or 0.0, yaw_rate or 0.0)
    message = mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, frame, mask, *numbers)
    dive.cockpit.extra.append(dive.cockpit.frame(message))


def test_a_step_of_the_ground_station_needs_a_place_to_count_from():
    dive = held(*CALM, pilot=True)
    dive.cockpit.push()
    dive.fault("message_stopped", 5.0, message="LOCAL_POSITION_NED")
    dive.run(3.0)
    assert not dive.step.sample.dofs.engaged[X]
    asks(dive, mavlink.MAV_FRAME_LOCAL_OFFSET_NED, place=(0.8, 0.0, 0.3))
    dive.run(8.0)
    assert dive.step.sample.dofs.engaged[X]
    np.testing.assert_allclose(dive.step.sample.eta_d[:3], [0.0, 0.0, 2.3], atol=0.05)


def test_position_targets_of_the_ground_station_move_it_and_do_not_reach_the_vehicle():
    dive = held(*CALM, pilot=True, companion=FENCED)
    dive.cockpit.push()
    passed = len(dive.cockpit.passed)
    asks(dive, mavlink.MAV_FRAME_LOCAL_NED, place=(0.8, 0.0, 2.3), yaw=1.57)
    dive.run(7.0)
    np.testing.assert_allclose(dive.step.sample.dofs.x_d, [0.8, 0.0, 2.3, 1.57], atol=0.02)
    asks(dive, mavlink.MAV_FRAME_BODY_OFFSET_NED, place=(0.5, 0.0, 0.0))
    dive.run(5.0)
    np.testing.assert_allclose(dive.step.sample.dofs.x_d, [0.8, 0.5, 2.3, 1.57], atol=0.02)
    asks(dive, mavlink.MAV_FRAME_LOCAL_NED, velocity=(-0.2, 0.0, 0.0))
    moving = dive.run(1.1)
    assert min(step.sample.dofs.x_d_dot[0] for step in moving) < -0.15
    stopped = dive.run(4.0)
    assert np.abs(stopped[-1].sample.dofs.x_d_dot).max() < 0.01, "it said nothing more, and the place is held"
    assert stopped[-1].sample.eta_d[0] < 0.72
    asks(dive, mavlink.MAV_FRAME_LOCAL_NED, place=(9.0, 0.5, 2.3))
    beyond = dive.run(4.0)
    assert max(step.sample.eta_d[0] for step in beyond) <= 1.5
    assert max(step.truth.eta[0] for step in beyond) < 1.5
    smooth([*moving, *stopped])
    said = dive.cockpit.passed[passed:]
    assert b"\xfd" not in said or all(said[i + 7] != 84 for i in range(len(said) - 9) if said[i] == 0xFD)
    dive = held(*CALM, pilot=True, seconds=1.0)
    dive.cockpit.push()
    asks(dive, mavlink.MAV_FRAME_LOCAL_OFFSET_NED, place=(0.0, 0.0, -9.0))
    dive.run(0.2)
    assert dive.engine.target[2] == 0.0, "no higher than the surface"
