"""A heading that is silently wrong: told by course or gyro, and no place is held that cannot be."""

import numpy as np
import pytest
from virtual import Dive, Somebody, hold, shared

from companion.records import Condition, Request, State, X, Z

KNOWS_NORTH = ("sensors.dvl=true", "sensors.dvl_knows_north=true")
SETTLES_S = 45.0
"""The EKF follows the compass with 12.5 s."""


def reported(steps):
    return [bool(step.sample.verdict.warnings & Condition.HEADING_WRONG) for step in steps]


def place_held(step):
    return any(step.sample.requested[:2])


def tries_s(steps):
    """When a place that was released is held again."""
    held = np.array([*map(place_held, steps)])
    return np.flatnonzero(np.diff(held.astype(int)) == 1) * 0.02


@shared
def turned_round():
    """A vehicle that holds a place, and whose compass was the wrong way round."""
    fault = 'faults=[{kind="compass", value=180.0}]'
    dive = Dive(*KNOWS_NORTH, fault, setpoint=hold(x=0.0, y=0.0), engage=False)
    dive.run(SETTLES_S)
    dive.ask(Request.ENGAGE)
    return dive.until(State.ACTIVE)


def test_a_wrong_heading_releases_the_place_and_not_the_depth_and_tries_it_less_and_less():
    """Other angles are in test_heading_watch.py."""
    dive = turned_round()
    steps = dive.run(20.0)
    assert reported(steps).index(True) * 0.02 < 10.0
    assert not any(map(place_held, steps[-500:]))
    assert {step.sample.verdict.state for step in steps} == {State.ACTIVE}
    assert np.abs([step.truth.eta[Z] - 1.0 for step in steps[-500:]]).max() < 0.03
    assert np.abs([step.truth.eta[:2] for step in steps]).max() < 3.0
    while len(tries := tries_s(steps)) < 2:
        steps += dive.run(4.0)
        assert len(steps) < 7000
    assert tries[1] - tries[0] > 1.5 * tries[0]
    assert np.abs([step.truth.eta[:2] for step in steps]).max() < 8.0
    dive.fault("clear")
    dive.run(SETTLES_S)
    dive.ask(Request.ENGAGE)
    steps = dive.run(10.0)
    assert not any(reported(steps)[1:])
    assert np.abs([step.sample.dofs.e[X] for step in steps[-200:]]).max() < 0.1


def test_a_place_is_tried_again_when_the_evidence_is_gone():
    dive = turned_round()
    dive.run(12.0)
    dive.fault("clear")
    dive.run(50.0)
    steps = dive.run(10.0)
    assert all(map(place_held, steps))
    assert np.abs([step.sample.dofs.e[X] for step in steps[-200:]]).max() < 0.1


def test_a_compass_that_is_bent_is_reported_by_the_gyro_and_a_dvl_keeps_the_place():
    dive = Dive("sensors.dvl=true", setpoint=hold(x=0.0, y=0.0)).until(State.ACTIVE)
    dive.run(3.0)
    assert not any(reported(dive.run(3.0)))
    dive.fault("compass", value=20.0)
    steps = dive.run(20.0)
    assert 5.0 < reported(steps).index(True) * 0.02 < 20.0
    assert place_held(steps[-1])
    assert np.abs([step.truth.eta[:2] for step in steps]).max() < 0.1


def in_waves(height_m, period_s, *plant):
    waves = f'{{enabled=true, spectrum="regular", height_m={height_m}, period_s={period_s}}}'
    sea = (f"waves={waves}", "sensors.dvl=true", "sensors.dvl_drift_m=0", "initial.eta=[0,0,2,0,0,0]")
    dive = Dive(*sea, *plant, setpoint=hold(z=2.0, x=0.0, y=0.0))
    dive.tap.to_vehicle.append(Somebody().origin())
    return dive.until(State.ACTIVE, within_s=12.0)


@pytest.mark.parametrize("period_s", [4.0, 5.0])
def test_waves_that_thrust_counters_in_part_are_no_wrong_heading(period_s):
    """They move the vehicle against its thrust, coherently from the first one on."""
    steps = in_waves(1.2, period_s).run(12.0)
    assert not any(reported(steps))
    assert all(map(place_held, steps[50:]))


def test_where_the_thrust_does_not_suffice_in_waves_it_says_so_and_what_would():
    steps = in_waves(1.5, 8.0, "current.enabled=true", "current.speed_m_s=0.5").run(40.0)
    assert not any(reported(steps))
    assert all(map(place_held, steps[50:]))
    told = [step.sample.verdict for step in steps if Condition.SATURATED in step.sample.verdict.warnings]
    assert len(told) > 500
    assert max(int(verdict.remedy.split()[2]) for verdict in told) in range(70, 200)
    assert told[-1].remedy.endswith(f"N: {Condition.SATURATED.remedy}")
