"""What an operator asks for: done only when it is so, refused with a reason, never past the supervisor."""

import json
import math

import msgspec
import numpy as np
import pytest
from console import at_console
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from virtual import Dive, Somebody, shared

from companion.config import Config, load_config
from companion.io.command_queue import MAX_WAITING, CommandQueue, ReceivedCommand
from companion.records import ENGAGE_S, Condition, Setpoint, State, Verdict
from companion.telemetry.operator_commands import COMMANDS, MAX_BYTES
from companion.telemetry.schemas import Reply
from companion.telemetry.status_line import status_line
from lab.loop.lockstep import LinkDelay


@pytest.fixture
def console():
    """An operator at a vehicle that waits."""
    return at_console()[1]


def test_engage_is_answered_when_it_is_so_and_release_when_thrust_is_gone():
    dive, console = at_console()
    reply = console.tell("engage")
    assert (reply.done, reply.value["state"]) == (True, "ACTIVE")
    assert dive.state is State.ACTIVE
    assert reply.value["depth_m"] == pytest.approx(1.0)
    reply = console.tell("release")
    assert (reply.done, dive.step.sample.verdict.authority) == (True, 0.0)
    assert dive.state is not State.ACTIVE


@pytest.mark.parametrize("steered", [False, True], ids=["by nobody", "by a pilot"])
def test_after_a_release_it_says_until_when_somebody_has_to_steer(steered):
    dive, console = at_console(engaged=True)
    assert dive.step.sample.disarms_in_s == 0.0
    reply = console.tell("release")
    assert "nobody steers: the autopilot disarms in 3 s" in reply.said
    assert "(wanted" not in status_line(dive.step.sample), "nothing is held"
    left_s = []
    for _ in range(6):
        if steered:
            dive.tap.to_vehicle.append(Somebody().stick(1600))
        dive.run(1.0)
        left_s.append((dive.step.sample.disarms_in_s, dive.step.sample.state.armed))
    if not steered:
        assert left_s[0][0] == pytest.approx(2.5, abs=0.1)
        assert all(left > 0.0 or not armed for left, armed in left_s), "until it is so"
    assert left_s[-1] == (0.0, steered)


def test_a_release_withdraws_an_engage_that_waits():
    dive, console = at_console()
    dive.vehicle.autopilot.arm = lambda *_, **__: 4
    waiting = console.ask("engage")
    dive.run(0.5)
    assert not waiting
    assert console.tell("release").done
    assert not waiting[0].done
    assert "released" in waiting[0].said


def test_a_place_at_once_moves_what_it_names_and_is_read_back():
    dive, console = at_console()
    kept = console.tell("goto", depth_m=1.5, at_once=True)
    assert kept.done
    assert "when it engages" in kept.said
    assert kept.value["depth_m"] == 1.5
    console.tell("engage")
    reply = console.tell("goto", heading_deg=-90.0, at_once=True)
    assert (reply.done, reply.said) == (True, "on its way")
    assert (reply.value["depth_m"], reply.value["heading_deg"]) == (1.5, pytest.approx(270.0))
    assert "x_m" not in reply.value, "it is not held"
    refused = console.tell("goto", x_m=3.0, at_once=True)
    assert (refused.done, "no position" in refused.said) == (False, True)
    dive.run(9.0)
    assert dive.step.truth.eta[2] == pytest.approx(1.5, abs=0.06)
    assert math.remainder(dive.step.truth.eta[5] + math.pi / 2, math.tau) == pytest.approx(0.0, abs=0.06)


@pytest.mark.parametrize(
    ("name", "what", "axis", "key"),
    [
        ("gains", {"axis": "heave", "kappa_per_s": 8.0}, "heave", "kappa_per_s"),
        ("gains", {"axis": "yaw", "lambda_per_s": 1.5, "leak_per_s": 0.001}, "yaw", "lambda_per_s"),
        ("compensator", {"axis": "heave", "compensator": "observer"}, "heave", "compensator"),
    ],
)
def test_a_retune_is_in_force_and_read_back_while_it_goes_on_holding(name, what, axis, key):
    dive, console = at_console(engaged=True)
    reply = console.tell(name, **what)
    assert reply.done
    assert reply.value[key] == what[key] == getattr(getattr(dive.engine.config, axis), key)
    assert "was" in reply.said
    assert console.given[-1].config is dive.engine.config
    dive.run(2.0)
    assert dive.state is State.ACTIVE


