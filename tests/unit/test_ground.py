"""The ground under the vehicle: followed on a slope, not believed where it jumps, lost without echoes."""

import math

import numpy as np
import pytest

from companion.estimation.ground import (
    FALL_BELIEVED_S,
    LOST_S,
    RISE_BELIEVED_S,
    Grounds,
)
from companion.guidance.altitude import AltitudeHold
from companion.records import Ground, Range

PERIOD_S = 0.1


def over(finder, ranges, depth_m=4.0, start_s=0.0, tilt_cos=1.0):
    """Give a range every PERIOD_S, NaN for none; return where the ground was after each."""
    found = []
    for i, range_m in enumerate(ranges):
        t_s = start_s + i * PERIOD_S
        heard = [] if math.isnan(range_m) else [Range(t_s, range_m)]
        found.append(finder.step(t_s, heard, depth_m, tilt_cos))
    return found


def known(range_m=2.0):
    finder = Grounds()
    over(finder, [range_m] * 20)
    return finder


def test_a_slope_is_followed_without_lag():
    finder = known()
    found = over(finder, 2.0 - 0.1 * PERIOD_S * np.arange(60), start_s=2.0)
    assert found[-1].depth_m == pytest.approx(4.0 + 2.0 - 0.1 * PERIOD_S * 59, abs=0.005)
    assert found[-1].rate_mps == pytest.approx(-0.1, abs=0.005)


@pytest.mark.parametrize("false_m", [0.3, 40.0])
def test_single_false_echoes_change_nothing(false_m):
    ranges = [2.0] * 40
    ranges[5::4] = [false_m] * len(ranges[5::4])
    found = over(known(), ranges, start_s=2.0)
    assert [ground.depth_m for ground in found] == pytest.approx([6.0] * len(found))


@pytest.mark.parametrize(("range_m", "believed_s"), [(1.2, RISE_BELIEVED_S), (3.5, FALL_BELIEVED_S)])
def test_another_ground_is_believed_when_it_stays(range_m, believed_s):
    found = over(known(), [range_m] * 50, start_s=2.0)
    depths = [ground.depth_m for ground in found]
    first = depths.index(4.0 + range_m)
    assert first * PERIOD_S == pytest.approx(believed_s, abs=0.11)
    assert all(math.isnan(depth) or depth == pytest.approx(6.0) for depth in depths[:first])


def test_without_echoes_it_is_lost_and_scattered_ones_do_not_find_it():
    finder = known()
    lost = over(finder, [math.nan] * 15, start_s=2.0)
    assert [ground.known for ground in lost].index(False) * PERIOD_S == pytest.approx(LOST_S, abs=0.11)
    assert not any(ground.known for ground in over(finder, [1.0, 30.0] * 30, start_s=4.0))


def test_the_range_is_along_the_hulls_own_axis():
    for tilt in (20.0, 55.0):
        cos = math.cos(math.radians(tilt))
        assert over(Grounds(), [2.0 / cos] * 20, tilt_cos=cos)[-1].depth_m == pytest.approx(6.0)
    assert not over(Grounds(), [2.0] * 20, tilt_cos=math.cos(math.radians(65.0)))[-1].known
    assert not over(Grounds(), [2.0] * 20, tilt_cos=math.nan)[-1].known


def judged(answers, delay_s=0.3, drift_mps=0.0):
    """Return what was told of a range whose changes come with a factor, while the vehicle heaves."""
    finder, rng, found = Grounds(0.3), np.random.default_rng(3), []
    t_s = 0.02 * np.arange(1000)
    depths = 4.0 + 0.15 * np.sin(2.0 * np.pi / 4.0 * t_s)
    ranges = (2.0 - answers * (depths - 4.0) + drift_mps * t_s + 0.01 * rng.standard_normal(1000)).tolist()
    t_s = t_s.tolist()
    for tick in range(round(delay_s / 0.02), len(t_s)):
        heard = [Range(t_s[tick], ranges[tick - round(delay_s / 0.02)])] if tick % 5 == 0 else []
        found.append(finder.step(t_s[tick], heard, depths[tick], 1.0).moves_along)
    return np.array([f for f in found if not math.isnan(f)])


