"""A place in a current: held where thrust allows, and released without disturbing depth and heading."""

import numpy as np
import pytest
from virtual import Dive, Somebody, hold, shared

from companion.config import load_config
from companion.guidance.paths.shapes import build
from companion.guidance.paths.time_law import limits
from companion.records import Condition, Request, Setpoint, State
from companion.telemetry.operator_commands import Goto, SetPath
from companion.telemetry.plan import Circle, PathPlan
from lab.loop.dive import engaging, recorded
from lab.studies.trials import DEPTH_M, delayed

PLACE = {"x": 0.0, "y": 0.0, "z": 2.0, "psi": 0.0}
DVL = ("initial.eta=[0,0,2,0,0,0]", "sensors.dvl=true", "current.enabled=true", "current.sigma_m_s=0.02")


def current(speed_m_s, direction_deg, *plant):
    """A dive that has been told to hold PLACE in a current."""
    water = (f"current.speed_m_s={speed_m_s}", f"current.direction_deg={direction_deg}")
    dive = Dive(*DVL, *water, *plant, setpoint=hold(**PLACE))
    dive.tap.to_vehicle.append(Somebody().origin())
    return dive.until(State.ACTIVE)


A50 = (
    *("current.speed_m_s=0.3", "waves.enabled=true", "waves.height_m=0.3", "waves.period_s=4"),
    *("sensors.dvl_reports.enabled=true", "sensors.dvl_drift_m=0.0"),
)
"""A Water Linked A50 as it was recorded, in the water of config/sim-dvl-a50.toml."""


def believed_error_m(steps):
    """How far from the place the companion's own position is: a DVL's drift does not count."""
    return np.hypot(*np.array([step.sample.state.eta[:2] for step in steps]).T)


def test_a_current_that_takes_more_than_half_of_the_force_leaves_no_error():
    dive = current(0.45, 90.0)
    dive.run(18.0)
    assert believed_error_m(dive.run(2.0)).mean() < 0.02


def test_a_vehicle_that_tilted_as_it_stopped_a_drift_is_soon_at_its_place_again():
    turning = ("current.turn_deg_s=3", "waves.enabled=true", "tether.enabled=true")
    dive = current(0.5, 0.0, *turning)
    dive.run(16.0)
    assert believed_error_m(dive.run(3.0)).mean() < 0.1


def test_a_place_that_swings_against_a_current_in_waves_is_followed_behind_a_delay():
    """0.8 m north and back in 8 s, a current of 0.3 m/s to the north, 50 ms of delay each way."""

    def swing(t_s):
        phase = np.pi / 4.0 * max(t_s - 14.0, 0.0)
        x, x_dot, x_ddot = 1.0 - np.cos(phase), np.sin(phase), np.cos(phase) if t_s > 14.0 else 0.0
        at = (0.4 * x, 0.4 * np.pi / 4.0 * x_dot, 0.4 * (np.pi / 4.0) ** 2 * x_ddot)
        (x_m, *rates) = map(float, at)
        return Setpoint((x_m, 0.0, DEPTH_M, 0.0), *((rate, 0.0, 0.0, 0.0) for rate in rates))

    seed = 9001
    there = delayed(seed, "place")
    with engaging(load_config(), there.plant, swing(0.0), seed, there.link, surveyed=True) as loop:
        dived = recorded(list(loop.run(46.0, swing))).within(30.0, 46.0)
    off_m = np.hypot(*(dived.believed - dived.reference[:, :2]).T)
    assert dived.held
    assert off_m.max() < 0.2


@shared
def engaged_before_its_position():
    """A vehicle that drifts in a current, and gets a position when it has been engaged for a while."""
    late = 'faults=[{kind="message_stopped", message="LOCAL_POSITION_NED", duration_s=6.0}]'
    dive = Dive(*DVL, "current.speed_m_s=0.2", late, setpoint=hold(z=2.0))
    dive.tap.to_vehicle.append(Somebody().origin())
    return dive.until(State.ACTIVE)


@shared
def engaged_and_positioned():
    dive = engaged_before_its_position()
    dive.run(9.0 - dive.t_s)
    return dive


def offered(step):
    return bool(step.sample.verdict.warnings & Condition.POSITION_UNUSED)


def test_a_position_that_comes_during_a_dive_is_offered_and_not_taken_up_unasked():
    dive = engaged_before_its_position()
    before, after = dive.run(5.8 - dive.t_s), dive.run(5.0)
    assert not any(map(offered, before))
    assert all(map(offered, after[150:]))
    assert not any(any(step.sample.requested[:2]) for step in after)


@pytest.mark.parametrize("ask", ["hold here", "engage", "go"])
def test_a_position_that_came_is_taken_up_by_whoever_asks(ask):
    dive = engaged_and_positioned()
    there = np.array(dive.step.sample.state.eta[:2])
    if ask == "engage":
        dive.ask(Request.ENGAGE)
    else:
        dive.engine.guide(Goto(x_m=0.5, frame="offset") if ask == "go" else SetPath(action="hold"))
    dive.run(9.0)
    steps = dive.run(3.0)
    away = np.array([step.sample.state.eta[:2] for step in steps]) - there
    assert not any(map(offered, steps))
    assert np.ptp(away, axis=0).max() < 0.05
    assert np.abs(away - [0.5 if ask == "go" else 0.0, 0.0]).max() < 0.35


@pytest.mark.parametrize(
    ("base", "circles", "bound_mm"), [("sim-tank-heavy.toml", False, 30.0), ("sim-dvl-a50.toml", True, 80.0)]
)
def test_with_a_dvl_as_one_was_recorded(base, circles, bound_mm):
    """Late reports, invalid ones of which half are passed on, outages in which the EKF goes on without them.

    Truth against the place that is wanted, less what the DVL was off before.
    """
    dive = Dive(*DVL, *A50, "sensors.dvl_reports.invalid_passed=0.5", setpoint=hold(**PLACE), base=base)
    dive.tap.to_vehicle.append(Somebody().origin())
    dive.until(State.ACTIVE)
    dive.run(12.0)
    if circles:
        plan = PathPlan(circle=Circle(radius_m=1.5, x_m=-1.5, depth_m=2.0), laps=0, speed_mps=0.3)
        dive.engine.guide(build(plan, limits(dive.engine.config)))
    steps = dive.run(25.0)
    truth, believed, wanted = np.transpose(
        [(step.truth.eta[:2], step.sample.state.eta[:2], step.sample.eta_d[:2]) for step in steps], (1, 0, 2)
    )
    away_m = truth - wanted - (truth - believed)[0]
    assert all(step.sample.verdict.state is State.ACTIVE for step in steps)
    assert all(all(step.sample.dofs.engaged[:2]) for step in steps)
    assert 1e3 * np.sqrt(np.mean(np.sum(away_m**2, axis=1))) < bound_mm
