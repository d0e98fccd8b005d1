"""The EKF corrects its yaw or position while it is held: the vehicle stays, no thrust comes of it.

At the end: an origin that comes late, and a depth that is noisy or late.

The sensors are almost without noise here, so that a step in thrust is the reset's alone.
"""

from math import nan

import numpy as np
import pytest
from virtual import DEPTH_M, Dive, Somebody, active, hold, shared

from companion.guidance.paths.shapes import build
from companion.guidance.paths.time_law import limits
from companion.io.command_queue import CommandQueue, ReceivedCommand
from companion.records import Condition, Request, State
from companion.telemetry.event_log import EventLog
from companion.telemetry.operator_commands import Goto, SetVelocity
from companion.telemetry.plan import Circle, PathPlan

QUIET = (
    *(f"sensors.{name}=0.0001" for name in ("depth_slow_m", "depth_white_m", "climb_slow_m_s")),
    *(f"sensors.{name}=0.0001" for name in ("climb_white_m_s", "drift_m", "dvl_drift_m", "dvl_white_m")),
    *(f"sensors.{name}=0.00001" for name in ("attitude_slow_rad", "attitude_white_rad", "gyro_white_rad_s")),
)
DVL = ("sensors.dvl=true", "current.enabled=true")
MOST_STEP = np.array([0.3, 0.3, 2.0, 0.03])
"""N and N·m a tick at most. Depth, which no reset here concerns, comes in whole millimetres."""

FORTY = {"kind": "yaw_reset", "value": 40.0}
BURST = {"kind": "yaw_reset", "value": 3.0, "seconds": 2.0, "count": 48}
AROUND = {"kind": "yaw_reset", "value": 170.0}
NORTH = {"kind": "position_reset", "value": 3.0}
SERIES = {"kind": "position_reset", "value": -0.5, "seconds": 2.0, "count": 10}


def heading_errors_deg(steps, psi):
    """How far the true heading is from `psi`."""
    turned = np.array([step.truth.eta[5] for step in steps]) - psi
    return np.degrees(np.abs((turned + np.pi) % (2.0 * np.pi) - np.pi))


@pytest.mark.parametrize(
    ("plant", "faults"),
    [((), (FORTY, BURST)), (DVL, (FORTY, AROUND, NORTH, SERIES))],
    ids=["without a position", "with a DVL"],
)
def test_a_reset_moves_nothing(plant, faults):
    dive = active(*QUIET, *plant, seconds=12.0)
    before, began_s, steps = dive.step.truth.eta, dive.t_s, [dive.step]
    for fault in faults:
        dive.fault(**fault)
        steps += dive.run(4.0)
        assert any(step.sample.state.frame_shift for step in steps[-200:])
    assert dive.states_since(began_s) == [State.ACTIVE]
    thrust = np.array([step.sample.requested for step in steps])
    assert (np.abs(np.diff(thrust, axis=0)) <= MOST_STEP).all()
    assert heading_errors_deg(steps, before[5]).max() < 2.0
    if plant:
        moved = np.array([step.truth.eta[:2] for step in steps]) - before[:2]
        assert np.abs(moved).max() < 0.03


def under_way(faults):
    """A dive around a circle in a current, faults as (after s, fault): thrust, true places, resets seen."""
    dive = active(*QUIET, *DVL, setpoint=hold(x=0.0, y=0.0, psi=0.3), seconds=3.0)
    plan = PathPlan(circle=Circle(radius_m=1.0), speed_mps=0.25)
    dive.engine.guide(build(plan, limits(dive.engine.config)))
    steps, began_s = [], dive.t_s
    for after_s, fault in [*faults, (10.0, None)]:
        steps += dive.run(began_s + after_s - dive.t_s)
        if fault is not None:
            dive.fault(**fault)
    assert dive.states_since(began_s) == [State.ACTIVE]
    return (
        np.array([step.sample.requested for step in steps]),
        np.array([step.truth.eta for step in steps])[:, [0, 1, 2, 5]],
        sum(step.sample.state.frame_shift is not None for step in steps),
    )


