"""What falls silent is frozen at its last value and said to be absent; it starts anew when it comes back.

A silence under a second, and a tick that is late by less, only interrupt: neutral, then on where it was.
"""

import itertools

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from virtual import Dive, Somebody, active, hold, pieces, shared

from companion.config import load_config
from companion.guidance.orders import ordering
from companion.records import PSI, ZERO, Condition, Request, State, X, Z
from companion.steps import finish
from companion.telemetry import samples
from companion.telemetry import schemas as telemetry
from companion.telemetry.event_log import EventLog
from companion.telemetry.operator_commands import Follow
from companion.telemetry.plan import PathPlan, Waypoint
from lab.loop.lockstep import START_S

DVL = ("sensors.dvl=true",)
ALL = ("depth_m", "depth_rate_mps", "heading_rad", "heading_rate_radps", "roll_rad", "pitch_rad")


def reported(step):
    """The telemetry's State of a step."""
    state = samples.records(step.sample)[0]
    assert isinstance(state, telemetry.State)
    return state


def test_after_the_link_is_lost_nothing_is_invented():
    dive = active("waves.enabled=true", *DVL)
    assert reported(dive.step).absent == ()
    last = dive.step.sample.state.eta
    dive.fault("link_cut", 20.0)
    steps = dive.run(16.0)
    frozen = steps[60:]  # 1.2 s: the longest of the timeouts is 1 s
    for step in frozen:
        state = step.sample.state
        assert state.eta == frozen[0].sample.state.eta
        assert state.eta_ahead == state.eta
        assert state.eta_dot == state.eta_dot_ahead == state.disturbance == ZERO
        assert (state.p, state.q) == (0.0, 0.0)
    assert np.abs(np.subtract(frozen[0].sample.state.eta, last)).max() < 0.3
    assert {*ALL, "x_m", "y_m", "armed", "mode", "voltage_v"} <= set(reported(dive.step).absent)
    for record in samples.records(dive.step.sample)[1:5]:
        assert {"x", "x_dot", "e", "e_dot"} <= set(record.absent)


def test_only_what_is_silent_is_absent():
    never = active("current.enabled=true")
    assert not any(any(step.sample.state.eta[:2]) for step in never.run(3.0)), "a place that never came"
    dive = active(*DVL)
    dive.fault("message_stopped", 20.0, message="LOCAL_POSITION_NED")
    dive.run(3.0)
    for one in (never, dive):
        assert reported(one.step).absent == ("x_m", "x_rate_mps", "y_m", "y_rate_mps")
    dive.fault("message_stopped", 20.0, message="ATTITUDE")
    dive.run(3.0)
    assert {"heading_rad", "depth_m"} & set(reported(dive.step).absent) == {"heading_rad"}


@pytest.mark.parametrize("plant", [(), DVL])
def test_it_starts_anew_when_the_link_returns_and_engages_without_a_step(plant):
    dive = active("current.enabled=true", "current.speed_m_s=0.3", *plant)
    dive.fault("link_cut", 2.0)
    dive.run(2.5)
    assert dive.state is State.FAULT
    state, held = dive.step.sample.state, [X, 1, Z, PSI] if plant else [Z, PSI]
    assert np.abs(state.eta - dive.step.truth.eta[[0, 1, 2, 5]])[held].max() < 0.15
    assert not any(state.stale[dof] for dof in held)
    assert "depth_m" not in reported(dive.step).absent
    dive.ask(Request.CLEAR_FAULT)
    dive.run(0.1)
    dive.ask(Request.ENGAGE)
    dive.until(State.ACTIVE)
    thrust = np.array([step.sample.requested for step in dive.run(0.5)])
    assert np.abs(thrust[:5]).max() < 15.0
    assert dive.step.sample.verdict.state is State.ACTIVE


LIMITS = load_config().supervisor
CURRENT = ("current.enabled=true", "current.speed_m_s=0.2", "initial.eta=[0,0,2,0,0,0]")
LINE = PathPlan(
    name="line",
    waypoint=(Waypoint(x_m=0.0, y_m=0.0), Waypoint(x_m=6.0, y_m=0.0)),
    heading="keep",
    speed_mps=0.3,
)
SILENT = ("all", "ATTITUDE", "GLOBAL_POSITION_INT", "uplink", "late tick", "late tick and stamps")