@pytest.mark.parametrize(
    ("allow", "local", "says"),
    [("local", False, "--allow-control"), ("never", True, "read-only"), ("never", False, "read-only")],
)
def test_without_permission_nothing_happens(allow, local, says):
    dive, console = at_console(local=local, companion=[f"telemetry.allow_control={allow}"])
    before = dive.engine.config
    for name in COMMANDS:
        reply = console.tell(name, axis="heave", kappa_per_s=8.0, depth_m=3.0)
        assert not reply.done
        assert says in reply.said
        assert console.given[-1] == ([], None, None)
    assert dive.engine.config is before


@pytest.mark.parametrize(
    ("name", "what", "says"),
    [
        ("fly", {}, "there is no command 'fly'"),
        ("goto", {"at_once": True}, "at least one of x_m"),
        ("goto", {"x_m": 10**400}, "must be -10000 to 10000"),
        ("goto", {"depth_m": -1, "at_once": True}, "depth_m: -1.00 m is above the surface"),
        ("goto", {"depth_m": 101, "at_once": True}, "supervisor.max_depth_m = 100"),
        ("goto", {"frame": "body", "depth_m": 1, "at_once": True}, "nothing is held"),
        ("goto", {"depth_m": "3"}, "depth_m"),
        ("gains", {"axis": "roll", "kappa_per_s": 1.0}, "surge, sway, heave, yaw"),
        ("gains", {"axis": "heave"}, "at least one"),
        ("gains", {"axis": "heave", "kappa_per_s": 100.0}, "kappa_per_s = 100: must be 0.05 to 50"),
        ("gains", {"axis": "heave", "mass": 20.0}, "mass: unknown key"),
        ("compensator", {"axis": "heave", "compensator": "magic"}, "+observer"),
        ("engage", {"now": True}, "now: unknown key"),
    ],
)
def test_what_is_refused_says_what_is_allowed(console, name, what, says):
    reply = console.tell(name, **what)
    assert not reply.done
    assert says in reply.said


@pytest.mark.parametrize(
    ("name", "key", "now", "wanted"),
    [
        ("gains", "kappa_per_s", 10.0, 20.1),
        ("gains", "leak_per_s", 0.002, 0.0),
        ("gains", "hidden_learning_rate", 0.0, 0.1),
    ],
)
def test_more_than_twofold_at_once_has_to_be_confirmed(console, name, key, now, wanted):
    dive = console.dive
    assert getattr(dive.engine.config.heave, key) == now
    reply = console.tell(name, axis="heave", **{key: wanted})
    assert not reply.done
    assert f"heave.{key} = {wanted:g}: it is {now:g}" in reply.said
    assert "confirm=true" in reply.said
    assert getattr(dive.engine.config.heave, key) == now
    assert console.tell(name, axis="heave", confirm=True, **{key: wanted}).done
    assert getattr(dive.engine.config.heave, key) == wanted


@pytest.mark.parametrize(("delay_s", "done"), [(0.0, True), (0.04, False)])
def test_gains_are_held_against_the_measured_delay(delay_s, done):
    """1/14 + 1/10 = 0.171 s: more than 0.026 + 0.138 s, less than with 80 ms more delay."""
    usual = LinkDelay()
    slow = LinkDelay(up_s=usual.up_s + delay_s, down_s=usual.down_s + delay_s)
    dive, console = at_console(link=slow, waits_s=6.0)
    reply = console.tell("gains", axis="heave", lambda_per_s=14.0)
    assert reply.done is done, reply.said
    if not done:
        assert "1/lambda + 1/kappa" in reply.said
        assert dive.engine.config.heave.lambda_per_s == 7.5
    assert console.tell("gains", axis="heave", kappa_per_s=9.9).done, "less is always taken"


def test_too_many_commands_are_told_so_at_once():
    _, console = at_console()
    waiting = [console.ask("reset_model") for _ in range(MAX_WAITING)]
    assert not any(waiting)
    (reply,) = console.ask("engage")
    assert not reply.done
    assert "busy" in reply.said
    assert not console.ask("release"), "there is room for a release"


def test_engage_waits_for_what_is_not_read_yet_and_is_then_done():
    """A script that engaged in the first second was refused: "MAV_GCS_SYSID was not reported"."""
    _, console = at_console(waits_s=0.02)
    reply = console.tell("engage", within_s=12.0)
    assert reply.done, reply.said


