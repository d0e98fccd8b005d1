"""A loop that swings by itself is noticed, and a sea, a load or a setpoint is not taken for it."""

import numpy as np
import pytest

from companion.control.oscillation import LEAST, Oscillation

DT_S = 0.02
LIMIT_N = 12.0


def watched(demand, seconds=20.0):
    swing = Oscillation(np.full(4, LIMIT_N))
    scale = []
    for i in range(round(seconds / DT_S)):
        swing.step(np.array([0.0, 0.0, demand(i * DT_S), 0.0]), DT_S)
        scale.append(swing.gain_scale.copy())
    return np.array(scale)


def test_a_limit_cycle_draws_the_gains_back_within_two_seconds():
    scale = watched(lambda t_s: 60.0 * np.sign(np.sin(2.0 * np.pi * 1.2 * t_s)))
    assert scale[round(2.0 / DT_S), 2] < 0.4
    assert scale[-1, 2] == pytest.approx(LEAST, abs=0.02)
    assert (scale[:, [0, 1, 3]] == 1.0).all()


def test_a_sea_is_no_limit_cycle():
    assert (watched(lambda t_s: 25.0 * np.sin(2.0 * np.pi * 0.3 * t_s)) == 1.0).all()


def test_a_load_costs_little_and_not_for_long():
    scale = watched(lambda t_s: 20.0 * (t_s > 5.0))[:, 2]
    assert scale.min() > 0.7
    assert scale[-1] > 0.95


def test_engaging_or_a_setpoint_is_no_limit_cycle():
    """Two half-swings of 60 N, as a large error makes them: they pass."""
    scale = watched(lambda t_s: 60.0 * np.sin(2.0 * np.pi * 1.2 * t_s) * (t_s < 1.0 / 1.2))
    assert (scale == 1.0).all()


def test_the_gains_come_back_when_it_is_quiet():
    scale = watched(lambda t_s: 60.0 * np.sign(np.sin(8.0 * t_s)) * (t_s < 5.0), seconds=40.0)[:, 2]
    assert scale.min() == pytest.approx(LEAST, abs=0.02)
    assert scale[-1] == 1.0


def test_reset_gives_full_gains():
    swing = Oscillation(np.full(4, LIMIT_N))
    for i in range(200):
        swing.step(np.full(4, 80.0 * (-1) ** (i // 20)), DT_S)
    assert swing.gain_scale.max() < 1.0
    swing.reset()
    assert (swing.gain_scale == 1.0).all()
