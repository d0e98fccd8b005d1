"""In which flight mode it steers: STABILIZE for depth alone, and the mode of before given back on release."""

import math

import numpy as np
import pytest
from virtual import Dive, active, hold, shared

from companion.records import PSI, Request, State

STABILIZE, ALT_HOLD, SURFACE, MANUAL = 0, 2, 9, 19
DEPTH_ONLY = ('vehicle.steering_mode="stabilize"',)


def rms(x):
    return float(np.sqrt(np.mean(np.square(x))))


@shared
def in_mode(mode, depth_m=0.0, **arguments):
    """A dive whose pilot had the vehicle in `mode` when engaging was asked for."""
    dive = Dive(f"initial.eta=[0,0,{depth_m},0,0,0]", engage=False, **arguments)
    dive.fault("mode", value=mode)
    dive.run(2.5)
    dive.ask(Request.ENGAGE)
    return dive.until(State.ACTIVE)


def modes_of(steps):
    modes = [step.truth.mode for step in steps]
    return [now for i, now in enumerate(modes) if i == 0 or modes[i - 1] != now]


def test_a_depth_only_dive_holds_depth_and_the_firmware_the_rest():
    """Waves, a current and a heading that we neither name nor touch."""
    dive = Dive(
        *("waves.enabled=true", "current.enabled=true", "initial.eta=[0,0,1,0.1,-0.1,0.7]"),
        companion=DEPTH_ONLY,
        setpoint=hold(z=3.0, psi=math.nan),
    ).until(State.ACTIVE)
    assert dive.step.truth.mode == STABILIZE
    dive.run(14.0)
    kept = dive.run(20.0)
    eta = np.array([step.truth.eta for step in kept])
    assert {step.sample.verdict.state for step in kept} == {State.ACTIVE}
    assert rms(eta[:, 2] - 3.0) < 0.008
    assert np.abs(np.degrees(eta[:, 3:5])).max() < 8.0
    assert np.abs(np.degrees(eta[:, 5] - 0.7)).max() < 6.0
    assert not any(axes[3] for _, axes in dive.tap.frames), "yaw is the firmware's"
    assert not kept[-1].sample.dofs.engaged[PSI]
    assert kept[-1].sample.state.delays.command_known


@pytest.mark.parametrize("companion", [(), DEPTH_ONLY], ids=["manual", "stabilize"])
def test_the_mode_of_before_is_given_back_on_release(companion):
    """ALT_HOLD through STABILIZE, because entered straight from MANUAL it dips."""
    dive = in_mode(ALT_HOLD, companion=companion, setpoint=hold(z=math.nan))
    dive.run(3.0)
    dive.ask(Request.STOP)
    after = dive.run(2.5)
    steering = STABILIZE if companion else MANUAL
    assert modes_of(after) == list(dict.fromkeys([steering, STABILIZE, ALT_HOLD]))
    asked = sum(step.truth.mode == ALT_HOLD for step in after)
    assert asked > 10


def test_an_unsafe_mode_is_not_given_back():
    acro = 1
    dive = in_mode(acro)
    dive.run(1.0)
    dive.ask(Request.STOP)
    assert modes_of(dive.run(4.0)) == [MANUAL]


def test_a_pilot_who_changed_the_mode_keeps_it():
    dive = in_mode(ALT_HOLD)
    dive.run(1.0)
    dive.fault("mode", value=STABILIZE)
    dive.until(State.PILOT)
    assert modes_of(dive.run(4.0)) == [STABILIZE]


def test_after_release_a_mode_that_the_pilot_chose_is_left_alone():
    """Deep enough that the way up outlasts our asking for the former mode."""
    dive = in_mode(ALT_HOLD, setpoint=hold(z=math.nan), depth_m=8.0)
    dive.run(1.0)
    dive.ask(Request.STOP)
    dive.run(0.3)
    dive.fault("mode", value=SURFACE)
    assert modes_of(dive.run(4.0))[-1] == SURFACE


def test_every_way_out_gives_the_mode_back():
    """What Ctrl-C sends: neutral frames, and with them the mode."""
    dive = in_mode(ALT_HOLD)
    dive.run(1.0)
    farewells = [dive.engine.shutdown_frames() for _ in range(5)]
    dive.tap.asleep_until_s = 1e9
    modes = []
    for frame in farewells:
        dive.tap.to_vehicle.append(frame)
        modes += modes_of(dive.run(0.02))
    modes += modes_of(dive.run(0.1))
    assert list(dict.fromkeys(modes)) == [MANUAL, STABILIZE, ALT_HOLD]


def test_it_arms_only_what_it_could_engage():
    """With the failsafe off nothing else would be permitted: so the motors stay off too."""
    dive = Dive("parameters.FS_PILOT_INPUT=0")
    dive.run(6.0)
    assert not dive.step.truth.armed
    assert active().step.truth.armed