def test_engage_waits_for_a_vehicle_that_was_switched_on_late():
    """The time for reading its parameters began with the process: it was refused as in the first second."""
    dive, console = at_console(waits_s=0.02)
    dive.fault("link_cut", ENGAGE_S + 1.0)
    for step in dive.loop.run(ENGAGE_S + 3.0):
        if Condition.LINK_LOST not in step.sample.verdict.conditions:
            break
    assert step.sample.reads
    reply = console.tell("engage", within_s=12.0)
    assert reply.done, reply.said


def test_nothing_may_be_engaged_before_the_list_was_made():
    """For up to a quarter of a second a list counted that was made before the vehicle was heard."""
    for late_s in (0.13, 0.21, 0.29, 0.37):
        dive = Dive(engage=False)
        dive.fault("message_stopped", message="PARAM_VALUE")
        dive.fault("link_cut", late_s)
        for step in dive.loop.run(2.5):
            held = step.sample.verdict.conditions
            assert held & (Condition.LINK_LOST | Condition.PREFLIGHT_FAILURE)


def test_engage_is_refused_where_a_parameter_is_never_read():
    dive, console = at_console(waits_s=0.02)
    dive.fault("message_stopped", message="PARAM_VALUE")
    reply = console.tell("engage", within_s=12.0)
    assert not reply.done
    assert dive.t_s == pytest.approx(ENGAGE_S, abs=0.3)
    assert "MAV_GCS_SYSID was not reported" in reply.said


def test_the_log_line_is_bounded_whatever_came(make_sample):
    commands = CommandQueue(load_config())
    commands.put(ReceivedCommand("goto", b"\xff" * 10 * MAX_BYTES, lambda _: None, True))
    commands.before_tick(_Untouchable(), 0.0)
    (result,) = commands.after_tick(_Untouchable(), make_sample(), 0.0)
    assert len(result.text) < 1000


@pytest.mark.parametrize("payload", [b'{"a\n2026 forged\x1b[2J": 1}', b"\n2026 forged", b'{"\\n\\u202e": 1}'])
def test_an_order_forges_no_line_of_the_log(payload, make_sample):
    commands = CommandQueue(load_config())
    commands.put(ReceivedCommand("goto", payload, lambda _: None, True))
    commands.before_tick(_Untouchable(), 0.0)
    (result,) = commands.after_tick(_Untouchable(), make_sample(), 0.0)
    assert result.text.isprintable()


def test_a_heading_leaves_the_depth_where_the_pilots_stick_took_it():
    """The command after it used to send it back to the depth of the command before."""
    dive, console = at_console(pilot=True, engaged=True)
    assert console.tell("goto", depth_m=1.5, at_once=True).done
    dive.run(4.0)
    dive.cockpit.push(heave=0.5)
    dive.run(3.0)
    dive.cockpit.push()
    dive.run(1.0)
    depth_m = dive.engine.target[2]
    assert depth_m > 1.6
    assert console.tell("goto", heading_deg=90, at_once=True).done
    dive.run(0.1)
    assert dive.engine.target[2] == pytest.approx(depth_m, abs=0.01)


def test_in_stabilize_no_heading_is_taken():
    console = at_console(waits_s=0.5, companion=["vehicle.steering_mode=stabilize"])[1]
    for how in ({}, {"at_once": True}):
        reply = console.tell("goto", heading_deg=90, depth_m=1.2, **how)
        assert (reply.done, "the firmware keeps the heading" in reply.said) == (False, True)


DVL = ("sensors.dvl=true", "initial.eta=[0,0,2,0,0,0]", "current.enabled=false")


def test_goto_and_follow_are_commands_that_are_answered_and_done():
    dive, console = drifting()
    console.tell("engage")
    dive.run(2.0)
    reply = console.tell("goto", x_m=0.5, frame="offset")
    assert reply.done
    goal = dive.engine.destination[0]
    assert goal == pytest.approx(dive.step.truth.eta[0] + 0.5, abs=0.1)
    assert reply.said.startswith(f"on its way to north {goal:.2g} m: 0.5 m, about ")
    assert reply.value["x_m"] == goal, "where it goes, not where it is"
    plan = {"name": "ring", "relative": True, "circle": {"radius_m": 1.0}}
    reply = console.tell("follow", path=plan)
    assert reply.done
    assert "ring" in reply.said
    assert reply.value["length_m"] == pytest.approx(math.tau, abs=0.01)
    assert console.given[-1].order[0] == "follow"
    assert console.tell("path", action="pause").said.startswith("paused")
    refused = console.tell("follow", path={"circle": {"radius_m": 0.01}})
    assert not refused.done
    assert "path.circle.radius_m = 0.01: must be 0.1 to 1000" in refused.said
    refused = console.tell("goto", frame="body")
    assert "at least one of x_m" in refused.said


