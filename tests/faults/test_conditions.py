"""Each kind of condition of the supervisor through real bytes and the whole loop: how soon nothing pushes.

test_supervisor.py has every condition in every state, test_fault_campaign.py faults in each state; each tick
here keeps `lab.studies.promises`.
"""

import numpy as np
import pytest
from virtual import Dive, Somebody, active, hold, shared

from companion.records import Request, State

TICK_S = 0.02
HEARTBEAT_S = 1.0
RAMP_S = 1.0
DEPTH_S = ATTITUDE_S = 0.5
"""The shipped configuration's timeouts."""

ALT_HOLD = 2
PILOT_TIMEOUT_S = 3.0
"""ArduSub's own, after which it drops the last command."""


@shared
def idle():
    dive = Dive(arm=False, engage=False)
    dive.run(2.5)
    assert dive.state is State.IDLE
    return dive


@shared
def ready():
    """Armed by somebody else, in a vehicle whose own failsafe does not disarm it for want of a pilot."""
    dive = Dive("parameters.FS_PILOT_INPUT=1", arm=False, engage=False)
    dive.run(2.5)
    dive.tap.to_vehicle.append(Somebody().arm())
    return dive.until(State.READY)


@shared
def ramping_down():
    dive = active(companion=["supervisor.ramp_down_s=4"])
    dive.ask(Request.STOP)
    return dive.until(State.RAMP_DOWN)


@shared
def handing_over():
    """Its position is reset with every sample for a while, which it does not believe."""
    dive = Dive("sensors.dvl=true", setpoint=hold(x=0.1, y=0.1))
    dive.tap.to_vehicle.append(Somebody().origin())
    dive.until(State.ACTIVE)
    dive.run(1.0)
    dive.fault("position_reset", 2.0, value=0.6, count=100)
    return dive.until(State.HAND_OVER)


@shared
def pilots():
    dive = active()
    dive.fault("mode", value=0)
    dive.until(State.PILOT)
    dive.fault("mode", value=19)
    dive.run(1.2)
    assert dive.state is State.PILOT
    return dive


@shared
def faulty():
    dive = active()
    dive.fault("message_stopped", 1.3, message="ATTITUDE")
    dive.until(State.FAULT)
    dive.run(0.6)
    return dive


STATES = {
    State.IDLE: idle,
    State.READY: ready,
    State.ACTIVE: active,
    State.RAMP_DOWN: ramping_down,
    State.HAND_OVER: handing_over,
    State.PILOT: pilots,
    State.FAULT: faulty,
}


def link_lost(dive):
    dive.fault("link_cut", 1.6)


def depth_stale(dive):
    dive.fault("message_stopped", 1.2, message="GLOBAL_POSITION_INT")


def attitude_stale(dive):
    dive.fault("message_stopped", 1.2, message="ATTITUDE")


def disarmed(dive):
    dive.fault("disarm")


def wrong_mode(dive):
    dive.fault("mode", value=0)


def failsafe_unsafe(dive):
    dive.tap.to_vehicle.append(Somebody().parameter("FS_PILOT_INPUT", 0.0))


def not_fit(dive):
    dive.tap.to_vehicle.append(Somebody().parameter("FRAME_CONFIG", 1.0))


def non_finite(dive):
    engine = dive.engine  # setpoints and telemetry that are not finite are refused
    controlled = engine.memory.controlled
    surge, sway, heave, yaw = controlled.axes
    heave = heave._replace(reference=heave.reference._replace(x_d_dot=np.nan))
    controlled = controlled._replace(axes=(surge, sway, heave, yaw))
    engine.memory = engine.memory._replace(controlled=controlled)


def tick_late(dive):
    dive.tap.asleep_until_s = dive.t_s + 1.2


def pilot_takes_over(dive):
    somebody, since_s = Somebody(), dive.t_s

    def stick(t_s, inbox):
        if t_s - since_s < 1.0 and round(t_s / TICK_S) % 5 == 0:
            inbox.append((round((1000.0 + t_s) * 1e9), somebody.stick()))
        return inbox

    dive.tap.spoil = stick


def operator_stops(dive):
    dive.ask(Request.STOP)


# Condition: what ACTIVE comes to, and the longest that anything may push then.
FROM_ACTIVE = {
    link_lost: ([State.FAULT], DEPTH_S + 0.1),
    depth_stale: ([State.FAULT], DEPTH_S + 0.1),
    attitude_stale: ([State.FAULT], ATTITUDE_S + 0.1),
    disarmed: ([State.IDLE], HEARTBEAT_S + 0.1),
    wrong_mode: ([State.PILOT], HEARTBEAT_S + 0.1),
    failsafe_unsafe: ([State.RAMP_DOWN, State.IDLE], RAMP_S + 0.2),
    not_fit: ([State.RAMP_DOWN, State.IDLE], RAMP_S + 0.5),
    non_finite: ([State.FAULT], 0.04),
    tick_late: ([State.RAMP_DOWN, State.IDLE, State.READY], 1.2 + RAMP_S + 0.1),
    pilot_takes_over: ([State.PILOT], 0.2),
    operator_stops: ([State.RAMP_DOWN, State.IDLE, State.READY], RAMP_S + 0.1),
}


def left(dive, state, since_s):
    """The states that came after `state`."""
    seen = dive.states_since(since_s)
    return seen[1:] if seen[0] is state else seen


@pytest.mark.parametrize("condition", FROM_ACTIVE, ids=lambda condition: condition.__name__)
@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
def test_in_active_it_lets_go_in_time(condition):
    expected, within_s = FROM_ACTIVE[condition]
    dive = active()
    since_s = dive.t_s
    condition(dive)
    dive.run(3.6 if condition in (link_lost, tick_late) else 2.0)
    assert left(dive, State.ACTIVE, since_s) == expected
    assert dive.tap.last_thrust_s - since_s <= within_s
    assert dive.motors_rest() or condition is wrong_mode


@pytest.mark.parametrize("state", [state for state in State if state is not State.ACTIVE])
def test_after_a_fault_the_operator_alone_brings_it_back(state):
    """From wherever it is: cleared, asked, permitted, and not otherwise."""
    dive = STATES[state]()
    if state is State.IDLE:
        dive.tap.to_vehicle.append(Somebody().arm())
    if state is State.RAMP_DOWN:
        dive.until(State.READY)
    if state is State.HAND_OVER:
        dive.run(4.0)
        dive.ask(Request.STOP)
        dive.until(State.PILOT)
    if state is State.FAULT:
        dive.ask(Request.ENGAGE)
        dive.run(0.5)
        assert dive.state is State.FAULT
        dive.ask(Request.CLEAR_FAULT)
    dive.ask(Request.ENGAGE)
    dive.until(State.ACTIVE)


def test_the_vehicles_own_failsafe_covers_a_companion_that_died():
    """No frame at all: ArduSub drops the last one by itself."""
    dive = active()
    dive.tap.asleep_until_s = 1e9
    dive.run(PILOT_TIMEOUT_S + 1.0)
    assert dive.motors_rest()