def test_with_resets_at_any_time_it_pushes_and_goes_as_without():
    """What is left: the moment of a reset between two samples, and depth in whole millimetres."""
    rng = np.random.default_rng(1)
    times = np.sort(rng.uniform(0.5, 9.0, 8))
    kinds = [("yaw_reset", rng.uniform(-180.0, 180.0)), ("position_reset", rng.uniform(1.2, 5.0))] * 4
    rng.shuffle(kinds)
    faults = [
        (t, {"kind": kind, "value": float(value)}) for t, (kind, value) in zip(times, kinds, strict=True)
    ]
    undisturbed, there, _ = under_way([])
    thrust, places, resets = under_way(faults)
    assert resets == len(faults)
    assert (np.abs(thrust - undisturbed).max(axis=0) < [0.8, 0.8, 4.0, 0.05]).all()
    assert (np.abs(places - there).max(axis=0) < [0.03, 0.03, 0.002, 0.005]).all()


@pytest.mark.parametrize(("fault", "after_s"), [(FORTY, -0.5), (NORTH, 0.0), (FORTY, 0.1)])
def test_a_place_that_is_ordered_near_a_reset_lies_where_the_ekf_had_it_then(after_s, fault):
    """It is taken by the frame that the companion knew in that tick, and stays there."""
    dive = active(*QUIET, *DVL, setpoint=hold(x=0.0, y=0.0), seconds=6.0)
    steps = []
    if after_s > 0.0:
        dive.fault(**fault)
        steps = dive.run(after_s)
    dive.engine.guide(Goto(x_m=2.0, y_m=1.0, speed_mps=0.4))
    if after_s == 0.0:
        dive.fault(**fault)
    steps += dive.run(0.02)
    if after_s < 0.0:
        dive.run(-after_s)
        dive.fault(**fault)
    known = [step.sample.state.frame_shift for step in steps if step.sample.state.frame_shift]
    turn_rad, north_m = sum(one.turn_rad for one in known), sum(one.north_m for one in known)
    expected = complex(2.0 - north_m, 1.0) * np.exp(-1j * turn_rad)
    dive.run(16.0)
    north, east = dive.step.truth.eta[:2]
    assert complex(north, east) == pytest.approx(expected, abs=0.04)
    assert dive.state is State.ACTIVE


def test_after_a_reset_steps_velocities_fence_and_map_are_in_the_new_frame():
    fenced = ("fence.enabled=true", "fence.north_m=[-1.5,1.5]", "fence.east_m=[-1.5,1.5]")
    dive = active(*QUIET, *DVL, setpoint=hold(x=0.0, y=0.0), seconds=6.0, pilot=True, companion=fenced)
    dive.fault("yaw_reset", value=90.0)
    dive.run(4.0)
    dive.engine.guide(Goto(x_m=1.0, frame="offset"))
    dive.run(9.0)
    assert dive.step.sample.state.eta[:2] == pytest.approx((1.0, 0.0), abs=0.03)
    assert dive.step.truth.eta[:2] == pytest.approx((0.0, -1.0), abs=0.03)
    dive.engine.guide(SetVelocity(forward_mps=-0.2, frame="local", lasts_s=2.0))
    moving = dive.run(2.0)
    assert moving[-1].sample.dofs.x_d_dot[:2] == pytest.approx((-0.2, 0.0), abs=0.03)
    assert moving[-1].sample.state.eta_dot[:2] == pytest.approx((-0.2, 0.0), abs=0.03)
    dive.run(3.0)
    with pytest.raises(ValueError, match="fence"):
        dive.engine.guide(Goto(x_m=1.6))
    dive.cockpit.push(surge=0.5, sway=0.5)
    steps = dive.run(12.0)
    dive.cockpit.push()
    dive.run(1.0)
    assert max(max(step.sample.state.eta[:2]) for step in steps) < 1.5
    assert max(dive.step.sample.state.eta[:2]) > 1.2
    dive.engine.guide(
        build(PathPlan(circle=Circle(radius_m=1.0), speed_mps=0.25), limits(dive.engine.config))
    )
    dive.run(1.0)
    dive.fault(**NORTH)
    dive.run(1.0)
    path, placed = dive.engine.path
    drawn = [placed((*place, 0.0)) for place in path.polyline(0.1) if place]
    assert {round(np.hypot(x - 3.0, y), 2) for x, y, *_ in drawn} == {1.0}, "it went north with the frame"


