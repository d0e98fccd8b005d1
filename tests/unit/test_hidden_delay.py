"""The delay that no stamp shows: found where it is, not found where it is not, and never at rest."""

import math

import numpy as np
import pytest

from companion import assembly
from companion.config import load_config
from companion.core import observers
from companion.core.hidden_delay import LARGEST_S, start, step
from companion.core.observer import Push, Sample
from companion.estimation.observer_design import Noise, observer_parameters

M, DRAG, LAG_S, DT_S = 28.0, 30.0, 0.15, 0.02
NOISE = Noise(0.0006, 0.0008, 0.003, 0.004, 1.0, slow_time_s=0.8)
PARAMETERS = observer_parameters(M, DRAG, LAG_S, NOISE, DT_S)


def found(hidden_s, seconds=60.0, force_n=5.0, noise_m=0.0005, inertia=1.0, drag=1.0, period_s=None):
    """Drive a vehicle open loop by a random force; its measurements lie `hidden_s` further back than said.

    It has so many times the model's inertia and drag. With a period it swings by 30 N beside.
    """
    rng = np.random.default_rng(1)
    per_tick, late = 10, round(hidden_s / (DT_S / 10))
    state, z, w, f, past = start(0.0, 0.0), 0.0, 0.0, 0.0, [(0.0, 0.0)] * (late + 2)
    random, u = 0.0, 0.0
    for tick in range(round(seconds / DT_S)):
        random = 0.98 * random + 0.4 * force_n * rng.standard_normal()
        u = random + (30.0 * math.sin(2.0 * math.pi * tick * DT_S / period_s) if period_s else 0.0)
        for _ in range(per_tick):
            f += (u - f) * DT_S / per_tick / LAG_S
            w += (f - drag * DRAG * w) / (inertia * M) * DT_S / per_tick
            z += w * DT_S / per_tick
            past.append((z, w))
        seen, before = np.array(past[-1 - late]), np.array(past[-2 - late])
        brought_up = seen + (seen - before) * per_tick / DT_S * state.hidden_s  # as the estimator does
        measured = brought_up + noise_m * rng.standard_normal(2)
        state = step(
            PARAMETERS, state, Push(u, M, DRAG, DT_S, u), 1.0, LAG_S, Sample(*measured.tolist()), 0.0
        )
    return state.hidden_s


@pytest.mark.parametrize("hidden_s", [0.0, 0.02, 0.04])
def test_open_loop_it_finds_what_is_there(hidden_s):
    assert found(hidden_s) == pytest.approx(hidden_s, abs=0.01)


@pytest.mark.parametrize(("inertia", "drag"), [(1.5, 1.0), (1.0, 2.0), (1.5, 0.5), (0.7, 1.5)])
@pytest.mark.parametrize("hidden_s", [0.0, 0.04])
def test_a_wrong_model_on_a_path_is_not_taken_for_delay(hidden_s, inertia, drag):
    there = found(hidden_s, force_n=3.0, inertia=inertia, drag=drag, period_s=6.0)
    assert there == pytest.approx(hidden_s, abs=0.012)


def test_it_stays_within_its_bounds():
    assert found(0.3) == LARGEST_S


def test_what_was_not_measured_teaches_nothing():
    state = start(0.0, 0.03)
    for tick in range(200):
        state = step(
            PARAMETERS,
            state,
            Push(10.0 * (tick % 2), M, DRAG, DT_S, 0.0),
            1.0,
            LAG_S,
            Sample(math.nan, math.nan),
            0.0,
        )
    assert state.hidden_s == 0.03


def test_a_delay_that_the_vehicles_file_knows_is_where_it_begins():
    known = assembly.observers(load_config(overrides=["thrusters.delay_s=0.06"]))
    assert observers.start(known).hidden.hidden_s == 0.06
