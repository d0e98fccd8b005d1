"""What a pilot reads, plots and presses at the ground station during a dive, decoded by pymavlink."""

import hashlib
import json
from itertools import pairwise
from typing import Any

import pytest
from forwarding_tests import (
    begun,
    test_the_autopilot_keeps_its_own_counsel,  # noqa: F401 - they run here
    test_words_numbers_commands_and_answers_pass_the_vehicle,  # noqa: F401
)
from pilot_station import ENGAGE, HOLD, RELEASE, Shown, command, joined, results
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from virtual import ROOT, Dive, Somebody, active, hold, pieces

from companion.config import load_config
from companion.mavlink.codec import Packer
from companion.mavlink.messages import message_type
from companion.mavlink.signing import Signing
from companion.records import PilotAction, State
from dashboard.web.cockpit import ACTIONS, COMPONENT, extras


@pytest.fixture
def pilot():
    return begun()


def test_a_dive_is_told_from_ready_to_engaged_to_a_fault_and_its_end():
    dive = Dive()
    shown = Shown(dive)
    kept = "Holdfast when it engages: go to depth 1 m, heading 17.19 deg"
    assert [text for _, text in shown.texts(5.0)] == [
        kept,
        "Holdfast READY: all conditions for engaging are met",
        "Holdfast ACTIVE: engaged",
    ]
    dive.fault("link_cut", 1.5)
    [fault, still, end] = shown.texts(4.0)
    verdict = dive.step.sample.verdict
    assert fault == (
        mavlink.MAV_SEVERITY_CRITICAL,
        "Holdfast FAULT: the vehicle is not heard; to do: check the cable, the router and link.endpoint; "
        "then clear the fault (`holdfast tell clear_fault`, button or dashboard)",
    )
    assert verdict.state is State.FAULT
    assert still[1] == kept
    assert end == (mavlink.MAV_SEVERITY_INFO, "Holdfast: the vehicle is heard")


def test_a_quiet_dive_is_quiet_and_its_numbers_are_those_of_the_sample():
    dive = active(seconds=8.0)
    shown = Shown(dive)
    shown.run(0.1)
    messages = shown.run(10.0)
    assert joined(messages) == []
    assert {m.get_type() for m in messages} == {"NAMED_VALUE_FLOAT"}
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in messages} == {(1, 25)}
    last = {m.name: m.value for m in messages}
    sample = dive.step.sample
    assert last["HfState"] == 2
    assert last["HfDepthErr"] == pytest.approx(sample.dofs.e[2], abs=0.005)
    assert last["HfDistD"] == pytest.approx(sample.state.disturbance[2], abs=3.0)
    assert 60.0 < last["HfReserve"] < 100.0


def test_without_a_pilots_link_one_sequence_numbers_heartbeats_and_words():
    """The vehicle forwards both: a gap would count as loss at the ground station."""
    shown = Shown(active())
    shown.run(5.0)
    assert len(shown.sequence) > 70
    assert all((now - last) % 256 == 1 for last, now in pairwise(shown.sequence))


class Hands:
    """A pilot's commands and buttons, on a link of their own or behind Holdfast."""

    def __init__(self, dive, behind):
        self.dive, self.behind, self.forwarded = dive, behind, b""
        if not behind:
            dive.tap.spoil = self._forward

    def _forward(self, now_s, inbox):
        """The vehicle forwards what is for our component; tests/firmware shows that it does."""
        data, self.forwarded = self.forwarded, b""
        return [*inbox, (inbox[-1][0], data)] if data and inbox else inbox

    def send(self, frame):
        if self.behind:
            self.dive.cockpit.extra.append(frame)
        else:
            self.forwarded += frame


