"""A camera is triggered along a path: asked at its place, told, recorded; and said where it fails."""

import math

import msgspec
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from virtual import Dive, hold

from companion.guidance.paths.shapes import build
from companion.guidance.paths.time_law import limits
from companion.records import State
from companion.telemetry import samples, schemas
from companion.telemetry.degrees import metres
from companion.telemetry.event_log import EventLog
from companion.telemetry.plan import PathPlan, TriggerPlan, Waypoint

CALM = ("sensors.dvl=true", "initial.eta=[0,0,2,0,0,0]", "current.enabled=true", "current.speed_m_s=0.0")
ORIGIN = (0.0, 0.0)  # the simulated DVL sets it so
LINE = (Waypoint(x_m=0.0, y_m=0.0), Waypoint(x_m=2.0, y_m=0.0))


def followed(seconds=16.0, **trigger):
    dive = Dive(*CALM, setpoint=hold(x=0.0, y=0.0, z=2.0, psi=0.0))
    asked: list[mavlink.MAVLink_command_long_message] = []
    events: list[schemas.Event] = []
    log = EventLog()
    parser = mavlink.MAVLink(None)

    def look(out, sample):
        for data in out:
            asked.extend(m for m in parser.parse_buffer(data) or [] if m.get_type() == "COMMAND_LONG")
        events.extend(log.step(sample))

    dive.tap.after = look
    dive.until(State.ACTIVE)
    dive.run(3.0)
    plan = PathPlan(waypoint=LINE, speed_mps=0.25, acceleration_mps2=0.2, trigger=TriggerPlan(**trigger))
    dive.engine.guide(build(plan, limits(dive.engine.config)))
    steps = dive.run(seconds)
    pictures = [m for m in asked if m.command == mavlink.MAV_CMD_IMAGE_START_CAPTURE]
    return steps, pictures, [event.text for event in events]


def test_a_picture_is_asked_for_every_half_metre_and_recorded_with_place_and_time():
    steps, pictures, texts = followed(every_m=0.5)
    triggered = [step for step in steps if step.sample.trigger]
    assert [step.sample.trigger for step in triggered] == [1, 2, 3, 4, 5]
    assert [(m.param1, m.param2, m.param3) for m in pictures] == [(0.0, 0.0, 1.0)] * 5
    for step, north_m in zip(triggered, (0.0, 0.5, 1.0, 1.5, 2.0), strict=True):
        assert step.truth.eta[0] == pytest.approx(north_m, abs=0.08)
        record = msgspec.json.decode(
            schemas.to_json(samples.trigger(step.sample)), type=schemas.Trigger, strict=True
        )
        assert record.x_m == pytest.approx(step.truth.eta[0], abs=0.03)
        assert (record.t_s, record.picture) == (step.sample.state.t_s, True)
        north_east = metres((record.latitude_deg, record.longitude_deg), ORIGIN)
        assert math.dist(north_east, (record.x_m, record.y_m)) < 0.01
        assert "latitude_deg" not in record.absent
    assert "altitude_m" in record.absent, "there is no rangefinder"
    (said,) = {text for text in texts if "picture" in text}
    assert said.startswith("ArduSub took no picture: CAM1_TYPE"), "the stand-in has no camera"


def test_a_marker_asks_for_no_picture():
    steps, pictures, texts = followed(at_waypoints=True, camera=False)
    triggered = [step.sample for step in steps if step.sample.trigger]
    assert [(sample.trigger, sample.picture) for sample in triggered] == [(1, False), (2, False)]
    assert not pictures
    assert not any("picture" in text for text in texts)
