"""One tick, from outside: bytes in, bytes and records out."""

import math
from copy import deepcopy

import numpy as np
import pytest
from msgspec.structs import replace
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from virtual import Dive, Somebody, active, hold, message_id

from companion.config import load_config
from companion.engine import Engine
from companion.records import NEUTRAL, LoopHealth, Request, Setpoint, State, Z, vector
from lab.loop.dive import SURVEYOR, send_origin
from lab.studies.promises import steering

HEALTH = LoopHealth(1, 50.0, 0.0, 0.0, 0, 0)
TICK_S = 0.02
BURST_S = 0.5
MANUAL = Somebody().frame(mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, 19, 0, 0, 0, 0, 0))
NAN = vector([math.nan] * 4)
PATHS = ("rc_override", "manual_control")


def engine(*overrides, setpoint=NAN):
    return Engine(load_config(overrides=overrides), Setpoint(setpoint))


def test_nobody_heard_nobody_steered():
    e = engine()
    for k in range(100):
        out, sample = e.step(1000.0 + k * TICK_S, [], HEALTH, [Request.ENGAGE])
        assert all(steering(frame) is None for frame in out)
        assert sample.verdict.state is State.IDLE
        assert sample.command == NEUTRAL


def test_the_kalman_gains_follow_the_noise_of_depth_through_a_retune_and_a_home_in_mid_dive():
    dive = Dive("sensors.barometer_without_home=true", "sensors.pressure_white_m=0.012", engage=False)

    def heave():
        return dive.engine.parameters.observers.tables[Z]

    configured = heave()
    dive.run(12.0)
    noisy, config = heave(), dive.engine.config
    assert noisy.control[0].rows[12][0] < 0.3 * configured.control[0].rows[12][0]
    dive.engine.retune(replace(config, heave=replace(config.heave, kappa_per_s=9.0)))
    assert heave() == noisy
    send_origin(dive.vehicle, SURVEYOR)
    dive.run(35.0)
    assert heave() == configured


def boarded(*messages, after_s=2.5):
    """A dive whose companion starts when the vehicle has long been up and has heard `messages`."""
    dive = Dive(arm=False, engage=False)
    dive.vehicle.open_link(0)
    while dive.t_s < after_s:
        dive.vehicle.step([])
    dive.vehicle.step([(0, message) for message in messages])
    return dive


@pytest.mark.parametrize("contact_s", [0.0, 4.0])
def test_whoever_arms_soon_after_first_contact_stays_armed(contact_s):
    """Neutral frames would count as a pilot, and their end as his loss: FS_PILOT_INPUT would disarm."""
    dive = boarded(after_s=contact_s)
    dive.run(2.1)
    dive.tap.to_vehicle.append(Somebody().arm())
    dive.run(5.0)
    assert dive.step.truth.armed
    assert dive.tap.frames == []


def test_what_a_dead_companion_left_in_force_is_neutral_soon_after_the_next_one_starts():
    dive = boarded(MANUAL, Somebody().arm(), Somebody().stick())
    dive.vehicle.step([])
    assert not set(dive.vehicle.truth().motor_pwm) <= {1500}
    dive.run(2.0)
    assert dive.step.truth.armed, "its own failsafe is still to come"
    assert dive.motors_rest()
    times = [t_s for t_s, _ in dive.tap.frames]
    assert all(axes == (0.0,) * 6 for _, axes in dive.tap.frames)
    assert times[-1] - times[0] == pytest.approx(BURST_S, abs=0.05)


@pytest.mark.parametrize("path", PATHS)
def test_it_steers_every_tick_then_neutral_for_a_while_and_its_farewell_is_neutral(path):
    dive = active(companion=[f"vehicle.thrust_path={path}"])
    assert any(dive.tap.frames[-1][1])
    before = len(dive.tap.frames)
    dive.run(1.0)
    assert len(dive.tap.frames) - before == 50
    assert steering(deepcopy(dive.engine).shutdown_frames()) == (0.0,) * 6
    dive.ask(Request.STOP)
    dive.run(2.0)
    stopped = dive.tap.last_thrust_s
    after = [(t_s, axes) for t_s, axes in dive.tap.frames if t_s > stopped + 0.001]
    assert all(axes == (0.0,) * 6 for _, axes in after)
    assert after[-1][0] - stopped == pytest.approx(BURST_S, abs=0.06)


