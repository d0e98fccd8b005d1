"""A pilot at the sticks while the companion holds, through the relay and real bytes, in virtual time.

`Cockpit` stands at the ground station's link; the truth is what the stand-in vehicle makes of all the frames.
"""

import hashlib
import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from virtual import WITH_PILOT, Dive, Somebody, active, hold, shared

from companion.config import load_config
from companion.mavlink.codec import Packer
from companion.mavlink.messages import message_type
from companion.mavlink.relay import Relay
from companion.mavlink.signing import Signing
from companion.records import Condition, Request, Sender, State
from companion.telemetry.glossary import STATES

HEAVE, YAW = 2, 3
PITCH, ROLL, THROTTLE, TURN, FORWARD, LATERAL = range(6)
"""Channels of the stand-in vehicle."""

GAIN = 0.5
"""ArduSub's own at boot."""

GAIN_UP = 11
SURFACE, ALT_HOLD, STABILIZE, MANUAL = 9, 2, 0, 19


def channels(dive):
    return dive.vehicle.autopilot.pilot.channels


KEY = hashlib.sha256(b"kelp").digest()


def holding(*plant, seconds=3.0, depth_m=1.0, **arguments):
    start = f"initial.eta=[0,0,{depth_m},0,0,0.3]"
    return active(start, *plant, pilot=True, seconds=seconds, setpoint=hold(z=depth_m), **arguments)


def engaged(dive):
    return list(dive.step.sample.dofs.engaged)


def steering_bytes(data):
    """How many steering frames are in a stretch of whole frames."""
    parser = mavlink.MAVLink(None)
    kinds = [m.get_type() for m in parser.parse_buffer(data) or ()]
    return kinds.count("MANUAL_CONTROL") + kinds.count("RC_CHANNELS_OVERRIDE")


def test_nobody_says_that_nobody_steers_once_a_pilot_has_taken_over():
    dive = active(seconds=3.0)
    dive.fault("stick", 5.0, axis="z", value=1.0)
    after = [step.sample for step in dive.loop.run(4.0) if step.sample.verdict.state is State.PILOT]
    assert len(after) > 100
    assert [sample.disarms_in_s for sample in after] == [0.0] * len(after)


def test_a_pilot_who_steered_and_went_silent_is_missed_before_the_autopilot_disarms():
    """That he was heard once after a release counted for ever: nobody was told."""
    dive = holding()
    dive.cockpit.push(heave=0.1)
    dive.ask(Request.STOP)
    dive.run(2.0)
    assert dive.state is not State.ACTIVE
    assert dive.step.sample.disarms_in_s == 0.0
    dive.cockpit.sticks = None
    samples = [step.sample for step in dive.loop.run(6.0)]
    left_s = [sample.disarms_in_s for sample in samples if sample.state.armed]
    assert len(left_s) < len(samples), "the autopilot disarms"
    assert max(left_s) == pytest.approx(1.5, abs=0.3)
    assert min(left_s[100:]) > 0.0


@pytest.mark.parametrize(("axis", "push"), [("surge", 0.3), ("sway", -0.3)])
def test_axes_that_are_not_held_are_the_pilots_own(axis, push):
    dive = holding()
    dive.cockpit.push(**{axis: push})
    dive.run(3.0)
    assert dive.state is State.ACTIVE
    assert channels(dive)[FORWARD if axis == "surge" else LATERAL] == round(1500 + 400 * GAIN * push)
    nu = dive.step.truth.nu
    assert math.copysign(1.0, nu[0 if axis == "surge" else 1]) == math.copysign(1.0, push)
    assert dive.step.truth.eta[2] == pytest.approx(1.0, abs=0.15)
    assert dive.step.truth.eta[5] == pytest.approx(0.3, abs=0.15)


def test_while_it_holds_the_vehicle_hears_one_sender_only():
    dive = holding()
    dive.cockpit.push(surge=0.3)
    before = len(dive.cockpit.passed)
    dive.run(2.0)
    assert steering_bytes(dive.cockpit.passed[before:]) == 0
    assert len(dive.cockpit.passed) > before, "heartbeats pass"
    dive.ask(Request.STOP)
    dive.until(State.IDLE)
    dive.run(2.0)
    assert steering_bytes(dive.cockpit.passed[before:]) > 20