OUT = {"name": "out", "relative": True, "waypoint": [{"x_m": 0.0, "y_m": 0.0}, {"x_m": 0.4, "y_m": 0.0}]}
FROM_HERE = [
    (
        "goto",
        {"frame": "offset", "x_m": -0.4, "depth_m": 0.3},
        "go -0.4 m north, 0.3 m down from",
        (-0.4, 0.3),
    ),
    ("goto", {"frame": "body", "depth_m": 0.3, "heading_deg": 20}, "0.3 m down, 20° clockwise", (0.0, 0.3)),
    ("follow", {"path": OUT}, "follow the path out from where it is", (0.4, 0.0)),
]


@shared
def drifting():
    """An operator at a vehicle that nobody holds, and that drifts."""
    dive, console = at_console(*DVL)
    dive.tap.to_vehicle.append(Somebody().origin())
    dive.run(2.0)
    return dive, console


@pytest.mark.parametrize(("name", "what", "words", "step_m"), FROM_HERE)
def test_from_here_is_from_where_it_engages_and_every_screen_says_so(name, what, words, step_m):
    dive, console = drifting()
    reply = console.tell(name, **what)
    assert reply.done
    assert words in reply.said.partition("kept, when it engages: ")[2]
    asked_at = dive.step.truth.eta
    dive.run(6.0)
    assert math.dist(asked_at[:3], dive.step.truth.eta[:3]) > 0.3
    assert words in dive.step.sample.guided.pending
    assert words in status_line(dive.step.sample)
    console.tell("engage")
    assert words in console.results[-1].reply.said
    start = dive.engine.target
    dive.run(7.0)
    assert dive.step.sample.guided.pending == ""
    x, _, z, _ = dive.step.sample.eta_d
    assert (x - start[0], z - start[2]) == pytest.approx(step_m, abs=0.02)


@pytest.mark.parametrize("again", [False, True], ids=["while it is let go", "as it engages"])
def test_from_here_does_not_outlive_the_place_where_it_was_asked(again):
    dive, console = drifting()
    console.tell("engage")
    if not again:
        dive.run(2.0)
        console.ask("release")
        dive.run(0.3)
    console.ask("goto", frame="offset", depth_m=0.3)
    dive.run(0.1)
    if again:
        console.ask("release")
    dive.run(2.0)
    console.ask("engage")
    dive.run(0.1)
    start = dive.engine.target
    dive.run(8.0)
    assert dive.step.sample.eta_d[2] - start[2] == pytest.approx(0.3, abs=0.02)


def test_what_is_asked_in_a_fault_is_kept_as_it_is_said():
    dive, console = at_console(engaged=True)
    console.tell("goto", altitude_m=0.8)
    dive.fault("link_cut", 1.5)
    dive.run(3.0)
    assert dive.state is State.FAULT
    assert "altitude" not in dive.step.sample.guided.pending, "it ended with the fault"
    reply = console.tell("goto", depth_m=1.4)
    assert reply.done
    dive.run(0.5)
    assert dive.step.sample.guided.pending.endswith("go to depth 1.4 m")


def test_a_move_that_its_beginning_forbids_is_refused_there():
    dive, console = drifting()
    assert console.tell("goto", frame="offset", depth_m=-5.0).done
    console.tell("engage")
    dive.run(2.0)
    assert dive.step.sample.guided.kind == "refused"
    assert "above the surface" in dive.step.sample.guided.name


def test_what_waits_for_engaging_can_be_taken_back_and_nothing_goes_on_while_nothing_is_held():
    dive, console = drifting()
    console.tell("goto", frame="offset", depth_m=0.3)
    assert "when it engages: hold here" in console.tell("path", action="hold").said
    console.tell("engage")
    console.tell("follow", path=OUT)
    dive.run(2.0)
    console.tell("velocity", forward_mps=0.2, lasts_s=10.0)
    console.tell("release")
    refused = console.tell("path", action="resume")
    assert (refused.done, "engage first" in refused.said) == (False, True)
    console.tell("engage")
    dive.run(1.5)
    held = dive.step.sample.eta_d
    dive.run(1.0)
    assert dive.step.sample.eta_d == pytest.approx(held, abs=0.02), "neither the path nor the velocity"


