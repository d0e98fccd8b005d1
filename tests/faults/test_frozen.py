"""A sensor that hangs, or a rate that is wrong, with fresh stamps: told at once, the vehicle stays near."""

import itertools
from math import nan, remainder, tau

import numpy as np
import pytest
from virtual import HEADING_RAD, Dive, Somebody, active, blocked, freeze, hold, rewritten, shared

from companion.records import Condition, State, Z
from companion.telemetry.event_log import EventLog

DEPTH_M = 3.0
WAVES = ("waves.enabled=true",)
FROM_PRESSURE = ('vehicle.depth_source="pressure"',)


def zero(value, _):
    return type(value)(0)


def negative(value, _):
    return -value


DEPTH = {
    "GLOBAL_POSITION_INT": {"relative_alt": freeze, "alt": freeze},
    "SCALED_PRESSURE": {"press_abs": freeze},
    "SCALED_PRESSURE2": {"press_abs": freeze},
}
ANGLES, RATES = ("roll", "pitch", "yaw"), ("rollspeed", "pitchspeed", "yawspeed")
SPOILT = {
    "depth and climb rate": DEPTH | {"VFR_HUD": {"climb": freeze, "alt": freeze}},
    "depth, and the climb rate is 0": DEPTH | {"VFR_HUD": {"climb": zero, "alt": freeze}},
    "climb rate": {"VFR_HUD": {"climb": freeze}},
    "climb rate is 0": {"VFR_HUD": {"climb": zero}},
    "climb rate turned round": {"VFR_HUD": {"climb": negative}},
    "attitude": {"ATTITUDE": dict.fromkeys((*ANGLES, *RATES), freeze)},
    "angles": {"ATTITUDE": dict.fromkeys(ANGLES, freeze)},
    "gyro": {"ATTITUDE": {"yawspeed": freeze}},
    "gyro turned round": {"ATTITUDE": {"yawspeed": negative}},
}


def held(*plant, companion=()):
    return active(*plant, companion=companion, setpoint=hold(z=DEPTH_M), seconds=20.0)


def spoil(dive, what, seconds=4.0):
    """Steps of a dive until it is no longer held, and those after that."""
    dive.tap.spoil = rewritten(SPOILT[what])
    steps = dive.run(seconds)
    active_ = list(itertools.takewhile(lambda step: step.sample.verdict.state is State.ACTIVE, steps))
    return active_, steps[len(active_) :]


def off(steps):
    """How far it is off, m and degrees."""
    places = np.array([step.truth.eta for step in steps])
    turned = [remainder(psi - HEADING_RAD, tau) for psi in places[:, 5]]
    return np.abs(places[:, 2] - DEPTH_M).max(), np.degrees(np.abs(turned).max())


@pytest.mark.parametrize("what", SPOILT)
def test_what_does_not_answer_is_told_and_released_while_the_vehicle_is_near(what):
    dive = held(*WAVES)
    began_s = dive.t_s
    steps, after = spoil(dive, what)
    verdict, doubts = after[0].sample.verdict, Condition.DEPTH_DOUBTED | Condition.ATTITUDE_DOUBTED
    told_s = next(step.t_s for step in steps + after if step.sample.verdict.warnings & doubts) - began_s
    assert told_s < 2.0 if "turned" in what else told_s < 0.6
    assert verdict.state is State.FAULT
    assert verdict.reason.startswith(("no fresh depth (", "no fresh attitude ("))
    assert verdict.remedy.startswith("restart the autopilot")
    assert np.less(off([*steps, after[0]]), (0.3, 12.0)).all()
    assert dive.motors_rest()


@pytest.mark.parametrize("companion", [(), FROM_PRESSURE], ids=["of the EKF", "of the pressure"])
def test_a_depth_that_stays_while_the_climb_rate_goes_on_is_told(companion):
    dive = held(*WAVES, companion=companion)
    dive.tap.spoil = rewritten(DEPTH)
    steps = dive.run(0.02)
    while dive.state is State.ACTIVE and len(steps) < 2000:
        steps += dive.run(0.02)
    assert off(steps)[0] < 0.3
    assert dive.state is not State.ACTIVE
    assert "repeats" in dive.step.sample.verdict.reason


def test_a_sensor_that_hangs_for_a_moment_is_ridden_out():
    dive = held(*WAVES)
    dive.tap.spoil = rewritten(SPOILT["depth and climb rate"])
    steps = dive.run(0.8)
    dive.tap.spoil = lambda _, inbox: inbox
    steps += dive.run(6.0)
    assert {step.sample.verdict.state for step in steps} == {State.ACTIVE}
    assert off(steps)[0] < 0.2
    assert off(steps[-50:])[0] < 0.03


