"""Where the EKF's frame lies, seen from the one inside: after resets, and while fixes are followed."""

from math import hypot, nan

import numpy as np
import pytest

from companion.estimation.frame import (
    FOLLOWED_MPS,
    FOLLOWED_MPS2,
    FOLLOWED_RADPS,
    RESET_LASTS_S,
    RESET_M,
    STREAM_S,
    Frame,
    Offset,
)

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
    assert np.abs(np.diff(speeds)).max() <= FOLLOWED_MPS2 * TICK_S + 1e-9, "no jump of the velocity"
    phase = 10.0 * FOLLOWED_RADPS
    left_m = 0.5 * (1.0 + phase) * np.exp(-phase)
    assert hypot(frame.now.north_m, frame.now.east_m) == pytest.approx(left_m, rel=0.02)
    assert followed(fixed, 120.0)[0].now.north_m == pytest.approx(0.0, abs=1e-3)


def test_jumps_that_come_to_more_are_a_reset_and_so_are_those_soon_after_it():
    frame = Frame().jumped(0.6 * RESET_M, 0.0, 1.0, held=True).jumped(0.6 * RESET_M, 0.0, 1.2, held=True)
    assert frame.settled == frame.now == Offset(0.0, 1.2 * RESET_M, 0.0)
    frame = frame.jumped(0.2, 0.0, 5.0, held=True)
    assert frame.settled == frame.now
    frame = frame.jumped(0.2, 0.0, 1.3 + RESET_LASTS_S, held=True)
    assert frame.now.north_m - frame.settled.north_m == pytest.approx(0.2)


@pytest.mark.parametrize(("period_s", "jump_m"), [(1.0, 0.14), (2.0, 0.24), (5.0, 0.5), (10.0, 0.9)])
def test_jumps_that_keep_coming_are_the_noise_of_fixes_and_a_large_one_among_them_a_reset(period_s, jump_m):
    """So large are those of an EKF with a USBL of 0.5 m alone (SD of a component)."""
    rng, frame, t_s = np.random.default_rng(1), Frame(), 0.0
    before = frame
    while t_s < 600.0:
        t_s += period_s
        north_m, east_m = rng.normal(0.0, jump_m, 2).tolist()
        before, frame = frame, frame.jumped(north_m, east_m, t_s, held=t_s > STREAM_S + period_s)
        if t_s <= STREAM_S + 2.0 * period_s:
            settled = frame.settled
        frame, speeds = followed(frame, period_s)
        assert speeds.max() <= FOLLOWED_MPS + 1e-9
        assert frame.settled == settled
        assert hypot(*frame.owed) < 2.5
    lane = frame.jumped(6.0, 0.0, t_s + 1.0, held=True)
    assert lane.owed == frame.owed
    assert lane.now.north_m == pytest.approx(frame.now.north_m + 6.0)
    assert lane.settled.north_m == pytest.approx(settled.north_m + 6.0)
    assert before.has_fixes(t_s)
    assert not frame.has_fixes(t_s + 61.0)


def test_where_the_velocity_is_wrong_the_frame_moves_with_it():
    frame = Frame()
    for _ in range(round(5.0 / TICK_S)):
        frame = frame.followed(TICK_S, 0.08 + 0j, held=True)
    assert frame.velocity_inside(0.08 + frame.follows[0], 0.0) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert 0.2 < frame.now.north_m < 0.4
    assert frame.settled == Offset()


def test_where_nothing_is_held_a_jump_is_not_followed():
    jumped = Frame().jumped(0.5, 0.0, 1.0, held=False)
    assert jumped.settled == jumped.now
    released, _ = followed(Frame().jumped(0.5, 0.0, 1.0, held=True), 1.0, held=False)
    assert released.settled == released.now == Offset(0.0, 0.5, 0.0)
