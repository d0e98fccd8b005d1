"""Gain and lag of the vehicle: found where it moves, left alone where it does not, and used with care."""

import math

import numpy as np
import pytest
from alone import Learner

from companion import assembly
from companion.config import load_config
from companion.core.observer import scheduled_parameters
from companion.core.positioning import jacobian
from companion.core.vehicle_model import (
    LAG_PER_S,
    LEAST_LAG_S,
    LOG_GAIN_PER_S,
    MOST_LAG_S,
    MOST_LOG_GAIN,
    PRIOR_LOG_GAIN,
    Evidence,
    Found,
    Theta,
    doubt,
    follow,
    learn,
)
from companion.estimation.observer_design import model_tables, vehicle
from companion.records import PSI, X, Y, Z

CONFIG = load_config()
MODEL = assembly.model(CONFIG)
TABLES = model_tables(CONFIG, MODEL)
LAG_S, DT_S = CONFIG.thrusters.lag_s, 0.02
EVERY, NONE = (True,) * 4, (False,) * 4
NORTH = jacobian(0.0)
NOTHING = Found(Theta(0.0, LAG_S), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("reported", [1e12, 1e20, 1e160, 1e300])
def test_evidence_that_tells_gain_and_lag_alike_divides_by_nothing(reported):
    """As rounding leaves it: the determinant of a matrix that is all the same number is zero."""
    found = Found(Theta(0.1, LAG_S), *[reported] * 6)
    learnt = learn(found, Evidence(1.0, 1.0, 1.0, *[reported] * 6), DT_S)
    assert abs(learnt.theta.log_gain) < MOST_LOG_GAIN
    assert not any(part < 0.0 for part in doubt(found))
    follow(Theta(0.0, LAG_S), found, 1.0)


def test_an_hour_of_telemetry_that_is_exactly_zero_makes_nothing_sure():
    """Without an EKF origin depth and climb are 0 to the last bit."""
    one = learner()
    known = set()
    for _ in range(300):
        one.step(Z, (0.0, MODEL.m[Z], MODEL.d1[Z], DT_S), (0.0, 0.0), NONE)
        known.add(repr(one.memory._replace(ticks=0)))
    assert len(known) == 1, "no tick adds anything: an hour is as these six seconds"
    assert dived(one, 3.0, LAG_S, 60.0).gain[Z] > 2.0


def learner():
    return Learner(TABLES, LAG_S, adapts=True)


def dived(
    of,
    gain,
    lag_s,
    seconds,
    force=0.25,
    dof=Z,
    heading=0.0,
    learns=EVERY,
    noise=0.001,
    seed=1,
    every=1,
    drag=1.0,
    period_s=None,
):
    """Move one degree of freedom of a vehicle open loop, by a random share of its largest force.

    Its drag is `drag` times the model's; with a period it swings, and nothing is random.
    """
    rng = np.random.default_rng(seed)
    J, u, f, v, q = jacobian(heading), 0.0, 0.0, 0.0, 0.0
    m, c, most = MODEL.m[dof], MODEL.d1[dof], CONFIG.axes[dof].max_force
    for tick in range(round(seconds / DT_S)):
        u = 0.97 * u + 0.24 * force * most * rng.standard_normal()
        if period_s:
            u = force * most * math.sin(2.0 * math.pi * tick * DT_S / period_s)
        for _ in range(10):
            f += (u - f) * (1.0 - math.exp(-0.1 * DT_S / lag_s))
            v += 0.1 * DT_S * gain * (f - drag * c * v / gain) / m
            q += 0.1 * DT_S * v
        of.turn(J)
        seen = q + noise * rng.standard_normal(), v + noise * rng.standard_normal()
        if tick % every:
            seen = math.nan, math.nan
        of.step(dof, (u, m, c, DT_S), seen, learns)
    return of.model


@pytest.mark.parametrize(("dof", "every"), [(X, 10), (Y, 2), (Z, 5), (PSI, 5)])
def test_data_that_come_seldom_make_nothing_sure(dof, every):
    """At 5 Hz heave and yaw diverged, and their doubt was 1e-24."""
    model = dived(learner(), 2.0, LAG_S, 20.0, dof=dof, noise=0.003, every=every)
    assert model.found_gain[dof] == pytest.approx(1.0, abs=0.2)
    assert model.log_gain_doubt[dof] > 0.5 * PRIOR_LOG_GAIN


@pytest.mark.parametrize(
    ("dof", "gain", "lag_s"),
    [(Z, 1.0, 0.15), (Z, 3.0, 0.05), (Z, 0.4, 0.25), (X, 3.0, LAG_S), (PSI, 3.0, LAG_S), (PSI, 0.4, LAG_S)],
)
def test_open_loop_it_finds_gain_and_of_heave_the_lag(dof, gain, lag_s):
    model = dived(learner(), gain, lag_s, 30.0, dof=dof)
    assert model.found_gain[dof] == pytest.approx(gain, rel=0.2)
    assert model.found_lag_s[dof] == pytest.approx(lag_s, rel=0.25, abs=0.02)
    assert min(gain, 1.0) <= model.gain[dof] <= max(gain, 1.0)
    assert model.log_gain_doubt[dof] < 0.3
    for other in {X, Y, Z, PSI} - {dof}:
        assert model.found_gain[other] == 1.0


@pytest.mark.parametrize("drag", [0.5, 1.0, 2.5])
def test_drag_that_the_model_lacks_is_not_taken_for_inertia(drag):
    model = dived(learner(), 1.0, LAG_S, 40.0, drag=drag, period_s=6.0)
    assert model.found_gain[Z] == pytest.approx(1.0, rel=0.25)


def test_what_is_found_is_used_only_where_that_is_wanted():
    idle = Learner(TABLES, LAG_S, adapts=False)
    model = dived(idle, 3.0, LAG_S, 20.0)
    assert model.found_gain[Z] > 2.0
    assert model.gain == (1.0,) * 4


def test_the_heading_tells_surge_from_sway():
    """Heading east, what moves it north is sway."""
    model = dived(learner(), 2.0, LAG_S, 20.0, dof=X, heading=math.pi / 2)
    assert model.found_gain[Y] == pytest.approx(2.0, rel=0.1)
    assert model.found_gain[X] == pytest.approx(1.0, abs=1e-3)
    assert model.dof_gain[X] == pytest.approx(model.gain[Y])


@pytest.mark.parametrize("changed", [{"force": 0.0}, {"learns": NONE}])
def test_what_does_not_move_or_may_not_learn_stays_nominal(changed):
    model = dived(learner(), 3.0, 0.05, 20.0, **changed)
    assert model.found_gain == model.gain == (1.0,) * 4
    assert model.found_lag_s == model.lag_s == (LAG_S,) * 4


def test_a_vehicle_that_changes_is_found_again():
    """A load of half the mass is taken: the gain falls to two thirds."""
    of = learner()
    assert dived(of, 1.0, LAG_S, 20.0).found_gain[Z] == pytest.approx(1.0, rel=0.1)
    of.begin(Z, 0.0)
    assert dived(of, 1 / 1.5, LAG_S, 20.0, seed=2).found_gain[Z] == pytest.approx(1 / 1.5, rel=0.15)


def test_between_its_nodes_the_table_is_near_the_riccati_equation():
    nominal = vehicle(CONFIG, MODEL, Z, CONFIG.heave.disturbance_noise)
    for log_gain, lag_s in ((0.35, 0.12), (-1.0, 0.2), (0.9, 0.06)):
        exact = nominal.like(log_gain, lag_s, 1)
        found = scheduled_parameters(TABLES[Z].control[0], log_gain, lag_s)
        assert found.by_rate.v == pytest.approx(exact.by_rate.v, rel=0.1)
        assert found.by_rate.d == pytest.approx(exact.by_rate.d, rel=0.2)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_it_stays_within_its_bounds_and_moves_slowly(sign):
    found, steps = NOTHING, []
    for _ in range(1000):
        before = found
        found = learn(found, Evidence(1e6 * sign, 1e6 * sign, 0.0, 1e4, 0.0, 0.0, 1e4, 0.0, 0.0), DT_S)
        steps.append(abs(np.subtract(found.theta, before.theta)))
    assert max(step for step, _ in steps) <= LOG_GAIN_PER_S * DT_S + 1e-12
    assert max(step for _, step in steps) <= LAG_PER_S * DT_S + 1e-12
    assert found.theta.log_gain == pytest.approx(sign * MOST_LOG_GAIN)
    assert found.theta.lag_s == (MOST_LAG_S if sign > 0 else LEAST_LAG_S)
