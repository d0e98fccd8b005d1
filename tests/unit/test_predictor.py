"""The network that predicts the disturbance: better than "d stays" where d repeats, harmless elsewhere."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from companion import assembly
from companion.config import load_config
from companion.core import predictor
from companion.records import Z

PARAMETERS = assembly.predictor_of(load_config(), Z)
TICK_S, HORIZON_S = PARAMETERS.tick_s, 0.4
AHEAD = 20  # ticks


def run(d, rates=None, state=None):
    """Return the last state and the rise predicted at each tick of a disturbance."""
    state, rises = state or predictor.start(PARAMETERS), []
    for i, now in enumerate(d):
        rate, acceleration = (0.0, 0.0) if rates is None else rates[i]
        state = predictor.step(PARAMETERS, state, float(now), rate, acceleration, HORIZON_S)
        rises.append(state.predicted.rise)
    return state, np.array(rises)


def spared(d, rises, since_s=30.0):
    """Return the RMS that is left of what d rises, over that of "d stays"."""
    first, d = round(since_s / TICK_S), np.asarray(d)
    rose = d[first + AHEAD :] - d[first:-AHEAD]
    return np.sqrt(np.mean((rose - rises[first:-AHEAD]) ** 2) / np.mean(rose**2))


def times(seconds):
    return TICK_S * np.arange(round(seconds / TICK_S))


def swell(seconds, seed):
    """Waves of many periods about 4 s, 6 N."""
    rng, t = np.random.default_rng(seed), times(seconds)
    omegas = 2.0 * math.pi / rng.uniform(3.3, 5.0, 12)
    return sum(math.sqrt(6.0) * np.sin(omega * t + rng.uniform(0.0, 6.3)) for omega in omegas)


@pytest.mark.parametrize("d", [0.0, 7.0, -40.0])
def test_a_disturbance_that_stays_rises_by_nothing(d):
    _, rises = run([d] * 2000)
    np.testing.assert_array_equal(rises, 0.0)


@pytest.mark.parametrize("seed", range(3))
def test_of_waves_less_than_half_is_left(seed):
    d = swell(90.0, seed)
    assert spared(d, run(d)[1]) < 0.5


def test_on_a_path_the_reference_tells_what_the_model_lacks():
    """A mass that is 10 kg off, on a path that begins anew each 6 s with another amplitude."""
    rng, t = np.random.default_rng(4), times(120.0)
    swing = np.repeat(rng.uniform(0.05, 0.3, 20), round(6.0 / TICK_S))
    rate, acceleration = swing * np.sin(math.pi / 3.0 * t), swing * math.pi / 3.0 * np.cos(math.pi / 3.0 * t)
    d = 10.0 * np.concatenate((np.zeros(AHEAD), acceleration[:-AHEAD]))  # the reference is AHEAD of d
    known = run(d, list(zip(rate.tolist(), acceleration.tolist(), strict=True)))[1]
    assert spared(d, known) < 0.8 * spared(d, run(d)[1])


@pytest.mark.parametrize("step_n", [15.0, -15.0])
def test_a_step_that_nothing_announced_is_not_drawn_out(step_n):
    """Calm, then a load: d is never taken for more than a tenth beyond what it is."""
    noise = np.zeros(3000)
    for i, white in enumerate(np.random.default_rng(1).normal(0.0, 0.15, 2999)):
        noise[i + 1] = 0.96 * noise[i] + white  # as the observer's d, within half a second
    d = np.where(times(60.0) < 40.0, 0.0, step_n) + noise
    rises = run(d)[1]
    assert np.abs(rises).max() < 0.1 * abs(step_n)


def test_silence_forgets_the_past_and_keeps_what_was_learnt():
    d = swell(60.0, 5)
    learnt, _ = run(d)
    silent = predictor.interrupted(learnt)
    assert silent.W == learnt.W
    _, rises = run(swell(20.0, 6) + 30.0, state=silent)
    quiet = round(predictor.TAPS * predictor.SPACING_S / TICK_S)
    np.testing.assert_array_equal(rises[:quiet], 0.0)
    assert np.abs(rises[quiet:]).max() > 0.5


def test_a_motor_that_is_found_dead_is_no_step():
    """What it was believed to give goes from the whole past: the prediction is that of the twin."""
    d = swell(60.0, 7)
    state, _ = run(d[:2500])
    twin = run(d[2500:], state=state)[1]
    without = run(d[2500:] - 12.0, state=predictor.without_thrust(state, 12.0))[1]
    np.testing.assert_allclose(without, twin, atol=1e-6)


steps = st.lists(st.tuples(st.floats(-1e9, 1e9), st.integers(1, 200)), min_size=1, max_size=12)


@given(steps, st.floats(-3.0, 3.0), st.floats(0.02, 1.5))
@example([(0.0, 200), (1e9, 200), (-1e9, 200), (1e-3, 200)], 0.0, 0.4)
def test_for_any_steps_it_stays_finite_and_bounded(jumps, rate, horizon_s):
    state = predictor.start(PARAMETERS)
    for d, ticks in jumps:
        for _ in range(ticks):
            state = predictor.step(PARAMETERS, state, d, rate, -rate, horizon_s)
            assert abs(state.predicted.rise) <= PARAMETERS.max_disturbance
    n = len(state.W)
    P = np.array(state.P).reshape(n, n)
    assert np.isfinite(state.W).all()
    np.testing.assert_array_equal(P, P.T)
    assert np.linalg.eigvalsh(P)[0] > -1e-9
    assert np.trace(P) <= n * predictor.PRIOR * (1.0 + 1e-9)