@pytest.mark.parametrize("to_m", [DEPTH_M - 1.0, DEPTH_M + 1.0])
def test_a_depth_with_noise_that_full_thrust_does_not_move_ends_control(to_m):
    dive = held(*WAVES)
    dive.tap.spoil = rewritten(blocked())
    dive.tap.aim(hold(z=to_m))
    steps = dive.run(10.0)
    active_ = list(itertools.takewhile(lambda step: step.sample.verdict.state is State.ACTIVE, steps))
    ended = steps[len(active_)].sample.verdict
    assert ended.reason == Condition.THRUST_UNANSWERED.text
    assert "port of the depth sensor" in ended.remedy
    assert off(active_)[0] < 2.5
    assert dive.motors_rest()


def mirrored(value, first):
    return 2 * first - value


@pytest.mark.parametrize("plant", [(), WAVES], ids=["calm", "waves"])
def test_a_depth_of_the_wrong_sign_ends_control_before_it_leads_far_away(plant):
    """It went 3.3 m away, and was handed to an ALT_HOLD that believes the same depth."""
    dive = Dive(*plant, f"initial.eta=[0,0,{DEPTH_M},0,0,{HEADING_RAD}]", setpoint=hold(z=DEPTH_M))
    dive.until(State.ACTIVE)
    depth = {"GLOBAL_POSITION_INT": {"relative_alt": mirrored}, "SCALED_PRESSURE2": {"press_abs": mirrored}}
    dive.tap.spoil = rewritten(depth | {"VFR_HUD": {"climb": negative}})
    active_ = [step for step in dive.run(6.0) if step.sample.verdict.state is State.ACTIVE]
    assert dive.step.sample.verdict.reason.endswith(f"control ended: {Condition.THRUST_OPPOSED.text}")
    assert off(active_)[0] < 1.5
    assert dive.motors_rest()


PLACED = ("sensors.dvl=true", "sensors.dvl_drift_m=0", "current.enabled=true", "current.speed_m_s=0.15")
DVL = {
    "all": dict.fromkeys(("x", "y", "vx", "vy"), freeze),
    "velocity is 0": dict.fromkeys(("x", "y"), freeze) | dict.fromkeys(("vx", "vy"), zero),
    "velocity": dict.fromkeys(("vx", "vy"), freeze),
    "position": dict.fromkeys(("x", "y"), freeze),
}


@shared
def placed():
    """A dive that has held a place for a while."""
    dive = Dive(*PLACED, setpoint=hold(z=DEPTH_M, x=0.0, y=0.0))
    dive.tap.to_vehicle.append(Somebody().origin())
    dive.until(State.ACTIVE, within_s=12.0).run(12.0)
    return dive


@pytest.mark.parametrize("what", DVL)
def test_a_position_that_hangs_is_told_and_released_and_depth_and_heading_are_held(what):
    dive = placed()
    dive.tap.spoil = rewritten({"LOCAL_POSITION_NED": DVL[what]})
    steps, log = dive.run(4.0), EventLog()
    told = [event.text for step in steps for event in log.step(step.sample)]
    assert Condition.POSITION_DOUBTED.text in told
    lost = [step for step in steps if step.sample.verdict.warnings & Condition.POSITION_STALE]
    assert lost[0].t_s - steps[0].t_s < 1.2
    assert dive.state is State.ACTIVE
    assert dive.step.sample.dofs.engaged == (False, False, True, True)
    assert off(steps)[0] < 0.05
    assert np.hypot(*steps[60].truth.eta[:2]) < 0.3
    dive.tap.spoil = lambda _, inbox: inbox
    assert not dive.run(1.0)[-1].sample.verdict.warnings & Condition.POSITION_STALE


QUIET = (
    "sensors.depth_slow_m=0",
    "sensors.depth_white_m=0",
    "sensors.climb_slow_m_s=0",
    "sensors.climb_white_m_s=0",
    "sensors.attitude_slow_rad=0",
    "sensors.attitude_white_rad=0",
    "sensors.gyro_white_rad_s=0",
    "sensors.depth_defects={step = 0.01}",
    "sensors.attitude_defects={step = 0.01}",
)


def test_the_quietest_sensors_in_calm_water_are_believed():
    """Without noise, and rounded: what is at rest may repeat for minutes."""
    dive = Dive(*QUIET, setpoint=hold(z=DEPTH_M)).until(State.ACTIVE)
    for z in (DEPTH_M, 2.0, nan):
        dive.tap.aim(hold(z=z))
        steps = dive.run(30.0)
        assert {step.sample.verdict.state for step in steps} == {State.ACTIVE}
        doubts = Condition.DEPTH_DOUBTED | Condition.ATTITUDE_DOUBTED
        assert not any(step.sample.verdict.conditions & doubts for step in steps)
    assert not dive.step.sample.state.stale[Z]
