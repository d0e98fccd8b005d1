"""The watch of the heading: what thrust makes of the velocity, and what the gyro says."""

import cmath
import math

import numpy as np
import pytest

from companion.core.positioning import Model
from companion.estimation.heading_watch import HeadingWatch
from companion.records.state import NOMINAL

MASS = (20.0, 20.0, 30.0, 0.5)
STILL = (0.0, 0.0, 0.0, 0.0)
DT_S = 0.02


def watched(error_deg, push_n, current_mps=0.0, seconds=30.0, answer=1.0):
    """Push a mass, which moves by `answer` of what the model says, with a heading that is off."""
    watch, v, noise = HeadingWatch(), 0j, np.random.default_rng(1)
    model = NOMINAL._replace(lag_s=(0.02,) * 4)
    for tick in range(round(seconds / DT_S)):
        t_s = tick * DT_S
        push = push_n * complex(math.sin(1.3 * t_s), math.cos(0.9 * t_s))
        v += answer * push / MASS[0] * cmath.exp(-1j * math.radians(error_deg)) * DT_S
        white = 0.003 * complex(*noise.standard_normal(2))
        seen = v + white + current_mps
        tau = (push.real, push.imag, 0.0, 0.0)
        nominal = Model(MASS, STILL, STILL)
        watch.turn(0.0, 0.0, DT_S, turns=True)
        watch.push(seen, 0.0, tau, nominal, model, 0.0, DT_S, pushes=True)
    return watch.check


@pytest.mark.parametrize("error_deg", [-135.0, -60.0, 0.0, 20.0, 90.0])
def test_the_course_shows_by_how_much_the_heading_is_off(error_deg):
    check = watched(error_deg, 20.0, current_mps=0.5)
    assert math.degrees(check.course_rad) == pytest.approx(-error_deg, abs=10.0)
    assert check.lost is check.doubtful is (abs(error_deg) > 45.0)


@pytest.mark.parametrize(("answer", "lost"), [(0.45, True), (0.25, False)])
def test_a_backward_compass_is_told_by_half_the_answer_and_not_by_a_quarter(answer, lost):
    """So little answered a vehicle of 4.5.7 that ran away for good; a countered disturbance answers less."""
    assert watched(180.0, 20.0, answer=answer).lost is lost


@pytest.mark.parametrize("period_s", [4.5, 6.0, 8.0, 10.0])
@pytest.mark.parametrize("share", [0.5, 0.75])
def test_a_narrow_sea_of_which_thrust_takes_a_share_says_nothing_of_the_heading(period_s, share):
    """The vehicle moves against its thrust, with all coherence, at one frequency; above is noise."""
    watch, v, noise = HeadingWatch(), 0.3 + 0j, np.random.default_rng(1)
    reported = []
    for tick in range(round(60.0 / DT_S)):
        wave = 20.0 * math.cos(math.tau * tick * DT_S / period_s)
        push = -share * wave + 1.5 * noise.standard_normal()
        v += (wave + push) / MASS[0] * DT_S
        seen = v + 0.003 * complex(*noise.standard_normal(2))
        tau = (push, 0.0, 0.0, 0.0)
        watch.push(seen, 0.0, tau, Model(MASS, STILL, STILL), NOMINAL, 0.0, DT_S, pushes=True)
        reported.append(watch.check.doubtful)
    assert not any(reported)


def test_a_vehicle_that_is_not_pushed_says_nothing():
    check = watched(90.0, 0.5)
    assert math.isnan(check.course_rad)
    assert not check.doubtful


@pytest.mark.parametrize(
    ("compass_radps", "gyro_radps", "reported"),
    [(0.0, 0.0, False), (0.004, 0.0, True), (0.5, 0.5, False), (0.5, 0.495, False)],
)
def test_a_heading_that_turns_without_the_gyro_is_reported(compass_radps, gyro_radps, reported):
    watch = HeadingWatch()
    for tick in range(round(90.0 / DT_S)):
        psi = math.remainder(compass_radps * tick * DT_S, math.tau)
        watch.turn(psi, gyro_radps, DT_S, turns=True)
    assert watch.check.doubtful is reported
    assert not watch.check.lost