def interrupt(dive, what, seconds):
    """What arrived during a late tick is stamped when it came, or as a process does it: when it is read."""
    until_s = dive.t_s + seconds
    if what == "all":
        dive.fault("link_cut", seconds)
    elif what == "uplink":
        dive.tap.mute_until_s = until_s
    elif what.startswith("late tick"):
        dive.tap.asleep_until_s = until_s
    else:
        dive.fault("message_stopped", seconds, message=what)
    if what == "late tick and stamps":
        spoil, read_ns = dive.tap.spoil, round((START_S + until_s) * 1e9)
        dive.tap.spoil = lambda t_s, inbox: [(max(at, read_ns), data) for at, data in spoil(t_s, inbox)]


@shared
def placed(setpoint=None, seconds=12.0):
    """Holding a place in a current, without a ground station."""
    dive = Dive(
        "sensors.dvl=true", "sensors.dvl_drift_m=0", *CURRENT, setpoint=setpoint or hold(z=2.5, x=0.0, y=0.0)
    )
    dive.tap.to_vehicle.append(Somebody().origin())
    dive.until(State.ACTIVE).run(seconds)
    return dive


def distance(dive, eta):
    """How far from there it is, m and degrees."""
    *off, turned = np.subtract(dive.step.truth.eta, eta)[[0, 1, 2, 5]]
    return np.linalg.norm(off), abs(np.degrees(turned))


@settings(max_examples=14, deadline=None)
@given(what=st.sampled_from(SILENT), seconds=st.floats(0.02, 1.6))
def test_any_short_interruption_is_ridden_out_and_a_longer_one_ends_it_as_ever(what, seconds):
    """No tick of `Dive` breaks a promise: thrust rests on old telemetry as soon as it ever did."""
    dive = placed()
    there = dive.step.truth.eta
    interrupt(dive, what, seconds)
    steps = dive.run(6.0)
    states = [state for state, _ in itertools.groupby(step.sample.verdict.state for step in steps)]
    if what == "uplink" or seconds <= 0.95:
        assert states == [State.ACTIVE]
        assert np.less(distance(dive, there), (0.05, 2.0)).all()
    elif seconds >= 1.2:
        assert states[1] is (State.RAMP_DOWN if what.startswith("late tick") else State.FAULT)
        assert dive.state is not State.ACTIVE


ENDINGS = Condition.INTERRUPTED_OFTEN | Condition.LINK_LOST | Condition.DEPTH_STALE | Condition.ATTITUDE_STALE
STUTTERS = {
    "depth": ("GLOBAL_POSITION_INT",),
    "attitude": ("ATTITUDE",),
    "depth and attitude by turns": ("GLOBAL_POSITION_INT", "ATTITUDE"),
    "all": ("",),
}


@settings(max_examples=4, deadline=None)
@given(
    what=st.sampled_from(sorted(STUTTERS)),
    silent=st.lists(st.floats(0.1, 0.95), min_size=1, max_size=4),
    heard=st.lists(st.floats(0.02, 2.0), min_size=1, max_size=4),
)
@example(what="depth", silent=[0.52], heard=[0.02])
@example(what="attitude", silent=[0.54], heard=[0.02])
@example(what="depth and attitude by turns", silent=[0.54], heard=[0.02])
@example(what="all", silent=[0.9], heard=[0.3])
def test_pauses_without_end_leave_most_of_the_authority_or_end_it_and_say_why(what, silent, heard):
    dive, steps = placed(), []
    messages, turns = itertools.cycle(STUTTERS[what]), itertools.cycle(zip(silent, itertools.cycle(heard)))
    began_s = dive.t_s
    while dive.t_s - began_s < 14.0 and dive.state is State.ACTIVE:
        silent_s, heard_s = next(turns)
        dive.fault("message_stopped", silent_s, message=next(messages))
        steps += dive.run(silent_s + heard_s)
    authority = [step.sample.verdict.authority for step in steps]
    held = list(itertools.takewhile(lambda step: step.sample.verdict.state is State.ACTIVE, steps))
    means = [np.mean(authority[i : i + 500]) for i in range(max(len(held) - 500, 0))]
    assert min(means, default=1.0) >= 0.8
    if len(held) < len(steps):
        ended = steps[len(held)].sample.verdict
        assert ended.conditions & ENDINGS
        assert ended.reason
    off = np.abs([step.truth.eta - held[0].truth.eta for step in held])
    assert off[:, Z].max() < 0.3
    assert np.hypot(off[:, X], off[:, 1]).max() < 0.5


