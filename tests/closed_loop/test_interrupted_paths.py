"""A path that was interrupted goes on where it was, after a restart too, and says so where it cannot."""

import math
import re

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace
from virtual import Dive, hold

from companion.config import load_config
from companion.engine import Engine
from companion.guidance.orders import order_of
from companion.records import Request, State
from companion.telemetry.commands import Follow, Goto, SetPath
from companion.telemetry.plan import Circle, PathPlan, TriggerPlan, Waypoint

CALM = ("sensors.dvl=true", "initial.eta=[0,0,2,0,0,0]", "current.enabled=true", "current.speed_m_s=0.0")
LINE = PathPlan(
    name="reef",
    waypoint=(Waypoint(x_m=0.0, y_m=0.0), Waypoint(x_m=3.0, y_m=0.0)),
    heading="keep",
    speed_mps=0.25,
    acceleration_mps2=0.2,
    trigger=TriggerPlan(every_m=0.5),
)
RESUME = SetPath(action="resume")


def follow(dive, command):
    order = order_of(command, dive.engine.config)
    assert order is not None
    dive.engine.guide(order)


def under_way(plan=LINE, seconds=7.0, **arguments):
    dive = Dive(*CALM, setpoint=hold(x=0.0, y=0.0, z=2.0, psi=0.0), **arguments)
    dive.until(State.ACTIVE)
    dive.run(3.0)
    follow(dive, Follow(path=plan))
    return dive, dive.run(seconds)


def restarted(dive, left, *, engage=True):
    """Put another engine in the place of the one that steered, with what that one left behind."""
    dive.engine = dive.tap.engine = Engine(load_config(), hold(z=math.nan, psi=math.nan), arm=True)
    follow(dive, msgspec.json.decode(msgspec.json.encode(left), type=Follow))
    if engage:
        dive.loop.requests.append(Request.ENGAGE)


def triggers(steps):
    """Return how far along the path each trigger was."""
    return [step.sample.guided.progress_m for step in steps if step.sample.trigger]


@pytest.mark.parametrize(
    "interruption", [Goto(y_m=1.0, speed_mps=0.4), SetPath(action="hold")], ids=["a move", "hold"]
)
def test_a_path_that_something_else_replaced_goes_on_where_it_was(interruption):
    dive, before = under_way()
    was_m = dive.step.sample.guided.progress_m
    dive.engine.guide(interruption)
    meanwhile = dive.run(12.0)
    guided = meanwhile[-1].sample.guided
    assert (guided.kind, guided.left_m) == ("hold", pytest.approx(3.0 - was_m, abs=0.05))
    assert not triggers(meanwhile)
    dive.engine.guide(RESUME)
    after = dive.run(20.0)
    assert after[5].sample.guided.kind == "path"
    assert after[5].sample.guided.progress_m == pytest.approx(was_m, abs=0.05)
    assert after[-1].truth.eta[0] == pytest.approx(3.0, abs=0.05)
    assert triggers([*before, *after]) == pytest.approx([0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0], abs=0.02)


def test_a_new_path_leaves_nothing_to_resume():
    dive, _ = under_way()
    dive.engine.guide(Goto(y_m=1.0))
    circle = PathPlan(circle=Circle(radius_m=1.0), relative=True)
    follow(dive, Follow(path=circle))
    dive.engine.guide(SetPath(action="hold"))
    with pytest.raises(ValueError, match="no path and no move"):
        dive.engine.guide(RESUME)


def test_a_fault_pauses_a_path():
    dive, _ = under_way()
    was_m = dive.step.sample.guided.progress_m
    dive.fault("message_stopped", 6.0, message="ATTITUDE")
    dive.run(8.0)
    assert dive.state is State.FAULT
    assert dive.step.sample.guided.kind == "paused"
    dive.ask(Request.CLEAR_FAULT)
    dive.run(1.0)
    dive.ask(Request.ENGAGE)
    dive.until(State.ACTIVE)
    dive.run(2.0)
    assert dive.step.sample.guided.kind == "paused"
    dive.engine.guide(RESUME)
    steps = dive.run(25.0)
    assert was_m - 0.05 < steps[10].sample.guided.progress_m < was_m + 0.5
    assert steps[-1].truth.eta[0] == pytest.approx(3.0, abs=0.05)


