"""Who may steer. The expected table is written out here once more, not read from the code."""

import itertools
import math
from dataclasses import astuple, replace

import numpy as np
import pytest

from companion.config import load_config
from companion.supervisor import TRANSITIONS, Envelope, Supervisor, assess, guard, names, transition
from companion.types import (
    NEUTRAL,
    Ages,
    AxisCommand,
    Condition,
    Delays,
    State,
    VehicleState,
    Verdict,
)

C = Condition
TICK_S = 0.02
RAMP_S = 0.5
NOTHING = C(0)

UNFIT = (
    C.LINK_LOST,
    C.DEPTH_STALE,
    C.ATTITUDE_STALE,
    C.POSITION_STALE,
    C.DISARMED,
    C.WRONG_MODE,
    C.FAILSAFE_UNSAFE,
    C.NON_FINITE,
    C.TICK_LATE,
    C.TILTED,
)
FORBIDS_ENGAGING = (*UNFIT, C.PILOT_TAKEOVER, C.OPERATOR_STOP)

# What one condition alone leads to; what is not listed changes nothing.
EXPECTED = {
    State.IDLE: {
        **dict.fromkeys(UNFIT, State.IDLE),
        C.NON_FINITE: State.FAULT,
        NOTHING: State.READY,
        C.PILOT_TAKEOVER: State.READY,
        C.OPERATOR_STOP: State.READY,
        C.ENGAGE_ASKED: State.READY,
        C.CLEAR_ASKED: State.READY,
        C.RAMPED_DOWN: State.READY,
    },
    State.READY: {
        **dict.fromkeys(UNFIT, State.IDLE),
        C.NON_FINITE: State.FAULT,
        C.ENGAGE_ASKED: State.ACTIVE,
    },
    State.ACTIVE: {
        C.LINK_LOST: State.FAULT,
        C.DEPTH_STALE: State.FAULT,
        C.ATTITUDE_STALE: State.FAULT,
        C.POSITION_STALE: State.RAMP_DOWN,
        C.DISARMED: State.IDLE,
        C.WRONG_MODE: State.PILOT,
        C.FAILSAFE_UNSAFE: State.RAMP_DOWN,
        C.NON_FINITE: State.FAULT,
        C.TICK_LATE: State.RAMP_DOWN,
        C.TILTED: State.RAMP_DOWN,
        C.PILOT_TAKEOVER: State.PILOT,
        C.OPERATOR_STOP: State.RAMP_DOWN,
    },
    State.RAMP_DOWN: {
        C.LINK_LOST: State.FAULT,
        C.DEPTH_STALE: State.FAULT,
        C.ATTITUDE_STALE: State.FAULT,
        C.DISARMED: State.IDLE,
        C.WRONG_MODE: State.PILOT,
        C.NON_FINITE: State.FAULT,
        C.PILOT_TAKEOVER: State.PILOT,
        C.RAMPED_DOWN: State.IDLE,
    },
    State.PILOT: {
        C.NON_FINITE: State.FAULT,
        C.ENGAGE_ASKED: State.IDLE,
        C.CLEAR_ASKED: State.IDLE,
    },
    State.FAULT: {C.CLEAR_ASKED: State.IDLE},
}


def bits(conditions):
    return [bit for bit in C if bit & conditions]


def brought_to(state):
    """A supervisor in `state`, driven there from outside."""
    way = {
        State.IDLE: [],
        State.READY: [NOTHING],
        State.ACTIVE: [NOTHING, C.ENGAGE_ASKED],
        State.RAMP_DOWN: [NOTHING, C.ENGAGE_ASKED, C.OPERATOR_STOP],
        State.PILOT: [NOTHING, C.ENGAGE_ASKED, C.PILOT_TAKEOVER],
        State.FAULT: [NOTHING, C.ENGAGE_ASKED, C.LINK_LOST],
    }[state]
    supervisor, verdict = Supervisor(RAMP_S), None
    for conditions in way:
        verdict = supervisor.step(conditions, TICK_S)
    assert verdict is None or verdict.state is state
    return supervisor