def test_commands_of_the_ground_station_engage_hold_and_release():
    """Behind Holdfast; forwarding_tests.py has a link of its own."""
    dive = Dive(pilot=True, engage=False)
    shown, hands = Shown(dive), Hands(dive, behind=True)
    shown.run(4.0)
    assert dive.state is not State.ACTIVE
    hands.send(command(HOLD))
    assert results(shown.run(0.5)) == [mavlink.MAV_RESULT_TEMPORARILY_REJECTED]
    dive.tap.promises.asked_otherwise = True
    hands.send(command(ENGAGE))
    assert results(shown.run(3.0)) == [mavlink.MAV_RESULT_ACCEPTED]
    assert dive.state is State.ACTIVE
    dive.loop.engine.aim(hold(z=4.0))
    shown.run(2.0)
    hands.send(command(HOLD))
    assert results(shown.run(3.0)) == [mavlink.MAV_RESULT_ACCEPTED]
    depth_m = dive.step.truth.eta[2]
    assert 1.0 < depth_m < 3.0
    shown.run(2.0)
    assert dive.step.truth.eta[2] == pytest.approx(depth_m, abs=0.05), "it stays there"
    hands.send(command(RELEASE))
    assert results(shown.run(2.0)) == [mavlink.MAV_RESULT_ACCEPTED]
    assert dive.state is not State.ACTIVE
    assert mavlink.MAVLINK_MSG_ID_COMMAND_LONG not in dict(pieces(dive.cockpit.passed))


FOR_OTHERS: list[dict[str, Any]] = [
    {"target": (1, 1)},
    {"target": (2, 25)},
    {"target": (1, 24)},
    {"target": (0, 0)},
    {"target": (1, 0)},
]


@pytest.mark.parametrize("behind", [True, False], ids=["behind Holdfast", "with a link of its own"])
def test_a_command_that_is_for_another_or_for_all_does_nothing(behind):
    dive = active(pilot=behind)
    shown, hands = Shown(dive), Hands(dive, behind)
    shown.run(0.1)
    for other in FOR_OTHERS:
        hands.send(command(RELEASE, **other))
        assert {m.get_type() for m in shown.run(0.4)} <= {"NAMED_VALUE_FLOAT"}, other
        assert dive.state is State.ACTIVE, other


UNSUPPORTED, DENIED = mavlink.MAV_RESULT_UNSUPPORTED, mavlink.MAV_RESULT_DENIED
NO_MISSIONS = mavlink.MAV_MISSION_UNSUPPORTED
PILOT = Somebody(255, 190)
UNKNOWN: list[tuple[bytes, list[tuple[str, int]], str]] = [
    (command(RELEASE, system=254), [("COMMAND_ACK", DENIED)], "system 255 alone"),
    (command(RELEASE, number=mavlink.MAV_CMD_USER_2), [("COMMAND_ACK", UNSUPPORTED)], "COMMAND_LONG: 31011 "),
    (command(9), [("COMMAND_ACK", UNSUPPORTED)], "with 9 is not known"),
    (command(1, number=mavlink.MAV_CMD_REQUEST_MESSAGE), [("COMMAND_ACK", UNSUPPORTED)], "COMMAND_LONG: 512"),
    (
        PILOT.frame(mavlink.MAVLink_command_int_message(1, 25, 0, 400, 0, 0, 1, 0, 0, 0, 0, 0, 0)),
        [("COMMAND_ACK", UNSUPPORTED)],
        "COMMAND_INT: 400",
    ),
    (PILOT.frame(mavlink.MAVLink_mission_count_message(1, 25, 3)), [("MISSION_ACK", NO_MISSIONS)], "MISSION"),
    (PILOT.frame(mavlink.MAVLink_mission_request_list_message(255, 25)), [("MISSION_ACK", 3)], "MISSION"),
    (PILOT.frame(mavlink.MAVLink_param_request_list_message(1, 25)), [], "PARAM_REQUEST_LIST: "),
    (PILOT.frame(mavlink.MAVLink_param_set_message(1, 25, b"GAIN", 1.0, 9)), [], "PARAM_SET: "),
    (PILOT.frame(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 25, [0] * 251)), [], "FILE_TRANSFER"),
]