def test_the_setpoint_turns_with_the_frame_and_the_next_order_turns_nothing_back():
    """The operator's last heading was given in the old frame; a new depth or no heading leaves it alone."""
    dive = active(*QUIET, setpoint=hold(psi=0.5), seconds=6.0)
    commands = CommandQueue(dive.engine.config)
    dive.fault(**FORTY)
    for step in dive.run(1.0):
        commands.after_tick(dive.engine, step.sample, dive.t_s)
    psi = dive.step.truth.eta[5]
    assert dive.engine.target[3] == pytest.approx(0.5 + np.radians(40.0), abs=0.01)
    commands.put(
        ReceivedCommand("goto", b'{"depth_m": 1.4, "at_once": true}', lambda reply: None, local=True)
    )
    commands.before_tick(dive.engine, dive.t_s)
    assert heading_errors_deg(dive.run(5.0), psi).max() < 2.0
    assert dive.step.truth.eta[2] == pytest.approx(1.4, abs=0.05)
    dive.tap.aim(hold(z=1.5, psi=nan))
    assert heading_errors_deg(dive.run(3.0), psi).max() < 2.0


@pytest.mark.parametrize(("gap", "knock_radps", "most_deg"), [(False, 4.0, 4.0), (True, 3.0, 2.0)])
def test_a_blow_that_turns_it_is_no_reset_and_is_brought_back(gap, knock_radps, most_deg):
    """The rates show it, 40° within about 0.3 s; or it turns behind a gap in the telemetry."""
    dive = active(*QUIET, seconds=10.0)
    psi = dive.step.truth.eta[5]
    if gap:
        dive.fault("message_stopped", 0.4, message="ATTITUDE")
    dive.knock(knock_radps)
    steps = dive.run(8.0)
    assert gap or heading_errors_deg(steps[:16], psi).max() > 30.0
    assert not any(step.sample.state.frame_shift for step in steps)
    assert heading_errors_deg(steps[-50:], psi).max() < most_deg


def test_the_operator_hears_of_one_and_of_a_burst():
    dive, log = active(*QUIET), EventLog()
    dive.fault(**FORTY)
    steps = dive.run(0.5)
    texts = [event.text for step in steps for event in log.step(step.sample)]
    assert "the EKF was reset: yaw +40.0°; the heading that is held turns with it" in texts
    assert Condition.YAW_RESET in dive.step.sample.verdict.warnings
    dive.fault(**BURST)
    texts = [event.text for step in dive.run(6.0) for event in log.step(step.sample)]
    assert "49 resets of the EKF, yaw +184.0° in all" in texts
    assert "the EKF's yaw is steady" in texts
    assert Condition.YAW_RESET not in dive.step.sample.verdict.conditions


def test_fixes_are_followed_slowly_and_without_a_bump():
    """A USBL moves the EKF by 0.3 m, to and fro, every two seconds: the vehicle follows the mean of them."""
    dive = active(*QUIET, *DVL, setpoint=hold(x=0.0, y=0.0), seconds=6.0)
    steps, fixes = [], (0.3, -0.5, 0.4, -0.3, 0.5, -0.4)
    for jump_m in fixes:
        dive.fault("position_reset", value=jump_m)
        steps += dive.run(2.0)
    places = np.array([step.truth.eta[:2] for step in steps])
    thrust = np.array([step.sample.delivered[:2] for step in steps])
    assert len([step for step in steps if step.sample.state.frame_shift]) == len(fixes)
    assert np.abs(np.diff(places, axis=0)).max() / 0.02 < 0.08
    assert np.abs(np.diff(thrust, axis=0)).max() < 6.0
    assert np.hypot(*places.T).max() < 0.25
    dive.run(12.0)
    assert dive.engine.asked[:2] == pytest.approx((0.0, 0.0), abs=0.02), "the numbers that were asked for"
    assert dive.state is State.ACTIVE