@pytest.mark.parametrize("push", [0.5, -0.5])
def test_a_stick_on_heave_moves_the_depth_and_leaves_it_where_it_is_let_go(push):
    dive = holding(depth_m=5.0)
    before = dive.step.truth.eta[2]
    dive.cockpit.push(heave=push)
    steps = dive.run(4.0)
    rate = np.mean([step.truth.nu[2] for step in steps[100:]])
    assert rate == pytest.approx(0.45 * math.copysign((abs(push) - 0.1) / 0.9, push), abs=0.04)
    dive.cockpit.push()
    dive.run(1.0)
    wanted = dive.step.sample.eta_d[2]
    steps = dive.run(3.0)
    assert math.copysign(1.0, wanted - before) == math.copysign(1.0, push)
    assert abs(wanted - before) > 0.5
    np.testing.assert_allclose([step.truth.eta[2] for step in steps], wanted, atol=0.06)
    assert engaged(dive)[HEAVE]


def test_the_setpoint_stops_at_the_surface_and_at_the_deepest_allowed():
    dive = holding(companion=["supervisor.max_depth_m=1.5"])
    for push, depth_m in ((0.6, 1.5), (-0.6, 0.0)):
        dive.cockpit.push(heave=push)
        dive.run(8.0)
        assert dive.step.sample.eta_d[2] == pytest.approx(depth_m, abs=0.05)
    assert dive.state is State.ACTIVE


def test_a_stick_stops_a_way_that_has_only_begun():
    """Holding at 1 m, told to go to 9 m: a pilot who pulls up goes up from here, not from there."""
    dive = holding()
    dive.loop.engine.aim(hold(z=9.0))
    dive.run(3.0)
    z = dive.step.truth.eta[2]
    dive.cockpit.push(heave=-0.5)
    dive.run(2.0)
    assert dive.step.truth.eta[2] < z + 0.2
    assert dive.step.sample.eta_d[2] < z + 0.2


def test_full_deflection_takes_one_axis_back_and_the_operator_has_it_held_again_where_it_is():
    dive = holding(depth_m=5.0)
    dive.cockpit.push(heave=-1.0)
    dive.run(0.5)
    assert dive.state is State.ACTIVE
    assert engaged(dive) == [False, False, False, True]
    assert channels(dive)[THROTTLE] == 1500 + 400 * GAIN
    dive.cockpit.push(heave=0.2)
    dive.run(1.0)
    assert engaged(dive) == [False, False, False, True]
    assert channels(dive)[THROTTLE] == 1500 - 400 * GAIN * 0.2
    assert dive.step.truth.eta[5] == pytest.approx(0.3, abs=0.05)
    dive.cockpit.push(heave=-1.0)
    dive.run(3.0)
    dive.cockpit.push()
    dive.run(2.0)
    z = dive.step.truth.eta[2]
    assert z < 4.6
    dive.ask(Request.ENGAGE)
    dive.run(3.0)
    assert engaged(dive) == [False, False, True, True]
    assert dive.step.truth.eta[2] == pytest.approx(z, abs=0.1)


def test_a_stick_within_the_dead_zone_moves_nothing_and_a_short_knock_takes_nothing():
    dive = holding()
    wanted = dive.step.sample.eta_d
    dive.cockpit.push(heave=0.09, yaw=-0.09)
    dive.run(2.0)
    np.testing.assert_allclose(dive.step.sample.eta_d[2:], wanted[2:], atol=0.03)
    dive.cockpit.push(heave=1.0)
    dive.run(0.2)
    dive.cockpit.push()
    dive.run(1.0)
    assert engaged(dive)[HEAVE]


def test_the_last_axis_taken_makes_it_the_pilots():
    dive = holding()
    dive.cockpit.push(heave=-1.0, yaw=1.0, surge=0.5)
    dive.until(State.PILOT)
    dive.run(1.0)
    assert (channels(dive)[THROTTLE], channels(dive)[TURN]) == (1700, 1700)
    assert channels(dive)[FORWARD] == 1600
    before = len(dive.cockpit.passed), len(dive.cockpit.sent)
    dive.run(1.0)
    assert dive.cockpit.passed[before[0] :] == dive.cockpit.sent[before[1] :]


