"""Each reason to warn, to ramp down and to hand over, from the vehicle's bytes to what becomes of it."""

import numpy as np
import pytest
from builders import pulled
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from virtual import DEPTH_M, Somebody, active, hold, shared

from companion.records import Condition, Request, State
from companion.supervision.handover import KEEP_ALIVE_S, REFUSED_S
from companion.telemetry.event_log import EventLog

STABILIZE, ALT_HOLD, SURFACE, POSHOLD, MANUAL = 0, 2, 9, 16, 19
RAMP_S, HEARTBEAT_S = 1.0, 1.0
PILOT_TIMEOUT_S = 3.0


def leak(dive):
    dive.fault("leak")


def too_late(dive):
    dive.fault("link_delayed", value=0.25)


def carried_off(dive):
    for thruster in range(5, 9):
        dive.fault("thruster", thruster=thruster, value=0.0)


def compass_jumps(dive):
    """A heading that is half a radian wrong either way, sample by sample."""
    rng, wire = np.random.default_rng(1), mavlink.MAVLink(None, 1, 1)

    def spoilt(data):
        messages = wire.parse_buffer(data)
        for message in messages:
            if message.get_type() == "ATTITUDE":
                message.yaw += float(rng.choice([-0.5, 0.5]))
        return b"".join(message.pack(wire) for message in messages)

    dive.tap.spoil = lambda t_s, inbox: [(at, spoilt(data)) for at, data in inbox]


def ekf_bad(dive):
    dive.fault("ekf", value=2.0)


def own_failsafe(dive):
    """One of the autopilot's holds, and only warns."""
    dive.vehicle.autopilot.failing.add("battery")


HANDED_OVER = {
    leak: (Condition.LEAK, 0.5),
    too_late: (Condition.DELAY_TOO_LONG | Condition.INNOVATION_LARGE, 8.0),
    carried_off: (Condition.OFF_TRACK, 25.0),
}
RAMPED = {ekf_bad: (Condition.EKF_UNHEALTHY, 0.6), own_failsafe: (Condition.AUTOPILOT_FAILSAFE, 2.1)}


@shared
def handing_over(*companion):
    """A dive that a leak has just ended."""
    dive = active(companion=companion, seconds=3.0)
    leak(dive)
    return dive.until(State.HAND_OVER)


def what_ended(dive, act, within_s):
    """Do it; return the conditions with which ACTIVE was left."""
    act(dive)
    for step in dive.loop.run(within_s):
        dive.step = step
        if dive.state is not State.ACTIVE:
            return step.sample.verdict.conditions
    raise AssertionError(f"still ACTIVE: {dive.step.sample.verdict.conditions}")


@pytest.mark.parametrize("act", RAMPED, ids=lambda act: act.__name__)
def test_it_ramps_down_and_rests(act):
    condition, within_s = RAMPED[act]
    dive = active(seconds=3.0)
    conditions = what_ended(dive, act, within_s)
    assert dive.state is State.RAMP_DOWN
    assert conditions & condition
    left_s = dive.t_s
    dive.run(RAMP_S + 0.2)
    assert dive.state in (State.IDLE, State.READY)
    assert dive.tap.last_thrust_s - left_s <= RAMP_S + 0.05
    assert dive.motors_rest()


@pytest.mark.parametrize("act", HANDED_OVER, ids=lambda act: act.__name__)
def test_it_hands_over_through_stabilize(act):
    condition, within_s = HANDED_OVER[act]
    dive = active(pulled(20), seconds=3.0)
    conditions = what_ended(dive, act, within_s)
    assert dive.state is State.HAND_OVER
    assert conditions & condition
    left_s = dive.t_s
    modes = [step.truth.mode for step in dive.run(6.0)]
    assert [mode for i, mode in enumerate(modes) if not i or modes[i - 1] != mode] == [
        MANUAL,
        STABILIZE,
        ALT_HOLD,
    ]
    assert modes.count(STABILIZE) * 0.02 >= 1.0
    assert dive.tap.last_thrust_s - left_s <= RAMP_S + 0.05
    assert dive.state is State.HAND_OVER


def test_surprise_about_a_heading_ends_it_where_the_heading_is_ours():
    dive = active(companion=["supervisor.off_track_s=60"], seconds=3.0)
    assert what_ended(dive, compass_jumps, 3.0) & Condition.INNOVATION_LARGE
    assert dive.state is State.HAND_OVER
    dive = active(companion=["vehicle.steering_mode=stabilize"], setpoint=hold(psi=np.nan), seconds=3.0)
    compass_jumps(dive)
    assert {step.sample.verdict.state for step in dive.run(3.0)} == {State.ACTIVE}
    assert not dive.step.sample.verdict.conditions & Condition.INNOVATION_LARGE


