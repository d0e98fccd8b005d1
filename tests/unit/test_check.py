"""Every row of the pre-dive list, good and bad: a row that cannot say no is no row."""

from dataclasses import replace

import pytest
from msgspec import structs
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from virtual import Dive, Somebody, active

from companion.config import load_config
from companion.mavlink.autopilot import Autopilot
from companion.predive.check import JUDGES, Grade, refusals, rows
from companion.predive.survey import Directions, Observed, Survey
from companion.predive.table import as_json, from_json, show, worst
from companion.records import (
    Ages,
    Battery,
    Condition,
    Delays,
    EkfOrigin,
    EkfStatus,
    FirmwareVersion,
    Heartbeat,
    PilotGain,
    PilotToggle,
    Reboot,
    ReceiverChannels,
    State,
)

GOOD, WARNING, REFUSED = Grade
PARAMETERS = {
    "FRAME_CONFIG": 2.0,
    "MAV_GCS_SYSID": 255.0,
    "FS_PILOT_INPUT": 2.0,
    "FS_PILOT_TIMEOUT": 3.0,
    "JS_THR_GAIN": 1.0,
    "FS_LEAK_ENABLE": 1.0,
    "RC_PROTOCOLS": 1.0,
    "RC_OVERRIDE_TIME": 3.0,
    "BARO_PRIMARY": 1.0,
    "BARO_SPEC_GRAV": 1.0,
    "BARO2_GND_PRESS": 101325.0,
}
STICKS = ('vehicle.thrust_path="manual_control"',)
BLIND = Ages(0.01, 0.01, float("inf"), 0.01, float("inf"))


@pytest.fixture
def good(make_sample):
    state = make_sample(delays=Delays(0.01, 0.02, True, True)).state
    return Observed(
        state=state,
        parameters=PARAMETERS,
        measured_hz={"ATTITUDE": 49.8, "VFR_HUD": 50.0, "LOCAL_POSITION_NED": 0.0},
        asked_hz={"ATTITUDE": 50.0, "VFR_HUD": 50.0, "LOCAL_POSITION_NED": 50.0},
        heartbeat=Heartbeat(0.0, False, 19, 3),
        firmware=FirmwareVersion(0.0, "4.7.0", (4, 7, 0)),
        pilot_gain=0.5,
        toggles={"InputHold": False, "RollPitch": False},
        receiver_channels=16,
        failsafe_seen=True,
        origin_known=True,
        ekf=EkfStatus(0.0, attitude=True, depth=True, variance=0.05, position=True),
        voltage_v=16.0,
        directions=Directions(motors=(1.0,) * 8),
    )


def row(name, seen, *overrides):
    (found,) = [row for row in rows(seen, load_config(overrides=overrides)) if row.name == name]
    return found


def reported(seen, **parameters):
    """The same with other parameters; None: not reported."""
    changed = {**seen.parameters, **parameters}
    return replace(seen, parameters={key: value for key, value in changed.items() if value is not None})


def test_all_good(good):
    listed = rows(good, load_config())
    assert {row.grade for row in listed} == {GOOD}
    assert len(listed) == 17
    assert all(row.found and row.why for row in listed)
    assert refusals(listed) == ""
    assert worst(listed) == 0


