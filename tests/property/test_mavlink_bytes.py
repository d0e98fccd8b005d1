"""Whatever bytes come, the link neither raises nor loses what is good."""

from hypothesis import given
from hypothesis import strategies as st
from mavlink_wire import frame, name
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import LinkSection
from companion.mavlink.codec import Codec
from companion.mavlink.decode import Decoder
from companion.mavlink.messages import checksum, pack, unpack

FRAMES = [
    frame(message)
    for message in (
        mavlink.MAVLink_heartbeat_message(12, 3, 209, 19, 4, 3),
        mavlink.MAVLink_attitude_message(1000, 0.1, 0.2, 0.3, 0.01, 0.02, 0.03),
        mavlink.MAVLink_statustext_message(4, b"253 \xfd\xfd\xfd", 0, 0),
        mavlink.MAVLink_servo_output_raw_message(0xFDFDFDFD, 0, *(0xFDFD,) * 8),
        mavlink.MAVLink_param_value_message(b"JS_THR_GAIN", 1.0, 9, 1370, 3),
    )
]


def codec(stream):
    return Codec(LinkSection(), stream=stream)


@st.composite
def damaged(draw):
    """Valid frames, in any order, some with bits flipped, cut short or with junk between them."""
    out = b""
    for data in draw(st.lists(st.sampled_from(FRAMES), max_size=6)):
        match draw(st.sampled_from(("whole", "flip", "cut", "junk"))):
            case "flip":
                bit = draw(st.integers(0, 8 * len(data) - 1))
                data = (int.from_bytes(data, "little") ^ 1 << bit).to_bytes(len(data), "little")
            case "cut":
                data = data[: draw(st.integers(0, len(data)))]
            case "junk":
                data = draw(st.binary(max_size=40)) + data
        out += data
    return out


anything = st.one_of(st.binary(max_size=400), damaged())


@given(st.lists(anything, max_size=5), st.booleans())
def test_no_bytes_raise(chunks, stream):
    link = codec(stream)
    convert = Decoder(link.counters)
    for t_s, chunk in enumerate(chunks):
        for message in link.decode(float(t_s), chunk).messages:
            convert.to_events(message, float(t_s))
        assert len(link.splitter.rest) < 280


@given(anything)
def test_good_frames_behind_junk_in_a_datagram_are_found(junk):
    (*_, last) = codec(stream=False).decode(0.0, junk + b"".join(FRAMES)).messages
    assert name(last) == "PARAM_VALUE"


@given(anything)
def test_a_stream_recovers_from_junk(junk):
    link = codec(stream=True)
    link.decode(0.0, junk)
    tail = [message for n in range(60) for message in link.decode(0.02 * n, FRAMES[1]).messages]
    assert len(tail) >= 55
    assert not link.splitter.rest


@given(st.lists(st.sampled_from(FRAMES), max_size=10), st.data())
def test_a_stream_gives_the_same_however_it_is_cut(frames, data):
    whole = b"".join(frames)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(whole)), max_size=8)))
    link = codec(stream=True)
    parts = [whole[a:b] for a, b in zip([0, *cuts], [*cuts, len(whole)], strict=True)]
    got = [name(message) for part in parts for message in link.decode(0.0, part).messages]
    assert got == [name(message) for message in codec(stream=False).decode(0.0, whole).messages]
    assert len(got) == len(frames)


KINDS = st.sampled_from(sorted(mavlink.mavlink_map))


@given(KINDS, st.data())
def test_every_message_is_read_and_packed_as_pymavlink_does(message_id, data):
    """Numbers, texts and arrays, with zeros cut off the end or bytes beyond it."""
    kind = mavlink.mavlink_map[message_id]
    payload = data.draw(st.binary(min_size=1, max_size=min(kind.unpacker.size + 3, 255)))
    covered = bytes((len(payload), 0, 0, 0, 1, 1)) + message_id.to_bytes(3, "little") + payload
    sound = b"\xfd" + covered + checksum(covered, message_id).to_bytes(2, "little")
    theirs = mavlink.MAVLink(None).decode(bytearray(sound))
    ours = unpack(message_id, payload)
    for field in kind.fieldnames:
        expected = getattr(theirs, field)
        expected = tuple(expected) if isinstance(expected, list) else expected
        assert repr(getattr(ours, field)) == repr(expected)
    if all(str(getattr(ours, field)).isascii() for field in kind.fieldnames):
        again = unpack(message_id, pack(ours))
        assert repr(again) == repr(ours)
