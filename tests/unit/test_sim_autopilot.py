"""The ArduSub double does what the firmware was seen to do: steering, arming, modes, failsafes, commands."""

import math
import struct
from copy import deepcopy

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from sim_wire import (
    ALT_HOLD,
    ARM,
    MANUAL,
    REQUEST,
    SET_INTERVAL,
    SET_MODE,
    STABILIZE,
    SURFACE,
    Heard,
    Station,
    manual,
    override,
    vehicle,
)

DEEP = "initial.eta=[0, 0, 8, 0, 0, 0]"


def channels(station):
    station.command(REQUEST, mavlink.MAVLINK_MSG_ID_RC_CHANNELS)
    heard = station.run(0.05)
    return [getattr(heard.last("RC_CHANNELS"), f"chan{n}_raw") for n in range(1, 9)]


def set_param(station, name, value):
    station.say(mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, 9))
    return station.run(0.05)


def set_mode(station, mode):
    station.command(SET_MODE, 1, mode)
    return station.run(0.05)


# Who may steer


@pytest.mark.parametrize("steering", [manual(x=1000), override(forward=400)], ids=["manual", "override"])
def test_only_the_ground_stations_system_steers_and_only_this_vehicle(steering):
    """Whatever its component; a new MAV_GCS_SYSID counts at once."""
    rov = vehicle()
    Station(rov, system=245).run(0.1, steering)
    station = Station(rov, component=7)
    elsewhere = deepcopy(steering)
    elsewhere.target, elsewhere.target_system = 2, 2
    station.run(0.1, elsewhere)
    assert channels(station)[4] == 1500
    station.run(0.1, steering)
    assert channels(station)[4] > 1500
    set_param(station, "MAV_GCS_SYSID", 245)
    other = Station(rov, system=245)
    other.run(0.1, override(forward=50))
    assert channels(other)[4] == 1550


def test_joystick_gain_is_read_at_boot_only_throttle_gain_at_once():
    station = Station(vehicle())
    set_param(station, "JS_GAIN_DEFAULT", 1.0)
    set_param(station, "JS_THR_GAIN", 0.5)
    station.run(0.1, manual(x=1000, z=1000))
    assert channels(station)[4] == 1700
    assert channels(station)[2] == 1600
    station.command(246, 1)
    station.run(0.1)
    station.run(0.1, manual(x=1000))
    assert channels(station)[4] == 1900


def test_gain_buttons_act_on_the_edge_and_are_reported():
    station = Station(vehicle())
    heard = station.run(1.0, manual(buttons=1 << 11))
    assert "#Gain is 75%" in heard.texts()
    assert len([text for text in heard.texts() if text.startswith("#Gain")]) == 1
    gains = [m.value for m in station.run(1.0).of("NAMED_VALUE_FLOAT") if m.name == "PilotGain"]
    assert gains[-1] == 0.75
    station.run(0.1, manual(x=1000))
    assert channels(station)[4] == 1800


# Failsafes


def test_an_rc_receiver_silences_the_failsafe_and_only_the_override_time_neutralises():
    station = Station(vehicle("rc_receiver=true", "parameters={FS_GCS_ENABLE=0}")).arm()
    station.run(0.5, override(forward=200))
    assert "Lost manual control" not in station.run(2.9).texts()
    assert channels(station)[4] == 1700
    assert "Lost manual control" not in station.run(5.0).texts()
    assert channels(station)[4] == 1500
    assert station.rov.truth().armed


@pytest.mark.parametrize(("action", "mode"), [(3, ALT_HOLD), (4, SURFACE)])
def test_gcs_failsafe_changes_mode(action, mode):
    station = Station(vehicle(DEEP, f"parameters={{FS_GCS_ENABLE={action}, FS_PILOT_INPUT=0}}")).arm()
    station.run(4.9)
    assert station.rov.truth().mode == MANUAL
    station.run(0.3)
    assert station.rov.truth().mode == mode


# Arming and modes


def test_arming_is_earliest_2_s_after_boot():
    station = Station(vehicle())
    station.run(1.5)
    assert station.command(ARM, 1).run(0.1).result(ARM) == 4
    station.run(0.5)
    heard = station.command(ARM, 1).run(1.1)
    assert heard.result(ARM) == 0
    assert "Arming motors" in heard.texts()
    assert heard.last("HEARTBEAT").base_mode == 209


@pytest.mark.parametrize(("mode", "name"), [(16, "POSHOLD"), (4, "GUIDED"), (3, "AUTO"), (7, "CIRCLE")])
def test_position_modes_are_refused_in_ardusubs_words(mode, name):
    heard = set_mode(Station(vehicle()), mode)
    assert heard.result(SET_MODE) == 4
    assert heard.texts() == [f"Mode change failed: {name} requires position"]
    located = Station(vehicle("sensors.dvl=true"))
    heard = set_mode(located, mode)
    assert heard.result(SET_MODE) == 4
    assert heard.texts()[1] == f"The stand-in has no {name}; ArduSub: docs/sitl.md"
    assert located.rov.truth().mode == MANUAL


def test_a_mode_change_sends_a_heartbeat_at_once_and_neutralises():
    station = Station(vehicle(DEEP)).arm()
    station.run(0.5, override(forward=200))
    station.run(0.03)
    heard = station.command(SET_MODE, 1, STABILIZE).run()
    assert heard.last("HEARTBEAT").custom_mode == STABILIZE
    assert channels(station)[4] == 1500


