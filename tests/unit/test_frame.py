"""Where the EKF's frame lies, seen from the one inside: after resets, and while fixes are followed."""

from math import hypot, nan

import numpy as np
import pytest

from companion.estimation.frame import FOLLOWED_MPS, RESET_LASTS_S, RESET_M, Frame, Offset

TICK_S = 0.02


def followed(frame, seconds, *, held=True):
    """Return the frame and how fast its offset moved, m/s, tick by tick."""
    speeds = []
    for _ in range(round(seconds / TICK_S)):
        before, frame = frame.now, frame.followed(TICK_S, held=held)
        speeds.append(hypot(frame.now.north_m - before.north_m, frame.now.east_m - before.east_m) / TICK_S)
    return frame, np.array(speeds)


def test_without_a_reset_nothing_is_rounded():
    eta = (0.1 + 0.2, -1e-17, 3.3, 7.0)
    assert Frame().now.outside(eta) == Frame().now.inside(eta) == eta


def test_where_nothing_is_left_to_follow_the_depths_offset_stays():
    frame = Frame(sunk_m=0.4).jumped(0.3, 0.0, 0.0, held=True)
    assert frame.followed(0.02, held=False).sunk_m == 0.4


def test_a_coordinate_that_is_not_set_stays_unset():
    now = Frame().jumped(3.0, 0.0, 1.0, held=True).now
    np.testing.assert_array_equal(now.outside((1.0, nan, nan, nan)), (4.0, nan, nan, nan))


def test_a_fix_is_followed_slowly_to_the_same_numbers():
    fixed = Frame().jumped(0.3, -0.4, 1.0, held=True)
    assert fixed.now == Offset(0.0, 0.3, -0.4)
    assert fixed.settled == Offset()
    frame, speeds = followed(fixed, 10.0)
    assert 0.0 < speeds.max() <= FOLLOWED_MPS + 1e-12
    assert hypot(frame.now.north_m, frame.now.east_m) == pytest.approx(0.5 * np.exp(-0.5), rel=0.01)
    assert followed(fixed, 120.0)[0].now.north_m == pytest.approx(0.0, abs=1e-3)


def test_jumps_that_come_to_more_are_a_reset_and_so_are_those_soon_after_it():
    frame = Frame().jumped(0.6 * RESET_M, 0.0, 1.0, held=True).jumped(0.6 * RESET_M, 0.0, 1.2, held=True)
    assert frame.settled == frame.now == Offset(0.0, 1.2 * RESET_M, 0.0)
    frame = frame.jumped(0.2, 0.0, 5.0, held=True)
    assert frame.settled == frame.now
    frame = frame.jumped(0.2, 0.0, 1.3 + RESET_LASTS_S, held=True)
    assert frame.now.north_m - frame.settled.north_m == pytest.approx(0.2)


def test_where_nothing_is_held_a_jump_is_not_followed():
    jumped = Frame().jumped(0.5, 0.0, 1.0, held=False)
    assert jumped.settled == jumped.now
    released, _ = followed(Frame().jumped(0.5, 0.0, 1.0, held=True), 1.0, held=False)
    assert released.settled == released.now == Offset(0.0, 0.5, 0.0)
