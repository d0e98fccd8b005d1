"""What a flood on the link may cost a tick, in looks and not in seconds."""

import pytest
from mavlink_wire import frame
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import LinkSection
from companion.mavlink import frames
from companion.mavlink.codec import Codec
from companion.mavlink.inbox import MAX_BYTES, MAX_LOOKS, Inbox

VEHICLE = (1, 1)


def attitude(boot_ms):
    return frame(mavlink.MAVLink_attitude_message(boot_ms, 0.1, 0.2, 0.3, 0.01, 0.02, 0.03), VEHICLE)


ATTITUDE = attitude(1000)
FLOODS = {
    "markers": b"\xfd",
    "headers": b"\xfd\xff\x00",
    "headers of a known message": b"\xfd\xff\x00\x00\x00\x01\x01\x1e\x00\x00",
    "headers that ask for a checksum each": ATTITUDE[:10],
    "messages": ATTITUDE,
    "zeros": b"\0",
}


@pytest.mark.parametrize("flood", FLOODS.values(), ids=FLOODS)
@pytest.mark.parametrize("stream", [False, True])
@pytest.mark.parametrize("size", [1, 12, 1400, 60_000])
def test_a_tick_takes_a_bounded_number_of_looks_whatever_comes(monkeypatch, flood, stream, size):
    looks = []
    frame_at = frames.frame_at

    def looked(*at):
        looks.append(at)
        return frame_at(*at)

    monkeypatch.setattr(frames, "frame_at", looked)
    inbox, link, sent = Inbox(stream), Codec(LinkSection(), stream=stream), 0
    for _ in range(3):
        for k in range(400):
            data = (flood * (size // len(flood) + 1))[:size]
            inbox.add(k, data)
            sent += len(data)
        looks.clear()
        taken = inbox.take()
        for _, data in taken:
            link.decode(0.0, data)
        sent -= sum(len(data) for _, data in taken)
        assert inbox.left_out == sent, "every byte is looked at or counted"
        assert sum(len(data) for _, data in taken) <= MAX_BYTES
        assert len(looks) <= 2 * MAX_LOOKS + 40  # a piece may begin with what is no header


def test_what_a_vehicle_says_passes_untouched_in_its_order():
    """A second of telemetry at once, as after a tick that was late by that much."""
    inbox = Inbox(stream=False)
    said = [(k, attitude(20 * k)) for k in range(250)]
    for t_ns, data in said:
        inbox.add(t_ns, data)
    assert inbox.take() == said
    assert inbox.take() == []
    assert inbox.left_out == 0


@pytest.mark.parametrize("stream", [False, True])
def test_the_newest_gets_through_a_flood(stream):
    """On a stream a false header holds up what is behind it, 0.2 s at most, as without a flood."""
    inbox, link, heard = Inbox(stream), Codec(LinkSection(), stream=stream), []
    for tick in range(25):
        for _ in range(400):
            inbox.add(tick, (FLOODS["headers"] * 500)[:1400])
            inbox.add(tick, attitude(tick))
        heard += [
            (tick, m.time_boot_ms)
            for _, data in inbox.take()
            for m in link.decode(0.02 * tick, data).messages
        ]
    assert heard[-1][0] == 24
    assert all(tick - said <= 11 for tick, said in heard)