# CheckRow, what is changed, overrides of our configuration, the grade, and words that have to be there.
BAD = [
    ("firmware", {"heartbeat": Heartbeat(0.0, False, 19, 3, 2)}, (), REFUSED, ["type 2"]),
    ("firmware", {"heartbeat": Heartbeat(0.0, False, 19, 3, 12, 12)}, (), REFUSED, ["autopilot 12"]),
    ("firmware", {"firmware": None}, (), WARNING, ["not reported"]),
    ("firmware", {"firmware": FirmwareVersion(0.0, "4.1.2", (4, 1, 2))}, (), WARNING, ["4.1.2"]),
    ("pilot gain", {"pilot_gain": 0.25}, STICKS, WARNING, ["25 %"]),
    ("pilot gain", {"pilot_gain": None}, STICKS, REFUSED, ["PilotGain"]),
    ("input hold", {"toggles": {"InputHold": True, "RollPitch": False}}, (), REFUSED, ["InputHold on"]),
    ("input hold", {"toggles": {"InputHold": False, "RollPitch": True}}, (), REFUSED, ["RollPitch on"]),
    ("input hold", {"toggles": {}}, (), WARNING, ["not reported"]),
    ("RC receiver", {"failsafe_seen": False}, (), WARNING, ["after 3 s"]),
    ("streams", {"measured_hz": {"ATTITUDE": 12.5}}, (), WARNING, ["ATTITUDE 12 of 50 Hz"]),
    ("streams", {"measured_hz": {}}, (), WARNING, ["not measured"]),
    ("EKF origin", {"origin_known": False}, (), WARNING, ["not set"]),
    ("EKF", {"ekf": None}, (), REFUSED, ["no EKF_STATUS_REPORT"]),
    ("EKF", {"ekf": EkfStatus(0.0, False, False, 0.0, False, False)}, (), REFUSED, ["not init", "wait"]),
    ("EKF", {"ekf": EkfStatus(0.0, False, True, 0.0, True)}, (), REFUSED, ["no attitude", "wait"]),
    ("EKF", {"ekf": EkfStatus(0.0, True, False, 0.0, True)}, (), REFUSED, ["no depth", "wait"]),
    ("EKF", {"ekf": EkfStatus(0.0, True, True, 0.9, True)}, (), REFUSED, ["variance is 0.90", "wait"]),
    ("compass", {"yaw_aligned_t_s": 10.0}, (), REFUSED, ["aligned its yaw less than 3 s ago: wait"]),
    ("battery", {"voltage_v": 13.5}, (), WARNING, ["13.5 V"]),
    ("battery", {"voltage_v": 12.0}, (), REFUSED, ["12.0 V"]),
    ("battery", {"voltage_v": None}, (), WARNING, ["no voltage"]),
    ("clock", {"conditions": Condition.CLOCK_JUMPED}, (), WARNING, ["clock jumped"]),
    ("thrusters", {"directions": Directions((1, 1, -0.5, 1, 1, 1, 1, 1))}, (), REFUSED, ["motor 3 "]),
    (
        "thrusters",
        {"directions": Directions((1, 1, 1, 1, 0.1, 1, 1, 1))},
        (),
        REFUSED,
        ["motor 5 gives too little"],
    ),
    ("thrusters", {"directions": Directions(refused="it is not armed")}, (), WARNING, ["not armed"]),
]


@pytest.mark.parametrize(
    ("name", "changes", "overrides", "grade", "words"), BAD, ids=[f"{row[0]}-{row[4][0]}" for row in BAD]
)
def test_a_bad_row_says_what_and_what_mends_it(good, name, changes, overrides, grade, words):
    found = row(name, replace(good, **changes), *overrides)
    assert found.grade is grade
    assert all(word in found.found for word in words), found.found
    assert found.fix or name == "streams"
    (judge,) = [judge for judge in JUDGES if judge.name == name]
    refused = name in refusals(rows(replace(good, **changes), load_config(overrides=overrides)))
    assert refused == (grade is REFUSED and (not judge.condition or judge.settles))


# CheckRow, parameters, overrides of our configuration, grade, and words in `found` or `fix`.
BY_PARAMETER = [
    ("frame", {"FRAME_CONFIG": 1.0}, (), REFUSED, "vectored, expected vectored_6dof"),
    ("frame", {"FRAME_CONFIG": 1.0}, ('vehicle.frame="vectored"',), GOOD, "vectored"),
    ("frame", {"FRAME_CONFIG": 5.0}, (), REFUSED, "number 5"),
    ("frame", {"FRAME_CONFIG": None}, (), REFUSED, "FRAME_CONFIG was not reported"),
    ("steering id", {"MAV_GCS_SYSID": 254.0}, (), REFUSED, "accepts 254"),
    ("steering id", {"MAV_GCS_SYSID": 254.0}, ("link.system=254",), GOOD, ""),
    ("steering id", {"MAV_GCS_SYSID": None}, (), REFUSED, "was not reported"),
    ("pilot failsafe", {"FS_PILOT_INPUT": 0.0}, (), REFUSED, "FS_PILOT_INPUT = 2"),
    ("pilot failsafe", {"FS_PILOT_INPUT": 1.0}, (), GOOD, "neutral"),
    ("pilot failsafe", {"FS_PILOT_TIMEOUT": 3.0}, ("supervisor.max_pilot_timeout_s=1.0",), REFUSED, "<= 1"),
    ("pilot failsafe", {"FS_PILOT_TIMEOUT": None}, (), REFUSED, "FS_PILOT_TIMEOUT was not reported"),
    ("pilot gain", {"JS_THR_GAIN": 0.5}, STICKS, WARNING, "25 %"),
    ("pilot gain", {"JS_THR_GAIN": None}, STICKS, REFUSED, "JS_THR_GAIN"),
    ("pilot gain", {"JS_THR_GAIN": None}, (), GOOD, "not used"),
    ("leak", {"FS_LEAK_ENABLE": 0.0}, (), WARNING, "FS_LEAK_ENABLE = 1"),
    ("leak", {"FS_LEAK_ENABLE": None}, (), WARNING, "FS_LEAK_ENABLE was not reported"),
    ("leak", {"FS_LEAK_ENABLE": 1.0}, (), GOOD, "no leak; the autopilot warns if one is detected"),
    ("leak", {"FS_LEAK_ENABLE": 2.0}, (), GOOD, "surfaces"),
    ("RC receiver", {"RC_OVERRIDE_TIME": -1.0}, (), GOOD, "has acted"),
]