@pytest.mark.parametrize("by", ["button", "input hold", "override"])
def test_what_takes_everything_back_at_once(by):
    dive = holding(companion=["ground_station.release_button=3"])
    since_s = dive.t_s
    if by == "button":
        dive.cockpit.push(buttons=1 << 3)
    elif by == "input hold":
        dive.tap.spoil = toggled_on
    else:
        dive.cockpit.extra.append(dive.cockpit.stick(us=1700))
    dive.until(State.PILOT)
    assert dive.t_s - since_s <= 0.061


BUTTONS = ["ground_station.engage_button=0", "ground_station.release_button=15"]
ENGAGE, RELEASE = 1 << 0, 1 << 15


@shared
def at_the_stick(*plant, arm=True, depth_m=1.0, **arguments):
    """A companion as the service starts it, that only watches, and a pilot who has armed."""
    start = f"initial.eta=[0,0,{depth_m},0,0,0.3]"
    dive = Dive(start, *plant, pilot=True, companion=BUTTONS, arm=False, engage=False, **arguments)
    dive.tap.promises.asked_otherwise = True
    dive.cockpit.push()
    dive.run(2.5)
    if arm:
        dive.cockpit.extra.append(dive.cockpit.arm())
    dive.run(1.5)
    assert dive.step.truth.armed is arm
    return dive


def press(dive, button, seconds=0.2):
    dive.cockpit.push(buttons=button)
    dive.run(seconds)
    dive.cockpit.push()
    dive.run(0.1)


def test_a_button_engages_and_another_releases():
    dive = at_the_stick()
    assert dive.state is not State.ACTIVE
    press(dive, ENGAGE)
    dive.until(State.ACTIVE)
    dive.run(2.0)
    assert engaged(dive) == [False, False, True, True]
    press(dive, RELEASE)
    assert dive.state is State.PILOT
    press(dive, ENGAGE)
    dive.until(State.ACTIVE)


def test_a_press_engages_once_and_holding_the_button_does_not_engage_again():
    dive = at_the_stick()
    dive.cockpit.push(buttons=ENGAGE)
    dive.until(State.ACTIVE)
    dive.ask(Request.STOP)
    dive.run(3.0)
    assert dive.state is State.READY


@pytest.mark.parametrize("chosen", [True, False], ids=["down before it was heard of", "none chosen"])
def test_a_button_that_was_down_before_or_is_not_chosen_engages_nothing(chosen):
    dive = Dive(pilot=True, companion=BUTTONS if chosen else (), arm=False, engage=False)
    dive.cockpit.push(buttons=ENGAGE if chosen else 0)
    dive.run(2.5)
    dive.cockpit.extra.append(dive.cockpit.arm())
    dive.run(1.5)
    dive.cockpit.push(buttons=ENGAGE if chosen else ENGAGE | RELEASE)
    dive.run(2.0)
    assert dive.step.truth.armed
    assert Condition.ENGAGE_ASKED not in dive.step.sample.verdict.conditions


@pytest.mark.parametrize("withdrawn", [False, True])
def test_a_press_that_comes_to_nothing_leaves_no_wish_behind(monkeypatch, withdrawn):
    """In the mode later, it would take off. The other button withdraws it at once."""
    dive = at_the_stick()
    dive.fault("mode", value=2)
    dive.run(1.5)
    monkeypatch.setattr(dive.vehicle.autopilot, "set_mode", lambda number: 4)
    press(dive, ENGAGE)
    dive.run(1.0)
    assert Condition.ENGAGE_ASKED in dive.step.sample.verdict.conditions
    if withdrawn:
        press(dive, RELEASE)
    else:
        dive.run(5.0)
    monkeypatch.undo()
    dive.fault("mode", value=19)
    dive.run(3.0)
    assert dive.step.truth.mode == 19
    assert dive.state is not State.ACTIVE


