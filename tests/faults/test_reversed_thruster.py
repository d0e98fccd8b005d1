"""After work on it a thruster runs the other way round, from the first second or all at once."""

import numpy as np
import pytest
from virtual import Dive, Somebody, hold, shared

from companion.records import Condition, State
from companion.telemetry.event_log import EventLog

DEPTH_M = 3.0
SEA = ("waves.enabled=true", "current.enabled=true", "current.speed_m_s=0.2", "current.direction_deg=40")
START = ("sensors.dvl=true", f"initial.eta=[0,0,{DEPTH_M},0,0,0]")
SIX = {"base": "sim-bluerov2.toml", "companion": ('vehicle.preset="bluerov2"',)}


def turned(motor):
    """What the vehicle has where a motor's direction was not set after its leads were swapped."""
    return f"parameters.MOT_{motor}_DIRECTION=-1"


def begun(*plant, **arguments):
    """A dive that holds place, depth and heading from now on."""
    dive = Dive(*START, *plant, setpoint=hold(z=DEPTH_M, x=0.0, y=0.0), **arguments)
    dive.tap.to_vehicle.append(Somebody().origin())
    return dive.until(State.ACTIVE)


@shared
def holding(*plant):
    dive = begun(*plant)
    dive.run(8.0)
    return dive


def tilt_deg(steps):
    """From upright, at each step."""
    roll, pitch = np.transpose([step.truth.eta[3:5] for step in steps])
    return np.degrees(np.arccos(np.cos(roll) * np.cos(pitch)))


def away_m(steps):
    return np.array([np.hypot(*step.truth.eta[:2]) for step in steps])


def told(steps, log):
    return [event.text for step in steps for event in log.step(step.sample)]


@pytest.mark.parametrize(
    ("motor", "sea", "most_deg"), [(5, (), 30.0), (8, (), 30.0), (6, SEA, 70.0)], ids=str
)
def test_a_heavys_vertical_one_is_found_at_once_and_the_vehicle_righted(motor, sea, most_deg):
    """It turned over while ACTIVE, and "gives no thrust" was all that was told."""
    dive, log = begun(turned(motor), *sea), EventLog()
    steps = dive.run(15.0)
    sample = dive.step.sample
    assert {step.sample.verdict.state for step in steps} == {State.ACTIVE}
    assert not any(step.sample.state.dead_motor for step in steps)
    assert sample.state.reversed_motor == motor
    assert sample.verdict.warnings == Condition.THRUSTER_REVERSED
    assert f"MOT_{motor}_DIRECTION" in sample.verdict.remedy
    assert f"motor {motor} pushes the other way: change the sign of MOT_{motor}_DIRECTION" in told(steps, log)
    assert tilt_deg(steps).max() < most_deg
    assert tilt_deg(steps[-250:]).max() < 5.0
    assert abs(dive.step.truth.eta[2] - DEPTH_M) < 0.05


def test_one_that_turns_round_in_a_sea_does_not_leave_the_vehicle_upside_down():
    dive = holding(*SEA)
    dive.fault("thruster", thruster=5, value=-1.0)
    steps = dive.run(14.0)
    assert {step.sample.verdict.state for step in steps} == {State.ACTIVE}
    assert dive.step.sample.state.reversed_motor == 5
    assert tilt_deg(steps).max() < 125.0
    assert tilt_deg(steps[-250:]).max() < 5.0
    assert np.abs(np.array([step.truth.eta[2] for step in steps]) - DEPTH_M).max() < 0.4


@pytest.mark.parametrize("motor", [1, 3])
def test_a_horizontal_one_carries_the_vehicle_away_by_less_than_a_metre(motor):
    """It went 1.2 m away, was called dead, and the dive was handed over."""
    dive = begun(turned(motor))
    steps = dive.run(15.0)
    assert {step.sample.verdict.state for step in steps} == {State.ACTIVE}
    assert not any(step.sample.state.dead_motor for step in steps)
    assert dive.step.sample.state.reversed_motor == motor
    assert away_m(steps).max() < 1.0
    assert away_m(steps[-100:]).max() < 0.1


@pytest.mark.parametrize("motor", [5, 6])
def test_six_thrusters_are_upright_without_a_hand_over_that_could_not_right_them(motor):
    """STABILIZE and ALT_HOLD turn such a vehicle over: for the autopilot heave is roll."""
    dive = begun(turned(motor), **SIX)
    steps = dive.run(15.0)
    assert {step.sample.verdict.state for step in steps} == {State.ACTIVE}
    assert dive.step.sample.state.reversed_motor == motor
    assert tilt_deg(steps).max() < 45.0
    assert tilt_deg(steps[-250:]).max() < 5.0


def test_all_horizontal_ones_turn_the_vehicle_round_and_round_and_that_is_no_heading():
    dive = holding()
    for motor in (1, 2, 3, 4):
        dive.fault("thruster", thruster=motor, value=-1.0)
    steps = dive.run(20.0)
    ended = next(step for step in steps if step.sample.verdict.state is not State.ACTIVE)
    assert ended.sample.verdict.state is State.RAMP_DOWN
    assert ended.sample.verdict.reason == Condition.OFF_TRACK.text
    assert "reversed or exchanged thruster" in ended.sample.verdict.remedy


@pytest.mark.parametrize("motors", [(5, 8), (5, 6, 7)])
def test_several_vertical_ones_end_in_neutral_and_the_vehicle_rights_itself(motors):
    """The autopilot's own modes would go on turning it over."""
    dive = Dive(setpoint=hold(z=DEPTH_M))
    for motor in motors:
        dive.fault("thruster", thruster=motor, value=-1.0)
    steps = dive.until(State.ACTIVE, within_s=12.0).run(32.0)
    states = {step.sample.verdict.state for step in steps}
    assert states & {State.RAMP_DOWN, State.FAULT}
    assert State.HAND_OVER not in states
    assert tilt_deg(steps[-100:]).max() < 5.0
    assert dive.motors_rest()


def test_the_motor_that_was_put_right_on_deck_is_not_turned_again():
    dive = begun(turned(5))
    dive.run(4.0)
    assert dive.step.sample.state.reversed_motor == 5
    dive.fault("disarm")
    dive.run(1.0)
    assert dive.step.sample.state.reversed_motor == 5
    dive.tap.to_vehicle.append(Somebody().parameter("MOT_5_DIRECTION", 1))
    dive.run(0.5)
    assert dive.step.sample.state.reversed_motor == 0
