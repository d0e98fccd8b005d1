"""Who may steer. The expected table is written out here once more, not read from the code."""

import itertools
import math
from collections.abc import Mapping
from typing import Any

import msgspec
import pytest
from builders import RESTING
from msgspec import structs

from companion.config import load_config
from companion.records import (
    Angles,
    Condition,
    Delays,
    EkfStatus,
    HeadingCheck,
    LoopHealth,
    Request,
    State,
)
from companion.supervision.handover import HandOverStep
from companion.supervision.rules import (
    CLOCK_DOUBT_S,
    RESET_SETTLE_S,
    UNANSWERED_S,
    UPSIDE_DOWN_S,
    assess,
)
from companion.supervision.situation import Observation, Situation, Watched
from companion.supervision.supervisor import (
    StateMachine,
    remedy,
    transition,
)
from companion.telemetry.glossary import STATES

C = Condition
TICK_S = 0.02
RAMP_S = 0.5
NOTHING = C(0)

CLEAR = STATES[State.FAULT].remedy

BLOCKING = (
    C.LINK_LOST,
    C.DEPTH_STALE,
    C.ATTITUDE_STALE,
    C.DISARMED,
    C.WRONG_MODE,
    C.FAILSAFE_UNSAFE,
    C.PREFLIGHT_FAILURE,
    C.NON_FINITE,
    C.TICK_LATE,
    C.TILTED,
    C.DEPTH_JUMPED,
    C.DEPTH_DOUBTED,
    C.ATTITUDE_DOUBTED,
    C.DEPTH_OUT_OF_BOUNDS,
    C.EKF_UNHEALTHY,
    C.INNOVATION_LARGE,
    C.DELAY_TOO_LONG,
    C.LEAK,
    C.BATTERY_LOW,
    C.REBOOTED,
    C.PILOT_LOST,
    C.CLOCK_INCONSISTENT,
    C.THRUSTER_MISSED,
    C.OTHER_FIRST,
)
ONLY_REPORTED = (
    C.POSITION_DOUBTED,
    C.POSITION_STALE,
    C.THRUSTER_DEAD,
    C.THRUSTER_REVERSED,
    C.SATURATED,
    C.CLOCK_JUMPED,
    C.QUEUE_FULL,
    C.CONFIG_CHANGED,
    C.YAW_RESET,
    C.POSITION_RESET,
    C.DEPTH_RESET,
    C.PEER_CHANGED,
    C.GROUND_LOST,
    C.GROUND_DOUBTED,
    C.POSITION_UNUSED,
    C.HEADING_WRONG,
    C.UNSTEADY,
    C.OTHER_CAME,
)
FORBIDS_ENGAGING = (*BLOCKING, C.PILOT_TAKEOVER, C.OPERATOR_STOP)