def test_whoever_arms_within_3_s_of_a_reboot_and_does_not_steer_is_disarmed():
    station = Station(vehicle())
    station.run(1.0)
    station.command(246, 1).run(2.2)
    assert station.command(ARM, 1).run(0.1).result(ARM) == 0
    heard = station.run(2.0)
    assert heard.texts()[:2] == ["Lost manual control", "Disarming motors"]
    assert "EKF3 IMU0 MAG0 initial yaw alignment complete" in heard.texts()


# Commands, time, parameters


def test_parameters_list_read_set_and_survive_a_reboot():
    station = Station(vehicle())
    station.say(mavlink.MAVLink_param_request_list_message(1, 1))
    values = station.run(1.0).of("PARAM_VALUE")
    assert len(values) == values[0].param_count == len({v.param_id for v in values})
    assert [v.param_index for v in values] == list(range(len(values)))
    assert all(len(v.param_id) <= 16 for v in values)
    set_param(station, "FS_PILOT_TIMEOUT", 0.7)
    assert not set_param(station, "FS_PILOT_TIMEOUT", math.nan).of("PARAM_VALUE")
    station.command(246, 1).run(0.5)
    station.say(mavlink.MAVLink_param_request_read_message(1, 1, b"FS_PILOT_TIMEOUT", -1))
    assert station.run(0.05).last("PARAM_VALUE").param_value == pytest.approx(0.7)


@pytest.mark.parametrize("kind", [0, 1, 2])
def test_missions_have_no_items_and_take_none(kind):
    station = Station(vehicle())
    station.say(mavlink.MAVLink_mission_request_list_message(1, 1, kind))
    assert station.run(0.05).last("MISSION_COUNT").count == 0
    for message, result in (
        (mavlink.MAVLink_mission_request_int_message(1, 1, 0, kind), 13),
        (mavlink.MAVLink_mission_count_message(1, 1, 2, kind), 4),
        (mavlink.MAVLink_mission_count_message(1, 1, 0, kind), 0),
        (mavlink.MAVLink_mission_item_int_message(1, 1, 0, 3, 16, 0, 1, 0, 0, 0, 0, 0, 0, 0, kind), 1),
        (mavlink.MAVLink_mission_clear_all_message(1, 1, kind), 0),
    ):
        acknowledged = station.say(message).run(0.05).last("MISSION_ACK")
        assert (acknowledged.type, acknowledged.mission_type) == (result, kind)
    station.say(mavlink.MAVLink_mission_request_list_message(1, 1, 9))
    assert station.run(0.05).last("MISSION_ACK").type == 3, "another kind"
    assert Heard(station.heard).texts() == ["Only 0 items are supported; ArduSub: docs/sitl.md"]


@pytest.mark.parametrize(
    ("operation", "answer"), [(4, (129, b"\x0a")), (3, (129, b"\x0a")), (2, (128, b"")), (128, None)]
)
def test_there_are_no_files(operation, answer):
    """Open and list are refused, a reset is not, and another's answer gets none."""
    path = b"@PARAM/param.pck"
    asked = struct.pack("<HBBBBBBI", 65535, 3, operation, len(path), 0, 0, 0, 0) + path
    station = Station(vehicle())
    station.say(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, asked.ljust(251, b"\0")))
    replies = [bytes(reply.payload) for reply in station.run(0.05).of("FILE_TRANSFER_PROTOCOL")]
    assert [(reply[3], reply[12 : 12 + reply[4]]) for reply in replies] == ([answer] if answer else [])
    assert all(struct.unpack_from("<HB", reply) == (0, 3) and reply[5] == operation for reply in replies)


def test_a_reboot_forgets_arming_mode_origin_and_intervals():
    station = Station(vehicle())
    station.say(mavlink.MAVLink_set_gps_global_origin_message(1, 5, 6, 7))
    station.command(SET_INTERVAL, 30, 20000).command(SET_MODE, 1, STABILIZE).run(3.0)
    heard = station.command(246, 1).run(2.0)
    assert heard.last("HEARTBEAT").custom_mode == MANUAL
    assert heard.last("SYSTEM_TIME").time_boot_ms < 2100
    assert len(heard.of("ATTITUDE")) == pytest.approx(20, abs=2)
    assert not station.command(REQUEST, 49).run(0.05).of("GPS_GLOBAL_ORIGIN")
    station.arm()
    assert station.command(246, 1).run(0.05).result(246) == 4


def test_arming_and_rebooting_by_force():
    station = Station(vehicle())
    station.run(3.0).texts()
    station.say(override(yaw=200)).run(0.05)
    assert station.command(ARM, 1).run(0.05).result(ARM) == 4
    assert station.command(ARM, 1, 21196).run(0.05).result(ARM) == 0
    reboot = mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN
    assert station.command(reboot, 1).run(0.05).result(reboot) == 4
    assert station.rov.truth().armed
    forced = mavlink.MAVLink_command_int_message(1, 1, 0, reboot, 0, 0, 1, 0, 0, 0, 0, 20190226, 0.0)
    assert station.say(forced).run(0.05).result(reboot) == 0, "a whole number of a command is no latitude"
    assert not station.rov.truth().armed