@pytest.mark.parametrize("behind", [True, False], ids=["behind Holdfast", "with a link of its own"])
def test_what_is_asked_of_us_in_a_form_that_is_not_known_is_refused_in_words(behind):
    dive = active(pilot=behind)
    shown, hands = Shown(dive), Hands(dive, behind)
    for asked, acks, words in UNKNOWN:
        shown.run(1.0)
        hands.send(asked)
        told = shown.run(0.4)
        answers = [m for m in told if m.get_type() in ("COMMAND_ACK", "MISSION_ACK")]
        assert [(m.get_type(), getattr(m, "result", getattr(m, "type", -1))) for m in answers] == acks, words
        assert [words in text for _, text in joined(told)] == [True], words
        assert dive.state is State.ACTIVE, words
    assert not behind or all(asked not in dive.cockpit.passed for asked, *_ in UNKNOWN)


def test_refusals_are_told_once_a_second_at_most_however_many_come():
    dive = active(pilot=True)
    shown, hands = Shown(dive), Hands(dive, behind=True)
    told: list[str] = []
    for n in range(100):
        hands.send(command(10 + n))
        told += [text for _, text in joined(shown.run(0.04))]
    assert 3 <= len(told) <= 5


def test_a_ground_station_s_command_int_does_what_its_command_long_does():
    dive = active(pilot=True)
    shown, hands = Shown(dive), Hands(dive, behind=True)
    hands.send(
        PILOT.frame(
            mavlink.MAVLink_command_int_message(1, 25, 0, mavlink.MAV_CMD_USER_1, 0, 0, 2, 0, 0, 0, 0, 0, 0)
        )
    )
    assert results(shown.run(1.0)) == [mavlink.MAV_RESULT_ACCEPTED]
    assert dive.state is not State.ACTIVE


def target_of(place=(0.5, 0.0, 1.2), frame=1, mask=0xDF8, component=1, velocity=(0.0, 0.0, 0.0)):
    return PILOT.frame(
        mavlink.MAVLink_set_position_target_local_ned_message(
            0, 1, component, frame, mask, *place, *velocity, *(0.0,) * 5
        )
    )


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        (target_of(frame=3), "frame 3 is not supported"),
        (target_of(mask=0xFFF), "type_mask 4095"),
        (target_of(mask=0x3F8), "a force"),
        (target_of(), "needs a position"),
        (target_of(frame=9), "needs a position"),
        (target_of(mask=0xDC7, velocity=(0.2, 0.0, 0.0)), "needs a position"),
        (target_of(component=25), "needs a position"),
    ],
    ids=["frame", "nothing", "force", "place", "step", "velocity", "to our component"],
)
def test_a_target_that_is_not_followed_is_refused_in_words(asked, words):
    """Without a position source."""
    dive = active(pilot=True)
    shown, hands = Shown(dive), Hands(dive, behind=True)
    shown.run(0.5)
    hands.send(asked)
    assert [words in text for _, text in shown.texts(1.0) if "refused" in text] == [True]


def test_targets_that_are_followed_or_go_on_to_the_vehicle_are_not_answered():
    dive = active(pilot=True)
    shown, hands = Shown(dive), Hands(dive, behind=True)
    hands.send(target_of(mask=0xDFB))
    hands.send(target_of(mask=0xDC7, velocity=(0.0, 0.0, 0.1)))
    assert shown.texts(1.0) == []
    hands.send(command(RELEASE))
    dive.tap.promises.asked_otherwise = True
    shown.run(6.0)
    for asked, answered in ((target_of(frame=3), False), (target_of(component=25), True)):
        hands.send(asked)
        assert any("refused" in text for _, text in shown.texts(1.0)) is answered


@pytest.mark.parametrize("behind", [True, False], ids=["behind Holdfast", "with a link of its own"])
def test_where_there_is_a_key_commands_and_words_are_signed(behind):
    key = hashlib.sha256(b"kelp").digest()
    dive = active(
        'signing_passphrase="kelp"',
        signing=Signing(key, 25, 1.8e9),
        pilot=behind,
        companion=["ground_station.on_loss=hold"],
    )
    shown, hands = Shown(dive), Hands(dive, behind)
    shown.parser.signing.secret_key = key
    assert {m.get_type() for m in shown.run(1.0)} == {"NAMED_VALUE_FLOAT"}, "signed, or none came"
    refused = dive.step.sample.counters.refused
    hands.send(command(RELEASE))
    assert results(shown.run(1.0)) == []
    assert dive.state is State.ACTIVE
    assert dive.step.sample.counters.refused == refused + (not behind)
    release = message_type(mavlink.MAVLINK_MSG_ID_COMMAND_LONG)(
        target_system=1, target_component=25, command=mavlink.MAV_CMD_USER_1, param1=float(RELEASE)
    )
    hands.send(Packer(255, 190, Signing(key, 7, 1.8e9 + 60.0)).encode(release))
    assert results(shown.run(1.0)) == [mavlink.MAV_RESULT_ACCEPTED]
    assert dive.state is not State.ACTIVE