def test_a_wish_of_the_start_is_withdrawn_by_the_release_button_alone():
    dive = Dive(pilot=True, companion=BUTTONS, arm=False)
    dive.cockpit.push()
    dive.run(8.0)
    assert Condition.ENGAGE_ASKED in dive.step.sample.verdict.conditions
    press(dive, RELEASE)
    assert Condition.ENGAGE_ASKED not in dive.step.sample.verdict.conditions


def test_the_button_clears_a_fault_whose_cause_has_gone_and_engages():
    dive = at_the_stick()
    press(dive, ENGAGE)
    dive.until(State.ACTIVE)
    dive.fault("link_cut", 2.0)
    dive.until(State.FAULT)
    dive.run(0.7)
    press(dive, ENGAGE)
    assert dive.state is State.FAULT
    assert "check the cable" in dive.step.sample.verdict.remedy
    dive.run(3.0)
    assert dive.state is State.FAULT
    assert dive.step.sample.verdict.remedy == STATES[State.FAULT].remedy
    press(dive, ENGAGE)
    dive.until(State.ACTIVE)


def toggled_on(t_s, inbox):
    packer = mavlink.MAVLink(None, 1, 1)
    toggle = mavlink.MAVLink_named_value_float_message(round(1e3 * t_s), b"InputHold", 1.0)
    return [*inbox, (round((1000.0 + t_s) * 1e9), toggle.pack(packer))]


def test_an_override_without_deflection_is_withheld_and_one_that_touches_no_axis_passes():
    dive = holding()
    channels_7_up = mavlink.MAVLink_rc_channels_override_message(1, 1, *[65535] * 6, 1700, 65535)
    neutral, camera = dive.cockpit.stick(us=1500), dive.cockpit.frame(channels_7_up)
    dive.cockpit.extra += [neutral, camera]
    dive.run(0.5)
    assert dive.state is State.ACTIVE
    assert neutral not in dive.cockpit.passed
    assert camera in dive.cockpit.passed


def test_buttons_reach_the_vehicle_even_pressed_between_two_ticks_and_count_once():
    dive = holding()
    pilot = dive.vehicle.autopilot.pilot
    for gain in (0.75, 1.0):
        dive.cockpit.push(buttons=1 << GAIN_UP)
        pressed = dive.cockpit.frame(dive.cockpit.sticks)
        dive.cockpit.push()
        dive.cockpit.extra += [pressed, dive.cockpit.frame(dive.cockpit.sticks)]
        dive.run(0.3)
        assert pilot.gain == gain
    assert dive.state is State.ACTIVE


def test_a_mode_change_by_a_button_gives_the_pilot_everything():
    dive = holding()
    dive.cockpit.push(buttons=1 << 2)  # ArduSub's default for button 2: depth hold
    assert dive.until(State.PILOT).step.truth.mode == ALT_HOLD


def test_sticks_that_stop_coming_are_released():
    dive = holding()
    dive.cockpit.push(surge=0.3, buttons=1 << GAIN_UP)
    dive.run(1.0)
    dive.cockpit.sticks = None
    dive.run(0.7)
    assert channels(dive)[FORWARD] == 1500
    assert dive.state is State.ACTIVE


# --- Idle -------------------------------------------------------------------------------------------------


def test_while_it_only_watches_every_byte_passes_and_nothing_is_added():
    dive = Dive("parameters.FS_PILOT_INPUT=1", pilot=True, arm=False, engage=False)
    dive.cockpit.push(surge=0.4)
    dive.cockpit.extra.append(b"\xfd\xfe no MAVLink at all \x00")
    dive.run(2.5)
    frames, passed, sent = len(dive.tap.frames), len(dive.cockpit.passed), len(dive.cockpit.sent)
    dive.cockpit.push()  # arming with a stick off centre is refused
    dive.run(0.1)
    dive.cockpit.extra += [dive.cockpit.arm(), b"\xfe\xfd", b""]
    dive.run(0.2)
    dive.cockpit.push(surge=0.4)
    dive.run(3.7)
    assert len(dive.tap.frames) == frames
    assert dive.cockpit.passed[passed:] == dive.cockpit.sent[sent:]
    assert dive.step.truth.armed
    assert channels(dive)[FORWARD] == 1580