def watched(dive, seconds):
    """Let it run while a ground station is there and does not steer."""
    beat = Somebody().frame(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    for _ in range(seconds):
        dive.tap.to_vehicle.append(beat)
        dive.run(1.0)


def leaves(dive):
    """Let the companion leave, and the vehicle go on without it for longer than its failsafes wait."""
    for _ in range(5):
        dive.tap.to_vehicle.append(dive.engine.shutdown_frames())
        dive.tap.asleep_until_s = math.inf
        dive.run(0.02)
    watched(dive, 8)


def test_who_never_steered_leaves_in_silence():
    """Neutral frames would count as a pilot, and the silence after them as his loss."""
    assert engine().shutdown_frames() == b""
    dive = boarded(Somebody().arm())
    watched(dive, 3)
    assert dive.step.truth.armed
    leaves(dive)
    assert dive.step.truth.armed


def test_who_steered_and_let_go_long_ago_leaves_in_silence():
    """It is the pilot's by then: armed anew, and left alone by us."""
    dive = active(arm=True)
    dive.ask(Request.STOP)
    watched(dive, 8)
    assert not dive.step.truth.armed, "the pilot-input failsafe, after our last frame"
    dive.tap.to_vehicle.append(Somebody().arm())
    watched(dive, 2)
    assert dive.step.truth.armed
    leaves(dive)
    assert dive.step.truth.armed


def test_who_crashes_leaves_neutral_if_it_steered(monkeypatch):
    """Whatever breaks within a tick: what the vehicle was told in the tick before is still in force."""
    dive = active()
    monkeypatch.setattr("companion.core.controller.demand", None)
    with pytest.raises(TypeError):
        dive.run(0.02)
    assert steering(dive.engine.shutdown_frames()) == (0.0,) * 6


def test_nan_means_where_it_is_when_engaged():
    dive = Dive("initial.eta=[0,0,2.5,0,0,1.2]", setpoint=Setpoint(NAN)).until(State.ACTIVE)
    z, psi = dive.step.truth.eta[[2, 5]]
    dive.run(8.0)
    assert dive.step.truth.eta[2] == pytest.approx(z, abs=0.06)
    assert dive.step.truth.eta[5] == pytest.approx(psi, abs=0.06)
    assert dive.step.sample.eta_d[2] == pytest.approx(z, abs=0.05)
    assert dive.step.sample.eta_d[3] == pytest.approx(psi, abs=0.05)


def test_x_and_y_stay_free_without_one_whatever_the_setpoint():
    dive = active(setpoint=hold(x=5.0, y=5.0))
    np.testing.assert_array_equal(dive.step.sample.dofs.engaged, [False, False, True, True])
    assert all(axes[0] == axes[1] == 0.0 for _, axes in dive.tap.frames)


def test_what_is_delivered_is_told_from_what_was_requested():
    """A setpoint far away in a slow envelope: the law asks, the guard cuts, and learning stops meanwhile."""
    dive = active(companion=["thrusters.max_axis=0.1"], setpoint=hold(z=8.0), seconds=4.0)
    sample = dive.step.sample
    assert sample.dofs.saturated[2]
    assert not sample.dofs.adapting[2]
    assert abs(sample.delivered[2]) < abs(sample.requested[2])
    assert abs(sample.command.heave) <= 0.1


def test_the_mode_is_asked_for_only_when_engaging():
    """A vehicle that somebody flies in another mode is left in it."""
    dive = Dive(arm=False, engage=False)
    asked: list[bytes] = []
    dive.tap.spoil = lambda t_s, inbox: inbox
    step = dive.engine.step

    def listen(*arguments):
        out, sample = step(*arguments)
        asked.extend(
            frame
            for frame in out
            if message_id(frame) == 76 and int.from_bytes(frame[38:40], "little") == 176
        )
        return out, sample

    dive.tap.engine.step = listen
    dive.fault("mode", value=2)
    dive.run(3.0)
    assert not asked
    dive.ask(Request.ENGAGE)
    dive.run(1.0)
    assert asked


def test_a_zero_that_arming_moves_is_no_motion():
    """Half a metre, which no real vehicle jumps by: engaging is as calm as without."""

    def engaged(*plant):
        dive = Dive(*plant, setpoint=Setpoint(NAN)).until(State.ACTIVE)
        steps = [dive.step, *dive.run(3.0)]
        return steps, np.abs([step.sample.requested[2] for step in steps[:50]]).max()

    (steps, most_n), (_, without_n) = engaged("sensors.offset_m=0.5"), engaged()
    assert most_n < without_n + 2.0
    depths = [step.truth.eta[2] for step in steps]
    assert np.ptp(depths) < 0.04
