"""The watch of the heading: what thrust makes of the velocity, and what the gyro says."""

import cmath
import math

import numpy as np
import pytest

from companion.core.positioning import Model
from companion.estimation.heading_watch import HeadingWatch, HeaveWatch
from companion.records.state import NOMINAL

MASS = (20.0, 20.0, 30.0, 0.5)
STILL = (0.0, 0.0, 0.0, 0.0)
DT_S = 0.02


def watched(error_deg, push_n, current_mps=0.0, seconds=30.0, answer=1.0, mirrored=False):
    """Push a mass, which moves by `answer` of what the model says, by a heading that is off, or mirrored."""
    watch, v, noise = HeadingWatch(), 0j, np.random.default_rng(1)
    model = NOMINAL._replace(lag_s=(0.02,) * 4)
    for tick in range(round(seconds / DT_S)):
        t_s = tick * DT_S
        push = push_n * complex(math.sin(1.3 * t_s), math.cos(0.9 * t_s))
        pushed = push.conjugate() if mirrored else push
        v += answer * pushed / MASS[0] * cmath.exp(-1j * math.radians(error_deg)) * DT_S
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


@pytest.mark.parametrize("error_deg", [0.0, 90.0, -135.0])
def test_exchanged_motors_are_told_by_a_motion_that_is_mirrored(error_deg):
    assert watched(error_deg, 20.0, current_mps=0.5, mirrored=True).lost


def test_a_backward_compass_is_told_where_the_ekf_turns_accelerations_too():
    """As on 4.5.7: what is slower than its filter goes the other way, what is faster seems to obey."""
    watch, v, slow = HeadingWatch(), 0.0, 0.0
    nominal, model = Model(MASS, (60.0,) * 4, STILL), NOMINAL._replace(lag_s=(0.02,) * 4)
    for tick in range(round(14.0 / DT_S)):
        push = min(0.1 * math.exp(0.9 * tick * DT_S), 60.0)
        v -= (push + 60.0 * v) / MASS[0] * DT_S
        slow += 1.0 * (v - slow) * DT_S
        seen = complex(slow - (v - slow))
        watch.push(seen, 0.0, (push, 0.0, 0.0, 0.0), nominal, model, 0.0, DT_S, pushes=True)
    assert watch.check.lost


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


@pytest.mark.parametrize(
    ("answer", "load_n", "opposed"),
    [(1.0, 0.0, False), (-1.0, 0.0, True), (0.0, 0.0, False), (1.0, 60.0, False)],
)
def test_a_vehicle_that_moves_against_its_vertical_thrust_is_told(answer, load_n, opposed):
    """As with reversed motors, or a depth of the wrong sign; a load that pulls it down is no such thing."""
    watch, w, noise = HeaveWatch(), 0.0, np.random.default_rng(1)
    nominal, model = Model(MASS, (0.0, 0.0, 60.0, 0.0), STILL), NOMINAL._replace(lag_s=(0.02,) * 4)
    told = False
    for tick in range(round(8.0 / DT_S)):
        push = 40.0 * math.sin(1.3 * tick * DT_S) + 20.0 * math.sin(5.0 * tick * DT_S)
        w += (answer * push + load_n - 60.0 * w) / MASS[2] * DT_S
        seen = w + 0.003 * noise.standard_normal()
        told |= watch.step(seen, push, nominal, model, 0.0, DT_S, pushes=True)
    assert told is opposed
    assert not watch.step(w, 0.0, nominal, model, 0.0, DT_S, pushes=False)