def test_the_first_neutral_frames_do_not_cut_into_a_pilots_flight():
    dive = Dive(pilot=True, arm=False, engage=False)
    dive.cockpit.push(surge=0.5)
    seen = set()
    for step in dive.loop.run(1.5):
        dive.step = step
        seen.add(channels(dive)[FORWARD])
    assert seen == {1500, 1600}
    assert channels(dive)[FORWARD] == 1600
    assert [axes[0] for _, axes in dive.tap.frames].count(0.0) <= 2


def test_what_the_vehicle_says_reaches_the_ground_station_unchanged():
    dive = Dive(pilot=True)
    heard = []

    def listen(t_s, inbox):
        heard.extend(inbox)
        return inbox

    dive.tap.spoil = listen
    dive.run(2.0)
    assert dive.cockpit.heard == b"".join(data for _, data in heard)


def test_our_heartbeat_does_not_hide_from_the_vehicle_that_its_ground_station_is_lost():
    dive = Dive("parameters.FS_PILOT_INPUT=0", arm=False, engage=False)
    dive.run(3.0)
    station = Somebody()
    dive.tap.to_vehicle += [
        station.frame(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)),
        station.arm(),
    ]
    dive.run(1.0)
    assert dive.step.truth.armed
    dive.run(5.0)
    assert not dive.step.truth.armed


# --- The pilot is lost ------------------------------------------------------------------------------------


def test_without_a_ground_station_it_does_not_engage():
    dive = Dive(pilot=True)
    dive.cockpit.alive = False
    dive.run(5.0)
    assert dive.state is State.IDLE
    assert "the ground station's heartbeat" in dive.step.sample.verdict.reason


def lost(on_loss, *plant, depth_m=1.0, companion=()):
    dive = holding(*plant, companion=[f"ground_station.on_loss={on_loss}", *companion], depth_m=depth_m)
    dive.cockpit.alive = False
    dive.cockpit.sticks = None
    return dive


def test_lost_and_told_to_hold_it_holds():
    dive = lost("hold")
    dive.run(5.0)
    assert dive.state is State.ACTIVE
    assert dive.step.sample.state.ages.pilot_s > 4.0
    assert dive.step.truth.eta[2] == pytest.approx(1.0, abs=0.05)


def test_lost_and_told_to_fall_silent_the_firmwares_own_failsafe_acts():
    dive = lost("silence")
    since_s = dive.t_s
    dive.run(4.6)
    assert dive.states_since(since_s)[:3] == [State.ACTIVE, State.RAMP_DOWN, State.IDLE]
    assert dive.tap.last_thrust_s - since_s <= 4.0 + 0.6
    frames = len(dive.tap.frames)
    dive.run(4.0)
    assert len(dive.tap.frames) - frames <= 5
    assert not dive.step.truth.armed


def test_lost_and_told_to_surface_it_comes_up_on_its_own():
    brief = ["supervisor.keep_alt_hold_s=5"]  # of other hand-overs: this one goes on
    dive = lost("surface", "hull.net_buoyancy_n=-2.0", depth_m=3.0, companion=brief)
    dive.run(8.0)
    assert dive.step.truth.mode == SURFACE
    dive.run(12.0)
    assert dive.step.truth.armed
    assert dive.step.truth.mode == ALT_HOLD, "at the surface the firmware leaves SURFACE by itself"
    assert dive.state is State.HAND_OVER
    assert dive.step.sample.verdict.reason == "surfaced; the autopilot holds depth"
    assert dive.step.truth.eta[2] < 0.3
    dive.run(16.0)
    assert dive.step.truth.armed, "nobody has it: without our neutral frames it would be disarmed"
    assert dive.step.truth.eta[2] < 0.3
    assert not any(axis for t_s, axes in dive.tap.frames if t_s > dive.t_s - 10.0 for axis in axes)


@shared
def surfacing():
    dive = lost("surface", depth_m=6.0)
    dive.run(8.0)
    assert dive.step.truth.mode == SURFACE
    return dive


