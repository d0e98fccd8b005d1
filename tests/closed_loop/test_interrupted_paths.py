"""A path that was interrupted goes on where it was, and says so where it cannot."""

import pytest
from virtual import Dive, hold, shared

from companion.config import load_config
from companion.guidance.orders import ordering
from companion.guidance.sources import Sources
from companion.records import GlobalOrigin, Reboot, Request, State
from companion.steps import finish
from companion.telemetry.operator_commands import Follow, Goto, SetPath
from companion.telemetry.plan import PathPlan, Waypoint

CALM = ("sensors.dvl=true", "initial.eta=[0,0,2,0,0,0]", "current.enabled=true", "current.speed_m_s=0.0")
LINE = PathPlan(
    name="reef",
    waypoint=(Waypoint(x_m=0.0, y_m=0.0), Waypoint(x_m=3.0, y_m=0.0)),
    heading="keep",
    speed_mps=0.25,
    acceleration_mps2=0.2,
)
RESUME = SetPath(action="resume")


def follow(dive, command):
    order = finish(ordering(command, dive.engine.config))
    assert order is not None
    dive.engine.guide(order)


@shared
def under_way():
    dive = Dive(*CALM, setpoint=hold(x=0.0, y=0.0, z=2.0, psi=0.0))
    dive.until(State.ACTIVE)
    dive.run(3.0)
    follow(dive, Follow(path=LINE))
    dive.run(7.0)
    return dive


def test_a_move_ends_a_path():
    dive = under_way()
    dive.engine.guide(Goto(y_m=1.0))
    dive.engine.guide(SetPath(action="hold"))
    with pytest.raises(ValueError, match="no path and no move"):
        dive.engine.guide(RESUME)


def test_a_fault_pauses_a_path():
    dive = under_way()
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
    steps = dive.run(16.0)
    assert was_m - 0.05 < steps[10].sample.guided.progress_m < was_m + 0.5
    assert steps[-1].truth.eta[0] == pytest.approx(3.0, abs=0.05)


def test_after_a_reboot_of_the_autopilot_it_is_not_resumed():
    dive = under_way()
    dive.engine.guide(SetPath(action="hold"))
    dive.ask(Request.STOP)
    dive.run(2.0)
    dive.fault("reboot")
    while not any(isinstance(event, Reboot) for event in dive.engine.last.heard.events):
        dive.run(0.02)
    dive.run(0.04)
    with pytest.raises(ValueError, match=r"the autopilot was restarted meanwhile.*Follow it anew"):
        dive.engine.guide(RESUME)


def test_an_origin_that_is_another_displaces_a_path():
    sources = Sources(load_config(), hold())
    for latitude_deg, said in ((47.4, ""), (47.4, ""), (47.5, "the EKF's origin is another")):
        sources.hear([GlobalOrigin(0.0, latitude_deg, 8.5, 0.0)])
        assert sources.course.displaced == said
