import itertools

import mavlink_wire as wire
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.mavlink.ardusub import QUALITY_PARAMETER
from companion.mavlink.encode import Commands
from companion.mavlink.link_maintenance import PARAMETERS, VOLATILE, LinkMaintenance
from companion.mavlink.streams import streams
from companion.records import FirmwareVersion, GlobalOrigin, Heartbeat, Parameter, Reboot, StatusText
from companion.telemetry.modes import Mode

TICK_S = 0.02
STREAMS = streams("relative_alt")
VERSION, ORIGIN = mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN


def beat(t_s, *, armed=False, mode=Mode.MANUAL):
    return Heartbeat(t_s, armed, mode, 3)


class Dive:
    """Steps an LinkMaintenance through time and keeps what it sent, each with its time."""

    def __init__(self):
        self.upkeep = LinkMaintenance(Commands(1, 1), STREAMS)
        self.now_s = 0.0
        self.sent = []

    def step(self, *events, want_mode=None, want_armed=False):
        out = self.upkeep.step(self.now_s, events, want_mode=want_mode, want_armed=want_armed)
        self.sent += [(self.now_s, message) for message in out]
        return out

    def run(self, seconds, *, heard=True, answer=None, share=1.0, only=None, **wants):
        """Let heartbeats come and every stream, or `only` those, at `share` of its rate."""
        for _ in range(round(seconds / TICK_S)):
            before_s, self.now_s = self.now_s, self.now_s + TICK_S
            for key, rate_hz in STREAMS.items() if heard else ():
                hz = rate_hz * (share if only in (None, key) else 1.0)
                for _ in range(int(self.now_s * hz + 1e-6) - int(before_s * hz + 1e-6)):
                    self.upkeep.heard(key)
            beats = (beat(self.now_s, **(answer or {})),) if heard else ()
            self.step(*beats, **wants)

    def times(self, kind, command=None):
        return [
            t_s
            for t_s, message in self.sent
            if wire.name(message) == kind and command in (None, getattr(message, "command", None))
        ]

    def asked(self, message_id):
        """Return when a message was asked for once."""
        return [t_s for t_s, m in self.sent if getattr(m, "command", 0) == 512 and m.param1 == message_id]

    def intervals(self):
        """Return the ids of the streams that were asked for."""
        return [m.param1 for _, m in self.sent if getattr(m, "command", 0) == 511]

    def names(self):
        return [m.param_id for _, m in self.sent if wire.name(m) == "PARAM_REQUEST_READ"]


@pytest.fixture
def dive():
    return Dive()


def test_before_contact_only_our_heartbeat_goes_out_once_a_second(dive):
    dive.run(10.0, heard=False, want_mode=Mode.STABILIZE, want_armed=True)
    assert {wire.name(message) for _, message in dive.sent} == {"HEARTBEAT"}
    assert len(dive.times("HEARTBEAT")) == 10


def test_a_stream_that_slows_down_is_asked_for_again_and_the_others_are_not(dive):
    attitude = mavlink.MAVLINK_MSG_ID_ATTITUDE
    dive.run(5.0)
    dive.sent.clear()
    dive.run(4.0, share=0.25, only=attitude)
    assert set(dive.intervals()) == {attitude}
    assert dive.upkeep.streams.measured_hz[attitude] == pytest.approx(12.5, abs=1.5)
    assert dive.upkeep.streams.measured_hz[mavlink.MAVLINK_MSG_ID_VFR_HUD] == pytest.approx(50.0, abs=1.5)
    dive.run(3.0)
    assert dive.upkeep.streams.measured_hz[attitude] == pytest.approx(50.0, abs=1.5)


def test_asking_does_not_press(dive):
    """A parameter transfer of the ground station slows every stream fourfold, however often one asks."""
    dive.run(5.0)
    dive.sent.clear()
    dive.run(60.0, share=0.25)
    assert len(dive.times("COMMAND_LONG", 511)) <= 20 * len(STREAMS)


def test_what_the_firmware_has_refused_is_not_asked_for_again_until_it_reboots(dive):
    battery = mavlink.MAVLINK_MSG_ID_BATTERY_STATUS
    dive.run(1.0)
    dive.step(StatusText(dive.now_s, 6, f"No ap_message for mavlink id ({battery})"))
    dive.step(StatusText(dive.now_s, 6, "No ap_message for mavlink id (77777)"))
    dive.sent.clear()
    dive.run(60.0, share=0.0, only=battery)
    assert battery not in dive.intervals()
    assert mavlink.MAVLINK_MSG_ID_ATTITUDE in dive.intervals()
    dive.sent.clear()
    dive.step(Reboot(dive.now_s))
    assert battery in [m.param1 for _, m in dive.sent if wire.name(m) == "COMMAND_LONG"]