@pytest.mark.parametrize("drift_mps", [0.0, 0.05])
@pytest.mark.parametrize("answers", [0.0, -1.0, 0.305, 2.0, 3.28])
def test_a_ground_that_moves_along_with_the_vehicle_is_told(answers, drift_mps):
    found = judged(answers, drift_mps=drift_mps)
    assert len(found) > 100
    assert np.median(found) == pytest.approx(1.0 - answers, abs=0.1)
    assert found == pytest.approx([1.0 - answers] * len(found), abs=0.4)


def test_of_several_sensors_the_one_that_answers_is_followed():
    """Sensor 0 is stuck; sensor 1 answers until it falls silent; then 0 is better than none."""
    grounds, found = Grounds(), []
    for tick in range(2000):
        t_s = 0.02 * tick
        depth_m = 4.0 + 0.2 * math.sin(2.0 * math.pi / 4.0 * t_s)
        heard = [Range(t_s, 2.0, 0)] + [Range(t_s, 8.0 - depth_m, 1)] * (t_s < 30.0)
        found.append(grounds.step(t_s, heard if tick % 5 == 0 else [], depth_m, 1.0).depth_m)
    assert found[200:1540] == pytest.approx([8.0] * 1340, abs=0.01)
    assert found[-1] == pytest.approx(6.0, abs=0.3)


def test_a_sensor_is_used_however_many_were_heard_before():
    """Sensors 0 to 9 said something once, as forged or renumbered ones do; the eleventh was never used."""
    grounds = Grounds()
    grounds.step(0.0, [Range(0.0, 1.0, number) for number in range(10)], 4.0, 1.0)
    for tick in range(1, 300):
        found = grounds.step(0.02 * tick, [Range(0.02 * tick, 4.0, 200)], 4.0, 1.0)
    assert found.depth_m == pytest.approx(8.0, abs=0.01)


@pytest.mark.parametrize("delay_s", [0.0, 0.4, 0.8])
def test_a_late_range_is_added_to_the_depth_of_its_own_time(delay_s):
    """The vehicle heaves over a level ground; the range has 1 cm of noise."""
    finder, rng = Grounds(delay_s), np.random.default_rng(3)
    depths = 4.0 + 0.25 * np.sin(2.0 * np.pi / 6.0 * 0.02 * np.arange(1000))
    behind, found = round(delay_s / 0.02), []
    for tick in range(behind, len(depths)):
        reported = [Range(0.02 * tick, 6.0 - depths[tick - behind] + 0.01 * rng.standard_normal())]
        found.append(finder.step(0.02 * tick, reported if tick % 5 == 0 else [], depths[tick], 1.0))
    assert [ground.depth_m for ground in found[-500:]] == pytest.approx([6.0] * 500, abs=0.06)


def test_the_depth_moves_within_the_axis_limits_and_stays_without_a_ground():
    hold, places = AltitudeHold(1.5), []
    for tick in range(1500):
        ground = Ground(math.nan, 0.0) if 300 <= tick < 600 else Ground(6.0, 0.0)
        hold.step(ground, 4.0, 0.5, 0.2, 0.1, 0.02)
        places.append((hold.depth_m, hold.rate_mps))
    z, rate = np.array(places).T
    np.testing.assert_allclose(np.diff(z), rate[1:] * 0.02, atol=1e-12)
    assert np.abs(np.diff(rate)).max() <= 0.1 * 0.02 + 1e-12
    assert np.abs(rate).max() <= 0.2
    assert np.ptp(z[500:600]) == 0.0
    assert z[-1] == pytest.approx(4.5, abs=0.01)
    assert z.max() < 4.52
