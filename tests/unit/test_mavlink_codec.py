import math

import mavlink_wire as wire
import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import LinkSection
from companion.mavlink import messages
from companion.mavlink.codec import Codec
from companion.mavlink.frames import PARTIAL_TIMEOUT_S
from companion.mavlink.pilot_frames import attitude_target, global_target, position_target
from companion.records import AttitudeTarget, GlobalOrigin, PositionTarget, Refused, Sender

VEHICLE = (1, 1)
US = (255, 25)
PILOT = (255, 190)
EXPECTED, STRANGER = Sender.EXPECTED, Sender.STRANGER
FALSE_HEADER = bytes([0xFD, 0xFF, 0, 0, 0, 1, 1, 30, 0, 0])


def frames(*messages, sender=VEHICLE):
    return [wire.frame(message, sender) for message in messages]


def attitude(boot_ms=1000):
    return mavlink.MAVLink_attitude_message(boot_ms, 0.1, 0.2, 0.3, 0.01, 0.02, 0.03)


def manual_control(target=1):
    return mavlink.MAVLink_manual_control_message(target, 1, 0, 500, 0, 0)


def override(target=1):
    return mavlink.MAVLink_rc_channels_override_message(target, 1, *(1500,) * 8)


def codec(**options):
    return Codec(LinkSection(), **options)


def names(messages):
    return [wire.name(message) for message in messages]


def test_steering_of_others_passes():
    link = codec()
    (mine,) = frames(manual_control(), sender=PILOT)
    (any_target,) = frames(override(target=9), sender=PILOT)
    assert names(link.decode(0.0, mine + any_target).messages) == ["MANUAL_CONTROL", "RC_CHANNELS_OVERRIDE"]


def test_steering_of_another_vehicle_and_our_own_echo_are_foreign():
    link = codec()
    (other,) = frames(manual_control(target=2), sender=PILOT)
    (echo,) = frames(override(), sender=US)
    assert link.decode(0.0, other + echo).messages == []
    assert link.counters.foreign == 2


def test_unwanted_ids_are_dropped_but_checked():
    link = codec(wanted={mavlink.MAVLINK_MSG_ID_HEARTBEAT})
    (frame,) = frames(attitude())
    broken = frame[:-1] + bytes([frame[-1] ^ 1])
    assert link.decode(0.0, frame).messages == []
    assert link.decode(0.0, broken).messages == []
    assert (link.counters.messages, link.counters.garbage) == (1, 1)


def test_a_datagram_leaves_nothing_behind():
    link = codec()
    (frame,) = frames(attitude())
    assert link.decode(0.0, frame[:20]).messages == []
    assert link.decode(0.0, frame[20:]).messages == []
    assert len(link.decode(0.0, frame).messages) == 1
    assert link.counters.garbage == 2


def test_a_stream_gives_up_a_false_header_that_waits():
    link = codec(stream=True)
    data = FALSE_HEADER + frames(attitude())[0]
    assert link.decode(0.0, data).messages == []
    assert link.decode(PARTIAL_TIMEOUT_S, b"").messages == []
    assert len(link.decode(PARTIAL_TIMEOUT_S + 0.01, b"").messages) == 1


def test_mavlink_1_and_unknown_flags_are_garbage():
    link = codec()
    old = attitude().pack(mavlink.MAVLink(None, *VEHICLE), force_mavlink1=True)
    assert link.decode(0.0, old).messages == []
    (frame,) = frames(attitude())
    assert link.decode(0.0, frame[:2] + b"\x02" + frame[3:]).messages == []
    assert link.counters.garbage == 2


def test_the_vehicle_is_recognised_by_a_sound_frame_of_its_own():
    link = codec()
    (ours,) = frames(attitude())
    (others,) = frames(attitude(), sender=(1, 2))
    broken = ours[:-1] + bytes([ours[-1] ^ 1])
    assert EXPECTED is link.sender(0.0, ours)
    assert EXPECTED is link.sender(0.0, others + ours)
    for data in (b"", b"\0", b"\0" + ours, others, broken, ours[:-1], b"\xfd", broken + ours):
        assert STRANGER is link.sender(0.0, data)
    assert (link.counters.datagrams, link.counters.refused) == (0, 0)


def test_to_recognise_the_vehicle_takes_few_checksums(monkeypatch):
    """Anybody may send anything before the link is taken."""
    looked_at = []

    def checksum(*frame):
        looked_at.append(frame)
        return messages.checksum(*frame)

    monkeypatch.setattr("companion.mavlink.frames.checksum", checksum)
    (others,) = frames(attitude(), sender=(1, 2))
    assert codec().sender(0.0, 1000 * others) is STRANGER
    assert 0 < len(looked_at) <= 32


def position_target_of(frame=1, mask=0x1F8, **numbers):
    keys = ("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate")
    values = {**dict.fromkeys(keys, 0.0), **numbers}
    message = mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, frame, mask, **{key: values[key] for key in keys}
    )
    return next(position_target(message, 5.0))


def test_a_position_target_says_what_its_mask_leaves_in():
    place = position_target_of(x=1.0, y=2.0, z=3.0, mask=0x9F8, yaw=0.5)
    assert (place.place, place.offset, place.body) == ((1.0, 2.0, 3.0, 0.5), False, False)
    assert all(map(math.isnan, place.velocity))
    speed = position_target_of(frame=9, mask=0x5C7, vx=0.3, yaw_rate=0.1)
    assert (speed.velocity, speed.offset, speed.body) == ((0.3, 0.0, 0.0, 0.1), True, True)
    assert all(map(math.isnan, speed.place))