@pytest.mark.parametrize(("name", "parameters", "overrides", "grade", "words"), BY_PARAMETER)
def test_rows_by_parameter(good, name, parameters, overrides, grade, words):
    found = row(name, reported(good, **parameters), *overrides)
    assert found.grade is grade
    assert words in found.found + found.fix


def test_frames_that_are_not_signed_with_our_key_are_reported_where_there_is_one(good):
    assert all(row.name != "signing" for row in rows(good, load_config()))
    assert row("signing", good, "link.signing_key_file=/etc/holdfast/mavlink.key").grade is GOOD
    assert row("signing", replace(good, signs=True)).grade is WARNING, "it drops what we send unsigned"


@pytest.mark.parametrize(
    ("name", "condition"),
    [("leak", Condition.LEAK), ("supervisor", Condition.TILTED), ("supervisor", Condition.PILOT_TAKEOVER)],
)
def test_what_the_supervisor_finds_is_refused_and_the_last_line_says_so(good, capsys, name, condition):
    show(rows(good, load_config()), ["a note"])
    assert capsys.readouterr().out.endswith("a note\nready: it may engage as soon as it is armed\n")
    seen = replace(good, conditions=condition | Condition.DISARMED, origin_known=False)
    found = row(name, seen)
    assert (found.grade, found.found, found.fix) == (REFUSED, condition.text, condition.remedy)
    show(rows(seen, load_config()), [])
    assert capsys.readouterr().out.endswith(f"NOT ready: {name}: {condition.text}\n")
    show(rows(replace(good, origin_known=False), load_config()), [])
    assert capsys.readouterr().out.endswith("as soon as it is armed; look at EKF origin\n")


def test_of_a_vehicle_that_is_not_heard_the_list_says_what_is_heard_instead(good):
    silent = structs.replace(BLIND, heartbeat_s=4.0)
    seen = replace(good, state=structs.replace(good.state, ages=silent), contact=lambda _: ("a fish", "fish"))
    (found,) = rows(seen, load_config())
    assert (found.name, found.grade, found.fix) == ("link", REFUSED, "fish")
    assert "no heartbeat of system 1, component 1: a fish" in found.found


def test_streams_that_not_every_vehicle_has_may_stay_away_but_not_slow_down(good):
    asked = {**good.asked_hz, "SCALED_PRESSURE3": 50.0}
    seen = replace(good, asked_hz=asked, measured_hz={**good.measured_hz, "SCALED_PRESSURE3": 0.0})
    assert row("streams", seen).grade is GOOD
    slow = replace(seen, measured_hz={**good.measured_hz, "SCALED_PRESSURE3": 12.0})
    assert "SCALED_PRESSURE3 12 of 50 Hz" in row("streams", slow).found


def test_a_receiver_and_overrides_that_never_end_are_refused(good):
    """Nothing at all would stop the thrusters then."""
    seen = reported(replace(good, failsafe_seen=False), RC_OVERRIDE_TIME=-1.0)
    assert row("RC receiver", seen).grade is REFUSED
    assert "not reported" in row("RC receiver", reported(seen, RC_OVERRIDE_TIME=None)).found
    assert row("RC receiver", replace(seen, receiver_channels=0)).grade is GOOD
    assert row("RC receiver", reported(seen, RC_PROTOCOLS=0.0)).grade is GOOD


@pytest.mark.parametrize(
    ("row_name", "changes", "grade", "words"),
    [
        ("depth", {"ages": BLIND}, REFUSED, "no fresh depth"),
        ("clock", {"delays": Delays(0.08, 0.08, True, True)}, WARNING, "160 ms"),
        ("clock", {"delays": Delays(0.03, 0.08, False, True)}, WARNING, "not answered"),
    ],
)
def test_rows_by_the_state(good, row_name, changes, grade, words):
    found = row(row_name, replace(good, state=structs.replace(good.state, **changes)))
    assert found.grade is grade
    assert words in found.found


