"""A request that is refused changes nothing: at once, in words, in every state."""

from functools import cache
from typing import Any

import pytest
from console import Console
from test_conditions import STATES
from test_pilot import ENGAGE, at_the_stick
from virtual import Dive, Somebody, active, hold

from companion.records import Condition, Request, State
from companion.telemetry.event_log import EventLog

WATCHED_S, ENGAGE_WATCHED_S = 1.0, 6.0
"""The latter longer than a request to engage is valid."""

COMMANDS = {
    Request.ENGAGE: "engage",
    Request.STOP: "release",
    Request.CLEAR_FAULT: "clear_fault",
    Request.RESET_MODEL: "reset_model",
}
"""WITHDRAW alone is no command: the queue gives it when a request to engage is too old."""


def reached(state, blocked):
    """A dive in `state`, at its console; `blocked` by a leak, which forbids engaging."""
    dive = STATES[state]()
    if blocked and state is not State.ACTIVE:
        dive.fault("leak")
        dive.run(0.3)
    wanted = State.IDLE if blocked and state is State.READY else state
    assert dive.state is wanted
    return dive, Console(dive)


def course(dive, console, seconds):
    """Dive on; return all that was sent and every verdict."""
    sent, step = [], console.engine.step

    def noted(*arguments):
        out, sample = step(*arguments)
        sent.append((out, sample.verdict, sample.command, sample.guided))
        return out, sample

    console.engine.step = noted
    dive.run(seconds)
    return sent


@cache
def undisturbed(state, blocked, seconds):
    dive, console = reached(state, blocked)
    return course(dive, console, seconds)


ASKED = [
    (request, blocked) for request in Request for blocked in (False, True)[: 1 + (request == Request.ENGAGE)]
]


@pytest.mark.parametrize(("request_", "blocked"), ASKED, ids=lambda one: getattr(one, "name", str(one)))
@pytest.mark.parametrize("state", State)
def test_a_request_is_done_or_is_refused_at_once_and_changes_nothing(state, request_, blocked):
    dive, console = reached(state, blocked)
    why = console.engine.refusal(request_)
    seconds = ENGAGE_WATCHED_S if request_ is Request.ENGAGE else WATCHED_S
    if request_ is Request.WITHDRAW:
        dive.ask(request_)
        went, calm = course(dive, console, seconds), undisturbed(state, blocked, seconds)
        assert [(out, verdict.state) for out, verdict, *_ in went] == [(out, v.state) for out, v, *_ in calm]
        return
    if not why:
        reply = console.tell(COMMANDS[request_])
        assert reply.done, reply.said
        return
    answers = console.ask(COMMANDS[request_])
    went = course(dive, console, seconds)
    (reply,) = answers
    assert not reply.done
    assert reply.said == f"refused: {why}"
    assert not console.given[0].requests, "refused in the tick in which it came"
    assert "to do: " in why or "no fault is latched" in why
    assert went == undisturbed(state, blocked, seconds)


@pytest.mark.parametrize("state", [State.RAMP_DOWN, State.HAND_OVER, State.PILOT, State.FAULT])
def test_the_engine_too_drops_what_is_refused(state):
    """Whoever asks it, such as a recording: an ENGAGE that is kept would engage later, and surprise."""
    dive, console = reached(state, blocked=True)
    assert console.engine.refusal(Request.ENGAGE)
    dive.ask(Request.ENGAGE)
    assert course(dive, console, WATCHED_S) == undisturbed(state, True, WATCHED_S)
    assert Condition.ENGAGE_ASKED not in dive.step.sample.verdict.conditions


def test_an_engage_that_comes_to_nothing_is_withdrawn_and_releases_nothing():
    """The autopilot takes no mode: the request ends after 5 s, and no release is asked for."""
    dive: Any = Dive(engage=False)
    dive.fault("mode", value=2)
    dive.run(3.0)
    dive.vehicle.autopilot.set_mode = lambda number: 4
    console = Console(dive)
    reply = console.tell("engage")
    assert not reply.done
    assert reply.said.startswith("withdrawn: it did not engage within 5 s. IDLE: waiting for: ")
    dive.run(0.1)
    asked = [request for given in console.given for request in given.requests]
    assert asked == [Request.ENGAGE, Request.WITHDRAW]
    assert Condition.ENGAGE_ASKED not in dive.step.sample.verdict.conditions


def test_a_button_that_is_refused_says_so():
    dive, log = at_the_stick(arm=False), EventLog()
    dive.cockpit.push(buttons=ENGAGE)
    texts = [event.text for step in dive.run(0.2) for event in log.step(step.sample)]
    reported = f"engage by button: refused: the vehicle is disarmed; to do: {Condition.DISARMED.remedy}"
    assert texts.count(reported) == 1
    dive.cockpit.push()
    dive.run(0.1)
    dive.cockpit.extra.append(Somebody().arm())
    dive.run(3.0)
    assert dive.step.truth.armed
    assert dive.state is not State.ACTIVE


def test_the_surface_of_a_failsafe_is_left_by_no_request():
    dive = active("initial.eta=[0,0,4,0,0,0.3]", setpoint=hold(z=4.0))
    dive.fault("mode", value=9)
    dive.until(State.PILOT)
    console = Console(dive)
    assert "choose another flight mode" in console.tell("engage").said
    steps = dive.run(2.0)
    assert {step.truth.mode for step in steps} == {9}


@pytest.mark.parametrize("answers", [True, False])
def test_it_engages_only_on_a_failsafe_that_was_read_since(answers):
    """The notice of a change may be lost: until the next reading, 10 s later, one could engage."""
    dive = STATES[State.READY]()
    dive.fault("message_stopped", 0.5 if answers else 1e9, message="PARAM_VALUE")
    dive.tap.to_vehicle.append(Somebody().parameter("FS_PILOT_INPUT", 0.0))
    dive.run(0.6)
    assert dive.state is State.READY
    since_s = dive.t_s
    reply = Console(dive).tell("engage")
    assert not reply.done
    assert State.ACTIVE not in dive.states_since(since_s)
    if answers:
        assert reply.said.startswith("refused. IDLE: waiting for: the pilot-input failsafe")
        assert dive.t_s - since_s < 0.5, "it need not wait"
    else:
        assert "FS_PILOT_INPUT and FS_PILOT_TIMEOUT were not answered" in reply.said
    dive.run(0.1)
    assert Condition.ENGAGE_ASKED not in dive.step.sample.verdict.conditions