@pytest.mark.parametrize("period_s", [2.0, 10.0])
def test_fixes_alone_keep_the_place_and_a_reset_among_them_moves_nothing(period_s):
    """A USBL of 0.5 m without a DVL: each fix moves the EKF, and between fixes its velocity drifts."""
    usbl = f"sensors.usbl={{enabled=true, sigma_m=0.5, period_s={period_s}, missed=0.0}}"
    water = ("current.enabled=true", "current.speed_m_s=0.15")
    dive = Dive(usbl, *water, "initial.eta=[0,0,3,0,0,0]", setpoint=hold(z=3.0))
    dive.tap.to_vehicle.append(Somebody().origin())
    dive.run(30.0)
    place = dive.step.sample.state.eta[:2]
    dive.engine.aim(hold(z=3.0, x=place[0], y=place[1]))
    steps = dive.run(45.0)
    assert dive.engine.asked[:2] == place
    off_m = np.hypot(*(np.array([step.truth.eta[:2] for step in steps]) - place).T)
    assert off_m.mean() < 1.0
    assert off_m.max() < 2.5
    assert not any(Condition.POSITION_RESET in step.sample.verdict.conditions for step in steps)
    thrust = np.array([step.sample.delivered[:2] for step in steps])
    assert np.abs(np.diff(thrust, axis=0)).max() < 10.0
    dive.run(3.0)  # not at a fix
    dive.fault("position_reset", value=7.0)
    steps = dive.run(6.0)
    assert dive.engine.asked[:2] == pytest.approx((place[0] + 7.0, place[1]), abs=1.0)
    assert np.hypot(*(np.array(steps[-1].truth.eta[:2]) - place)) < 2.5
    thrust = np.array([step.sample.delivered[:2] for step in steps])
    assert np.abs(np.diff(thrust, axis=0)).max() < 10.0
    assert any(Condition.POSITION_RESET in step.sample.verdict.warnings for step in steps)


def test_while_the_compass_aligns_it_does_not_engage_and_says_wait():
    dive = Dive(*QUIET, engage=False)
    dive.run(3.0)
    dive.fault(**BURST)
    dive.run(1.0)
    dive.ask(Request.ENGAGE)
    dive.run(1.5)
    assert dive.state is State.IDLE
    assert "compass: the EKF aligned its yaw" in dive.step.sample.verdict.reason
    assert "wait" in dive.step.sample.verdict.reason
    dive.until(State.ACTIVE, within_s=6.0)


def test_a_position_that_is_reset_with_every_sample_is_not_believed():
    dive = active(*QUIET, *DVL)
    dive.fault("position_reset", 4.0, value=0.6, count=200)
    dive.run(2.0)
    assert dive.state is State.HAND_OVER
    assert Condition.INNOVATION_LARGE in dive.step.sample.verdict.conditions


WAVES = ("waves.enabled=true",)
GROUND = (
    "sensors.rangefinder=true",
    "seabed.enabled=true",
    "seabed.depth_m=6",
)


LASTS_S = 7.0


def holding(plant, **what):
    return active(*plant, **what, seconds=5.0)


def altitude(plant):
    dive = holding(plant + GROUND)
    dive.engine.guide(Goto(altitude_m=4.0))
    dive.run(5.0)
    return dive


def sinking(plant):
    dive = holding(plant)
    dive.engine.guide(Goto(depth_m=5.0, speed_mps=0.4))
    return dive