def test_refusals_name_the_row_and_the_worst_is_the_status(good):
    bad = reported(replace(good, origin_known=False, directions=None), FRAME_CONFIG=1.0, MAV_GCS_SYSID=1.0)
    listed = rows(bad, load_config())
    assert refusals(listed).startswith(
        'frame: vectored, expected vectored_6dof. Fix: vehicle.preset = "bluerov2"; steering id: '
    )
    assert worst(listed) == 2
    assert worst(rows(replace(good, origin_known=False), load_config())) == 1
    assert worst([]) == 2


class TestSurvey:
    def test_it_knows_what_came(self, make_sample):
        survey = Survey(Autopilot(load_config()))
        survey.take([Heartbeat(0.0, False, 19, 5), Battery(0.0, 15.5), PilotGain(0.0, 0.7)])
        assert not survey.observed(make_sample().state).failsafe_seen, "the first heartbeat always says so"
        survey.take([Heartbeat(1.0, False, 19, 5)])
        survey.take([PilotToggle(0.0, "InputHold", True), ReceiverChannels(0.0, 8), EkfOrigin(0.0, True)])
        seen = survey.observed(make_sample().state)
        assert (seen.voltage_v, seen.pilot_gain, seen.receiver_channels) == (15.5, 0.7, 8)
        assert seen.origin_known
        assert seen.failsafe_seen
        assert seen.toggles == {"InputHold": True}
        survey.take([Reboot(3.0)])
        seen = survey.observed(make_sample().state)
        assert seen.voltage_v is None
        assert not seen.origin_known
        assert not seen.toggles


def test_run_refuses_to_engage_or_arm_and_names_the_row():
    dive = Dive("parameters.FRAME_CONFIG=1")
    dive.run(5.0)
    assert dive.state is State.IDLE
    assert "frame: vectored, expected vectored_6dof" in dive.step.sample.verdict.reason
    assert not dive.step.truth.armed


@pytest.mark.parametrize(("button", "name"), [(8, "InputHold on"), (7, "RollPitch on")])
def test_a_pilots_toggle_forbids_engaging(button, name):
    """BTN8 is InputHold by default; RollPitch is put on another button. NAMED_VALUE_FLOAT tells of both."""
    dive = Dive("parameters.BTN7_FUNCTION=49", arm=False, engage=False)
    station = Somebody()
    dive.run(1.0)
    for buttons in (0, 1 << button, 0):
        stick = mavlink.MAVLink_manual_control_message(1, 400, 0, 500, 0, buttons)
        dive.tap.to_vehicle.append(station.frame(stick))
        dive.run(0.1)
    dive.run(3.0)
    assert name in dive.step.sample.verdict.reason


def test_a_steering_id_that_changes_while_holding_ramps_down_and_says_why():
    dive = active()
    dive.tap.to_vehicle.append(Somebody().parameter("MAV_GCS_SYSID", 254.0))
    dive.until(State.RAMP_DOWN, within_s=1.0)
    assert "steering id: it accepts 254" in dive.step.sample.verdict.reason


def test_run_says_once_who_the_autopilot_is():
    dive = Dive(engage=False)
    texts = [text.text for step in dive.run(6.0) for text in step.sample.texts]
    (about,) = [text for text in texts if text.startswith("ArduSub")]
    assert about.startswith("ArduSub 4.7.0 (dev), vectored_6dof, FS_PILOT_INPUT 2, FS_PILOT_TIMEOUT 3")


def test_a_position_that_the_ekf_does_not_vouch_for_is_waited_for(good):
    ekf = EkfStatus(0.0, attitude=True, depth=True, variance=0.0)
    assert row("EKF", replace(good, ekf=ekf)).grade is GOOD
    positioned = structs.replace(good.state, ages=structs.replace(good.state.ages, position_s=0.01))
    found = row("EKF", replace(good, ekf=ekf, state=positioned))
    assert found.grade is REFUSED
    assert "no position, though one is sent: wait" in found.found


def test_what_has_to_settle_before_engaging_ends_no_hold(good):
    listed = rows(replace(good, ekf=None, yaw_aligned_t_s=good.state.t_s), load_config())
    said = refusals(listed)
    assert said.startswith("EKF: no EKF_STATUS_REPORT arrived. Fix: ")
    assert "; compass: " in said
    assert refusals(listed, holding=True) == ""


def test_the_list_comes_back_from_its_json(good):
    listed = rows(good, load_config())
    assert from_json(as_json(listed, []).encode()) == listed
    assert '"grade": "GOOD"' in as_json(listed, [])
    for text in (b"[]", b"{}", b'{"rows": [{"name": 1}]}', b"no json"):
        with pytest.raises(ValueError):  # noqa: PT011
            from_json(text)
