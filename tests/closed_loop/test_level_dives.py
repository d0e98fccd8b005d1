"""A place held, or a depth changed, in currents, waves and with loads: level, held, and never disarmed.

The Heavy pushes 0.085 m below its centre of gravity and is righted by 1.3 N·m/rad; the water turns whoever
moves through it (Munk moment). Roll and pitch are ours in MANUAL; the six-thruster frame can only roll, so
there speed and horizontal force give way.
"""

from math import nan

import numpy as np
import pytest
from virtual import Dive, Somebody, hold, shared

from companion.records import Condition, Setpoint, State

SEA = ("sensors.dvl=true", "waves.enabled=true", "waves.height_m=0.3")
HEAVY = {"base": "sim.toml"}
SIX = {"base": "sim-bluerov2.toml", "companion": ('vehicle.frame="vectored"',)}


def current(speed_m_s):
    return ("current.enabled=true", f"current.speed_m_s={speed_m_s}")


def load(weight_n):
    return ("load.enabled=true", f"load.weight_n={weight_n}", "load.on_s=0", "load.off_s=1000")


@shared
def engaged(*plant, depth_m=3.0, setpoint=None, **arguments):
    """A dive that has just engaged; its position source has told the EKF where on earth it is."""
    start = f"initial.eta=[0,0,{depth_m},0,0,0]"
    dive = Dive(start, *plant, setpoint=setpoint or hold(z=depth_m, x=0.0, y=0.0), **arguments)
    dive.tap.to_vehicle.append(Somebody().origin())
    return dive.until(State.ACTIVE)


def tilt_deg(steps):
    eta = np.array([step.truth.eta for step in steps])
    return np.degrees(np.arccos(np.cos(eta[:, 3]) * np.cos(eta[:, 4])))


def off_mm(steps, depth_m):
    return 1e3 * np.array([step.truth.eta[2] - depth_m for step in steps])


def states(steps):
    return {step.sample.verdict.state for step in steps}


def test_the_heavy_holds_a_place_in_a_current_and_waves_by_manual_control():
    """Without levelling it lay on its side 2 s after engaging, was released and disarmed."""
    gain = ("parameters.JS_GAIN_DEFAULT=1.0",)
    dive = engaged(*SEA, *current(0.4), *gain, companion=("vehicle.thrust_path=manual_control",), seed=3)
    steps = dive.run(18.0)
    assert states(steps) == {State.ACTIVE}
    assert tilt_deg(steps).max() < 12.0
    held = steps[-300:]
    assert tilt_deg(held).max() < 8.0
    eta = np.array([step.truth.eta for step in held])
    assert np.sqrt(np.mean(np.square(eta[:, :2]))) < 0.06
    assert np.sqrt(np.mean(np.square(off_mm(held, 3.0)))) < 6.0
    assert dive.step.truth.armed


def test_a_current_that_surge_and_sway_cannot_resist_takes_neither_depth_nor_heading():
    """1 m/s across its corner: the motors that are at their end serve the heading too."""
    dive = engaged(*SEA, *current(1.0), "current.direction_deg=40", seed=3)
    dive.run(4.0)
    steps = dive.run(12.0)
    assert states(steps) == {State.ACTIVE}
    off_deg = [np.degrees(step.truth.eta[5] - 0.3) for step in steps]
    x, _, z, psi = np.mean([step.sample.dofs.saturated for step in steps], axis=0)
    assert x > 0.9
    assert z < 0.1
    assert psi == 0.0
    assert np.sqrt(np.mean(np.square(off_deg))) < 0.3
    assert np.sqrt(np.mean(np.square(off_mm(steps, 3.0)))) < 6.0
    assert tilt_deg(steps).max() < 18.0


@pytest.mark.parametrize(("vehicle", "most_deg"), [(HEAVY, 5.0), (SIX, 12.0)], ids=["heavy", "six"])
def test_a_load_is_brought_up_level(vehicle, most_deg):
    """Its weight drags a tilted vehicle sideways, and sideways it is turned further: it tipped on the way."""
    dive = engaged(*SEA[1:], *load(15.0), depth_m=8.0, setpoint=hold(z=8.0), **vehicle)
    dive.run(6.0)
    dive.engine.aim(Setpoint((nan, nan, 2.0, 0.3)))
    steps = dive.run(26.0)
    assert states(steps) == {State.ACTIVE}
    assert tilt_deg(steps).max() < most_deg
    assert np.abs(off_mm(steps[-100:], 2.0)).max() < 60.0
    assert dive.step.truth.armed