@pytest.mark.parametrize("condition", [NOTHING, *C], ids=lambda bit: bit.name or "NOTHING")
@pytest.mark.parametrize("state", list(State))
def test_every_condition_alone_in_every_state(state, condition):
    expected = EXPECTED[state].get(condition, state)
    verdict = brought_to(state).step(condition, TICK_S)
    assert verdict.state is expected
    assert verdict.conditions & condition == condition
    assert (verdict.authority > 0.0) == (expected in (State.ACTIVE, State.RAMP_DOWN))


@pytest.mark.parametrize("row", TRANSITIONS, ids=lambda row: f"{row.at}-{row.to}-{row.because}")
def test_every_row_of_the_table_is_taken(row):
    """Each of its conditions that no row above it takes leads where it says, unless one of `unless` holds."""
    own = [bit for bit in bits(row.when) or [NOTHING] if transition(row.at, bit) is row]
    assert own
    for condition in own:
        assert brought_to(row.at).step(condition, TICK_S).state is row.to
        for veto in bits(row.unless):
            assert transition(row.at, condition | veto) is not row


def test_every_state_is_reached_from_idle_and_left_again():
    reached, new = {State.IDLE}, {State.IDLE}
    ways = {
        state: {row.to for bit in [NOTHING, *C] if (row := transition(state, bit))} - {state}
        for state in State
    }
    while new:
        new = set().union(*(ways[state] for state in new)) - reached
        reached |= new
    assert reached == set(State)
    assert all(ways[state] for state in State)


def test_active_is_entered_from_ready_alone_asked_for_and_with_nothing_against_it():
    veto = NOTHING
    for bit in FORBIDS_ENGAGING:
        veto |= bit
    for state in State:
        for size in (0, 1, 2):
            for extra in itertools.combinations(C, size):
                conditions = NOTHING
                for bit in extra:
                    conditions |= bit
                row = transition(state, conditions)
                if row and row.to is State.ACTIVE:
                    assert state is State.READY
                    assert conditions & C.ENGAGE_ASKED
                    assert not conditions & veto


def test_fault_is_latched_until_the_operator_clears_it():
    supervisor = brought_to(State.FAULT)
    for condition in [bit for bit in C if bit is not C.CLEAR_ASKED] * 2:
        assert supervisor.step(condition, TICK_S).state is State.FAULT
    assert supervisor.step(C.CLEAR_ASKED | C.NON_FINITE, TICK_S).state is State.FAULT
    assert supervisor.step(C.CLEAR_ASKED, TICK_S).state is State.IDLE


def test_clearing_a_fault_engages_nothing_by_itself():
    supervisor = brought_to(State.FAULT)
    states = [supervisor.step(C.CLEAR_ASKED, TICK_S).state]
    states += [supervisor.step(NOTHING, TICK_S).state for _ in range(5)]
    assert states[:2] == [State.IDLE, State.READY]
    assert set(states[2:]) == {State.READY}


@pytest.mark.parametrize("worse", [C.LINK_LOST, C.DEPTH_STALE, C.ATTITUDE_STALE, C.NON_FINITE])
@pytest.mark.parametrize("milder", [C.OPERATOR_STOP, C.TICK_LATE, C.PILOT_TAKEOVER, C.WRONG_MODE])
def test_the_worse_of_two_reasons_counts(worse, milder):
    assert brought_to(State.ACTIVE).step(worse | milder, TICK_S).state is State.FAULT


def test_ramping_down_takes_its_time_evenly_and_ends_in_idle():
    supervisor = brought_to(State.ACTIVE)
    authorities = []
    for _ in range(100):
        verdict = supervisor.step(C.OPERATOR_STOP, TICK_S)
        if verdict.state is not State.RAMP_DOWN:
            break
        authorities.append(verdict.authority)
    assert verdict.state is not State.READY
    assert verdict.authority == 0.0
    np.testing.assert_allclose(np.diff([1.0, *authorities]), -TICK_S / RAMP_S, atol=1e-12)
    assert len(authorities) * TICK_S == pytest.approx(RAMP_S, abs=1.5 * TICK_S)


