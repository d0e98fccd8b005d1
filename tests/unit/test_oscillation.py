"""A loop that swings by itself is noticed, and a sea, a load or a setpoint is not."""

import numpy as np
import pytest

from companion.core import oscillation
from companion.core.oscillation import (
    LEAST,
    RELAPSE_SHARE,
    SHARES,
    START,
    Parameters,
)
from companion.records import PSI, Z

DT_S = 0.02
MAX_N = 100.0
PARAMETERS = Parameters(MAX_N, SHARES[Z] * MAX_N)


def step(state, tau):
    return oscillation.watch(PARAMETERS, state, tau, DT_S)


def watched(demand, seconds=20.0):
    state, scale = START, []
    for i in range(round(seconds / DT_S)):
        state = step(state, demand(i * DT_S))
        scale.append(state.gain_scale)
    return np.array(scale)


def test_a_limit_cycle_draws_the_gains_back_within_two_seconds():
    scale = watched(lambda t_s: 60.0 * np.sign(np.sin(2.0 * np.pi * 1.2 * t_s)))
    assert scale[round(2.0 / DT_S)] < 0.4
    assert scale[-1] == pytest.approx(LEAST, abs=0.03)


def test_a_sea_is_no_limit_cycle():
    assert (watched(lambda t_s: 25.0 * np.sin(2.0 * np.pi * 0.3 * t_s)) == 1.0).all()


def test_a_load_costs_little_and_not_for_long():
    scale = watched(lambda t_s: 20.0 * (t_s > 5.0))
    assert scale.min() > 0.7
    assert scale[-1] > 0.95


def test_an_approach_that_rings_once_costs_the_gains_for_ten_seconds():
    scale = watched(lambda t_s: 42.0 * np.sign(np.sin(6.0 * t_s)) * (t_s < 1.5), seconds=20.0)
    assert scale.min() < 0.6
    assert scale[round(15.0 / DT_S) :].min() == 1.0


def test_a_cycle_that_begins_again_leaves_the_gains_lower():
    """At 0.7 of where it began for half a minute, whole after minutes: above that it may begin again."""

    def swinging(t_s):
        return 42.0 * np.sign(np.sin(6.0 * t_s)) * (t_s % 13.0 < 1.5 and t_s < 20.0)

    scale = watched(swinging, seconds=270.0)
    assert scale[round(60.0 / DT_S)] == pytest.approx(RELAPSE_SHARE, abs=0.1)
    assert scale[-1] == 1.0


def test_an_approach_after_a_cycle_does_not_confirm_it():
    """120 N less within 0.8 s, once: a vehicle that is braked at the end of its way."""

    def approaching(t_s):
        swinging = 42.0 * np.sign(np.sin(6.0 * t_s)) * (t_s < 1.5)
        return swinging + np.interp(t_s, [3.0, 6.0, 6.8, 8.0, 9.6], [0.0, 60.0, -60.0, -60.0, 0.0])

    assert watched(approaching, seconds=14.0)[-1] > 0.95


def test_a_violent_cycle_draws_the_gains_back_within_a_second():
    """The thrusters go from stop to stop: no transient does."""
    scale = watched(lambda t_s: 100.0 * np.sign(np.sin(2.0 * np.pi * 1.5 * t_s)))
    assert scale[round(1.0 / DT_S)] < 0.5


def test_a_violent_cycle_needs_no_second_one_to_be_believed():
    scale = watched(lambda t_s: 100.0 * np.sign(np.sin(2.0 * np.pi * 1.5 * t_s)) * (t_s < 3.0), seconds=30.0)
    assert scale[-1] == pytest.approx(RELAPSE_SHARE, abs=0.06)


def test_a_cycle_in_heading_is_noticed_when_it_asks_for_little():
    """0.65 Hz, ± a fifth of the largest moment: nothing else asks for so much there."""
    most_nm = 12.0
    state = START
    for i in range(round(8.0 / DT_S)):
        tau = 0.2 * most_nm * np.sin(2.0 * np.pi * 0.65 * i * DT_S)
        state = oscillation.watch(Parameters(most_nm, SHARES[PSI] * most_nm), state, tau, DT_S)
    assert state.gain_scale < 0.5


def growing(t_s):
    """5.5 Hz, twice as large after each swing: a vehicle that answers at once, three times as strongly."""
    return PARAMETERS.limit * 2.0 ** (11.0 * t_s - 4.0) * np.sin(2.0 * np.pi * 5.5 * t_s)


@pytest.mark.parametrize("full", [True, False], ids=["full authority", "ramp"])
def test_a_quick_cycle_is_ended_before_it_reaches_a_dozen_times_the_limit(full):
    state, t_s = START, 0.0
    while state.gain_scale == 1.0 and t_s < 2.0:
        state = oscillation.watch(PARAMETERS, state, growing(t_s), DT_S, full)
        t_s += DT_S
    assert state.gain_scale < 0.5
    assert 2.0 ** (11.0 * t_s - 4.0) < 12.0


def test_two_quick_swings_are_a_measurement_that_jumped():
    scale = watched(lambda t_s: 50.0 * (5.0 <= t_s < 5.06) - 50.0 * (5.06 <= t_s < 5.12))
    assert (scale == 1.0).all()


def test_after_a_relapse_the_gains_stay_lower():
    """A limit cycle that begins whenever the gains are above a half: each time they come back less far."""
    state = START
    began: list[int] = []
    for i in range(round(400.0 / DT_S)):
        over = state.gain_scale > 0.5
        if over and (not began or i - began[-1] > 10.0 / DT_S):
            began.append(i)
        on = bool(began) and i - began[-1] < 2.0 / DT_S
        state = step(state, on * 60.0 * np.sin(10.0 * i * DT_S))
    assert len(began) <= 9, "it hunts"
    assert np.diff(began[3:]).min() * DT_S > 50.0


def test_what_rings_and_dies_away_is_no_limit_cycle():
    scale = watched(lambda t_s: 90.0 * np.exp(-2.0 * t_s) * np.sin(10.0 * t_s))
    assert (scale == 1.0).all()


def test_what_nobody_can_push_is_not_counted():
    """Demand far beyond the largest force that goes up and down without a change of sign pushes the same."""
    assert (watched(lambda t_s: 500.0 + 300.0 * np.sin(8.0 * t_s)) == 1.0).all()


def test_a_number_gone_bad_is_no_limit_cycle_and_no_error():
    state = step(step(START, np.nan), np.inf)
    assert LEAST <= state.gain_scale <= 1.0