def test_six_thrusters_that_cannot_pitch_drift_level_rather_than_capsize():
    """Head-on, a current of 0.4 m/s with waves is more than its weight rights."""
    dive = engaged(*SEA, *current(0.4), **SIX)
    steps = dive.run(18.0)
    assert states(steps) == {State.ACTIVE}
    assert tilt_deg(steps).max() < 15.0
    assert np.sqrt(np.mean(np.square(off_mm(steps[-300:], 3.0)))) < 8.0
    assert steps[-1].sample.verdict.conditions & Condition.SATURATED


def lying_on_its_side(weight_n=15.0, **companion):
    """Both vertical thrusters of its port side are dead, and a load pulls it down: nobody can level it."""
    dive = Dive("initial.eta=[0,0,5,0,0,0]", *load(weight_n), setpoint=hold(z=5.0), **companion)
    dive.until(State.ACTIVE).run(4.0)
    for thruster in (5, 7):
        dive.fault("thruster", thruster=thruster, value=0.0)
    return dive


def test_a_vehicle_that_tilts_is_not_let_go():
    """It used to ramp down, fall silent and be disarmed, and sink."""
    dive = lying_on_its_side(companion=("supervisor.off_track_s=60",))
    steps = dive.run(15.0)
    assert tilt_deg(steps).max() > 70.0, "else this test shows nothing"
    assert states(steps) == {State.ACTIVE}
    assert any(step.sample.verdict.warnings & Condition.TILTED for step in steps)
    assert np.abs(off_mm(steps, 5.0)).max() < 300.0
    assert dive.step.truth.armed


def test_a_tilt_that_lasts_is_kept_while_the_depth_is_held():
    """ALT_HOLD let it sink by 3 m in 40 s, here and on the firmware."""
    dive = lying_on_its_side(8.0, companion=("supervisor.max_tilt_deg=25",))
    steps = dive.run(22.0)
    assert np.mean([bool(step.sample.verdict.warnings & Condition.TILTED) for step in steps]) > 0.5
    assert states(steps) == {State.ACTIVE}
    assert np.abs(off_mm(steps, 5.0)).max() < 100.0


def test_a_tilt_that_lasts_is_the_autopilots_and_is_kept_alive_for_good():
    """Silence after keep_alt_hold_s would disarm it, and what tilts it would take it down."""
    dive = lying_on_its_side(30.0, companion=("supervisor.max_tilt_deg=25", "supervisor.keep_alt_hold_s=2"))
    dive.until(State.HAND_OVER, within_s=12.0)
    assert dive.step.sample.verdict.reason == "tilted too far for too long"
    dive.run(15.0)
    assert dive.state is State.HAND_OVER
    assert (dive.step.truth.mode, dive.step.truth.armed) == (2, True)
    sent_s = np.array([t_s for t_s, _ in dive.tap.frames])
    assert np.diff(sent_s[sent_s > dive.t_s - 8.0]).max() <= 1.1


def test_a_pilot_who_drives_at_full_stick_stays_level_and_at_his_depth():
    """His surge passes us by, and would turn the Heavy over."""
    dive = Dive("initial.eta=[0,0,2,0,0,0.3]", setpoint=hold(z=2.0), pilot=True)
    dive.until(State.ACTIVE)
    dive.cockpit.push()
    dive.run(2.0)
    dive.cockpit.push(surge=1.0, sway=0.5)
    steps = dive.run(3.0)
    dive.cockpit.push(surge=-1.0)
    steps += dive.run(3.0)
    assert states(steps) == {State.ACTIVE}
    eta = np.array([step.truth.eta for step in steps])
    assert np.ptp(eta[:, 0]) > 1.0, "else he did not drive"
    assert np.degrees(np.abs(eta[:, 3:5]).max()) < 8.0
    assert np.abs(eta[:, 2] - 2.0).max() < 0.05


def test_every_way_out_leaves_roll_and_pitch_neutral():
    """An override stays in force: so neutral has to name them."""
    dive = engaged(*SEA, setpoint=hold(x=0.5, y=-0.3))
    dive.run(3.0)
    frame = dive.engine.shutdown_frames()
    assert frame[10:14] == (1500).to_bytes(2, "little") * 2
