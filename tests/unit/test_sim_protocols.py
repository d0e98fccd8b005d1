"""The stand-in's missions, fences and files, as a ground station meets them."""

import struct
import zlib

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from sim_wire import Heard, Station, vehicle

from sim_bridge.firmware.files import packed_parameters
from sim_bridge.firmware.params import DEFAULTS, Parameters

BLOCK = 239
PACKED = {1: "<b", 2: "<h", 3: "<i", 4: "<f"}


def item(number, kind=0, command=16, frame=3):
    return mavlink.MAVLink_mission_item_int_message(
        1, 1, number, frame, command, 0, 1, 0, 0, 0, 0, 475000000 + number, -25710000, -2.0, kind
    )


def upload(station, *items, kind=0):
    """Upload as QGroundControl does: an item for each request; return the acknowledgement's result."""
    station.say(mavlink.MAVLink_mission_count_message(1, 1, len(items), kind))
    for _ in range(len(items) + 1):
        heard = station.run(0.05)
        if acknowledged := heard.of("MISSION_ACK"):
            return acknowledged[0].type
        station.say(items[heard.last("MISSION_REQUEST").seq])
    raise AssertionError("no acknowledgement")


def count(station, kind=0):
    station.say(mavlink.MAVLink_mission_request_list_message(1, 1, kind))
    return station.run(0.05).last("MISSION_COUNT").count


def test_a_mission_is_stored_and_read_back():
    station = Station(vehicle())
    assert upload(station, item(0), item(1), item(2)) == 0
    assert count(station) == 3
    station.say(mavlink.MAVLink_mission_request_int_message(1, 1, 2, 0))
    assert station.run(0.05).last("MISSION_ITEM_INT").x == 475000002
    station.say(mavlink.MAVLink_mission_set_current_message(1, 1, 2))
    current = station.run(0.05).last("MISSION_CURRENT")
    assert (current.seq, current.total, current.mission_state) == (2, 2, 2)
    station.say(mavlink.MAVLink_mission_clear_all_message(1, 1, 0)).run(0.05)
    assert count(station) == 0


@pytest.mark.parametrize(
    ("command", "kept"),
    [
        (16, (3, 1.0, 0.0, 0.0, 0.0, 475000000)),
        (19, (3, 1.0, 0.0, 1.0, 1.0, 475000000)),
        (93, (0, 1.5, 2.0, 3.0, 4.0, 0)),
    ],
)
def test_a_mission_keeps_of_an_item_what_its_command_needs(command, kept):
    station = Station(vehicle())
    second = mavlink.MAVLink_mission_item_int_message(
        1, 1, 1, 3, command, 0, 1, 1.5, 2.5, 3.5, 4.5, 475000000, -25710000, -2.0, 0
    )
    assert upload(station, item(0), second) == 0
    station.say(mavlink.MAVLink_mission_request_int_message(1, 1, 1, 0))
    back = station.run(0.05).last("MISSION_ITEM_INT")
    assert (back.frame, back.param1, back.param2, back.param3, back.param4, back.x) == kept


def test_a_command_that_no_mission_takes_is_refused():
    station = Station(vehicle())
    assert upload(station, item(0), item(1, command=mavlink.MAV_CMD_COMPONENT_ARM_DISARM)) == 3


def test_an_item_of_the_old_kind_is_taken_with_a_word():
    station = Station(vehicle())
    old = mavlink.MAVLink_mission_item_message(1, 1, 0, 3, 16, 0, 1, 0, 0, 0, 0, 47.5, -2.5, 0.0, 0)
    assert upload(station, old) == 0
    assert Heard(station.heard).texts() == [
        "got MISSION_ITEM; GCS should send MISSION_ITEM_INT",
        "Flight plan received",
    ]


def test_the_version_by_the_request_of_old():
    station = Station(vehicle())
    station.say(mavlink.MAVLink_autopilot_version_request_message(1, 1))
    assert station.run(0.05).of("AUTOPILOT_VERSION")


def test_a_fence_takes_fence_points_alone():
    station = Station(vehicle())
    corners = [item(number, kind=1, command=5001) for number in range(3)]
    assert upload(station, *corners, kind=1) == 0
    assert count(station, kind=1) == 3
    assert upload(station, item(0, kind=1, command=16), kind=1) == 3


def test_an_item_out_of_turn_is_refused_and_the_upload_goes_on():
    station = Station(vehicle())
    station.say(mavlink.MAVLink_mission_count_message(1, 1, 2, 0)).run(0.05)
    assert station.say(item(1)).run(0.05).last("MISSION_ACK").type == 13
    assert station.say(item(0)).run(0.05).last("MISSION_REQUEST").seq == 1


def test_an_upload_that_stops_is_asked_for_again_and_given_up():
    station = Station(vehicle())
    station.say(mavlink.MAVLink_mission_count_message(1, 1, 2, 0))
    heard = station.run(12.0)
    assert 5 <= len(heard.of("MISSION_REQUEST")) <= 9
    assert heard.last("MISSION_ACK").type == 15
    assert "Mission upload timeout" in heard.texts()


def test_what_is_not_a_number_is_not_stored():
    station = Station(vehicle())
    nowhere = mavlink.MAVLink_mission_item_message(
        1, 1, 0, 3, 16, 0, 1, 0, 0, 0, 0, float("nan"), 0.0, 0.0, 0
    )
    assert upload(station, nowhere) == 3