def on_a_path(plant):
    dive = holding(plant + DVL, setpoint=hold(x=0.0, y=0.0))
    plan = PathPlan(circle=Circle(radius_m=1.0), speed_mps=0.25)
    dive.engine.guide(build(plan, limits(dive.engine.config)))
    return dive


def by_stick(plant):
    dive = holding(plant, pilot=True)
    dive.cockpit.push(heave=0.5)
    return dive


@shared
def shifted(begin, plant, shifts):
    """True depths, each 20 ms, of a dive whose zero of depth moves by `shifts`, as (after s, m); the dive."""
    dive, steps = begin(plant), []
    began_s = dive.t_s
    for after_s, size_m in (*shifts, (LASTS_S, 0.0)):
        steps += dive.run(began_s + after_s - dive.t_s)
        if size_m:
            dive.fault("depth_shifted", value=size_m)
    assert dive.states_since(began_s) == [State.ACTIVE]
    times, depths = [step.t_s - began_s for step in steps], [step.truth.eta[2] for step in steps]
    return np.interp(np.arange(0.0, LASTS_S, 0.02), times, depths), dive


SMALL, LARGE = ((2.5, 0.2), (3.5, -0.4)), ((3.0, 8.0), (3.4, -3.0))


@pytest.mark.parametrize(
    ("begin", "plant", "shifts"),
    [
        (holding, QUIET, ((3.0, 0.05),)),
        (altitude, WAVES, LARGE),
        (sinking, QUIET, SMALL),
        (on_a_path, WAVES, LARGE),
        (by_stick, QUIET, SMALL),
    ],
)
def test_a_zero_of_depth_that_moves_moves_nothing(begin, plant, shifts):
    undisturbed, _ = shifted(begin, plant, ())
    depths, dive = shifted(begin, plant, shifts)
    assert np.abs(depths - undisturbed).max() < 0.03
    state = dive.step.sample.state
    assert state.eta[2] == pytest.approx(dive.step.truth.eta[2], abs=0.04), "the depth as it was known"


@pytest.mark.parametrize("size_m", [0.008, 0.03])
def test_a_zero_that_slides_within_a_second_is_found_by_the_pressure_which_brings_it_back(size_m):
    """Fifty steps, each below what is believed at once; nobody asks for the pressure, which comes at 2 Hz."""
    dive = holding(QUIET)
    before, began_s = dive.step.truth.eta[2], dive.t_s
    for _ in range(50):
        dive.fault("depth_shifted", value=size_m)
        dive.run(0.02)
    dive.run(5.0)
    assert dive.states_since(began_s) == [State.ACTIVE]
    assert dive.step.sample.state.depth_offset_m == pytest.approx(50.0 * size_m, abs=0.03)
    assert dive.step.truth.eta[2] == pytest.approx(before, abs=0.03)


def test_what_really_moves_it_is_no_reset_and_is_brought_back():
    """A pull of the tether, which the climb rate shows; and 0.3 m at once, which only pressure shows."""
    dive = active(*QUIET, setpoint=hold(z=3.0), seconds=9.0)
    *others, w, p, q, r = dive.vehicle.physics.state
    dive.vehicle.physics.state = (*others, w - 1.0, p, q, r)
    pulled = dive.run(8.0)
    assert not any(step.sample.state.frame_shift for step in pulled)
    x, y, z, *others = dive.vehicle.physics.state
    dive.vehicle.physics.state = (x, y, z - 0.3, *others)
    moved = dive.run(8.0)
    for steps in (pulled, moved):
        assert min(step.truth.eta[2] for step in steps) < 2.85
        assert steps[-1].truth.eta[2] == pytest.approx(3.0, abs=0.03)
    assert {step.sample.verdict.state for step in pulled + moved} == {State.ACTIVE}


