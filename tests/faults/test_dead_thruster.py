"""A thruster dies while depth and heading are held in waves and a current."""

import numpy as np
import pytest
from console import Console
from virtual import Dive, Somebody, hold, shared

from companion.records import Condition, Request, State
from companion.telemetry.event_log import EventLog

ALT_HOLD = 2
SEA = ("waves.enabled=true", "current.enabled=true", "initial.eta=[0.0, 0.0, 2.5, 0.0, 0.0, 0.3]")
DEPTH_M = 2.5


@shared
def holding(**arguments):
    dive = Dive(*SEA, setpoint=hold(z=DEPTH_M), **arguments).until(State.ACTIVE)
    dive.run(6.0)
    assert dive.step.sample.state.dead_motor == 0
    return dive


@pytest.mark.parametrize("motor", [2, 5])
def test_the_heavy_holds_depth_and_heading(motor):
    dive = holding()
    dive.fault("thruster", thruster=motor, value=0.0)
    steps = dive.run(30.0)
    depth_m = np.array([step.truth.eta[2] for step in steps]) - DEPTH_M
    heading_deg = np.degrees([step.truth.eta[5] - 0.3 for step in steps])
    tilt_deg = np.degrees([step.truth.eta[3:5] for step in steps])
    assert {step.sample.verdict.state for step in steps} == {State.ACTIVE}
    assert np.abs(depth_m).max() < 0.2
    assert np.sqrt(np.mean(depth_m[500:] ** 2)) < 0.03
    assert np.abs(heading_deg).max() < 5.0
    assert np.abs(tilt_deg).max() < 30.0
    if motor > 4:
        assert np.abs(tilt_deg[1200:]).max() < 5.0
        assert dive.step.sample.state.dead_motor == motor
        assert dive.step.sample.verdict.warnings == Condition.THRUSTER_DEAD


def without_motor_1(direction_deg, *plant):
    """A dive that holds its place in a current of 0.3 m/s, and loses its first motor now."""
    current = ("current.enabled=true", "current.speed_m_s=0.3", f"current.direction_deg={direction_deg}")
    start = ("sensors.dvl=true", f"initial.eta=[0,0,{DEPTH_M},0,0,0]")
    dive = Dive(*plant, *start, *current, setpoint=hold(x=0.0, y=0.0, z=DEPTH_M, psi=0.0))
    dive.tap.to_vehicle.append(Somebody().origin())
    dive.until(State.ACTIVE).run(16.0)
    dive.fault("thruster", thruster=1, value=0.0)
    return dive


def test_the_heavy_holds_its_place_in_a_current_without_a_horizontal_motor():
    """It turned by more than 90° and was handed over: the commands on their way kept the motor's thrust."""
    dive = without_motor_1(75)
    steps = dive.run(12.0)
    assert {step.sample.verdict.state for step in steps} == {State.ACTIVE}
    assert dive.step.sample.state.dead_motor == 1
    heading_deg = np.degrees([step.truth.eta[5] for step in steps])
    assert np.abs(heading_deg).max() < 20.0
    assert np.abs(heading_deg[-200:]).max() < 2.0
    assert max(np.hypot(*step.truth.eta[:2]) for step in steps) < 0.3


def test_a_vehicle_that_is_turned_across_the_dead_motors_diagonal_holds_its_place_again():
    """It was handed over for a heading that was on its way back, 2.5 s after the motor was found."""
    dive = without_motor_1(315, "thrusters.gain=[0.85]")
    steps = dive.run(5.0)
    dive.engine.aim(hold(x=0.0, y=0.0, z=DEPTH_M, psi=0.5 * np.pi))
    steps += dive.run(20.0)
    assert {step.sample.verdict.state for step in steps} == {State.ACTIVE}
    assert dive.step.sample.state.dead_motor == 1
    assert max(np.hypot(*step.truth.eta[:2]) for step in steps[-200:]) < 0.1
    assert abs(np.degrees(dive.step.truth.eta[5]) - 90.0) < 2.0


def test_the_pilot_pushes_without_a_motor_and_the_heading_is_held():
    dive = holding(pilot=True)
    dive.fault("thruster", thruster=1, value=0.0)
    for surge, sway in ((0.0, -0.3), (0.6, 0.3), (0.6, -0.3), (0.0, 0.3), (0.6, -0.3)):
        dive.cockpit.push(surge=surge, sway=sway)
        dive.run(2.5)
    assert dive.step.sample.state.dead_motor == 1
    dive.cockpit.push()
    dive.run(3.0)
    dive.cockpit.push(surge=0.6, sway=-0.3)
    heading_deg = np.degrees([step.truth.eta[5] - 0.3 for step in dive.run(4.0)])
    assert np.abs(heading_deg).max() < 5.0


def test_a_dead_motor_is_reported_and_forgotten_when_the_fault_is_cleared():
    dive, log = holding(), EventLog()
    dive.fault("thruster", thruster=6, value=0.0)
    reported = [event.text for step in dive.run(15.0) for event in log.step(step.sample)]
    assert {"motor 6 gives no thrust", "a motor gives no thrust"} <= set(reported)
    answers = Console(dive).ask("clear_fault")
    reported = [event.text for step in dive.run(0.1) for event in log.step(step.sample)]
    assert "motor 6 is trusted again" in reported
    assert answers[0].done
    assert dive.step.sample.state.dead_motor == 0


def test_six_thrusters_hand_over_what_five_cannot_hold():
    dive = holding(base="sim-bluerov2.toml", companion=['vehicle.frame="vectored"'])
    dive.fault("thruster", thruster=6, value=0.0)
    dive.until(State.HAND_OVER, within_s=10.0)
    verdict = dive.step.sample.verdict
    assert Condition.THRUSTER_MISSED.text in verdict.reason
    assert verdict.remedy == "bring the vehicle up, and repair it"
    dive.run(10.0)
    assert dive.step.truth.mode == ALT_HOLD
    assert abs(dive.step.truth.eta[2] - DEPTH_M) < 1.0
    dive.ask(Request.STOP)
    dive.ask(Request.CLEAR_FAULT)
    dive.run(0.1)
    assert not dive.step.sample.verdict.conditions & Condition.THRUSTER_MISSED