def unpacked(data):
    """Return the parameters of a packed file by name."""
    _, total, _ = struct.unpack_from("<HHH", data)
    place, before, found = 6, "", {}
    while place < len(data):
        if data[place] == 0:
            place += 1
            continue
        kind, flags = data[place] & 15, data[place] >> 4
        shared, length = data[place + 1] & 15, (data[place + 1] >> 4) + 1
        name = before[:shared] + data[place + 2 : place + 2 + length].decode()
        place += 2 + length
        value = struct.unpack_from(PACKED[kind], data, place)[0]
        size = struct.calcsize(PACKED[kind])
        assert place // BLOCK == (place + size - 1) // BLOCK, f"{name} lies across two blocks"
        place += size * (2 if flags else 1)
        found[name], before = value, name
    assert len(found) == total
    return found


@pytest.mark.parametrize("with_defaults", [False, True])
def test_the_parameter_file_holds_every_parameter(with_defaults):
    params = Parameters({"FS_PILOT_TIMEOUT": 2.5})
    found = unpacked(packed_parameters(params, with_defaults, BLOCK))
    assert list(found) == list(DEFAULTS)
    assert found == pytest.approx({name: params[name] for name in DEFAULTS})


def ftp(station, sequence, opcode, data=b"", size=None, offset=0, session=0):
    size = len(data) if size is None else size
    head = struct.pack("<HBBBBBBI", sequence, session, opcode, size, 0, 0, 0, offset)
    payload = (head + data).ljust(251, b"\0")
    station.say(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, payload))
    answers = [bytes(answer.payload) for answer in station.run(0.05).of("FILE_TRANSFER_PROTOCOL")]
    return [(answer[3], answer[12 : 12 + answer[4]]) for answer in answers]


def test_a_file_is_opened_read_in_a_burst_and_closed():
    station = Station(vehicle())
    assert ftp(station, 0, 4, b"@PARAM/param.pck")[0][0] == 128
    assert ftp(station, 2, 4, b"@PARAM/param.pck") == [(129, b"\x01")], "one at a time"
    *pieces, end = ftp(station, 4, 15, size=BLOCK)
    assert end == (129, b"\x06")
    assert set(unpacked(b"".join(piece for _, piece in pieces))) == set(DEFAULTS)
    assert ftp(station, 200, 1) == [(128, b"")]
    assert ftp(station, 202, 5, size=10) == [(129, b"\x0a")]


def test_other_files_and_writing_are_refused():
    station = Station(vehicle())
    for number, (opcode, path) in enumerate(((4, b"/etc/passwd"), (6, b"/x"), (3, b"@SYS"), (99, b""))):
        assert ftp(station, 2 * number, opcode, path)[0][0] == 129


def test_a_request_that_comes_twice_gets_the_same_answer():
    station = Station(vehicle())
    opened = ftp(station, 0, 4, b"@PARAM/param.pck")
    assert opened[0][0] == 128
    assert ftp(station, 0, 4, b"@PARAM/param.pck") == opened


def test_an_open_file_is_of_its_session_until_that_has_been_silent():
    station = Station(vehicle())
    ftp(station, 0, 4, b"@PARAM/param.pck", session=3)
    assert ftp(station, 2, 4, b"@PARAM/param.pck", session=4) == [(129, b"\x04")]
    assert ftp(station, 4, 1, session=4) == [(128, b"")]
    assert ftp(station, 6, 5, size=10, session=3)[0][0] == 128, "the other one's end closes nothing"
    station.run(3.1)
    assert ftp(station, 2, 4, b"@PARAM/param.pck", session=4)[0][0] == 128


def test_the_parameter_file_comes_with_the_banner_and_slows_the_streams():
    station = Station(vehicle())
    station.run(3.0)
    assert len(station.run(1.0).of("ATTITUDE")) == 10
    ftp(station, 0, 4, b"@PARAM/param.pck")
    assert any("ArduSub V4.7" in text for text in Heard(station.heard).texts())
    assert len(station.run(0.9).of("ATTITUDE")) <= 3
    station.run(0.5)
    assert len(station.run(1.0).of("ATTITUDE")) == 10


def test_a_part_of_the_parameter_file():
    station = Station(vehicle())
    assert ftp(station, 0, 4, b"@PARAM/param.pck?start=10&count=5")[0][0] == 128
    content = ftp(station, 2, 5, size=239)[0][1]
    assert struct.unpack_from("<HHH", content) == (0x671B, 5, len(DEFAULTS))
    assert list(unpacked(content)) == list(DEFAULTS)[10:15]
    assert ftp(station, 4, 5, size=100) == [(129, b"\x02\x16")], "one size of reads for one file"


def test_a_parameter_file_that_is_not_opened_comes_without_banner():
    station = Station(vehicle())
    station.run(0.1)
    assert ftp(station, 0, 4, b"@PARAM/param.pck?start=65535") == [(129, b"\x02\x16")]
    assert not Heard(station.heard).texts()


def test_a_checksum():
    station = Station(vehicle())
    content = struct.pack("<HHHHH", 0x763D, 1, 0, 0, 0)
    expected = ~zlib.crc32(content, 0xFFFFFFFF) & 0xFFFFFFFF
    assert ftp(station, 0, 14, b"@MISSION/fence.dat") == [(128, struct.pack("<I", expected))]
    assert ftp(station, 2, 14, b"/none") == [(129, b"\x0a")]


def test_what_is_not_known_is_said_and_a_stray_answer_is_not_answered():
    station = Station(vehicle())
    assert ftp(station, 0, 16, b"/") == [(129, b"\x01")]
    assert "Unsupported FTP: 16" in Heard(station.heard).texts()
    assert ftp(station, 2, 128) == []
    assert ftp(station, 4, 0, size=240) == [(129, b"\x03")]
