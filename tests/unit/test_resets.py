"""What is a reset of the EKF and what is motion."""

from math import radians

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.core.bounds import wrap
from companion.estimation.resets import (
    POSITION_RESET_M,
    DepthResets,
    position_resets,
    yaw_resets,
)


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
    assert resets(yaw_resets(), samples) == pytest.approx([radians(turn_deg)], abs=1.7e-4)


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


@pytest.mark.parametrize("stamps", [(0.0, 0.6, 0.62), (1.0, 1.0, 0.5, 0.52)])
def test_after_a_long_gap_and_stamps_that_stand_still_or_go_back_nothing_is_known(stamps):
    assert resets(yaw_resets(), [(t, 0.3 * (n > 0), 0.0) for n, t in enumerate(stamps)]) == []


def test_a_position_that_jumps_and_one_that_moves():
    moving = [(t, 0.8 * t, 0.8) for t in np.arange(0.0, 2.0, 0.02).tolist()]
    assert resets(position_resets(), moving) == []
    jumped = [(t, x - 3.0 * (t > 1.0), v) for t, x, v in moving]
    assert resets(position_resets(), jumped) == pytest.approx([-3.0], abs=0.01)
    little = [(t, x + 0.8 * POSITION_RESET_M * (t > 1.0), v) for t, x, v in moving]
    assert resets(position_resets(), little) == []


DIVED_S, NOW_S = 24.0, 12.0
STILL = (lambda t: 0.0 * t), (lambda t: 0.0 * t)
RISING = (lambda t: -0.5 * t), (lambda t: -0.5 + 0.0 * t)
WAVES = (lambda t: 0.3 * np.sin(1.57 * t)), (lambda t: 0.47 * np.cos(1.57 * t))


def pull(t):
    return np.clip(t - NOW_S, 0.0, 1.0)


PULLED = (
    (lambda t: 0.5 * pull(t) - np.sin(2.0 * np.pi * pull(t)) / (4.0 * np.pi)),
    (lambda t: np.sin(np.pi * pull(t)) ** 2),
)


class Depths:
    """A depth of 3 m and `motion` for DIVED_S, as an EKF or the raw barometer tells it: what is reset in all.

    `zero` and `sensor` are functions of time: how far the zero of depth lies from the surface, and the sensor
    in the water is off; `climb` is the error of the climb rate.
    """

    def __init__(self, motion=STILL, hz=50.0, pressure_hz=10.0, raw_m=0.0, seed=1, climbs=True, **errors):
        self.rng = np.random.default_rng(seed)
        self.hz, self.pressure_hz, self.raw_m, self.climbs = hz, pressure_hz, raw_m, climbs
        self.moved, self.rate = motion
        self.zero, self.sensor, self.climb, self.pressure = (
            errors.get(name, lambda t: 0.0 * t) for name in ("zero", "sensor", "climb", "pressure")
        )

    def reset_m(self):
        times = np.arange(0.0, DIVED_S, 1.0 / self.hz)
        normal = self.rng.standard_normal
        readings = self.raw_m * normal(int(10 * DIVED_S) + 2)
        """The barometer's noise: ten new values a second."""
        seen = np.round(10.0 * times - 0.5).astype(int)
        error = readings[seen] if self.raw_m else 0.0005 * normal(len(times))
        depth = 3.0 + self.moved(times - 0.012) + self.sensor(times) + self.zero(times) + error
        rate = self.rate(times - 0.015) + 0.0008 * normal(len(times)) + self.climb(times)
        resets, total, expected, pressure_s = DepthResets(), 0.0, 3.0, 0.0
        for t, z, w, n in zip(times.tolist(), np.round(depth, 3).tolist(), rate.tolist(), seen, strict=True):
            surprise = z - total - expected
            total += resets.step(t, z, w if self.climbs else 0.0, surprise, climbs=self.climbs)
            expected += w / self.hz + 0.15 * (z - total - expected)
            if self.pressure_hz and t >= pressure_s:
                pressure_s += 1.0 / self.pressure_hz
                noise = readings[n] if self.raw_m else 0.003 * normal()
                felt = 13.3 + self.moved(t - 0.065) + self.sensor(t - 0.065) + self.pressure(t) + noise
                total += resets.pressed(t - 0.053, float(felt))
        return total