# What one condition alone leads to; what is not listed changes nothing.
EXPECTED = {
    State.IDLE: {
        **dict.fromkeys((NOTHING, *C), State.READY),
        **dict.fromkeys(BLOCKING, State.IDLE),
        C.NON_FINITE: State.FAULT,
    },
    State.READY: {
        **dict.fromkeys(BLOCKING, State.IDLE),
        C.NON_FINITE: State.FAULT,
        C.ENGAGE_ASKED: State.ACTIVE,
    },
    State.ACTIVE: {
        C.LINK_LOST: State.FAULT,
        C.DEPTH_STALE: State.FAULT,
        C.ATTITUDE_STALE: State.FAULT,
        C.REBOOTED: State.FAULT,
        C.LEAK: State.HAND_OVER,
        C.DELAY_TOO_LONG: State.HAND_OVER,
        C.INTERRUPTED_OFTEN: State.HAND_OVER,
        C.CLOCK_INCONSISTENT: State.HAND_OVER,
        C.INNOVATION_LARGE: State.HAND_OVER,
        C.OFF_TRACK: State.HAND_OVER,
        C.THRUST_UNANSWERED: State.RAMP_DOWN,
        C.THRUST_OPPOSED: State.RAMP_DOWN,
        C.EKF_UNHEALTHY: State.RAMP_DOWN,
        C.DEPTH_OUT_OF_BOUNDS: State.RAMP_DOWN,
        C.AUTOPILOT_FAILSAFE: State.RAMP_DOWN,
        C.DISARMED: State.IDLE,
        C.FAILSAFE_SURFACES: State.HAND_OVER,
        C.WRONG_MODE: State.PILOT,
        C.FAILSAFE_UNSAFE: State.RAMP_DOWN,
        C.OTHER_FIRST: State.RAMP_DOWN,
        C.PREFLIGHT_FAILURE: State.RAMP_DOWN,
        C.NON_FINITE: State.FAULT,
        C.TICK_LATE: State.RAMP_DOWN,
        C.TURNED_OVER: State.FAULT,
        C.TILT_PERSISTS: State.HAND_OVER,
        C.THRUSTER_MISSED: State.HAND_OVER,
        C.PILOT_TAKEOVER: State.PILOT,
        C.PILOT_LOST: State.RAMP_DOWN,
        C.PILOT_LOST_SURFACE: State.HAND_OVER,
        C.OPERATOR_STOP: State.RAMP_DOWN,
    },
    State.RAMP_DOWN: {
        C.LINK_LOST: State.FAULT,
        C.DEPTH_STALE: State.FAULT,
        C.ATTITUDE_STALE: State.FAULT,
        C.DISARMED: State.IDLE,
        C.FAILSAFE_SURFACES: State.HAND_OVER,
        C.WRONG_MODE: State.PILOT,
        C.NON_FINITE: State.FAULT,
        C.PILOT_TAKEOVER: State.PILOT,
        C.RAMPED_DOWN: State.IDLE,
        C.REBOOTED: State.FAULT,
    },
    State.HAND_OVER: {
        C.LINK_LOST: State.FAULT,
        C.REBOOTED: State.FAULT,
        C.NON_FINITE: State.FAULT,
        C.TURNED_OVER: State.FAULT,
        C.HAND_OVER_REFUSED: State.FAULT,
        C.WRONG_MODE: State.PILOT,
        C.PILOT_TAKEOVER: State.PILOT,
        C.OPERATOR_STOP: State.PILOT,
        C.HANDED_OVER: State.PILOT,
        C.DISARMED: State.IDLE,
    },
    State.PILOT: {
        C.NON_FINITE: State.FAULT,
        C.ENGAGE_ASKED: State.IDLE,
    },
    State.FAULT: {C.CLEAR_ASKED: State.IDLE},
}


def brought_to(state):
    """A supervisor in `state`, driven there from outside."""
    way = {
        State.IDLE: [],
        State.READY: [NOTHING],
        State.ACTIVE: [NOTHING, C.ENGAGE_ASKED],
        State.RAMP_DOWN: [NOTHING, C.ENGAGE_ASKED, C.OPERATOR_STOP],
        State.HAND_OVER: [NOTHING, C.ENGAGE_ASKED, C.OFF_TRACK],
        State.PILOT: [NOTHING, C.ENGAGE_ASKED, C.PILOT_TAKEOVER],
        State.FAULT: [NOTHING, C.ENGAGE_ASKED, C.LINK_LOST],
    }[state]
    supervisor, verdict = StateMachine(RAMP_S), None
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
    carries = expected in (State.ACTIVE, State.RAMP_DOWN, State.HAND_OVER)
    surfaces = condition is C.FAILSAFE_SURFACES and expected is State.HAND_OVER
    rests = surfaces or condition is C.INTERRUPTED
    assert (verdict.authority > 0.0) == (carries and not rests), "who surfaces gets no thrust of ours"


def test_active_is_entered_from_ready_alone_asked_for_and_with_nothing_against_it():
    for state, one, other in itertools.product(State, C, C):
        row = transition(state, one | other)
        if row and row.to is State.ACTIVE:
            assert state is State.READY
            assert C.ENGAGE_ASKED in (one, other)
            assert not {one, other} & set(FORBIDS_ENGAGING)