def test_the_actions_for_qgroundcontrol_are_those_that_holdfast_takes():
    """The file that docs/wiring.md names; command() makes its bytes."""
    file = ROOT / "docs" / "examples" / "qgroundcontrol-actions.json"
    actions = json.loads(file.read_text(encoding="utf-8"))["actions"]
    assert [(action["compId"], action["mavCmd"], action["param1"]) for action in actions] == [
        (COMPONENT, mavlink.MAV_CMD_USER_1, number) for number in PilotAction
    ]


def by_cockpit(name):
    """The bytes of an action in Cockpit: the text's inputs filled in, then JSON to MAVLink from (255, 240).

    bluerobotics/cockpit: src/libs/utils-data-lake.ts, src/libs/actions/mavlink-message-actions.ts and
    src/libs/communication/mavlink.ts.
    """
    offered = extras({"depth": "Depth"}, "http://192.168.2.2:8600", "1.0")["actions"]
    [action] = [action for action in offered if action["name"] == f"Holdfast: {name}"]
    assert (action["type"], action["config"]["message_type"]) == ("mavlink-message", "COMMAND_LONG")
    text = action["config"]["message_config"].replace('"{{autopilotSystemId}}"', "1")
    fields = json.loads(text)
    fields["command"] = getattr(mavlink, fields["command"]["type"])
    return Somebody(255, 240).frame(mavlink.MAVLink_command_long_message(**fields))


def test_the_actions_that_cockpit_finds_engage_hold_and_release():
    dive = Dive(pilot=True, engage=False)
    shown, hands = Shown(dive), Hands(dive, behind=True)
    shown.run(4.0)
    dive.tap.promises.asked_otherwise = True
    for name, holds in (("engage", True), ("hold here", True), ("release", False)):
        hands.send(by_cockpit(name))
        assert results(shown.run(3.0)) == [mavlink.MAV_RESULT_ACCEPTED]
        assert (dive.state is State.ACTIVE) == holds
    assert {name: PilotAction(number).name for name, number in ACTIONS.items()} == {
        "engage": "ENGAGE",
        "release": "RELEASE",
        "hold here": "HOLD",
    }
    assert load_config().link.component == COMPONENT


def test_a_parameter_that_means_nothing_is_answered_and_changes_nothing():
    dive = active(pilot=True)
    shown, hands = Shown(dive), Hands(dive, behind=True)
    shown.run(0.1)
    for action in (0, 4, 1.5, float("nan"), 1e9):
        hands.send(command(action))
        assert results(shown.run(0.3)) == [mavlink.MAV_RESULT_UNSUPPORTED]
        assert dive.state is State.ACTIVE


def test_the_hold_button_stops_a_way_and_counts_once_a_press():
    """QGroundControl sends every button that is down, as bits (src/Joystick/Joystick.cc)."""
    dive = active(
        "initial.eta=[0,0,2,0,0,0.3]",
        setpoint=hold(z=2.0),
        pilot=True,
        companion=["ground_station.hold_button=15"],
        seconds=2.0,
    )
    dive.cockpit.push()
    dive.run(0.5)
    dive.loop.engine.aim(hold(z=6.0))
    dive.run(2.0)
    dive.cockpit.push(buttons=1 << 15)
    dive.run(3.0)
    stopped_m = dive.step.sample.eta_d[2]
    assert 2.0 < stopped_m < 4.0
    dive.loop.engine.aim(hold(z=3.5 if stopped_m < 3.0 else 2.5))
    dive.run(2.0)
    assert abs(dive.step.sample.eta_d[2] - stopped_m) > 0.2, "a button that stays down is one press"