@pytest.mark.parametrize(
    ("message_id", "asked", "answer", "name"),
    [
        (VERSION, 3, FirmwareVersion(12.0, "4.7.0 (dev)", (4, 7, 0)), "firmware"),
        (ORIGIN, 6, GlobalOrigin(12.0, 47.4, 8.55, 0.0), "origin"),
    ],
    ids=["version", "origin"],
)
def test_it_is_asked_for_until_it_is_reported_and_again_after_a_reboot(dive, message_id, asked, answer, name):
    dive.run(12.0)
    assert len(dive.asked(message_id)) == asked
    dive.step(answer)
    assert getattr(dive.upkeep, name) is answer
    dive.sent.clear()
    dive.run(12.0)
    assert not dive.asked(message_id)
    dive.step(Reboot(dive.now_s))
    assert getattr(dive.upkeep, name) is None
    assert dive.asked(message_id)


def test_a_vehicle_that_returns_is_asked_anew_and_a_lost_one_is_left_alone(dive):
    dive.step(beat(0.0))
    dive.run(20.0, heard=False)
    assert max(dive.times("TIMESYNC")) <= 5.0
    assert dive.times("COMMAND_LONG", 511)[-1] <= 5.0
    dive.run(0.02)
    assert dive.times("COMMAND_LONG", 511)[-1] == dive.now_s


def test_parameters_are_read_until_answered(dive):
    dive.run(5.0)
    assert set(dive.names()) == {*PARAMETERS, QUALITY_PARAMETER}
    assert dive.names().count("FS_PILOT_INPUT") >= 2
    dive.step(Parameter(dive.now_s, "FS_PILOT_INPUT", 2.0))
    dive.sent.clear()
    dive.run(5.0)
    assert "FS_PILOT_INPUT" not in dive.names()
    assert dive.upkeep.parameters == {"FS_PILOT_INPUT": 2.0}


def test_parameters_that_nobody_answers_are_asked_for_ever_more_rarely(dive):
    dive.run(600.0)
    asked = [t_s for t_s, m in dive.sent if getattr(m, "param_id", "") == "FRAME_CONFIG"]
    waits = [b - a for a, b in itertools.pairwise(asked)]
    assert waits[0] == pytest.approx(2.0, abs=1.5)
    assert all(b > a - 1.5 for a, b in itertools.pairwise(waits))
    assert 55.0 < waits[-1] < 65.0
    assert all(dive.names().count(name) <= 16 for name in PARAMETERS)


def test_the_surface_pressure_is_read_again_and_at_once_after_arming(dive):
    """The autopilot sets it anew at the surface and on arming, and tells nobody."""
    dive.run(0.1)
    for name in (*PARAMETERS, QUALITY_PARAMETER):
        dive.step(Parameter(dive.now_s, name, 1.0))
    dive.sent.clear()
    dive.run(25.0)
    assert set(dive.names()) == VOLATILE
    assert {"BARO1_GND_PRESS", "BARO2_GND_PRESS", "BARO3_GND_PRESS"} <= VOLATILE
    dive.step(*(Parameter(dive.now_s, name, 1.0) for name in VOLATILE))
    dive.sent.clear()
    dive.run(0.4, answer={"armed": True})
    assert sorted(dive.names()) == ["BARO1_GND_PRESS", "BARO2_GND_PRESS", "BARO3_GND_PRESS"]


def test_one_name_of_a_renamed_parameter_will_do(dive):
    dive.run(0.1)
    dive.step(Parameter(dive.now_s, "SYSID_MYGCS", 254.0))
    dive.sent.clear()
    dive.step(Parameter(dive.now_s, "P1", 1.0))
    dive.run(10.0)
    assert not {"MAV_GCS_SYSID", "SYSID_MYGCS"} & set(dive.names())
    assert dive.upkeep.parameters == {"MAV_GCS_SYSID": 254.0}


@pytest.mark.parametrize(
    ("command", "want", "answer"),
    [
        (176, {"want_mode": Mode.STABILIZE}, {"mode": Mode.STABILIZE}),
        (400, {"want_armed": True}, {"armed": True}),
    ],
    ids=["mode", "arming"],
)
def test_what_is_wanted_is_asked_once_a_second_until_the_heartbeat_confirms(dive, command, want, answer):
    dive.run(5.0, **want)
    asked = dive.times("COMMAND_LONG", command)
    assert 4 <= len(asked) <= 5
    dive.run(5.0, answer=answer, **want)
    assert dive.times("COMMAND_LONG", command) == asked