@pytest.mark.parametrize("worse", [C.LINK_LOST, C.DEPTH_STALE, C.ATTITUDE_STALE, C.NON_FINITE])
@pytest.mark.parametrize("milder", [C.OPERATOR_STOP, C.TICK_LATE, C.PILOT_TAKEOVER, C.WRONG_MODE])
def test_the_worse_of_two_reasons_counts(worse, milder):
    assert brought_to(State.ACTIVE).step(worse | milder, TICK_S).state is State.FAULT


@pytest.mark.parametrize("gives_up", [C.TILT_PERSISTS, C.OFF_TRACK])
def test_a_reversed_motor_is_not_handed_to_an_autopilot_that_does_not_know_of_it(gives_up):
    verdict = brought_to(State.ACTIVE).step(gives_up | C.THRUSTER_REVERSED, TICK_S)
    assert verdict.state is State.RAMP_DOWN
    assert verdict.reason == gives_up.text


def test_waiting_says_for_what():
    verdict = StateMachine(RAMP_S).step(C.DISARMED | C.DEPTH_STALE, TICK_S)
    assert verdict.state is State.IDLE
    assert verdict.reason == "waiting for: a fresh depth, arming"
    found = {C.PREFLIGHT_FAILURE: ("the frame", ""), C.LINK_LOST: ("a fish", "fish")}
    reported = StateMachine(RAMP_S).step(C.DISARMED | C.SATURATED | C.PREFLIGHT_FAILURE, TICK_S, found)
    assert reported.reason == "waiting for: the pre-dive list (the frame), arming"
    silent = StateMachine(RAMP_S).step(C.DEPTH_STALE | C.ATTITUDE_STALE | C.LINK_LOST, TICK_S, found)
    assert silent.reason == "waiting for: the vehicle's heartbeat (a fish)", "nothing else is known then"
    assert silent.remedy == "fish"


def test_why_control_ended_stays_readable_until_it_begins_again():
    supervisor = brought_to(State.RAMP_DOWN)
    for conditions in (C.RAMPED_DOWN, NOTHING, NOTHING):
        verdict = supervisor.step(conditions, TICK_S)
    assert verdict.state is State.READY
    assert verdict.reason.endswith("; control ended: the operator released the vehicle")
    waits = [supervisor.step(C.DISARMED, TICK_S) for _ in range(3)][-1]
    assert waits.reason == "waiting for: arming; control ended: the operator released the vehicle"
    supervisor.step(NOTHING, TICK_S)
    assert supervisor.step(C.ENGAGE_ASKED, TICK_S).reason == "engaged"


@pytest.mark.parametrize("state", [State.FAULT, State.PILOT])
def test_a_cause_that_is_over_is_named_as_past(state):
    supervisor = brought_to(state)
    cause = {State.FAULT: C.LINK_LOST, State.PILOT: C.PILOT_TAKEOVER}[state]
    assert supervisor.step(cause, TICK_S).reason == cause.text
    assert supervisor.step(C.DISARMED, TICK_S).reason == f"was: {cause.text}; now {cause.ended}"
    assert supervisor.step(cause, TICK_S).reason == cause.text


# --- What to do --------------------------------------------------------------------------------------------


def todo(state, *conditions):
    held = NOTHING
    for condition in conditions:
        held |= condition
    return remedy(state, held)


@pytest.mark.parametrize("state", list(State))
def test_a_lost_link_outranks_everything(state):
    for other in C:
        assert todo(state, C.LINK_LOST, other).startswith("check the cable, the router and link.endpoint")


def test_a_latched_fault_is_to_be_cleared_whatever_else_is_missing():
    for other in (
        NOTHING,
        C.DISARMED,
        C.WRONG_MODE,
        C.DISARMED | C.WRONG_MODE | C.PREFLIGHT_FAILURE,
        C.PILOT_TAKEOVER,
    ):
        assert todo(State.FAULT, other) == CLEAR
    assert "clear the fault" in CLEAR


