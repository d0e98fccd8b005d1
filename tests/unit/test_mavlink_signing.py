"""Our signatures against pymavlink's, which nobody here wrote, and the clock that must not go back."""

import hashlib
from itertools import pairwise

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import ConfigError, LinkSection
from companion.mavlink.codec import Codec, Packer
from companion.mavlink.encode import Commands
from companion.mavlink.signing import EPOCH_S, UNITS_PER_S, Signing, read_key
from companion.records import Sender

KEY = bytes(range(32))
UTC_2026_S = 1_795_000_000.0
YEAR_S = 365 * 86400.0
VEHICLE, US = (1, 1), (255, 25)


class Vehicle:
    """Somebody else's implementation at the other end."""

    def __init__(self, key=KEY, utc_s=UTC_2026_S, link_id=0):
        self.mav = mavlink.MAVLink(None, *VEHICLE)
        self.mav.robust_parsing = True
        self.mav.signing.secret_key = key
        self.mav.signing.sign_outgoing = key is not None
        self.mav.signing.link_id = link_id
        self.mav.signing.timestamp = round((utc_s - EPOCH_S) * UNITS_PER_S)

    def says(self, boot_ms=1000):
        said = mavlink.MAVLink_attitude_message(boot_ms, 0.1, 0.2, 0.3, 0.01, 0.02, 0.03).pack(self.mav)
        self.mav.seq = (self.mav.seq + 1) & 0xFF
        return bytes(said)

    def takes(self, data):
        return [m.get_type() for m in self.mav.parse_buffer(data)]


def codec(signing):
    return Codec(LinkSection(), signing=signing)


def heartbeat():
    return Commands().heartbeat()


@pytest.mark.parametrize("key", [None, bytes(32)])
def test_unsigned_and_wrongly_signed_are_refused_and_counted(key):
    stranger, ours = Vehicle(key), codec(Signing(KEY, 7, UTC_2026_S))
    assert ours.decode(0.0, stranger.says()).messages == []
    assert (ours.counters.refused, ours.counters.messages, ours.counters.garbage) == (1, 0, 0)
    assert stranger.takes(ours.encode(heartbeat())) == (["HEARTBEAT"] if key is None else ["BAD_DATA"])


def test_a_replay_is_refused_and_so_is_a_changed_byte():
    vehicle, ours = Vehicle(), codec(Signing(KEY, 7, UTC_2026_S))
    first, second = vehicle.says(), vehicle.says()
    for at in (-1, -6, -7, -12, -13):
        assert (
            ours.decode(0.0, second[:at] + bytes([second[at] ^ 1]) + second[len(second) + at + 1 :]).messages
            == []
        )
    assert len(ours.decode(0.0, first).messages) == 1
    assert ours.decode(0.0, first).messages == []
    assert len(ours.decode(0.0, second).messages) == 1
    assert ours.decode(0.0, first).messages == []
    assert ours.counters.refused == 7


@pytest.mark.parametrize("utc_s", [EPOCH_S + (2**48 - 2) / UNITS_PER_S, 2.0**32 + 9.0, 1e12])
def test_the_end_of_all_timestamps_is_not_believed_whether_heard_or_our_own_clock_s(utc_s):
    """In 2104 six bytes are full: whoever went on from there could sign nothing more, and ended."""
    ours, vehicle, late = Signing(KEY, 7, utc_s), Vehicle(), Vehicle()
    late.mav.signing.timestamp = 2**48 - 2
    assert not ours.accepts(late.says())
    for _ in range(3):
        assert ours.accepts(vehicle.says())
        assert vehicle.takes(codec(ours).encode(heartbeat())) == ["HEARTBEAT"]


def test_a_forged_future_locks_nobody_out():
    vehicle, ours = Vehicle(), Signing(KEY, 7, UTC_2026_S)
    forged = bytearray(vehicle.says())
    forged[-12:-6] = b"\xff" * 6
    assert not ours.accepts(bytes(forged))
    assert ours.accepts(vehicle.says())