def test_authority_is_one_when_engaged_again_after_a_ramp():
    supervisor = brought_to(State.RAMP_DOWN)
    for _ in range(60):
        supervisor.step(NOTHING, TICK_S)
    assert supervisor.step(C.ENGAGE_ASKED, TICK_S).authority == 1.0


def test_waiting_says_for_what():
    verdict = Supervisor(RAMP_S).step(C.DISARMED | C.DEPTH_STALE, TICK_S)
    assert verdict.state is State.IDLE
    assert "disarmed" in verdict.reason
    assert "depth stale" in verdict.reason
    assert names(C.LINK_LOST | C.TICK_LATE) == "link lost, tick late"


# --- What holds --------------------------------------------------------------------------------------------

LIMITS = load_config().supervisor
FINE_STATE = VehicleState(
    t_s=10.0,
    boot_s=5.0,
    eta=np.zeros(4),
    eta_dot=np.zeros(4),
    ahead_s=0.1,
    eta_ahead=np.zeros(4),
    eta_dot_ahead=np.zeros(4),
    disturbance=np.zeros(4),
    roll=0.0,
    pitch=0.0,
    p=0.0,
    q=0.0,
    armed=True,
    mode=19,
    system_status=4,
    voltage_v=16.0,
    pilot_gain=0.5,
    ages=Ages(0.0, 0.0, 0.0, 0.0, 0.0),
    delays=Delays(0.01, 0.01, True, True),
)
SAFE = {"FS_PILOT_INPUT": 2.0, "FS_PILOT_TIMEOUT": 3.0}


def assessed(state=FINE_STATE, **changes):
    arguments = {
        "steering_mode": 19,
        "parameters": SAFE,
        "holds_position": True,
        "finite": True,
        "late_s": 0.0,
        "pilot_deflection": 0.0,
        "stop": False,
        "engage": False,
        "clear": False,
    }
    return assess(state, LIMITS, **(arguments | changes))


def aged(**ages):
    return replace(FINE_STATE, ages=replace(FINE_STATE.ages, **ages))


def test_nothing_holds_when_all_is_well():
    assert assessed() == NOTHING


@pytest.mark.parametrize(
    ("state", "changes", "expected"),
    [
        (aged(link_s=LIMITS.link_timeout_s + 0.01), {}, C.LINK_LOST),
        (aged(depth_s=LIMITS.depth_timeout_s + 0.01), {}, C.DEPTH_STALE),
        (aged(attitude_s=LIMITS.attitude_timeout_s + 0.01), {}, C.ATTITUDE_STALE),
        (aged(position_s=LIMITS.position_timeout_s + 0.01), {}, C.POSITION_STALE),
        (aged(position_s=math.inf), {"holds_position": False}, NOTHING),
        (replace(FINE_STATE, armed=False), {}, C.DISARMED),
        (replace(FINE_STATE, mode=0), {}, C.WRONG_MODE),
        (FINE_STATE, {"parameters": {}}, C.FAILSAFE_UNSAFE),
        (FINE_STATE, {"parameters": SAFE | {"FS_PILOT_INPUT": 0.0}}, C.FAILSAFE_UNSAFE),
        (FINE_STATE, {"parameters": SAFE | {"FS_PILOT_TIMEOUT": 3.1}}, C.FAILSAFE_UNSAFE),
        (FINE_STATE, {"parameters": {"FS_PILOT_INPUT": 2.0}}, C.FAILSAFE_UNSAFE),
        (FINE_STATE, {"finite": False}, C.NON_FINITE),
        (FINE_STATE, {"late_s": LIMITS.late_tick_s + 0.01}, C.TICK_LATE),
        (FINE_STATE, {"pilot_deflection": LIMITS.pilot_deflection + 0.01}, C.PILOT_TAKEOVER),
        (FINE_STATE, {"stop": True}, C.OPERATOR_STOP),
        (FINE_STATE, {"engage": True}, C.ENGAGE_ASKED),
        (FINE_STATE, {"clear": True}, C.CLEAR_ASKED),
    ],
)
def test_each_condition_is_seen(state, changes, expected):
    assert assessed(state, **changes) == expected