@pytest.mark.parametrize("cause", [C.LINK_LOST, C.DEPTH_STALE, C.ATTITUDE_STALE, C.REBOOTED, C.NON_FINITE])
def test_a_fault_whose_cause_still_holds_names_the_cause_first(cause):
    text = todo(State.FAULT, cause, C.DISARMED, C.WRONG_MODE)
    assert text == f"{cause.remedy}; then {CLEAR}"


def test_what_keeps_it_from_engaging_comes_in_an_order_that_gets_on():
    disarmed = (C.DISARMED, C.WRONG_MODE)
    assert todo(State.IDLE, C.PREFLIGHT_FAILURE, C.DEPTH_STALE, *disarmed) == todo(State.IDLE, C.DEPTH_STALE)
    assert "holdfast check" in todo(State.IDLE, C.PREFLIGHT_FAILURE, *disarmed)
    assert todo(State.IDLE, *disarmed).startswith("arm the vehicle at the ground station")
    assert todo(State.IDLE, C.WRONG_MODE).startswith("engage")
    assert todo(State.READY).startswith("engage")
    assert "release the stick" in todo(State.READY, C.PILOT_TAKEOVER)
    assert todo(State.PILOT).startswith("engage (`holdfast engage`")
    for state in (State.RAMP_DOWN, State.HAND_OVER):
        for passing in (C.WRONG_MODE, C.DISARMED, C.CLOCK_JUMPED):
            assert todo(state, passing).startswith("wait")
            assert "tether" in todo(state, passing, C.PILOT_LOST)
    assert todo(State.ACTIVE, C.BATTERY_LOW, C.DISARMED) == "bring the vehicle up"


# --- What holds --------------------------------------------------------------------------------------------

LIMITS = load_config().supervisor
SOUND = EkfStatus(9.9, attitude=True, depth=True, variance=0.1)
RELEASES = structs.replace(
    load_config().ground_station, endpoint="udpin::14550", timeout_s=3.0, on_loss="silence"
)
SURFACES = structs.replace(RELEASES, on_loss="surface")
SAFE = {"FS_PILOT_INPUT": 2.0, "FS_PILOT_TIMEOUT": 3.0}
ACTIVE = {"active": True}


def situation(state=RESTING, **changes):

    def record(kind, **values):
        names = {field.name for field in structs.fields(kind)} & changes.keys()
        return kind(**(values | {name: changes.pop(name) for name in names}))

    watched = record(Watched, ekf=SOUND)
    loop = LoopHealth(1, 50.0, 0.0, 0.0, 0, 0)
    observed = record(Observation, state=state, dt_s=TICK_S, loop=loop, held=(True,) * 4)
    known: dict[str, Any] = {"mode_right": True, "parameters": SAFE, "steered": True, "tick_s": TICK_S}
    known["ground_station"] = structs.replace(RELEASES, endpoint="")
    return Situation(observed=observed, state=observed.state, watched=watched, **(known | changes))


def assessed(state=RESTING, **changes):
    return assess(situation(state, **changes), LIMITS)


def aged(**ages):
    return structs.replace(RESTING, ages=structs.replace(RESTING.ages, **ages))


def at_depth(z):
    return structs.replace(RESTING, eta=(0.0, 0.0, z, 0.0))


def delayed(total_s):
    return structs.replace(RESTING, delays=Delays(0.5 * total_s, 0.5 * total_s, True, True))


def test_what_is_only_reported_is_reported_and_freezes_where_it_should():
    supervisor = brought_to(State.ACTIVE)
    doubts = (C.DEPTH_JUMPED, C.DEPTH_DOUBTED, C.ATTITUDE_DOUBTED)
    for condition in (*ONLY_REPORTED, C.BATTERY_LOW, *doubts):
        verdict = supervisor.step(condition, TICK_S)
        assert verdict.state is State.ACTIVE
        assert verdict.warnings == condition
        assert verdict.freeze == (condition in (C.SATURATED, C.CLOCK_JUMPED, *doubts))
    calm = supervisor.step(NOTHING, TICK_S)
    assert (calm.warnings, calm.freeze) == (NOTHING, False)


