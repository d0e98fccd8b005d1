"""What samples of depth and heading show of themselves: white noise, repeats, delay behind the rate."""

import math
from typing import NamedTuple

import numpy as np
import pytest

from companion.estimation.sample_meter import SampleMeter

CONFIGURED = 0.0006
TICK_S = 0.02
STEP_M = 0.001
"""Of relative_alt."""


class Source(NamedTuple):
    """Samples of a moving depth."""

    noise: float = 0.0
    late_s: float = 0.0
    each: int = 1
    """Ticks for which it repeats a reading."""
    swing: float = 0.3
    """Of the motion, m."""


EKF, BAROMETER, BAR30 = Source(), Source(0.012, 0.07, 5), Source(0.003, 0.07, 5)


def sampled(meter, source, seconds, start_s=0.0, seed=1):
    """Let a meter take a source; return what it made of the samples, less the truth."""
    rng = np.random.default_rng(seed)
    errors, reading = [], 0.0
    for k in range(round(seconds / TICK_S)):
        t_s = start_s + k * TICK_S
        phase = 0.9 * t_s
        meter.rate(t_s, source.swing * 0.9 * math.cos(phase) + 0.0008 * rng.standard_normal())
        if k % source.each == 0:
            true = source.swing * math.sin(phase - 0.9 * source.late_s)
            reading = STEP_M * round((true + source.noise * rng.standard_normal()) / STEP_M)
        value = meter.position(t_s, reading)
        if value is not None:
            errors.append(value - source.swing * math.sin(phase))
    return np.array(errors)


def meter(configured=CONFIGURED, later_s=0.0, angular=False):
    return SampleMeter(configured, later_s, angular=angular)


@pytest.mark.parametrize("swing", [0.3, 0.002])
@pytest.mark.parametrize("noise", [0.003, 0.012, 0.1])
@pytest.mark.parametrize("each", [1, 5])
def test_white_noise_is_measured_whether_the_vehicle_moves_or_not(noise, each, swing):
    depth = meter()
    sampled(depth, Source(noise, 0.0, each, swing), 30.0)
    assert depth.noise == pytest.approx(noise, rel=0.6)


@pytest.mark.parametrize("swing", [0.0, 0.002, 0.3])
def test_a_depth_that_is_as_believed_keeps_its_noise_and_every_sample_to_the_last_bit(swing):
    depth = meter()
    rng = np.random.default_rng(1)
    slow = 0.0
    for k in range(3000):
        slow += TICK_S / 0.8 * (-slow) + 0.003 * math.sqrt(2.0 * TICK_S / 0.8) * rng.standard_normal()
        depth.rate(k * TICK_S, swing * math.cos(k * TICK_S))
        z_m = STEP_M * round((swing * math.sin(k * TICK_S) + slow) / STEP_M)
        assert depth.position(k * TICK_S, z_m) == z_m
    assert (depth.noise, depth.later_s) == (CONFIGURED, 0.0)


@pytest.mark.parametrize("late_s", [0.04, 0.07, 0.12])
def test_a_late_depth_is_brought_on_to_the_time_of_its_rate(late_s):
    depth = meter()
    sampled(depth, Source(0.012, late_s, 5), 20.0)
    errors = sampled(depth, Source(0.012, late_s, 5), 40.0, start_s=20.0)
    assert depth.later_s == pytest.approx(late_s, abs=0.03)
    assert errors.std() < 0.015
    assert len(errors) == pytest.approx(400, abs=20), "what repeats a reading is left out"


def test_the_source_may_change_in_mid_dive():
    depth = meter()
    for number, source in enumerate((EKF, BAROMETER, EKF, BAR30)):
        sampled(depth, source, 40.0, start_s=40.0 * number)
        assert (depth.noise > CONFIGURED) is (source is not EKF)
        assert depth.later_s == pytest.approx(source.late_s, abs=0.03)


def test_a_heading_that_is_noisier_than_believed_is_measured_too_across_the_turn():
    heading, rng = meter(0.002, angular=True), np.random.default_rng(1)
    for k in range(2000):
        heading.rate(k * TICK_S, 0.5)
        yaw = 0.5 * k * TICK_S + 0.02 * rng.standard_normal()
        heading.position(k * TICK_S, (yaw + math.pi) % math.tau - math.pi)
    assert heading.noise == pytest.approx(0.02, rel=0.5)
