"""Each promise of a tick, broken once: somebody notices."""

import math

import pytest
from builders import RESTING
from msgspec.structs import replace
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import load_config
from companion.records import NEUTRAL, Condition, Request, State, Verdict
from lab.studies.promises import PromiseBrokenError, Promises, hold_telemetry, steering

PACKER = mavlink.MAVLink(None, 255, 25)
CONFIG = load_config(overrides=["thrusters.max_axis=0.8", "thrusters.max_slew_per_s=5"])
REST = (1500,) * 4


def override(*axes, pitch=65535, roll=65535, camera=65535):
    return bytes(
        mavlink.MAVLink_rc_channels_override_message(1, 1, pitch, roll, *axes, camera, camera).pack(PACKER)
    )


NOTHING = Condition(0)
OLD = replace(RESTING, ages=replace(RESTING.ages, depth_s=0.6))


def verdict(state=State.ACTIVE, authority=1.0, conditions=NOTHING):
    return Verdict(state, conditions, authority, "")


def held(make_sample, *, out=(), pilot=False, steers=True, asked=(Request.ENGAGE,), was=None, **changes):
    """Two ticks: READY with `was` as its command, and one with these changes."""
    promises, sample = Promises(CONFIG, pilot=pilot), make_sample()
    ready = replace(sample, verdict=verdict(State.READY, 0.0), command=NEUTRAL)
    promises.hold(0.0, [], ready, asked, steers=False)
    given = {"verdict": verdict(), "command": NEUTRAL} | changes
    if was is not None:
        promises.hold(0.02, [], replace(sample, verdict=verdict(), command=was), (), steers=True)
    promises.hold(0.04, out, replace(sample, **given), (), steers=steers)
    return promises


def test_a_tick_that_keeps_all_of_them_passes(make_sample):
    promises = held(make_sample, out=[override(1510, *REST[1:])], command=NEUTRAL._replace(heave=0.1))
    assert promises.last_thrust_s == 0.04
    hold_telemetry(make_sample())


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"command": NEUTRAL._replace(yaw=math.nan)}, "not finite"),
        ({"command": NEUTRAL._replace(yaw=0.81), "was": NEUTRAL._replace(yaw=0.8)}, "envelope|jumps"),
        ({"command": NEUTRAL._replace(pitch=0.49)}, "envelope"),
        ({"state": OLD}, "too old"),
        ({"command": NEUTRAL._replace(heave=0.11)}, "jumps"),
        ({"command": NEUTRAL._replace(heave=0.11), "pilot": True}, "jumps"),
        ({"out": [override(*REST)] * 2}, "2 steering frames"),
        ({"out": [override(*REST)], "steers": False}, "1 steering frames"),
        ({"out": [override(*REST, camera=1500)]}, "camera"),
        ({"out": [override(1100 - 1, *REST[1:])]}, "out of range"),
        ({"out": [override(*REST, pitch=1700)]}, "tilts"),
        ({"verdict": verdict(authority=1.1)}, "absurd"),
        ({"verdict": verdict(State.FAULT)}, "without permission"),
        ({"verdict": verdict(State.FAULT, 0.0), "command": NEUTRAL._replace(heave=0.05)}, "a command"),
        ({"verdict": verdict(State.FAULT, 0.0), "out": [override(1510, *REST[1:])]}, "thrust"),
        ({"asked": ()}, "without being asked"),
        ({"asked": (Request.ENGAGE, Request.STOP)}, "without being asked"),
        ({"verdict": verdict(conditions=Condition.LEAK)}, "engaged against"),
        ({"verdict": verdict(conditions=Condition.PILOT_TAKEOVER)}, "engaged against"),
    ],
)
def test_each_that_is_broken_is_told(make_sample, changes, said):
    with pytest.raises(PromiseBrokenError, match=said):
        held(make_sample, **changes)


def test_active_comes_from_ready_alone(make_sample):
    promises, sample = Promises(CONFIG), make_sample()
    with pytest.raises(PromiseBrokenError, match="engaged from IDLE"):
        promises.hold(
            0.0, [], replace(sample, verdict=verdict(), command=NEUTRAL), [Request.ENGAGE], steers=False
        )


def test_telemetry_that_is_no_number_is_told(make_sample, monkeypatch):
    monkeypatch.setattr("lab.studies.promises.encode", lambda *_: [("key", "json", b'{"z":NaN}')])
    with pytest.raises(PromiseBrokenError, match="no number"):
        hold_telemetry(make_sample())


def test_a_pilots_axes_are_his_and_his_frame_is_read():
    sticks = mavlink.MAVLink_manual_control_message(1, 500, -250, 750, 1000, 0).pack(PACKER)
    assert steering(bytes(sticks)) == (0.5, -0.25, 0.5, 1.0, 0.0, 0.0)
    assert steering(bytes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(PACKER))) is None