SEEN = [
    (aged(link_s=LIMITS.link_timeout_s + 0.01), {}, C.LINK_LOST),
    (aged(depth_s=LIMITS.depth_timeout_s + 0.01), {}, C.DEPTH_STALE),
    (aged(attitude_s=LIMITS.attitude_timeout_s + 0.01), {}, C.ATTITUDE_STALE),
    (aged(position_s=LIMITS.position_timeout_s + 0.01), {}, C.POSITION_STALE),
    (aged(position_s=math.inf), {"held": (False, False, True, True)}, NOTHING),
    (aged(position_s=math.inf), {"held": (False,) * 4, "awaits_position": True}, C.POSITION_STALE),
    (aged(position_s=math.inf), {"steered": False}, NOTHING),
    (aged(pilot_s=3.01), {"ground_station": RELEASES}, C.PILOT_LOST),
    (aged(pilot_s=math.inf), {"ground_station": RELEASES}, C.PILOT_LOST),
    (
        aged(pilot_s=3.01),
        {"ground_station": SURFACES},
        C.PILOT_LOST | C.PILOT_LOST_SURFACE,
    ),
    (aged(pilot_s=2.9), {"ground_station": SURFACES}, NOTHING),
    (structs.replace(RESTING, armed=False), {}, C.DISARMED),
    (RESTING, {"mode_right": False}, C.WRONG_MODE),
    (RESTING, {"ekf": None}, C.EKF_UNHEALTHY),
    (RESTING, {"ekf": structs.replace(SOUND, attitude=False)}, C.EKF_UNHEALTHY),
    (RESTING, {"ekf": structs.replace(SOUND, depth=False)}, C.EKF_UNHEALTHY),
    (RESTING, {"ekf_doubt_s": LIMITS.ekf_doubt_s + 0.01}, C.EKF_UNHEALTHY),
    (aged(heartbeat_s=LIMITS.heartbeat_timeout_s + 0.01), {}, C.LINK_LOST),
    (structs.replace(RESTING, roll=math.radians(LIMITS.max_tilt_deg) + 0.01), {}, C.TILTED),
    (structs.replace(RESTING, pitch=-math.radians(LIMITS.max_tilt_deg) - 0.01), {}, C.TILTED),
    (structs.replace(RESTING, pitch=-1.0), {"angles": Angles(0.0, -1.0)}, NOTHING),
    (RESTING, {"angles": Angles(math.radians(LIMITS.max_tilt_deg) + 0.01, 0.0)}, C.TILTED),
    (at_depth(LIMITS.max_depth_m + LIMITS.depth_margin_m + 0.01), {}, C.DEPTH_OUT_OF_BOUNDS),
    (at_depth(-LIMITS.depth_margin_m - 0.01), {}, C.DEPTH_OUT_OF_BOUNDS),
    (structs.replace(RESTING, depth_refused=True), {}, C.DEPTH_JUMPED),
    (aged(yaw_reset_s=RESET_SETTLE_S), {}, C.YAW_RESET),
    (aged(position_reset_s=RESET_SETTLE_S), {}, C.POSITION_RESET),
    (aged(depth_reset_s=RESET_SETTLE_S), {}, C.DEPTH_RESET),
    (aged(yaw_reset_s=RESET_SETTLE_S + 0.1, position_reset_s=RESET_SETTLE_S + 0.1), {}, NOTHING),
    (delayed(LIMITS.max_delay_s + 0.001), {}, C.DELAY_TOO_LONG),
    (structs.replace(RESTING, clock_doubt_s=0.02), {}, C.CLOCK_JUMPED),
    (
        structs.replace(RESTING, clock_doubt_s=CLOCK_DOUBT_S + 0.01),
        {},
        C.CLOCK_JUMPED | C.CLOCK_INCONSISTENT,
    ),
    (RESTING, {"leaking": True}, C.LEAK),
    (RESTING, {"rebooted": True}, C.REBOOTED),
    (RESTING, {"failsafe": True}, C.AUTOPILOT_FAILSAFE),
    (RESTING, {"failsafe_surfaces": True}, NOTHING),
    (RESTING, {"failsafe_surfaces": True, "mode_right": False}, C.FAILSAFE_SURFACES | C.WRONG_MODE),
    (RESTING, {"battery_low_s": LIMITS.battery_low_s + 0.01}, C.BATTERY_LOW),
    (RESTING, {"saturated_s": LIMITS.saturated_s + 0.01}, C.SATURATED),
    (RESTING, {"unanswered_s": UNANSWERED_S + 0.01}, C.THRUST_UNANSWERED),
    (RESTING, {"off_track_s": LIMITS.off_track_s + 0.01}, C.OFF_TRACK),
    (RESTING, {"tilted_s": LIMITS.off_track_s + 0.01}, C.TILT_PERSISTS),
    (RESTING, {"upside_down_s": UPSIDE_DOWN_S + 0.01}, C.TURNED_OVER),
    (structs.replace(RESTING, dead_motor=6), {}, C.THRUSTER_DEAD),
    (structs.replace(RESTING, dead_motor=6), {"misses_motor": True}, C.THRUSTER_MISSED),
    (structs.replace(RESTING, reversed_motor=6), {}, C.THRUSTER_REVERSED),
    (RESTING, {"innovation_m": LIMITS.max_innovation_m + 0.001}, C.INNOVATION_LARGE),
    (RESTING, {"innovation_deg": LIMITS.max_innovation_deg + 0.01}, C.INNOVATION_LARGE),
    (RESTING, {"samples_dropped": True}, C.QUEUE_FULL),
    (RESTING, {"config_changed": True}, C.CONFIG_CHANGED),
    (RESTING, {"peer_changed": True}, C.PEER_CHANGED),
    (RESTING, {"parameters": {}}, C.FAILSAFE_UNSAFE),
    (RESTING, {"parameters": SAFE | {"FS_PILOT_INPUT": 0.0}}, C.FAILSAFE_UNSAFE),
    (RESTING, {"parameters": SAFE | {"FS_PILOT_TIMEOUT": 3.1}}, C.FAILSAFE_UNSAFE),
    (RESTING, {"finite": False}, C.NON_FINITE),
    (RESTING, {"dt_s": TICK_S + LIMITS.late_tick_s + 0.01}, C.TICK_LATE),
    *(
        (state, ACTIVE | changes, expected)
        for state, changes, expected in (
            (aged(depth_s=LIMITS.depth_timeout_s + 0.01), {}, C.INTERRUPTED),
            (aged(attitude_s=LIMITS.attitude_timeout_s + 0.01), {}, C.INTERRUPTED),
            (RESTING, {"dt_s": TICK_S + LIMITS.late_tick_s + 0.01}, C.INTERRUPTED),
            (aged(depth_s=LIMITS.link_timeout_s + 0.11), {}, C.INTERRUPTED | C.DEPTH_STALE),
            (aged(attitude_s=LIMITS.link_timeout_s + 0.11), {}, C.INTERRUPTED | C.ATTITUDE_STALE),
            (aged(link_s=1.01, depth_s=1.01, attitude_s=1.01), {}, C.INTERRUPTED | C.LINK_LOST),
            (RESTING, {"dt_s": TICK_S + LIMITS.link_timeout_s + 0.01}, C.INTERRUPTED | C.TICK_LATE),
        )
    ),
    (RESTING, {"lost_s": 0.81 * LIMITS.link_timeout_s}, C.INTERRUPTED_OFTEN),
    (RESTING, {"unsteady": True}, C.UNSTEADY),
    (structs.replace(RESTING, depth_doubt="it repeats"), {}, C.DEPTH_DOUBTED),
    (structs.replace(RESTING, attitude_doubt="it repeats"), {}, C.ATTITUDE_DOUBTED),
    (structs.replace(RESTING, position_doubt="it repeats"), {}, C.POSITION_DOUBTED),
    (structs.replace(RESTING, position_doubt="it repeats"), {"steered": False}, NOTHING),
    (RESTING, {"other_first": True}, C.OTHER_FIRST),
    (RESTING, {"other_came": True}, C.OTHER_CAME),
    (RESTING, {"pilot_deflection": LIMITS.pilot_deflection + 0.01}, C.PILOT_TAKEOVER),
    (RESTING, {"full_override": True}, C.PILOT_TAKEOVER),
    (RESTING, {"requests": [Request.STOP]}, C.OPERATOR_STOP),
    (RESTING, {"engage": True}, C.ENGAGE_ASKED),
    (RESTING, {"requests": [Request.CLEAR_FAULT]}, C.CLEAR_ASKED),
    (RESTING, {"offers_position": True}, C.POSITION_UNUSED),
    (RESTING, {"wants_ground": True}, C.GROUND_LOST),
    (RESTING, {"doubts_range": True}, C.GROUND_DOUBTED),
    (structs.replace(RESTING, heading_check=HeadingCheck(doubtful=True)), {}, C.HEADING_WRONG),
    (structs.replace(RESTING, heave_opposed=True), {}, C.THRUST_OPPOSED),
    (RESTING, {"details": {C.PREFLIGHT_FAILURE: ("the leak", "")}}, C.PREFLIGHT_FAILURE),
    (RESTING, {"ramped_down": True}, C.RAMPED_DOWN),
    (RESTING, {"hand_over": HandOverStep.HELD}, C.HAND_OVER_HELD),
    (RESTING, {"hand_over": HandOverStep.DONE}, C.HANDED_OVER),
    (RESTING, {"hand_over": HandOverStep.SURFACED}, C.SURFACED),
    (RESTING, {"hand_over": HandOverStep.REFUSED}, C.HAND_OVER_REFUSED),
]