def test_a_pilot_who_comes_back_gets_the_vehicle():
    dive = surfacing()
    dive.cockpit.alive = True
    dive.cockpit.push(surge=0.5)
    dive.run(2.0)
    frames = len(dive.tap.frames)
    dive.run(1.0)
    assert len(dive.tap.frames) == frames
    assert channels(dive)[FORWARD] == 1600
    assert dive.step.truth.mode == SURFACE
    assert dive.state is State.PILOT


def test_surfacing_that_somebody_ends_is_not_begun_again():
    dive = surfacing()
    dive.fault("mode", value=ALT_HOLD)
    dive.run(2.0)
    assert dive.step.truth.mode == ALT_HOLD
    assert dive.state is State.PILOT


# --- Trouble from the ground station ----------------------------------------------------------------------


@pytest.mark.parametrize("flood", [b"\xfe" * 4000, b"\xfd\x09\x00\x00" * 900, bytes(60_000)])
def test_a_flood_is_cut_off_and_the_control_goes_on(flood):
    dive = holding(seconds=1.0)
    for _ in range(25):
        dive.cockpit.extra += [flood] * 20
        dive.run(0.02)
    assert dive.state is State.ACTIVE
    assert dive.cockpit.relay.left_out > 100
    dive.run(1.0)
    assert dive.step.truth.eta[2] == pytest.approx(1.0, abs=0.05)


def test_sticks_of_another_system_and_for_another_vehicle_are_none_of_our_business():
    dive = holding()
    frames = [
        Somebody(system=245).frame(mavlink.MAVLink_manual_control_message(1, 900, 0, 500, 0, 0)),
        Somebody().frame(mavlink.MAVLink_manual_control_message(2, 900, 0, 500, 0, 0)),
    ]
    dive.cockpit.extra += frames
    dive.run(0.5)
    assert channels(dive)[FORWARD] == 1500
    assert all(frame in dive.cockpit.passed for frame in frames)
    assert dive.state is State.ACTIVE


def test_where_there_is_a_key_unsigned_sticks_are_neither_obeyed_nor_passed_while_it_holds():
    dive = holding(
        'signing_passphrase="kelp"',
        signing=Signing(KEY, 25, 1.8e9),
        companion=["ground_station.on_loss=hold"],
    )
    dive.cockpit.push(surge=0.8)
    dive.run(1.0)
    assert dive.state is State.ACTIVE
    assert channels(dive)[FORWARD] == 1500
    assert steering_bytes(dive.cockpit.passed) == 0


def test_the_pilots_link_is_taken_by_what_the_engine_would_heed_alone():
    """A ground station's heartbeat, or steering; signed where there is a key, and not used up by looking."""
    somebody, autopilot = Somebody(), Somebody(1, 1)
    beat = somebody.frame(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    sticks = somebody.frame(mavlink.MAVLink_manual_control_message(1, 1, 0, 500, 0, 0))
    foreign = autopilot.frame(mavlink.MAVLink_heartbeat_message(12, 3, 0, 0, 4, 3))
    relay = Relay(load_config(overrides=WITH_PILOT))
    for data in (beat, sticks, foreign + beat):
        assert relay.sender(0.0, data) is Sender.EXPECTED
    for data in (b"", b"\0", b"\xfd", foreign, beat[:-1], b"\0" + beat):
        assert relay.sender(0.0, data) is Sender.STRANGER
    keyed = Relay(load_config(overrides=WITH_PILOT), Signing(KEY))
    assert keyed.sender(0.0, beat) is Sender.STRANGER
    packer = Packer(255, 190, Signing(KEY, 1))
    heartbeat = message_type(mavlink.MAVLINK_MSG_ID_HEARTBEAT)
    signed = packer.encode(heartbeat(type=mavlink.MAV_TYPE_GCS))
    assert keyed.sender(0.0, signed) is Sender.EXPECTED
    assert keyed.sender(0.0, signed) is Sender.EXPECTED
    keyed.to_vehicle(0, signed)
    assert len(keyed.take()) == 1
    assert keyed.sender(0.0, signed) is Sender.BEHIND, "a replay"
