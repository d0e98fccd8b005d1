"""The relay loses no byte, adds none and changes none; what it withholds is steering, in whole frames."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import load_config
from companion.mavlink.autopilot import Autopilot
from companion.mavlink.frames import frame_at
from companion.mavlink.inbox import MAX_BYTES
from companion.mavlink.relay import MAX_DATAGRAM, MAX_LOOKS_A_TICK, Relay
from companion.records import PilotHeartbeat, PilotInput, PilotSticks

ENDPOINTS = {True: "tcp:127.0.0.1:5760", False: "udp-connect:127.0.0.1:14550"}


def relay(vehicle_is_stream=False, ground_is_stream=False):
    return Relay(
        load_config(
            overrides=[
                f"link.endpoint={ENDPOINTS[vehicle_is_stream]}",
                f"ground_station.endpoint={ENDPOINTS[ground_is_stream]}",
                "vehicle.thrust_path=manual_control",
            ]
        )
    )


def pilot_events(ground):
    """Return what the engine gets of the pilot's frames."""
    return Autopilot(load_config()).receive([], ground)


def _frame(kind, version, system, signed):
    packer = mavlink.MAVLink(None, system, 190)
    if signed:
        packer.signing.secret_key, packer.signing.sign_outgoing = bytes(32), True
    message = {
        "heartbeat": mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3),
        "sticks": mavlink.MAVLink_manual_control_message(1, 1, -2, 503, 4, 5, s=6),
        "override": mavlink.MAVLink_rc_channels_override_message(1, 1, *(1500,) * 8),
        "parameter": mavlink.MAVLink_param_request_read_message(1, 1, b"FS_PILOT_INPUT", -1),
        "mode": mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, 19, 0, 0, 0, 0, 0),
    }[kind]
    return bytes(message.pack(packer, force_mavlink1=version == 1))


frames = st.builds(
    _frame,
    st.sampled_from(["heartbeat", "sticks", "override", "parameter", "mode"]),
    st.sampled_from([1, 2]),
    st.sampled_from([255, 245]),
    st.booleans(),
)
bits = st.lists(
    st.one_of(frames, st.binary(max_size=40), st.sampled_from([b"\xfd", b"\xfe", b"\xfd\xff\x00", b""])),
    max_size=12,
)


def chunks(data, seed):
    """Cut into pieces of any size."""
    rng, out = np.random.default_rng(seed), []
    while data:
        size = int(rng.choice([1, 3, 10, 50, 300]))
        out.append(data[:size])
        data = data[size:]
    return out


@given(bits, st.integers(0, 99), st.booleans(), st.booleans())
def test_both_ways_every_byte_passes_in_order(parts, seed, vehicle_is_stream, ground_is_stream):
    for to in ("to_vehicle", "to_ground"):
        wire = relay(vehicle_is_stream, ground_is_stream)
        from_stream = ground_is_stream if to == "to_vehicle" else vehicle_is_stream
        to_stream = vehicle_is_stream if to == "to_vehicle" else ground_is_stream
        arriving = chunks(b"".join(parts), seed) if from_stream else parts
        came, went = b"", b""
        for k, data in enumerate(arriving):
            out = getattr(wire, to)(k * 1_000_000, data)
            came, went = came + data, went + b"".join(out)
            assert came.startswith(went)
            if not (from_stream and not to_stream):
                assert went == came, "at once, and all of it"
            elif to_stream is False:
                assert all(len(piece) <= MAX_DATAGRAM for piece in out)
                assert len(came) - len(went) < 280, "only the beginning of a frame waits"


@given(st.lists(frames, max_size=12), st.integers(0, 99), st.booleans())
def test_of_a_stream_whole_frames_reach_a_datagram_link(parts, seed, ground_is_stream):
    """A receiver that knows nothing of a datagram's neighbours reads every frame."""
    wire = relay(vehicle_is_stream=not ground_is_stream, ground_is_stream=ground_is_stream)
    way = wire.to_vehicle if ground_is_stream else wire.to_ground
    read = []
    for k, data in enumerate(chunks(b"".join(parts), seed)):
        for datagram in way(k * 1_000_000, data):
            read += mavlink.MAVLink(None).parse_buffer(datagram)
    assert [bytes(m.get_msgbuf()) for m in read] == parts


def steers(part):
    return part in STEERING


STEERING = {
    _frame(kind, version, 255, signed)
    for kind in ("sticks", "override")
    for version in (1, 2)
    for signed in (False, True)
}


@given(st.lists(frames, max_size=15), st.integers(0, 99), st.booleans())
def test_withheld_is_the_pilots_steering_and_nothing_else(parts, seed, ground_is_stream):
    wire = relay(ground_is_stream=ground_is_stream)
    wire.withhold = True
    arriving = chunks(b"".join(parts), seed) if ground_is_stream else parts
    went = b"".join(piece for data in arriving for piece in wire.to_vehicle(0, data))
    assert went == b"".join(part for part in parts if not steers(part))
    kinds = [type(event) for event in pilot_events(wire.take())]
    assert kinds.count(PilotSticks) + kinds.count(PilotInput) == sum(map(steers, parts))
    assert kinds.count(PilotHeartbeat) == len(parts) - sum(
        part[5 if part[0] == 0xFE else 7] != 0 for part in parts
    )


@given(st.lists(frames, max_size=15), st.integers(0, 99), st.lists(st.booleans(), min_size=1), st.booleans())
def test_switching_at_any_moment_leaves_whole_frames(parts, seed, switches, vehicle_is_stream):
    """Whatever was withheld in between: the vehicle reads frames, in order, and no torn one among them."""
    wire = relay(vehicle_is_stream, ground_is_stream=True)
    went = b""
    for k, data in enumerate(chunks(b"".join(parts), seed)):
        wire.withhold = switches[k % len(switches)]
        went += b"".join(wire.to_vehicle(k * 1_000_000, data))
    kept = iter(parts)
    while went:
        part = next(kept, None)
        assert part is not None, "bytes that nobody sent, or torn ones"
        if went.startswith(part):
            went = went[len(part) :]
        else:
            assert steers(part) or part.startswith(went)
            if not steers(part):
                break


def test_a_flood_is_dropped_until_the_next_tick():
    wire = relay()
    assert wire.to_vehicle(0, bytes(MAX_BYTES)) != ()
    assert wire.to_vehicle(0, b"more") == ()
    assert wire.left_out == len(b"more")
    assert wire.to_ground(0, bytes(MAX_BYTES + 1)) == ()
    wire.take()
    assert list(wire.to_vehicle(0, b"again")) == [b"again"]
    assert list(wire.to_ground(0, b"again")) == [b"again"]


@pytest.mark.parametrize(
    "junk", [b"\xfe", b"\xfd", b"\xfd\xff\x00", b"\xfd\xff\x00\x00\x00\x01\x01\x1e\x00\x00"]
)
@pytest.mark.parametrize("way", ["to_vehicle", "to_ground"])
def test_a_flood_costs_a_bounded_number_of_looks_a_tick(monkeypatch, junk, way):
    """Each look at what may be a frame's beginning may take a checksum."""
    looks = []

    def looked(*at):
        looks.append(at)
        return frame_at(*at)

    monkeypatch.setattr("companion.mavlink.frames.frame_at", looked)
    wire = relay(vehicle_is_stream=way == "to_ground", ground_is_stream=way == "to_vehicle")
    for _ in range(400):
        getattr(wire, way)(0, (1400 * junk)[:1400])
    assert len(looks) <= MAX_LOOKS_A_TICK + 40
    assert wire.left_out > 300 * 1400
