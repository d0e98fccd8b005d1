"""Signing end to end, in virtual time: two implementations, ours and pymavlink's in the stand-in vehicle."""

import hashlib

import pytest
from virtual import Dive, Somebody, active

from companion.mavlink.signing import Signing
from companion.records import State

PASSPHRASE = "kelp"
KEY = hashlib.sha256(PASSPHRASE.encode()).digest()
SIGNED = 'signing_passphrase="kelp"'
UTC_2026_S = 1_795_000_000.0


@pytest.mark.parametrize("utc_s", [UTC_2026_S, 0.0], ids=["right clock", "no clock battery"])
def test_with_one_key_it_dives(utc_s):
    dive = active(SIGNED, signing=Signing(KEY, 25, utc_s))
    refused = dive.step.sample.counters.refused
    assert refused < 60, "a vehicle whose clock is behind is refused only until it has heard ours"
    dive.run(1.0)
    assert dive.step.sample.counters.refused == refused
    dive.fault("reboot")
    dive.run(6.0)
    assert dive.state is State.FAULT
    assert dive.step.sample.state.ages.link_s < 0.1


@pytest.mark.parametrize(
    ("plant", "signing"),
    [
        ([SIGNED], Signing(bytes(32), 25, UTC_2026_S)),
        ([SIGNED], None),
        ([], Signing(KEY, 25, UTC_2026_S)),
    ],
    ids=["another key", "we do not sign", "the vehicle does not sign"],
)
def test_without_one_key_nobody_obeys(plant, signing):
    key = [] if signing is None else ["link.signing_key_file=/etc/holdfast/mavlink.key"]
    dive = Dive(*plant, companion=key, signing=signing)
    dive.run(4.0)
    assert dive.state is State.IDLE
    assert not dive.step.truth.armed
    assert dive.motors_rest()
    if signing is not None:
        assert dive.step.sample.counters.refused > 100
        assert dive.step.sample.counters.messages == 0
        assert "frames of system 1, component 1 that are " in dive.step.sample.verdict.reason


def test_a_strangers_unsigned_disarm_and_stick_change_nothing():
    dive = active(SIGNED, signing=Signing(KEY, 25, UTC_2026_S))
    dive.tap.to_vehicle.append(Somebody().stick())
    dive.tap.spoil = lambda t_s, inbox: [*inbox, (round((1000.0 + t_s) * 1e9), Somebody().stick())]
    dive.run(1.0)
    assert dive.state is State.ACTIVE
    assert dive.step.sample.counters.refused >= 50
