"""Frames that are packed and read directly are pymavlink's, byte for byte."""

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_bridge.firmware.packing import pack, parse

KINDS = [mavlink.mavlink_map[number] for number in (0, 1, 24, 30, 33, 36, 65, 69, 70, 74, 77, 178, 12920)]
WITH_ARRAYS = [mavlink.mavlink_map[number] for number in (22, 147, 253)]


def message(kind, seed):
    """A message of random values, of which some are zero."""
    rng = np.random.default_rng(seed)
    size = kind.unpacker.size
    payload = (rng.integers(0, 100, size) * rng.integers(0, 2, size) * (seed > 0)).astype(np.uint8).tobytes()
    values = kind.unpacker.unpack(payload)
    return kind(*(values[place] for place in kind.orders))


def by_pymavlink(built, sequence=7):
    packer = mavlink.MAVLink(None, 3, 4)
    packer.seq = sequence
    return bytes(built.pack(packer))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.msgname)
def test_frames_are_pymavlinks(kind, seed):
    built = message(kind, seed)
    frame = pack(built, 7, 3, 4)
    assert frame is not None
    assert frame == by_pymavlink(built)
    read, expected = parse(frame), mavlink.MAVLink(None).parse_buffer(frame)[0]
    assert read.to_dict() == expected.to_dict()
    assert bytes(read.get_msgbuf()) == frame
    assert (read.get_srcSystem(), read.get_srcComponent(), read.get_seq()) == (3, 4, 7)


@pytest.mark.parametrize("kind", WITH_ARRAYS, ids=lambda kind: kind.msgname)
def test_arrays_and_text_are_left_to_pymavlink(kind):
    assert pack(object.__new__(kind), 0, 1, 1) is None
    assert parse(by_pymavlink(mavlink.MAVLink_statustext_message(4, b"hello", 0, 0))) is None


def test_what_is_not_one_whole_frame_is_left_to_pymavlink():
    frame = by_pymavlink(message(mavlink.mavlink_map[70], 1))
    signed = bytes([*frame[:2], 1, *frame[3:]])
    unknown = bytes([*frame[:7], 255, 255, 255, *frame[10:]])
    for data in (b"", frame[:-1], frame + frame, b"\x00" + frame, signed, unknown):
        assert parse(data) is None
    for place in range(len(frame)):
        assert parse(frame[:place] + bytes([frame[place] ^ 4]) + frame[place + 1 :]) is None