@pytest.mark.parametrize(("state", "changes", "expected"), SEEN)
def test_each_condition_is_seen(state, changes, expected):
    assert assessed(state, **changes) == expected
    assert all(any(condition in row[2] for row in SEEN) for condition in C)


def numbers(value, path=()):
    """Give where each number of a situation stands."""
    if isinstance(value, float):
        yield path
    elif isinstance(value, Mapping):
        for key in value:
            yield from numbers(value[key], (*path, key))
    elif isinstance(value, tuple):
        for key in getattr(value, "_fields", range(len(value))):
            item = getattr(value, key) if isinstance(key, str) else value[key]
            yield from numbers(item, (*path, key))
    elif isinstance(value, msgspec.Struct):
        for key in value.__struct_fields__:
            yield from numbers(getattr(value, key), (*path, key))


def put(value, path, number):
    """Return the situation with another number there."""
    if not path:
        return number
    key, *rest = path
    if isinstance(value, Mapping):
        return {**value, key: put(value[key], rest, number)}
    if isinstance(key, int):
        return (*value[:key], put(value[key], rest, number), *value[key + 1 :])
    if hasattr(value, "_replace"):
        return value._replace(**{key: put(getattr(value, key), rest, number)})
    return structs.replace(value, **{key: put(getattr(value, key), rest, number)})


AGES_OF_EVENTS = {"yaw_reset_s", "position_reset_s", "depth_reset_s"}
"""An age that is not known says that the event never was."""


@pytest.mark.parametrize("path", [*numbers(situation())], ids=lambda path: ".".join(map(str, path)))
def test_an_unknown_number_counts_against_permission_where_a_known_one_can(path):
    here = put(situation(), path, 0.0)
    seen = NOTHING
    for number in (0.0, -1e9, 1e9, math.inf):
        seen |= assess(put(here, path, number), LIMITS)
    if path[-1] not in AGES_OF_EVENTS:
        assert seen in assess(put(here, path, math.nan), LIMITS)