def test_timestamps_follow_the_monotonic_clock_and_never_repeat():
    signing = Signing(KEY, 7, UTC_2026_S)
    signing.advance(100.0)
    stamps = [signing.next_timestamp() for _ in range(3)]
    signing.advance(101.0)
    stamps.append(signing.next_timestamp())
    signing.advance(50.0)  # cannot be, and changes nothing
    stamps.append(signing.next_timestamp())
    assert all(late > early for early, late in pairwise(stamps))
    assert stamps[3] - stamps[0] == UNITS_PER_S


@pytest.mark.parametrize("utc_s", [0.0, UTC_2026_S - YEAR_S], ids=["no clock battery", "clock set back"])
def test_a_computer_whose_clock_is_behind_finds_to_the_present(utc_s):
    """The vehicle heard us, rightly signed, before we were restarted with a worse clock."""
    vehicle = Vehicle()
    assert vehicle.takes(Packer(*US, Signing(KEY, 7, UTC_2026_S)).encode(heartbeat())) == ["HEARTBEAT"]
    ours = codec(Signing(KEY, 7, utc_s))
    assert vehicle.takes(ours.encode(heartbeat())) == ["BAD_DATA"]
    assert len(ours.decode(0.0, vehicle.says()).messages) == 1
    assert vehicle.takes(ours.encode(heartbeat())) == ["HEARTBEAT"]


def test_a_vehicle_whose_clock_is_behind_is_brought_to_the_present():
    """An autopilot without GPS goes on from the day it was switched off."""
    vehicle, ours = Vehicle(utc_s=UTC_2026_S - YEAR_S), codec(Signing(KEY, 7, UTC_2026_S))
    assert ours.decode(0.0, vehicle.says()).messages == []
    assert vehicle.takes(ours.encode(heartbeat())) == ["HEARTBEAT"]
    assert len(ours.decode(0.0, vehicle.says()).messages) == 1


def test_who_may_take_the_link_is_judged_without_using_the_frame_up():
    """The link looks first, the engine decodes the same frame after it."""
    vehicle, ours = Vehicle(), codec(Signing(KEY, 7, UTC_2026_S))
    said = vehicle.says()
    assert ours.sender(0.0, said) is Sender.EXPECTED
    assert ours.sender(0.0, said) is Sender.EXPECTED
    assert len(ours.decode(0.0, said).messages) == 1
    assert ours.sender(0.0, said) is Sender.BEHIND, "a replay"
    assert ours.sender(0.0, Vehicle(utc_s=UTC_2026_S - YEAR_S).says()) is Sender.BEHIND
    assert ours.sender(0.0, Vehicle(bytes(32)).says()) is Sender.STRANGER
    assert ours.sender(0.0, Vehicle(None).says()) is Sender.STRANGER
    assert ours.counters.refused == 4


@pytest.fixture
def key_file(tmp_path):
    def write(content, mode=0o600):
        path = tmp_path / "mavlink.key"
        path.write_bytes(content)
        path.chmod(mode)
        return path

    return write


RAW = bytes(range(200, 232))


@pytest.mark.parametrize(
    ("content", "key"),
    [
        (RAW, RAW),
        (RAW.hex().encode() + b"\n", RAW),
        (RAW.hex().upper().encode(), RAW),
        (b"kelp grips the rock\n", hashlib.sha256(b"kelp grips the rock").digest()),
        (b"thirty-two printable characters!", hashlib.sha256(b"thirty-two printable characters!").digest()),
    ],
    ids=["raw", "hex", "HEX", "passphrase", "32 letters"],
)
def test_the_forms_of_a_key_file(key_file, content, key):
    assert read_key(key_file(content)) == key


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o666])
def test_a_key_that_others_can_read_is_refused_but_as_a_credential(key_file, mode, monkeypatch):
    path = key_file(b"kelp", mode)
    with pytest.raises(ConfigError, match=rf"mode is {mode:o}.*chmod 600 {path}"):
        read_key(path)
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(path.parent))
    assert read_key(path) == hashlib.sha256(b"kelp").digest()


@pytest.mark.parametrize("content", [b"", b" \n"])
def test_an_empty_key_is_refused_by_name(key_file, content):
    with pytest.raises(ConfigError, match=r"signing_key_file.*empty"):
        read_key(key_file(content))
