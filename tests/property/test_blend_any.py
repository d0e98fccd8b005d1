"""One MANUAL_CONTROL for two: what the stand-in vehicle makes of it, axis by axis, at any gain."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import load_config
from companion.mavlink.ardusub import quantise
from companion.mavlink.autopilot import Autopilot
from companion.mavlink.pilot_frames import pilot_sticks
from companion.records import AxisCommand, Condition, State, Verdict
from companion.supervision.guard import Envelope, guard
from sim_bridge.firmware.params import Parameters
from sim_bridge.firmware.pilot_input import Pilot

FORWARD, LATERAL, THROTTLE, YAW = 4, 5, 2, 3
CHANNELS = (FORWARD, LATERAL, THROTTLE, YAW)
CONFIG = load_config(overrides=["vehicle.thrust_path=manual_control"])

NO_BUTTONS = Parameters({f"BTN{button}_FUNCTION": 0 for button in range(16)})

OPEN = Envelope(1.0, 1e9, 1.0)

demand = st.floats(-1.0, 1.0)
stick = st.integers(-1000, 1000)


def manual_control(x, y, z, r, buttons=0, **rest):
    return mavlink.MAVLink_manual_control_message(1, x, y, z, r, buttons, **rest)


def vehicle_makes(message, gain):
    """Channels in µs, and the buttons held."""
    vehicle = Pilot(NO_BUTTONS, lambda function: None, lambda text: None)
    vehicle.gain = gain
    vehicle.manual_control(*(getattr(message, name) for name in ("x", "y", "z", "r", "buttons", "s", "t")))
    vehicle.input_loop()
    return vehicle.channels, vehicle.held_buttons


def blended(autopilot, command, held, pilot, gain):
    """What leaves where the guard has nothing to say."""
    permitted = Verdict(State.ACTIVE, Condition(0), 1.0, "")
    return guard(command, permitted, command, OPEN, 1.0, *autopilot.sticks_beside(held, pilot, gain))


def decoded(frame):
    (message,) = mavlink.MAVLink(None).parse_buffer(frame)
    return message


@given(
    st.builds(AxisCommand, *[demand] * 4, st.just(0.0), st.just(0.0)),
    st.tuples(stick, stick, st.integers(0, 1000), stick, st.integers(0, 0xFFFF)),
    st.lists(st.booleans(), min_size=4, max_size=4),
    st.floats(0.1, 1.0),
)
def test_held_axes_do_what_the_law_wants_and_the_rest_what_the_pilot_wants(command, sticks, held, gain):
    autopilot = Autopilot(CONFIG)
    reach = autopilot.reach(gain, 1.0)
    command = AxisCommand(*(axis * most for axis, most in zip(command, reach, strict=True)))
    theirs = manual_control(*sticks, s=33, t=-44)
    pilot = pilot_sticks(theirs, 0.0)
    sent = blended(autopilot, command, tuple(held), pilot, gain)
    got, buttons = vehicle_makes(decoded(autopilot.steer(sent, gain, pilot)), gain)
    alone, _ = vehicle_makes(theirs, gain)
    wanted = (command.surge, command.sway, -command.heave, command.yaw)
    for i, channel in enumerate(CHANNELS):
        if held[i]:
            assert got[channel] == pytest.approx(1500 + 400 * wanted[i], abs=2.0)
        else:
            assert got[channel] == alone[channel]
    levelled = (1500, 1500)  # in MANUAL, as long as anything is held
    assert (got[0], got[1]) == (levelled if any(held) else (1533, 1456))
    assert buttons == sticks[4]
    applied = quantise(sent, "manual_control", gain)
    reported = (applied.surge, applied.sway, -applied.heave, applied.yaw)
    np.testing.assert_allclose(
        [got[c] for c in CHANNELS], [1500 + 400 * axis for axis in reported], atol=1.001
    )


@pytest.mark.parametrize(
    ("axis", "channel", "more"),
    [("surge", FORWARD, True), ("sway", LATERAL, True), ("heave", THROTTLE, False), ("yaw", YAW, True)],
)
def test_signs_of_every_axis(axis, channel, more):
    """Forward, right, down and clockwise; ArduSub's throttle is up."""
    autopilot = Autopilot(CONFIG)
    rest = pilot_sticks(manual_control(0, 0, 500, 0), 0.0)
    sent = blended(autopilot, AxisCommand(**{axis: 0.2}), (True,) * 4, rest, 0.5)
    got, _ = vehicle_makes(decoded(autopilot.steer(sent, 0.5, rest)), 0.5)
    assert (got[channel] > 1500) is more
    assert abs(got[channel] - 1500) == pytest.approx(80, abs=1)
    theirs = pilot_sticks(decoded(autopilot.steer(sent, 0.5)), 0.0)
    assert getattr(theirs.sticks, axis) == pytest.approx(0.4, abs=0.002)
