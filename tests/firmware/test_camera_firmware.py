"""What the real ArduSub answers to the question for a picture, and what tells one boot of it from another."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from virtual import Dive, Somebody

from companion.records import CommandAck, GlobalOrigin, Parameter
from lab.loop.firmware import Firmware


def heard(dive, seconds):
    """Return what the autopilot said meanwhile."""
    events = []
    for _ in range(round(seconds / 0.02)):
        dive.run(0.02)
        events += dive.engine.events
    return events


def test_without_a_camera_image_start_capture_fails_and_digicam_control_does_not_say_so(ardusub):
    dive = Dive(engage=False, firmware=ardusub)
    assert isinstance(dive.vehicle, Firmware)
    with dive.vehicle:
        dive.run(4.0)
        for number, at in ((2000, 3), (203, 5)):
            params = [1.0 if i == at else 0.0 for i in range(1, 8)]
            question = mavlink.MAVLink_command_long_message(1, 1, number, 0, *params)
            dive.tap.to_vehicle.append(Somebody().frame(question))
        answers = {e.command: e.result for e in heard(dive, 1.0) if isinstance(e, CommandAck)}
    assert answers[2000] == mavlink.MAV_RESULT_FAILED
    assert answers[203] == mavlink.MAV_RESULT_ACCEPTED


def test_it_tells_its_origin_and_how_often_it_was_booted(ardusub):
    dive = Dive(engage=False, firmware=ardusub)
    assert isinstance(dive.vehicle, Firmware)
    with dive.vehicle:
        events = heard(dive, 8.0)
    (origin,) = (e for e in events if isinstance(e, GlobalOrigin))
    assert 47.0 < origin.latitude_deg < 48.0, "it is asked for once"
    (boots,) = {e.value for e in events if isinstance(e, Parameter) and e.name == "STAT_BOOTCNT"}
    assert boots >= 1.0