def test_alt_hold_holds_the_depth_is_kept_alive_and_then_left_alone():
    dive = active(companion=["supervisor.keep_alt_hold_s=8"], seconds=6.0)
    depth_m = dive.step.truth.eta[2]
    leak(dive)
    dive.until(State.HAND_OVER)
    steps = dive.run(10.0)
    assert max(abs(step.truth.eta[2] - depth_m) for step in steps) < 0.15
    held_s = next(step.t_s for step in steps if step.truth.mode == ALT_HOLD)
    kept = [t_s for t_s, _ in dive.tap.frames if t_s > held_s + 0.5]
    assert np.diff(kept).max() <= KEEP_ALIVE_S + 0.05
    assert np.diff(kept).min() >= 0.9
    assert dive.step.truth.armed
    dive.until(State.PILOT)
    silent_s = dive.t_s
    dive.run(PILOT_TIMEOUT_S + 1.5)
    assert max(t_s for t_s, _ in dive.tap.frames) <= silent_s + 0.1
    assert not dive.step.truth.armed


@pytest.mark.parametrize("lost", [False, True], ids=["heard", "heartbeats lost"])
def test_a_hand_over_says_when_alt_hold_holds_and_how_long_it_lasts(lost):
    """It lasts to keep the vehicle armed, and went on saying that there is a leak."""
    dive, log = handing_over("supervisor.keep_alt_hold_s=12"), EventLog()
    if lost:
        dive.run(1.0)
        dive.fault("message_stopped", 2.4, message="HEARTBEAT")
    steps = dive.run(20.0)
    texts = [event.text for step in steps for event in log.step(step.sample)]
    reported = "HAND_OVER: ALT_HOLD holds the depth until somebody steers"
    assert texts.count(reported) == 1
    held_s = next(step.t_s for step in steps if step.sample.state.mode == ALT_HOLD)
    end_s = next(step.t_s for step in steps if step.sample.verdict.state is State.PILOT)
    assert end_s - held_s == pytest.approx(12.0, abs=0.05)
    holding = next(step.sample for step in steps if step.t_s > held_s + 1.0)
    assert holding.verdict.reason in reported
    assert "ALT_HOLD holds" not in steps[0].sample.verdict.reason


@pytest.mark.parametrize("relieved", ["a pilot steers", "the operator stops it"])
def test_whoever_relieves_it_ends_it(relieved):
    dive, somebody = handing_over(), Somebody()
    dive.run(5.0)
    if relieved == "a pilot steers":
        dive.tap.spoil = lambda t_s, inbox: [*inbox, (round((1000.0 + t_s) * 1e9), somebody.stick(1500))]
    else:
        dive.ask(Request.STOP)
    dive.run(0.2)
    assert dive.state is State.PILOT
    relieved_s = dive.t_s
    dive.run(2.0)
    assert max(t_s for t_s, _ in dive.tap.frames) <= relieved_s
    assert not any(dive.tap.frames[-1][1])


def test_refused_is_a_fault_and_silence():
    """An autopilot that does not change its mode."""
    dive = active(seconds=3.0)
    dive.vehicle.autopilot.set_mode = lambda number: 4
    leak(dive)
    dive.until(State.HAND_OVER)
    dive.until(State.FAULT, within_s=REFUSED_S + 0.2)
    assert "did not change the mode" in dive.step.sample.verdict.reason
    silent_s = dive.t_s
    dive.run(PILOT_TIMEOUT_S + 1.5)
    assert max(t_s for t_s, _ in dive.tap.frames) <= silent_s + 0.6
    assert dive.motors_rest()


@pytest.mark.parametrize(("mode", "after_s"), [(SURFACE, 1.5), (MANUAL, 5.0)])
def test_somebody_elses_mode_ends_it(mode, after_s):
    """SURFACE before any heartbeat told of the leak's failsafe looks like that failsafe's own doing."""
    dive = handing_over()
    dive.run(after_s)
    dive.fault("mode", value=mode)
    dive.run(0.2)
    assert dive.state is State.PILOT
    dive.run(3.0)
    assert dive.step.truth.mode == mode or not dive.step.truth.armed


