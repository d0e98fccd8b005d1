"""What a tilt leaves of thrust: shares, the body's axes, the force that is found to be borne, the pace."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.assembly import tilt_limit
from companion.config import load_config
from companion.core.tilt import (
    CUT,
    FAST_N_PER_S,
    LEVEL_RAD,
    SLOW_N_PER_S,
    STEEP_RAD,
    TiltLimit,
    allowed_n,
    body_force,
    coming_tilt,
    find_limit,
    level_force,
    share,
    start,
)

TICK_S = 0.02
ANGLES = st.floats(-math.pi, math.pi)
FORCES = st.tuples(*[st.floats(-100.0, 100.0)] * 3)


def test_nothing_is_taken_from_a_level_vehicle_and_all_from_a_steep_one():
    assert share(0.0) == share(LEVEL_RAD) == 1.0
    assert share(STEEP_RAD) == share(3.0) == share(math.nan) == 0.0
    shares = [share(tilt) for tilt in np.linspace(LEVEL_RAD, STEEP_RAD, 100)]
    assert (np.diff(shares) <= 0.0).all()
    assert -np.diff(shares).min() < 0.02


@pytest.mark.parametrize("unknown", range(4))
def test_an_unknown_tilt_leaves_nothing(unknown):
    angles = [0.0] * 4
    angles[unknown] = math.nan
    assert share(coming_tilt(*angles)) == 0.0


@given(ANGLES, st.floats(-1.5, 1.5), FORCES)
def test_a_force_is_as_long_in_either_frame(roll, pitch, force):
    assert np.linalg.norm(level_force(roll, pitch, force)) == pytest.approx(np.linalg.norm(force))


@given(st.floats(-0.7, 0.7), st.floats(-0.7, 0.7), FORCES)
def test_heave_is_what_was_asked_however_it_tilts(roll, pitch, force):
    tilt = coming_tilt(roll, pitch, 0.0, 0.0)
    pushed = level_force(roll, pitch, body_force(roll, pitch, tilt, force))
    assert pushed[2] == pytest.approx(force[2], abs=1e-9)


def test_a_small_tilt_is_left_to_the_vertical_thrusters():
    assert body_force(0.05, -0.03, 0.06, (0.0, 0.0, 30.0))[:2] == (0.0, 0.0)


@pytest.mark.parametrize(("roll", "pitch"), [(0.3, 0.0), (0.0, -0.3), (0.25, 0.25)])
def test_heave_on_a_tilted_vehicle_does_not_push_it_sideways(roll, pitch):
    tilt = coming_tilt(roll, pitch, 0.0, 0.0)
    pushed = level_force(roll, pitch, body_force(roll, pitch, tilt, (0.0, 0.0, -40.0)))
    np.testing.assert_allclose(pushed, (0.0, 0.0, -40.0), atol=1.5)


@given(ANGLES, ANGLES, FORCES)
def test_whatever_the_tilt_the_force_is_bounded(roll, pitch, force):
    pushed = body_force(roll, pitch, coming_tilt(roll, pitch, 0.0, 0.0), force)
    assert np.isfinite(pushed).all()
    assert np.linalg.norm(pushed) <= 6.0 * np.linalg.norm(force) + 1e-9


def test_on_its_side_heave_rests_and_overturned_it_pushes_the_other_way_round():
    assert body_force(math.pi / 2.0, 0.0, math.pi / 2.0, (0.0, 0.0, 10.0))[2] == pytest.approx(0.0, abs=1e-9)
    assert body_force(math.pi, 0.0, math.pi, (0.0, 0.0, 10.0))[2] == pytest.approx(-10.0)


class Found:
    """What a limit allows, tick by tick."""

    def __init__(self, *limit):
        self.limit = TiltLimit(*limit)
        self.state = start(self.limit)


def after(found, seconds, tilt=0.0, pushed_n=8.0):
    for _ in range(round(seconds / TICK_S)):
        found.state = find_limit(found.limit, found.state, tilt, pushed_n, TICK_S)
    return allowed_n(found.state, tilt)


def test_the_force_rises_until_the_vehicle_tilts_and_then_stays_below_that():
    limit = Found(2.0, 100.0, 0.1, SLOW_N_PER_S)
    assert after(limit, 6.0) == pytest.approx(2.0 + 6.0 * FAST_N_PER_S)
    assert after(limit, TICK_S, tilt=0.12) == pytest.approx(CUT * 8.0, rel=0.1)
    borne = after(limit, 1.0)
    assert after(limit, 4.0) == pytest.approx(borne, rel=0.1)


def test_one_tilt_cuts_once():
    limit = Found(50.0, 50.0, 0.1, SLOW_N_PER_S)
    after(limit, 10.0, pushed_n=50.0)
    once = after(limit, TICK_S, tilt=0.12, pushed_n=50.0)
    assert after(limit, 3.0, tilt=0.12, pushed_n=50.0) == once
    assert once == pytest.approx(CUT * 50.0, rel=0.01)


def test_a_wave_that_tilts_a_levelled_vehicle_leaves_the_force_that_holds_a_current():
    """In 3 s with a limit below the current's 12 N it drifted by 0.1 m."""
    found = Found(*tilt_limit(load_config()))
    after(found, 10.0, tilt=0.05, pushed_n=12.0)
    after(found, 0.6, tilt=math.radians(17.0), pushed_n=12.0)
    assert after(found, TICK_S, tilt=0.05) > 11.5


def test_a_levelled_vehicle_that_tilted_once_soon_pushes_against_a_current_again():
    """On the firmware it tilted while it stopped a drift, and then drifted off for minutes."""
    limit = Found(99.0, 99.0, 0.26, FAST_N_PER_S)
    after(limit, 10.0, tilt=0.05, pushed_n=25.0)
    assert after(limit, TICK_S, tilt=0.3, pushed_n=25.0) < 25.0
    assert after(limit, 20.0, tilt=0.05, pushed_n=25.0) > 25.0
