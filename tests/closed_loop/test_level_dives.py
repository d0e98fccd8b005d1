"""All four held in MANUAL in waves: the Heavy tilts, because it pushes below its centre of gravity."""

import numpy as np
import pytest
from virtual import Dive, Somebody, hold

from companion.types import State

SEA = ("sensors.dvl=true", "waves.enabled=true", "current.enabled=true", "initial.eta=[0,0,1,0,0,0]")
LEVEL = ("levelling.enabled=true",)


def dive(*companion):
    """Depth RMS (mm) once settled, largest tilt (deg) and what was sent to roll and pitch."""
    dive = Dive(*SEA, companion=companion, setpoint=hold(x=0.5, y=-0.3, z=3.0, psi=0.5))
    dive.tap.to_vehicle.append(Somebody().origin())
    dive.until(State.ACTIVE)
    dive.run(12.0)
    steps = dive.run(24.0)
    assert {step.sample.verdict.state for step in steps} == {State.ACTIVE}
    eta = np.array([step.truth.eta for step in steps])
    tilts = np.array([(step.sample.command.roll, step.sample.command.pitch) for step in steps])
    rms_mm = 1e3 * float(np.sqrt(np.mean(np.square(eta[:, 2] - 3.0))))
    return rms_mm, float(np.degrees(np.abs(eta[:, 3:5]).max())), tilts


@pytest.mark.parametrize("path", ["rc_override", "manual_control"])
def test_levelling_keeps_it_level_and_its_depth(path):
    way = f"vehicle.thrust_path={path}"
    free_mm, free_deg, untouched = dive(way)
    level_mm, level_deg, tilts = dive(way, *LEVEL)
    assert free_deg > 15.0, "else this test shows nothing"
    assert not untouched.any()
    assert level_deg < 10.0
    assert level_mm <= 1.1 * free_mm
    assert np.abs(tilts).max() <= 0.4
    assert np.ptp(tilts) > 0.05


def test_a_pilot_who_drives_at_full_stick_stays_level_and_at_his_depth():
    """His surge passes us by, and would turn the Heavy over."""
    dive = Dive("initial.eta=[0,0,2,0,0,0.3]", companion=LEVEL, setpoint=hold(z=2.0), pilot=True)
    dive.until(State.ACTIVE)
    dive.cockpit.push()
    dive.run(2.0)
    dive.cockpit.push(surge=1.0, sway=0.5)
    steps = dive.run(3.0)
    dive.cockpit.push(surge=-1.0)
    steps += dive.run(3.0)
    assert {step.sample.verdict.state for step in steps} == {State.ACTIVE}
    eta = np.array([step.truth.eta for step in steps])
    assert np.ptp(eta[:, 0]) > 1.0, "else he did not drive"
    assert np.degrees(np.abs(eta[:, 3:5]).max()) < 8.0
    assert np.abs(eta[:, 2] - 2.0).max() < 0.05


def test_every_way_out_leaves_roll_and_pitch_neutral():
    """An override stays in force: so neutral has to name them."""
    dive = Dive(*SEA, companion=LEVEL, setpoint=hold(x=0.5, y=-0.3)).until(State.ACTIVE)
    dive.run(3.0)
    frame = dive.engine.farewell()
    assert frame[10:14] == (1500).to_bytes(2, "little") * 2
