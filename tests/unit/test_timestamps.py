"""Signing timestamps over restarts: nothing that was believed is believed again."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import LinkSection
from companion.mavlink.codec import Codec
from companion.mavlink.signing import EPOCH_S, UNITS_PER_S, Signing
from companion.mavlink.timestamps import AHEAD, TimestampFile

KEY = bytes(range(32))
UTC_S = 1_795_000_000.0
NOW = round((UTC_S - EPOCH_S) * UNITS_PER_S)
VEHICLE = (1, 1)


def signed(timestamp, key=KEY):
    """A frame of the vehicle's, signed by an implementation that nobody here wrote."""
    mav = mavlink.MAVLink(None, *VEHICLE)
    mav.signing.secret_key, mav.signing.sign_outgoing, mav.signing.timestamp = key, True, timestamp
    return bytes(mavlink.MAVLink_attitude_message(1000, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0).pack(mav))


class Process:
    """What of a companion believes frames, from its start to its end."""

    def __init__(self, path, utc_s=UTC_S, key=KEY, links=("vehicle", "ground")):
        self.signings = {link: Signing(key, 7, utc_s) for link in links}
        self.file = TimestampFile(path, self.signings)

    def believes(self, frame, link="vehicle"):
        return len(Codec(LinkSection(), signing=self.signings[link]).decode(0.0, frame).messages) == 1

    def writes(self):
        """As once a second."""
        self.file.write(AHEAD)

    def ends(self):
        """In order."""
        self.file.start()
        self.file.close()


@pytest.fixture
def path(tmp_path):
    return tmp_path / "state" / "signing-kelp.json"


def test_what_was_believed_is_a_replay_after_a_restart_and_what_is_newer_is_not(path):
    process = Process(path)
    for timestamp in (NOW + 1, NOW + 2):
        assert process.believes(signed(timestamp))
    process.ends()
    process = Process(path)
    assert not process.believes(signed(NOW + 1))
    assert not process.believes(signed(NOW + 2))
    assert process.believes(signed(NOW + 3))


def test_after_a_crash_nothing_is_believed_again_that_came_since_the_last_write(path):
    process = Process(path)
    assert process.believes(signed(NOW))
    process.writes()
    since = NOW + round(1.2 * UNITS_PER_S)
    assert process.believes(signed(since))
    process = Process(path)
    assert not process.believes(signed(since))
    assert process.believes(signed(NOW + AHEAD + 1))


def test_each_link_has_its_own(path):
    """The vehicle forwards the pilot's frames: what one link has heard is still new on the other."""
    process = Process(path)
    assert process.believes(signed(NOW), "vehicle")
    process.ends()
    process = Process(path)
    assert not process.believes(signed(NOW), "vehicle")
    assert process.believes(signed(NOW), "ground")


def test_what_looks_at_one_link_keeps_the_others(path):
    """`holdfast check` between two dives has no ground station."""
    process = Process(path)
    assert process.believes(signed(NOW), "ground")
    process.ends()
    Process(path, links=("vehicle",)).ends()
    assert not Process(path).believes(signed(NOW), "ground")


def test_our_own_timestamps_go_on_though_the_clock_was_set_back(path):
    process = Process(path)
    last = process.signings["vehicle"].next_timestamp()
    process.ends()
    assert Process(path, utc_s=EPOCH_S).signings["vehicle"].next_timestamp() > last


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\xff\x00",
        b"{}",
        b'{"key":"a","timestamp":-1,"seen":[]}',
        b'{"key":"a","timestamp":281474976710655,"seen":[]}',
        b'{"key":"a","timestamp":1,"seen":[{"link":"vehicle","stream":[1],"timestamp":1}]}',
    ],
)
def test_a_corrupt_file_is_said_and_made_anew(path, caplog, content):
    path.parent.mkdir()
    path.write_bytes(content)
    process = Process(path)
    assert f"{path} cannot be used" in caplog.text
    assert process.believes(signed(NOW))
    process.ends()
    assert not Process(path).believes(signed(NOW))


def test_timestamps_of_another_key_say_nothing(path):
    process = Process(path, key=bytes(32))
    assert process.believes(signed(NOW + 9, bytes(32)))
    process.ends()
    assert Process(path).believes(signed(NOW))


def test_a_folder_that_takes_nothing_is_said_once(tmp_path, caplog):
    (tmp_path / "state").write_text("a file where the folder should be")
    process = Process(tmp_path / "state" / "signing-kelp.json")
    process.writes()
    process.writes()
    process.ends()
    assert caplog.text.count("timestamps cannot be kept") == 1