@pytest.mark.parametrize(
    "asked",
    [
        {"frame": 6},
        {"mask": 0x3F8},
        {"mask": 0xFFF},
        {"x": math.inf},
        {"x": 1e6},
        {"mask": 0x9F8, "x": math.nan, "y": math.nan, "z": math.nan, "yaw": math.nan},
        {"x": 1.0, "y": 2.0, "z": 3.0, "mask": 0xDF9},
        {"vx": 1.0, "mask": 0xDCF},
    ],
    ids=["frame", "force", "nothing", "infinite", "far", "no number", "a part of a place", "of a velocity"],
)
def test_a_position_target_that_cannot_be_followed_is_refused_in_words(asked):
    assert isinstance(position_target_of(**asked), Refused)


def test_one_of_three_leaves_out_all_three_as_in_ardusub():
    depth = position_target_of(x=1.0, y=2.0, z=3.0, mask=0xDFB)
    np.testing.assert_equal(depth.place, (math.nan, math.nan, 3.0, math.nan))
    moving = position_target_of(x=1.0, vx=0.3, afx=0.1, mask=0xC00)
    assert moving.velocity[:3] == (0.3, 0.0, 0.0)
    assert moving.acceleration[:3] == (0.1, 0.0, 0.0)
    assert math.isnan(position_target_of(x=1.0, vx=0.3, afx=0.1, mask=0xC40).acceleration[0])


@pytest.mark.parametrize(
    ("mask", "q", "thrust", "said"),
    [
        (0x07, (1.0, 0.0, 0.0, 0.0), 0.5, (0.0, 0.0, 0.0, 0.0)),
        (0x07, (math.cos(0.2), 0.0, math.sin(0.2), 0.0), 1.0, (0.0, 0.4, 0.0, 1.0)),
        (0x47, (math.cos(0.2), math.sin(0.2), 0.0, 0.0), 1.0, (0.4, 0.0, 0.0, 0.0)),
        (0x87, (1.0, 0.0, 0.0, 0.0), 0.0, (math.nan, math.nan, math.nan, -1.0)),
    ],
)
def test_an_attitude_target_says_what_its_mask_leaves_in(mask, q, thrust, said):
    found = next(attitude_target(attitude_message(mask, q, thrust), 5.0), None)
    assert isinstance(found, AttitudeTarget)
    np.testing.assert_allclose((*found.angles, found.heading, found.climb), said, atol=1e-6)


@pytest.mark.parametrize(
    ("mask", "q", "thrust"),
    [
        (0xC7, (1.0, 0.0, 0.0, 0.0), 1.0),
        (0x47, (0.0, 0.0, 0.0, 0.0), 1.0),
        (0x47, (math.nan, 0.0, 0.0, 0.0), 1.0),
        (0x87, (1.0, 0.0, 0.0, 0.0), math.nan),
        (0x47, (30.0, 0.0, 0.0, 0.0), 1.0),
    ],
)
def test_an_attitude_target_that_cannot_be_followed_is_refused(mask, q, thrust):
    (refused,) = attitude_target(attitude_message(mask, q, thrust), 5.0)
    assert isinstance(refused, Refused)


def attitude_message(mask, q, thrust):
    return mavlink.MAVLink_set_attitude_target_message(0, 1, 1, mask, q, 0.0, 0.0, 0.0, thrust)


ORIGIN = GlobalOrigin(0.0, 47.4, 8.55, 400.0)


@pytest.mark.parametrize(
    ("frame", "mask", "alt", "origin", "place"),
    [
        (mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, 0xDF8, -3.0, ORIGIN, (11.13, 7.53, 3.0)),
        (mavlink.MAV_FRAME_GLOBAL_INT, 0xDF8, 397.0, ORIGIN, (11.13, 7.53, 3.0)),
        (mavlink.MAV_FRAME_GLOBAL_INT, 0xDFB, -3.0, None, (math.nan, math.nan, 3.0)),
    ],
)
def test_a_global_target_is_a_place_from_the_ekfs_origin(frame, mask, alt, origin, place):
    found = next(global_target(global_message(frame, mask, alt), 5.0, origin), None)
    assert isinstance(found, PositionTarget)
    np.testing.assert_allclose(found.place, (*place, math.nan), atol=0.02)
    assert (found.offset, found.body, found.turns) == (False, False, False)


def test_a_global_place_without_an_origin_in_another_frame_or_too_far_is_refused():
    relative, local = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, mavlink.MAV_FRAME_LOCAL_NED
    elsewhere = GlobalOrigin(0.0, -20.0, 8.55, 0.0)
    for frame, origin in ((relative, None), (local, ORIGIN), (relative, elsewhere)):
        (refused,) = global_target(global_message(frame, 0xDF8, -3.0), 5.0, origin)
        assert isinstance(refused, Refused)


LOCAL = mavlink.MAVLink_set_position_target_local_ned_message
WITH_HEADING = mavlink.MAVLink_set_position_target_global_int_message(0, 1, 1, 5, 0x9FB, 0, 0, -3, *(0,) * 8)


@pytest.mark.parametrize(
    ("target", "asked"),
    [
        (position_target, LOCAL(0, 1, 1, 1, 0xDD8, *(1.0,) * 11)),
        (position_target, LOCAL(0, 1, 1, 1, 0xD38, *(1.0,) * 11)),
        (global_target, WITH_HEADING),
    ],
    ids=["a part of a velocity", "an acceleration alone", "a heading beside a global place"],
)
def test_what_is_left_out_of_a_target_is_said(target, asked):
    assert {type(event) for event in target(asked, 5.0, ORIGIN)} == {PositionTarget, Refused}


def global_message(frame, mask, alt):
    return mavlink.MAVLink_set_position_target_global_int_message(
        0, 1, 1, frame, mask, 474001000, 85501000, alt, *(0.0,) * 8
    )