@pytest.mark.parametrize("size_m", [0.4, -3.0])
def test_after_it_depths_are_below_the_surface_as_it_was_known(size_m):
    """What is asked, what is told and what bounds it; a vehicle that was not held when it happened."""
    limit = ("supervisor.max_depth_m=6",)
    dive = Dive(*QUIET, setpoint=hold(z=3.0), arm=False, engage=False, companion=limit)
    dive.run(3.0)
    dive.tap.to_vehicle.append(Somebody().arm())
    dive.until(State.READY)
    dive.run(1.0)
    dive.fault("depth_shifted", value=size_m)
    dive.run(0.2)
    assert dive.step.sample.state.frame_shift or dive.step.sample.state.ages.depth_reset_s < 0.2
    dive.ask(Request.ENGAGE)
    dive.until(State.ACTIVE)
    dive.run(12.0)
    assert dive.step.truth.eta[2] == pytest.approx(3.0, abs=0.03)
    assert dive.step.sample.state.eta[2] == pytest.approx(3.0, abs=0.03)
    with pytest.raises(ValueError, match="max_depth_m = 6"):
        dive.engine.guide(Goto(depth_m=6.1))
    dive.engine.guide(Goto(depth_m=2.0, speed_mps=0.4))
    dive.run(12.0)
    assert dive.step.truth.eta[2] == pytest.approx(2.0, abs=0.03)


@pytest.mark.parametrize("end", ["disarm", "reboot"])
def test_the_operator_hears_by_how_much_the_ground_stations_depth_differs(end):
    dive, log = active(*QUIET, seconds=6.0), EventLog()
    dive.fault("depth_shifted", value=-0.4)
    texts = [event.text for step in dive.run(0.5) for event in log.step(step.sample)]
    assert "the EKF was reset: the autopilot's depth -0.40 m; the depth here counts on as before" in texts
    assert dive.step.sample.verdict.warnings == Condition.DEPTH_RESET
    assert dive.step.sample.state.depth_offset_m == pytest.approx(-0.4, abs=0.01)
    dive.fault("depth_shifted", value=0.6)
    texts = [event.text for step in dive.run(5.0) for event in log.step(step.sample)]
    assert "2 resets of the EKF, depth +0.20 m in all" in texts
    assert "the autopilot's zero of depth is steady" in texts
    dive.fault(end)
    dive.run(3.0)
    assert dive.step.sample.state.depth_offset_m == 0.0, "the autopilot sets its zero anew on arming"


def test_an_origin_that_comes_late_moves_nothing():
    dive = Dive("sensors.dvl=true", 'faults=[{kind="origin_late", duration_s=9.0}]')
    dive.run(8.9)
    assert dive.state is State.ACTIVE
    before, began_s = dive.step.truth.eta[2], dive.t_s
    steps = dive.run(6.0)
    assert dive.states_since(began_s) == [State.ACTIVE]
    depths = np.array([step.truth.eta[2] for step in steps])
    assert np.abs(depths - before).max() < 0.03
    places = np.array([step.truth.eta[:2] for step in steps])
    assert np.ptp(places, axis=0).max() < 0.05


@pytest.mark.parametrize(
    ("plant", "kind", "value", "most_m"),
    [((), "depth_noise", 0.02, 0.08), (("waves.enabled=true",), "depth_lag", 0.15, 0.15)],
)
def test_a_depth_that_is_worse_than_it_should_be_is_held_all_the_same(plant, kind, value, most_m):
    """Slow noise as measured on a real vehicle, and what GPS makes of the EKF's depth."""
    dive = active(*plant, seconds=6.0)
    began_s = dive.t_s
    dive.fault(kind, value=value)
    steps = dive.run(12.0)
    assert dive.states_since(began_s) == [State.ACTIVE]
    errors_m = np.array([step.truth.eta[2] - DEPTH_M for step in steps])
    assert np.abs(errors_m).max() < most_m
    late, early = np.std(errors_m[300:]), np.std(errors_m[:300])
    assert late < 2.0 * early + 0.01, "it swings itself up"