def step(size_m, lasts_s=1e-9, at_s=NOW_S + 0.003):
    return lambda t: size_m * np.clip((t - at_s) / lasts_s, 0.0, 1.0)


@pytest.mark.parametrize(("size_m", "lasts_s"), [(0.1, 1.0), (-0.4, 1.0), (0.1, 0.5), (-8.0, 1.0)])
@pytest.mark.parametrize("pressure_hz", [10.0, 2.0])
def test_a_zero_that_moves_within_a_second_is_reset_but_for_centimetres(size_m, lasts_s, pressure_hz):
    found = Depths(pressure_hz=pressure_hz, zero=step(size_m, lasts_s)).reset_m()
    assert found == pytest.approx(size_m, abs=0.06)


@pytest.mark.parametrize(("raw_m", "size_m"), [(0.003, 0.05), (0.003, -0.4), (0.012, 0.2), (0.012, 3.0)])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_barometers_noise_is_no_reset_and_hides_none_that_is_much_larger(raw_m, size_m, seed):
    assert abs(Depths(raw_m=raw_m, seed=seed).reset_m()) < 0.03
    assert Depths(raw_m=raw_m, seed=seed, zero=step(size_m)).reset_m() == pytest.approx(size_m, abs=0.05)


@pytest.mark.parametrize("pressure_hz", [10.0, 2.0])
@pytest.mark.parametrize(
    "dive",
    [
        {"motion": PULLED},
        {"motion": PULLED, "climbs": False},
        {"motion": WAVES, "climbs": False},
        {"sensor": step(0.3)},
        {"sensor": step(-3.0)},
        {"sensor": step(0.4, 1.0)},
        {"pressure": step(0.3)},
        {"pressure": step(-3.0)},
        {"climb": step(0.1)},
        {"climb": step(-0.4)},
        {"sensor": lambda t: 0.02 * t},
        {"zero": lambda t: 0.005 * t},
    ],
    ids="+".join,
)
def test_what_pressure_shows_too_and_what_only_it_shows_is_none(dive, pressure_hz):
    """Motion, also without a climb rate; a sensor that jumps; a climb rate or a zero that drifts."""
    assert Depths(pressure_hz=pressure_hz, **dive).reset_m() == pytest.approx(0.0, abs=0.001)


@given(
    sizes=st.lists(st.floats(0.05, 8.0) | st.floats(-8.0, -0.05), min_size=1, max_size=6),
    apart_s=st.floats(0.02, 1.5),
    motion=st.sampled_from([STILL, RISING, WAVES]),
    pressure_hz=st.sampled_from([10.0, 2.0, 0.0]),
)
@settings(max_examples=30, deadline=None)
def test_any_sequence_of_resets_is_found_but_for_centimetres(sizes, apart_s, motion, pressure_hz):
    def zero(t):
        return sum(step(size, at_s=10.0 + n * apart_s)(t) for n, size in enumerate(sizes))

    found = Depths(motion, pressure_hz=pressure_hz, zero=zero).reset_m()
    assert found == pytest.approx(sum(sizes), abs=0.05)


@pytest.mark.parametrize("pressure_hz", [10.0, 2.0, 0.0])
@pytest.mark.parametrize(("hz", "speed"), [(20.0, 1.0), (10.0, -1.0), (5.0, 0.5)])
@pytest.mark.parametrize("wrong", [-1.0, -2.0], ids=["frozen", "wrong sign"])
def test_a_climb_rate_that_is_wrong_hides_no_descent(wrong, hz, speed, pressure_hz):
    """Seldom samples make each of them look like a jump: a vehicle that sinks by 12 m was held "there"."""
    motion = (lambda t: speed * np.maximum(t - NOW_S, 0.0)), (lambda t: speed * (t > NOW_S))
    hidden_m = Depths(motion, hz, pressure_hz, climb=lambda t: wrong * motion[1](t)).reset_m()
    assert abs(hidden_m) < (0.05 if pressure_hz else 0.3) * abs(speed) * (DIVED_S - NOW_S)