@pytest.mark.parametrize("message", ["GLOBAL_POSITION_INT", "ATTITUDE"])
def test_a_stream_of_two_hertz_is_asked_for_anew_named_and_handed_over(message):
    dive, last_s = placed(), -1.0
    wanted, asked = getattr(mavlink, f"MAVLINK_MSG_ID_{message}"), list[tuple[int, bytes]]()

    def slow(t_s, inbox):
        nonlocal last_s
        kept = []
        for at, data in inbox:
            for kind, frame in pieces(data):
                if kind == wanted:
                    if t_s - last_s < 0.52:
                        continue
                    last_s = t_s
                kept.append((at, frame))
        return kept

    dive.tap.spoil = slow
    dive.tap.after = lambda out, _: asked.extend(
        piece for data in out for piece in pieces(data) if piece[0] == mavlink.MAVLINK_MSG_ID_COMMAND_LONG
    )
    steps = dive.run(10.0)
    ended = next(step.sample.verdict for step in steps if step.sample.verdict.state is not State.ACTIVE)
    assert ended.state is State.HAND_OVER
    signal = "attitude" if message == "ATTITUDE" else "depth"
    assert ended.reason.startswith(f"{Condition.INTERRUPTED_OFTEN.text} (no {signal} for 0.5")
    assert message in ended.remedy or "depth_source" in ended.remedy
    orders = [mavlink.MAVLink(None).parse_buffer(frame)[0] for _, frame in asked]
    rates = [order for order in orders if order.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL]
    assert sum(order.param1 == wanted for order in rates) >= 2
    assert np.ptp([step.truth.eta[2] for step in steps]) < 0.3


@pytest.mark.parametrize("path", [False, True], ids=["a place", "a path"])
def test_a_dive_over_a_link_that_pauses_ends_where_it_began_and_is_told_once(path):
    """0.3 to 0.9 s each 8 s, nobody at a ground station: the autopilot would disarm what nobody steers."""
    dive, log, told = placed(), EventLog(), []
    if path:
        dive.engine.guide(finish(ordering(Follow(path=LINE), dive.engine.config)))
    there = (6.0, 0.0, 2.5, *dive.step.truth.eta[3:]) if path else dive.step.truth.eta
    for seconds in (0.3, 0.6, 0.9, 0.75):
        dive.fault("link_cut", seconds)
        steps = dive.run(8.0)
        assert all(step.sample.state.armed for step in steps)
        told += [event.text for step in steps for event in log.step(step.sample)]
    assert np.less(distance(dive, there), (0.05, 2.0)).all()
    assert dive.states_since(dive.t_s - 32.0) == [State.ACTIVE]
    assert told.count(Condition.UNSTEADY.text) == 1
    assert not {Condition.LINK_LOST.text, Condition.DEPTH_STALE.text, Condition.ATTITUDE_STALE.text} & set(
        told
    )


@pytest.mark.parametrize(("kind", "far"), [("depth_shifted", 3), ("yaw_reset", 40), ("position_reset", 3)])
def test_what_is_another_one_after_an_interruption_is_not_followed(kind, far):
    """Nobody knows what happened to a depth in the silence: a zero that moved, a sensor that flooded."""
    dive, refused = placed(), kind == "depth_shifted"
    dive.fault("link_cut", 0.8)
    dive.fault(kind, 0.1, value=far)
    assert np.ptp([step.truth.eta for step in dive.run(4.0)], axis=0)[[2] if refused else ...].max() < 0.16
    assert dive.state is (State.FAULT if refused else State.ACTIVE)


def test_while_interrupted_it_is_neutral_and_what_is_wanted_stays():
    dive = placed()
    dive.tap.aim(hold(z=1.5, x=0.5, y=0.0))
    dive.run(0.5)
    target = dive.engine.target
    dive.fault("link_cut", 0.9)
    steps = dive.run(1.2)
    interrupted = [step.sample for step in steps if step.sample.verdict.conditions & Condition.INTERRUPTED]
    assert len(interrupted) == pytest.approx(50 * (0.9 - LIMITS.depth_timeout_s), abs=4)
    assert {sample.verdict.authority for sample in interrupted} == {0.0}
    assert not any(any(sample.command) for sample in interrupted)
    assert len(dive.tap.frames) >= 50 * 1.2, "neutral frames go on"
    assert dive.engine.target == pytest.approx(target, abs=1e-6)
    dive.run(8.0)
    assert np.less(distance(dive, (0.5, 0.0, 1.5, *dive.step.truth.eta[3:])), (0.05, 0.1)).all()
