"""What is measured answers what is done: which samples are not believed, and since when."""

import math

import numpy as np
import pytest

from companion.estimation.answers import (
    FROZEN_S,
    LEAST_M,
    AttitudeAnswers,
    DepthAnswers,
    ExactRepeats,
)
from companion.records.events import Attitude

TICK_S = 0.02


def fed(values, repeats=None, tick_s=TICK_S):
    repeats = repeats or ExactRepeats()
    for i, value in enumerate(values):
        repeats.step(i * tick_s, value)
    return repeats


def noise(n, seed=1):
    return list(np.random.default_rng(seed).normal(0.0, 1e-3, n))


def test_a_fine_signal_that_repeats_is_frozen_from_its_last_change_on():
    noisy = noise(200)
    stuck = fed([*noisy, *[noisy[-1]] * 30])
    assert stuck.since_s == pytest.approx(199 * TICK_S)
    assert not stuck.frozen(stuck.since_s + FROZEN_S - 0.01)
    assert stuck.frozen(stuck.since_s + FROZEN_S + 0.01)
    assert not fed([*noisy, *[noisy[-1]] * 30, 0.5]).frozen(10.0)


@pytest.mark.parametrize(
    "values",
    [
        [round(0.3 * math.exp(-0.05 * i), 2) for i in range(1000)],
        [math.exp(-0.1 * i) for i in range(10000)],
        [0.0] * 1000,
    ],
    ids=["rounded and at rest", "decays to nothing", "never anything"],
)
def test_a_rounded_signal_and_one_that_comes_to_rest_may_repeat(values):
    repeats = ExactRepeats()
    for i, value in enumerate(values):
        repeats.step(i * TICK_S, value)
        assert not repeats.frozen(i * TICK_S)


def test_a_few_repeats_of_a_slow_stream_are_none():
    noisy = noise(200)
    assert not fed([*noisy, *[noisy[-1]] * 3], tick_s=0.25).frozen(203 * 0.25)


def dive(depth_of, climb_of, pressure_of=None, seconds=8.0):
    """The first doubt and its time, of depths, climb rates and pressures that are functions of time."""
    answers, errors = DepthAnswers(), noise(round(seconds / TICK_S))
    for i, error in enumerate(errors):
        t_s = i * TICK_S
        answers.rate(t_s, climb_of(t_s) + error)
        if pressure_of is not None and i % 25 == 0:
            answers.pressure(t_s, pressure_of(t_s))
        believed_s, doubt = answers.position(t_s, round(depth_of(t_s), 3))
        if doubt:
            return t_s, believed_s, doubt
    return None


def swing(t_s):
    return 3.0 - 0.3 * math.cos(t_s)


def rate(t_s):
    return 0.3 * math.sin(t_s)


def slide(t_s):
    return min(max(t_s - 3.0, 0.0), 1.0)


@pytest.mark.parametrize(
    ("depth", "climb", "pressure"),
    [
        (swing, rate, swing),
        (swing, rate, None),
        (lambda t: 0.71 * swing(t - 0.15), rate, None),
        (lambda t: swing(t) + 0.4 * (t > 3.0), rate, None),
        (lambda t: 3.0 + slide(t), lambda t: 0.0, lambda t: 3.0),
        (lambda t: 3.0, lambda t: 0.004, None),
    ],
    ids=["sound", "no pressure", "an EKF with GPS", "its zero moves", "its zero slides", "at rest"],
)
def test_a_depth_that_answers_is_believed(depth, climb, pressure):
    assert dive(depth, climb, pressure) is None


@pytest.mark.parametrize(
    ("depth", "climb", "pressure", "words"),
    [
        (lambda t: 3.0, rate, None, "the depth repeats"),
        (lambda t: 3.0 + 0.001 * (t > 0.5), lambda t: 0.02, None, "the depth repeats"),
        (swing, lambda t: -rate(t), None, "different motions"),
        (swing, lambda t: -rate(t), swing, "different motions"),
        (swing, lambda t: 0.0, swing, "different motions"),
        (lambda t: 3.0 + slide(t), lambda t: 0.0, None, "different motions"),
    ],
)
def test_a_depth_that_does_not_is_doubted(depth, climb, pressure, words):
    t_s, believed_s, doubt = dive(depth, climb, pressure)
    assert words in doubt
    assert believed_s < t_s
    assert t_s < 4.0 or abs(climb(t_s)) * t_s < 2.0 * LEAST_M


@pytest.mark.parametrize("step_m", [0.0, 0.001], ids=["fine", "rounded"])
def test_a_pressure_that_hangs_is_told_after_two_seconds_unless_it_is_rounded(step_m):
    answers, errors = DepthAnswers(), noise(600)
    doubts = []
    for i, error in enumerate(errors):
        t_s = i * TICK_S
        answers.rate(t_s, error)
        if i % 5 == 0:
            reading_m = 3.0 + errors[min(i, 300)]
            answers.pressure(t_s, round(reading_m / step_m) * step_m if step_m else reading_m)
        believed_s, doubt = answers.position(t_s, 3.0 + error)
        doubts += [(t_s, believed_s, doubt)] if doubt else []
    if step_m:
        assert not doubts
    else:
        t_s, believed_s, doubt = doubts[0]
        assert t_s - believed_s == pytest.approx(2.0, abs=0.1)
        assert believed_s == pytest.approx(300 * TICK_S)
        assert "the pressure repeats" in doubt


def test_a_depth_sensor_that_the_autopilot_reports_is_not_believed():
    answers = DepthAnswers()
    assert answers.position(0.0, 3.0) == (0.0, "")
    answers.healthy = False
    assert answers.position(0.1, 3.0) == (-math.inf, "the autopilot reports its depth sensor unhealthy")


def attitude(t_s, yaw, r, roll=0.0, p=0.0):
    return Attitude(t_s, t_s, roll, 0.0, yaw, p, 0.0, r)


def turned(yaw_of, gyro_of, seconds=6.0):
    answers, errors = AttitudeAnswers(), noise(round(seconds / TICK_S))
    for i, error in enumerate(errors):
        t_s = i * TICK_S
        one = attitude(t_s, yaw_of(t_s) + 0.1 * error, gyro_of(t_s) + error)
        _, doubt = answers.step(one)
        if doubt:
            return doubt
    return ""


def test_an_angle_may_go_without_its_gyro_but_not_the_other_way():
    assert turned(lambda t: 0.3 * t, lambda t: 0.3) == ""
    assert turned(lambda t: 0.1 * t, lambda t: 0.0) == "", "an EKF that follows its compass"
    assert turned(lambda t: 0.5 * (t > 2.0), lambda t: 0.0) == "", "a reset"
    assert turned(lambda t: 0.3 * t, lambda t: -0.3) == "yaw: gyro and angle turn opposite ways"