def test_the_autopilots_own_leak_action_is_not_steered_against():
    depth = "initial.eta=[0,0,4,0,0,0.3]"
    dive = active("parameters.FS_LEAK_ENABLE=2", depth, setpoint=hold(z=4.0), seconds=3.0)
    leak(dive)
    steps = dive.run(2.0)
    assert dive.step.truth.mode == SURFACE
    assert dive.state is State.HAND_OVER
    assert "failsafe" in dive.step.sample.verdict.reason
    changed_s = next(step.t_s for step in steps if step.truth.mode == SURFACE)
    assert not any(axis for t_s, axes in dive.tap.frames if t_s > changed_s + 0.05 for axis in axes)
    dive.run(10.0)
    assert dive.step.truth.armed, "disarmed, it would go down with the water in it"
    assert dive.step.truth.eta[2] < 0.5


def test_a_failsafe_that_surfaces_while_handing_over_goes_first():
    dive = active("parameters.FS_LEAK_ENABLE=2", "initial.eta=[0,0,4,0,0,0.3]", setpoint=hold(z=4.0))
    dive.fault("link_delayed", value=0.3)
    dive.until(State.HAND_OVER, 30.0)
    leak(dive)
    dive.run(3.0)
    assert dive.step.truth.mode == SURFACE
    assert dive.state is State.HAND_OVER
    assert dive.step.truth.armed


def warned(dive, condition, seconds):
    """Whether it was told at some time, while ACTIVE went on."""
    steps = dive.run(seconds)
    assert {step.sample.verdict.state for step in steps} == {State.ACTIVE}
    return [step for step in steps if step.sample.verdict.warnings & condition]


def test_a_low_battery_is_reported_and_held_on():
    dive = active(seconds=2.0)
    dive.fault("voltage", value=12.5)
    assert warned(dive, Condition.BATTERY_LOW, 7.0)[-1] is dive.step


ALONE = ("SCALED_PRESSURE2", "VFR_HUD")
"""Without these nothing but the depth tells whether it moved."""


def test_a_single_depth_that_cannot_be_is_left_out():
    dive = active(seconds=6.0)
    for message in ALONE:
        dive.fault("message_stopped", message=message)
    dive.run(1.5)
    dive.fault("depth_shifted", value=3.0)
    one = dive.run(0.06)
    dive.fault("depth_shifted", value=-3.0)
    steps = [*one, *dive.run(1.0)]
    reported = [step for step in steps if step.sample.verdict.conditions & Condition.DEPTH_JUMPED]
    assert reported
    assert all(step.sample.verdict.freeze for step in reported)
    assert {step.sample.verdict.state for step in steps} == {State.ACTIVE}
    assert max(abs(step.truth.eta[2] - DEPTH_M) for step in steps) < 0.03


@pytest.mark.parametrize("shown_by_pressure", [False, True])
def test_a_depth_that_jumped_for_good_is_no_fresh_depth(shown_by_pressure):
    dive = active(seconds=6.0)
    for message in () if shown_by_pressure else ALONE:
        dive.fault("message_stopped", message=message)
    dive.run(1.5)
    since_s = dive.t_s
    if shown_by_pressure:
        x, y, z, *others = dive.vehicle.physics.state
        dive.vehicle.physics.state = (x, y, z + 3.0, *others)
    else:
        dive.fault("depth_shifted", value=3.0)
    dive.until(State.FAULT, 2.0 if shown_by_pressure else 1.3)
    assert "no fresh depth" in dive.step.sample.verdict.reason
    assert dive.tap.last_thrust_s - since_s <= (1.3 if shown_by_pressure else 0.6)
    assert max(abs(axes[2]) for t_s, axes in dive.tap.frames if t_s > since_s) < 0.4
    dive.run(3.0)
    assert dive.step.sample.state.eta[2] - DEPTH_M > 2.0


def test_thrust_at_its_end_for_long_is_reported_and_nothing_is_learnt():
    dive = active(
        pulled(25),
        companion=["thrusters.max_axis=0.25", "supervisor.off_track_s=60"],
        seconds=1.0,
    )
    reported = warned(dive, Condition.SATURATED, 9.0)
    assert reported
    assert not any(any(step.sample.dofs.adapting) for step in reported)


def test_a_failsafe_switched_off_is_seen_even_if_the_notice_of_it_was_lost():
    dive = active(seconds=2.0)
    dive.fault("message_stopped", 0.5, message="PARAM_VALUE")
    dive.tap.to_vehicle.append(Somebody().parameter("FS_PILOT_INPUT", 0.0))
    dive.until(State.RAMP_DOWN, within_s=12.0)
    assert "failsafe" in dive.step.sample.verdict.reason
