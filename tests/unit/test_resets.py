"""What is a reset of the EKF and what is motion."""

from math import degrees, radians

import numpy as np
import pytest

from companion.control.bounds import wrap
from companion.estimation.resets import POSITION_RESET_M, ResetDetector, position_resets, yaw_resets


def resets(detector, samples):
    """All resets (not 0) that the detector finds in (time, value, rate)."""
    return [reset for sample in samples if (reset := detector.step(*sample))]


def blow(t_s, length_s=0.3):
    """Angle and rate of 40° that a blow at t = 1 s makes: a rate that rises and falls evenly."""
    half, peak = 0.5 * length_s, 2.0 * radians(40.0) / length_s
    since = min(max(t_s - 1.0, 0.0), length_s)
    rising = min(since, half)
    falling = since - rising
    angle = 0.5 * peak * rising**2 / half + peak * falling - 0.5 * peak * falling**2 / half
    return angle, peak * (rising - falling) / half


def sampled(motion, hz, seconds=3.0, start=0.0):
    times = np.arange(0.0, seconds, 1.0 / hz)
    return [(t, wrap(start + motion(t)[0]), motion(t)[1]) for t in times.tolist()]


@pytest.mark.parametrize("hz", [50.0, 20.0, 10.0, 4.0, 2.1])
@pytest.mark.parametrize("start", [0.0, 3.1, -3.1])
@pytest.mark.parametrize("length_s", [0.3, 0.5, 1.0])
def test_a_turn_that_the_gyro_shows_is_none(hz, start, length_s):
    assert resets(yaw_resets(), sampled(lambda t: blow(t, length_s), hz, start=start)) == []


def test_a_turn_during_a_gap_of_half_a_second_is_none():
    samples = [s for s in sampled(blow, 50.0) if not 0.9 < s[0] < 1.35]
    assert resets(yaw_resets(), samples) == []


def test_a_steady_turn_through_south_with_lost_samples_is_none():
    lost = np.random.default_rng(1).random(1000) < 0.5
    samples = sampled(lambda t: (2.0 * t, 2.0), 50.0, seconds=20.0)
    assert resets(yaw_resets(), [s for s, gone in zip(samples, lost, strict=True) if not gone]) == []


@pytest.mark.parametrize("turn_deg", [2.0, -40.0, 120.0, -175.0])
@pytest.mark.parametrize("start", [0.0, 3.0])
def test_a_step_of_yaw_is_a_reset_of_that_size(turn_deg, start):
    samples = [
        (t, wrap(yaw + radians(turn_deg) * (t >= 1.5)), rate)
        for t, yaw, rate in sampled(lambda t: (0.3 * t, 0.3), 50.0, start=start)
    ]
    (found,) = resets(yaw_resets(), samples)
    assert degrees(found) == pytest.approx(turn_deg, abs=0.01)


def test_small_resets_are_added_up():
    """48 of 0.5° within two seconds."""
    samples = [(t, radians(0.5) * min(48, int(t * 24.0 + 1e-6)), 0.0) for t in np.arange(0.0, 2.5, 0.02)]
    found = resets(yaw_resets(), samples)
    assert degrees(sum(found)) == pytest.approx(24.0, abs=6.0)
    assert max(map(abs, found)) < radians(2.0)


@pytest.mark.parametrize(("rate_deg", "counts"), [(5.0, True), (2.0, True), (0.8, False)])
def test_a_yaw_that_slides_is_reset_only_if_it_is_fast(rate_deg, counts):
    """As the firmware's EKF does after boot: by 0.1° with each sample, the gyro at rest."""
    samples = [(t, radians(rate_deg) * t, 0.0) for t in np.arange(0.0, 10.0, 0.02)]
    found = resets(yaw_resets(), samples)
    assert bool(found) == counts
    assert all(abs(reset) < radians(1.5) for reset in found)


def test_noise_and_the_drift_of_a_compass_are_none():
    rng = np.random.default_rng(2)
    times = np.arange(0.0, 600.0, 0.02)
    yaw = radians(1.0) * np.sin(times) + 0.0005 * rng.standard_normal(len(times))
    rate = 0.003 * rng.standard_normal(len(times))
    assert resets(yaw_resets(), zip(times.tolist(), yaw.tolist(), rate.tolist(), strict=True)) == []


def test_after_a_long_gap_nothing_is_known():
    assert resets(yaw_resets(), [(0.0, 0.0, 0.0), (0.6, 1.0, 0.0), (0.62, 1.0, 0.0)]) == []


def test_stamps_that_stand_still_or_go_back_are_no_reset():
    assert resets(yaw_resets(), [(1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.5, 2.0, 0.0), (0.52, 2.0, 0.0)]) == []


def test_a_position_that_jumps_and_one_that_moves():
    moving = [(t, 0.8 * t, 0.8) for t in np.arange(0.0, 2.0, 0.02).tolist()]
    assert resets(position_resets(), moving) == []
    jumped = [(t, x - 3.0 * (t > 1.0), v) for t, x, v in moving]
    (found,) = resets(position_resets(), jumped)
    assert found == pytest.approx(-3.0, abs=0.01)
    little = [(t, x + 0.8 * POSITION_RESET_M * (t > 1.0), v) for t, x, v in moving]
    assert resets(position_resets(), little) == []


def test_a_detector_that_is_restarted_knows_nothing():
    detector = ResetDetector(0.1, 1.0, angular=False)
    detector.step(0.0, 0.0, 0.0)
    detector.restart()
    assert detector.step(0.02, 5.0, 0.0) == 0.0
