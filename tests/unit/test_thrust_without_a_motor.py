"""What three motors of a group give where the fourth is dead. The simulator's vehicle answers."""

import math

import numpy as np
import pytest
from true_thrust import true_wrench

from companion.core.allocation import (
    allocate,
    can_lose,
    delivered,
    overloaded,
    thrusters,
    turned_motor,
    without_motor,
)

FULL = (1.0,) * 6
UNBOUNDED = (1e6,) * 6
HEAVY = thrusters("vectored_6dof", UNBOUNDED, True)
LEVER_M = 0.085
"""How far below the centre of gravity the simulated Heavy's horizontal thrusters push."""


def heavy_without(dead):
    """The Heavy's thrusters that go on."""
    assert can_lose(HEAVY, dead)
    return without_motor(HEAVY, dead)


@pytest.mark.parametrize("dead", range(1, 9))
def test_the_three_others_give_the_whole_wrench(dead):
    """Exactly but for their dead bands; the vehicle within what whole µs leave."""
    rng = np.random.default_rng(dead)
    without_it = heavy_without(dead)
    for tau in rng.uniform(-1.0, 1.0, (50, 6)) * (7.0, 7.0, 15.0, 0.7, 0.7, 0.7):
        axes, saturated = allocate(without_it, tuple(tau.tolist()), 16.0, FULL)
        assert not any(saturated)
        assert not any(overloaded(without_it, axes))
        served = [0, 1, 3] if dead <= 4 else [2, 4, 5]
        np.testing.assert_allclose(
            np.array(delivered(without_it, axes, 16.0))[served], tau[served], atol=0.06
        )
        given = true_wrench("vectored_6dof", axes, dead=dead)
        given[4:] += LEVER_M * given[1], -LEVER_M * given[0]
        assert (np.abs(given - tau) <= [0.6, 0.6, 0.6, 0.1, 0.12, 0.12]).all()


@pytest.mark.parametrize(
    ("frame", "turned"), [("vectored_6dof", n) for n in range(1, 9)] + [("vectored", n) for n in range(1, 7)]
)
def test_a_motor_that_runs_the_other_way_round_gives_its_part(frame, turned):
    """The vehicle within what whole µs leave: a second kind of wrong would not cancel out there."""
    rng = np.random.default_rng(turned)
    as_it_is = turned_motor(thrusters(frame, UNBOUNDED, True), turned)
    served = [0, 1, 3] if turned <= 4 else [2, 4, 5] if frame == "vectored_6dof" else [2, 4]
    for tau in rng.uniform(-1.0, 1.0, (50, 6)) * (7.0, 7.0, 15.0, 0.7, 0.7, 0.7):
        axes, saturated = allocate(as_it_is, tuple(tau.tolist()), 16.0, FULL)
        assert not any(saturated)
        np.testing.assert_allclose(np.array(delivered(as_it_is, axes, 16.0))[served], tau[served], atol=0.15)
        if frame == "vectored_6dof":
            given = true_wrench(frame, axes, turned=turned)
            given[4:] += LEVER_M * given[1], -LEVER_M * given[0]
            assert (np.abs(given - tau) <= [0.8, 0.8, 0.8, 0.15, 0.16, 0.16]).all()


@pytest.mark.parametrize("heave_n", [-200.0, 200.0])
@pytest.mark.parametrize("dead", range(5, 9))
def test_beyond_what_they_have_they_keep_the_moments_and_give_less_heave(dead, heave_n):
    one = heavy_without(dead)
    axes, saturated = allocate(one, (0.0, 0.0, heave_n, 0.0, 0.8, -0.5), 16.0, FULL)
    assert saturated == (False, False, True, False, False, False)
    assert max(map(abs, axes)) <= 1.0
    assert not any(overloaded(one, axes))
    _, _, Z, _, K, M = delivered(one, axes, 16.0)
    assert pytest.approx(0.8, abs=0.05) == K
    assert pytest.approx(-0.5, abs=0.05) == M
    assert 15.0 < math.copysign(Z, heave_n * Z) < 60.0


def test_an_axis_stays_within_its_reach():
    """Roll and pitch more than a third of full stick are refused by the guard, and would be cut there."""
    for dead in range(5, 9):
        axes, _ = allocate(
            heavy_without(dead), (0.0, 0.0, 60.0, 0.0, 9.0, -9.0), 16.0, (1.0, 1.0, 1.0, 1.0, 0.48, 0.48)
        )
        assert max(map(abs, axes[4:])) <= 0.48 + 1e-9


def test_no_number_gives_no_number():
    axes, _ = allocate(heavy_without(5), (0.0, 0.0, math.nan, 0.0, 0.0, 0.0), 16.0, FULL)
    assert math.isnan(axes[2])


@pytest.mark.parametrize(
    ("frame", "tilts", "lost"),
    [
        ("vectored_6dof", True, []),
        ("vectored_6dof", False, [5, 6, 7, 8]),
        ("vectored", True, [5, 6]),
        ("vectored", False, [5, 6]),
    ],
)
def test_whose_loss_the_others_cannot_make_up_for(frame, tilts, lost):
    whole = thrusters(frame, UNBOUNDED, tilts)
    assert [motor for motor in range(1, whole.motor_count + 1) if not can_lose(whole, motor)] == lost
