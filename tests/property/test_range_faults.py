"""A range that is wrong does not drive the vehicle into the ground, whatever is wrong with it.

The altitude hold and the ground's finder alone: the vehicle follows the wanted depth exactly, 0.15 s late.
"""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.estimation.ground import Grounds
from companion.guidance.altitude import AltitudeHold
from companion.records import Range

TICK_S, PERIOD_S = 0.02, 0.1
LATE_TICKS, TELEMETRY_S = 8, 0.02
MARGIN_M = 0.15
"""Of an altitude of 1 m: half of it is for the leg, 0.1 m for the nod, the rest for an answer by chance."""

FAULTS = {
    "stuck": lambda before_m, range_m, since_s, size: before_m,
    "false": lambda before_m, range_m, since_s, size: size,
    "drifts": lambda before_m, range_m, since_s, size: before_m + 0.01 * size * since_s,
    "wrong sign": lambda before_m, range_m, since_s, size: 2.0 * before_m - range_m,
    "scaled": lambda before_m, range_m, since_s, size: (1.3 + 0.4 * size) * range_m,
    "second echo now and then": lambda before_m, range_m, since_s, size: (
        (1 + since_s // (0.5 * size) % 2) * range_m
    ),
    "fish": lambda before_m, range_m, since_s, size: 0.5 * range_m if since_s % 10.0 < size else range_m,
    "stuck for a while": lambda before_m, range_m, since_s, size: before_m if since_s < size else range_m,
    "not a number": lambda before_m, range_m, since_s, size: math.nan,
}


def dived(
    fault=None, size=1.0, at_s=math.inf, scatter_m=0.01, delay_s=0.3, seconds=70.0, seed=1, bottom=None
):
    """Go from 5 m to an altitude of 1 m from 3 s on; return times, altitudes and whether it doubts."""
    rng, finder, hold = np.random.default_rng(seed), Grounds(0.3), AltitudeHold(1.0)
    bottom = bottom or (lambda t_s: 9.0)
    wanted, told, before_m, out = [4.0] * LATE_TICKS, [], math.nan, []
    for tick in range(round(seconds / TICK_S)):
        t_s, depth_m = tick * TICK_S, wanted[-LATE_TICKS]
        if tick % round(PERIOD_S / TICK_S) == 0:
            range_m = bottom(t_s) - depth_m
            before_m = range_m if t_s < at_s else before_m
            if t_s >= at_s:
                range_m = FAULTS[fault](before_m, range_m, t_s - at_s, size)
            told.append((t_s + delay_s, round(range_m + scatter_m * rng.standard_normal(), 2)))
        heard = []
        while told and told[0][0] <= t_s - TELEMETRY_S:
            heard += [Range(t_s, told.pop(0)[1])]
        ground = finder.step(t_s, heard, depth_m + 0.002 * rng.standard_normal(), 1.0, TELEMETRY_S)
        if t_s >= 3.0:
            hold.step(ground, wanted[-1], 0.5, 0.45, 0.4, TICK_S)
        wanted.append(hold.target[0] if t_s >= 3.0 else 4.0)
        out.append((t_s, bottom(t_s) - depth_m, hold.doubts))
    return np.array(out).T


@settings(max_examples=30)
@given(
    fault=st.sampled_from(sorted(FAULTS)),
    size=st.floats(0.5, 5.0),
    at_s=st.floats(2.0, 30.0),
    scatter_m=st.floats(0.0, 0.03),
    delay_s=st.floats(0.1, 0.5),
    seed=st.integers(0, 1000),
)
def test_a_wrong_range_keeps_the_vehicle_off_the_ground(fault, size, at_s, scatter_m, delay_s, seed):
    _, altitudes, _ = dived(fault, size, at_s, scatter_m, delay_s, seed=seed)
    assert altitudes.min() > MARGIN_M
    assert altitudes.max() < 7.6


@pytest.mark.parametrize("until_s", [15.0, 40.0])
def test_a_range_that_answers_again_is_believed_again(until_s):
    t_s, altitudes, doubts = dived("stuck for a while", until_s, at_s=2.0, seconds=90.0)
    held = (t_s > 8.0) & (t_s < until_s)
    assert doubts[held].all()
    assert np.ptp(altitudes[held]) < 0.21
    assert np.abs(np.diff(altitudes)).max() < 0.6 * TICK_S
    assert altitudes[t_s > 80.0] == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("delay_s", [0.0, 0.3, 0.8])
@pytest.mark.parametrize("rate_mps", [-0.06, 0.0, 0.045])
def test_a_sound_range_over_a_slope_is_believed(rate_mps, delay_s):
    _, altitudes, doubts = dived(delay_s=delay_s, bottom=lambda t_s: 9.0 + rate_mps * max(0.0, t_s - 20.0))
    assert doubts.mean() < 0.05
    assert altitudes.min() > 0.85
    assert altitudes[1000:] == pytest.approx(1.0, abs=0.22)