@pytest.mark.parametrize("plan", [LINE, replace(LINE, relative=True)], ids=["fixed", "relative"])
def test_after_a_restart_of_the_companion_it_goes_on_where_it_was(plan):
    dive, before = under_way(plan)
    left = dive.engine.unfinished
    was_m = dive.step.sample.guided.progress_m
    restarted(dive, left)
    dive.until(State.ACTIVE)
    waiting = dive.run(4.0)
    guided = waiting[-1].sample.guided
    assert (guided.kind, guided.name) == ("paused", "reef")
    assert guided.progress_m == pytest.approx(was_m, abs=1e-6)
    assert guided.left_m == pytest.approx(3.0 - was_m, abs=1e-6)
    assert np.abs(waiting[-1].sample.dofs.x_d_dot).max() < 0.01, "it does not move by itself"
    dive.engine.guide(RESUME)
    after = dive.run(18.0)
    assert after[-1].truth.eta[0] == pytest.approx(3.0, abs=0.05)
    assert triggers([*before, *after]) == pytest.approx([0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0], abs=0.02)
    assert dive.engine.unfinished is None


def test_a_companion_that_was_told_to_follow_it_goes_on_by_itself():
    dive, _ = under_way()
    left = dive.engine.unfinished
    was_m = dive.step.sample.guided.progress_m
    restarted(dive, replace(left, interrupted=replace(left.interrupted, goes_on=True)))
    dive.until(State.ACTIVE)
    steps = dive.run(20.0)
    assert steps[-1].truth.eta[0] == pytest.approx(3.0, abs=0.05)
    way = [step.sample.guided.progress_m for step in steps]
    assert way[0] == pytest.approx(was_m, abs=1e-6)
    assert way == sorted(way)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"boots": 7}, "the autopilot was restarted meanwhile"),
        ({"boot_s": 9e5}, "the autopilot was restarted meanwhile"),
        (
            {"origin_deg": (47.4, 8.55)},
            r"origin is another: it was 47.4000000, 8.5500000 and is 0.0000000, 0.0",
        ),
        ({"surface_pa": 90e3}, "the zero of the depth has moved by"),
    ],
)
def test_where_its_places_are_others_it_is_refused_with_the_reason(change, said):
    dive, _ = under_way()
    left = dive.engine.unfinished
    datum = replace(left.interrupted.datum, **change)
    restarted(dive, replace(left, interrupted=replace(left.interrupted, datum=datum, goes_on=True)))
    dive.until(State.ACTIVE)
    steps = dive.run(6.0)
    guided = steps[-1].sample.guided
    assert guided.kind == "refused"
    assert re.search(said, guided.name), guided.name
    assert "Follow it anew" in guided.name
    assert max(abs(step.truth.eta[0] - steps[0].truth.eta[0]) for step in steps) < 0.1
    assert dive.engine.unfinished is None
    with pytest.raises(ValueError, match="no path and no move"):
        dive.engine.guide(RESUME)


def test_it_is_not_resumed_before_the_autopilot_has_told_where_it_counts_from():
    dive, _ = under_way()
    restarted(dive, dive.engine.unfinished, engage=False)
    dive.run(0.02)
    with pytest.raises(ValueError, match="has not told its boot count"):
        dive.engine.guide(RESUME)


def test_an_autopilot_that_reboots_meanwhile_is_noticed_by_the_same_companion_too():
    dive, _ = under_way()
    dive.engine.guide(SetPath(action="hold"))
    dive.ask(Request.STOP)
    dive.run(2.0)
    dive.fault("reboot")
    dive.run(15.0)
    with pytest.raises(ValueError, match="the autopilot was restarted meanwhile"):
        dive.engine.guide(RESUME)


def test_what_cannot_be_a_place_of_the_path_is_refused():
    dive, _ = under_way()
    left = dive.engine.unfinished
    wrong = replace(left, interrupted=replace(left.interrupted, leg=5))
    with pytest.raises(ValueError, match=r"interrupted\.leg = 5"):
        follow(dive, wrong)
    assert dive.engine.unfinished == left