@pytest.mark.parametrize("signal", ["link_s", "depth_s", "attitude_s", "position_s"])
@pytest.mark.parametrize("age", [math.inf, math.nan])
def test_an_age_that_is_not_known_counts_against_permission(signal, age):
    assert assessed(aged(**{signal: age})) != NOTHING


@pytest.mark.parametrize(
    "changes",
    [
        {"late_s": math.nan},
        {"pilot_deflection": math.nan},
        {"parameters": SAFE | {"FS_PILOT_INPUT": math.nan}},
    ],
)
def test_nan_counts_against_permission(changes):
    assert assessed(**changes) != NOTHING


# --- The last word -----------------------------------------------------------------------------------------

ENVELOPE = Envelope(max_axis=0.8, max_slew_per_s=5.0)
FULL = Verdict(State.ACTIVE, NOTHING, 1.0, "")


def test_guard_lets_a_fair_command_pass():
    command = AxisCommand(0.05, -0.05, 0.09, -0.1)
    assert guard(command, FULL, NEUTRAL, ENVELOPE, TICK_S) == command


@pytest.mark.parametrize("axis", ["surge", "sway", "heave", "yaw"])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_guard_bounds_and_slows_each_axis_alone(axis, sign):
    command = NEUTRAL
    seen = []
    for _ in range(20):
        command = guard(replace(NEUTRAL, **{axis: sign * 9.0}), FULL, command, ENVELOPE, TICK_S)
        seen.append(getattr(command, axis))
        assert astuple(replace(command, **{axis: 0.0})) == (0.0, 0.0, 0.0, 0.0)
    np.testing.assert_allclose(seen[:8], sign * 0.1 * np.arange(1, 9), atol=1e-12)
    np.testing.assert_allclose(seen[8:], sign * 0.8, atol=1e-12)


@pytest.mark.parametrize("state", [State.IDLE, State.READY, State.PILOT, State.FAULT])
def test_guard_is_neutral_at_once_without_permission_whatever_the_authority(state):
    verdict = Verdict(state, NOTHING, 1.0, "")
    command = AxisCommand(0.5, 0.5, 0.5, 0.5)
    assert guard(command, verdict, command, ENVELOPE, TICK_S) == NEUTRAL


@pytest.mark.parametrize("authority", [0.0, -1.0, 1.0001, math.nan, math.inf])
def test_guard_is_neutral_at_an_absurd_authority(authority):
    verdict = Verdict(State.ACTIVE, NOTHING, authority, "")
    assert guard(AxisCommand(0.1, 0.1, 0.1, 0.1), verdict, NEUTRAL, ENVELOPE, TICK_S) == NEUTRAL


@pytest.mark.parametrize("axis", ["surge", "sway", "heave", "yaw"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_one_axis_that_is_not_finite_makes_all_neutral(axis, value):
    command = replace(AxisCommand(0.1, 0.1, 0.1, 0.1), **{axis: value})
    assert guard(command, FULL, AxisCommand(0.1, 0.1, 0.1, 0.1), ENVELOPE, TICK_S) == NEUTRAL


def test_authority_scales_the_command():
    verdict = Verdict(State.RAMP_DOWN, NOTHING, 0.25, "")
    was = AxisCommand(0.1, -0.1, 0.1, -0.1)
    got = guard(AxisCommand(0.4, -0.4, 0.4, -0.4), verdict, was, ENVELOPE, TICK_S)
    np.testing.assert_allclose(astuple(got), (0.1, -0.1, 0.1, -0.1), atol=1e-12)