json_values = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=20), inner, max_size=4),
    max_leaves=12,
)
likely = st.dictionaries(
    st.sampled_from(sorted({field for command in COMMANDS.values() for field in command.__struct_fields__})),
    st.sampled_from(["heave", "yaw", "observer", 0.0, 8.0, -3, 1e9, 10**400, math.nan, math.inf, None, True]),
    max_size=4,
)
payloads = st.binary(max_size=60) | (json_values | likely).map(lambda value: json.dumps(value).encode())


@settings(suppress_health_check=[HealthCheck.too_slow])
@given(name=st.sampled_from([*COMMANDS, "config", "", "*"]), payload=payloads)
@example(name="goto", payload=b'{"depth_m":1e999}').via("the reason for refusing it raised TypeError")
def test_whatever_comes_is_answered_once_and_changes_nothing_unless_done(name, payload):
    engine = _Recorder()
    commands = CommandQueue(engine.config)
    answers: list[Reply] = []
    commands.put(ReceivedCommand(name, payload, answers.append, True))
    while commands.prepare():
        pass
    given = commands.before_tick(engine, 0.0)
    if answers:
        assert not answers[0].done
        assert answers[0].said
        assert given == ([], None, None)
        assert not engine.got
    else:
        assert len(given.requests) + len(engine.got) == 1
        for thing in engine.got:
            if isinstance(thing, Config):
                assert thing == msgspec.convert(msgspec.to_builtins(thing), Config), "as at the start"


class _Untouchable:
    config = load_config()
    verdict = Verdict(State.IDLE, Condition(0), 0.0, "just started")

    def __getattr__(self, name):
        raise AssertionError(f"{name} was touched")


class _Recorder:
    """An engine that only notes what it gets."""

    config = load_config()
    target = asked = destination = (0.0,) * 4
    reads = False
    verdict = Verdict(State.IDLE, Condition(0), 0.0, "just started")

    def __init__(self):
        self.got = []

    def refusal(self, request):
        return ""

    def guide(self, order):
        self.got.append(order)

    def retune(self, config):
        self.got.append(config)


PATH = {"laps": 0, "waypoint": [{"x_m": 0.0, "y_m": 0.0}, {"x_m": 1.0, "y_m": 0.0}], "relative": True}


def test_an_error_that_nobody_foresaw_refuses_the_command_and_the_dive_goes_on(monkeypatch):
    dive, console = at_console(engaged=True)
    for error, where, name, what in (
        (MemoryError, "companion.guidance.orders.building", "follow", {"path": PATH}),
        (ZeroDivisionError, "companion.engine.Engine.guide", "goto", {"depth_m": 1.5}),
        (MemoryError, "companion.engine.Engine.retune", "gains", {"axis": "heave", "kappa_per_s": 5.0}),
        (ZeroDivisionError, "companion.io.command_queue.parse", "release", {}),
        (MemoryError, "companion.io.command_queue.CommandQueue._settled", "goto", {"depth_m": 1.5}),
    ):

        def fails(*_, error=error, **__):
            raise error("of numbers that lead nowhere")

        with monkeypatch.context() as broken:
            broken.setattr(where, fails)
            reply = console.tell(name, **what)
        assert (reply.done, "of numbers that lead nowhere" in reply.said) == (False, True), where
        dive.run(0.2)
        assert dive.state is State.ACTIVE
        assert console.tell("goto", depth_m=1.2, at_once=True).done


def test_a_path_that_leads_nowhere_on_the_way_ends_and_the_place_is_held(monkeypatch):
    dive, console = at_console("sensors.dvl=true", waits_s=4.0, engaged=True)

    def raises(*_):
        raise ZeroDivisionError("no way")

    for leads_nowhere in (raises, lambda *_: Setpoint((math.nan,) * 4)):
        assert console.tell("follow", path=PATH).done
        dive.run(1.0)
        with monkeypatch.context() as broken:
            broken.setattr("companion.guidance.course.Course.step", leads_nowhere)
            dive.run(0.1)
        assert dive.step.sample.guided.kind == "refused"
        assert "cannot be followed" in dive.step.sample.guided.name
        before = dive.step.truth.eta[:3]
        dive.run(3.0)
        assert dive.state is State.ACTIVE
        assert np.linalg.norm(dive.step.truth.eta[:3] - before) < 0.15
