"""Defects of instruments, dead reckoning and the compass: each as large as its configuration says."""

import cmath
import math
from typing import Any

import numpy as np
import pytest
from builders import STILL_SENSORS
from sim_wire import Station, vehicle

from sim_bridge.physics.defects import Defective
from sim_bridge.physics.dvl import DvlReporter
from sim_bridge.physics.ekf_height import NO_HEIGHT_ERROR, drawn_off
from sim_bridge.physics.plant import state_of
from sim_bridge.physics.position_error import BELIEVED_M_S, ODOMETRY_SIGMA_M_S, UNAIDED_S, PositionErrors
from sim_bridge.physics.sensors import COMPASS_TAU_S, EARTH_NORTH_UT, Sensors, deviation
from sim_bridge.sim_config import Defects, DvlReports, Seabed, SensorConfig, Steel, Usbl

DT = 0.005


def instruments(seed=1, seabed_m=None, steel=None, **changes):
    rng = np.random.default_rng(seed)
    return Sensors(
        SensorConfig(**(STILL_SENSORS | changes)), DT, rng, seabed_m and Seabed(depth_m=seabed_m), steel
    )


def reading(sensors, z=3.0, nu=(0.0,) * 6, seconds=DT):
    for _ in range(round(seconds / DT)):
        sensors.record(state_of((0, 0, z, 0, 0, 0), nu), (0.0, 0.0, 0.0), 0.0)
    return sensors.estimate(1.0)


def test_a_bias_walks_with_the_square_root_of_time():
    biases = []
    for seed in range(300):
        defective = Defective(Defects(walk_per_sqrt_s=0.02), 0.1, np.random.default_rng(seed))
        for _ in range(40):
            defective.step()
        biases.append(defective.bias)
    assert np.std(biases) == pytest.approx(0.02 * math.sqrt(4.0), rel=0.15)


def test_outages_take_their_share_of_time():
    config = Defects(outage_every_s=0.6, outage_s=0.2)
    defective = Defective(config, 0.01, np.random.default_rng(1))
    out = []
    for _ in range(200_000):
        defective.step()
        out.append(defective.out)
    assert np.mean(out) == pytest.approx(0.2 / 0.8, rel=0.1)
    assert 2000.0 / np.sum(np.diff(np.array(out, int)) > 0) == pytest.approx(0.8, rel=0.1)


def test_while_the_depth_is_out_it_stands_still_and_the_attitude_does_not():
    sensors = instruments(depth_defects=Defects(outage_every_s=0.01, outage_s=1e6))
    before = reading(sensors, z=2.0, nu=(0, 0, 0, 0.1, 0, 0), seconds=0.2)
    after = reading(sensors, z=5.0, nu=(0, 0, 0.7, 0.3, 0, 0), seconds=1.0)
    assert (after.depth_m, after.climb_m_s) == (before.depth_m, before.climb_m_s)
    assert (before.rollspeed, after.rollspeed) == (0.1, 0.3)


def test_jitter_makes_readings_older():
    sensors = instruments(depth_delay_s=0.0, barometer_late_s=0.0, depth_defects=Defects(jitter_s=0.1))
    late_s = []
    for step in range(2000):
        z = 0.5 * DT * step
        late_s.append((z - reading(sensors, z=z).depth_m) / 0.5)
    assert np.mean(late_s[100:]) == pytest.approx(0.05, rel=0.1)
    assert max(late_s) < 0.1


@pytest.mark.parametrize(
    ("period_s", "depth", "rate"),
    [
        (2.0, (0.61, -126.0), (0.14, 161.0)),
        (3.0, (1.04, -98.0), (0.35, -168.0)),
        (4.0, (1.37, -74.0), (0.59, -141.0)),
        (6.0, (1.70, -39.0), (1.05, -100.0)),
        (10.0, (1.47, -7.0), (1.34, -53.0)),
    ],
)
def test_the_barometer_draws_depth_and_climb_rate_as_it_does_in_4_7(period_s, depth, rate):
    """Size and phase (°) of what SIM_BARO_DELAY 120 and 0 differ by, in relative_alt and VFR_HUD.climb."""
    omega, error = math.tau / period_s, NO_HEIGHT_ERROR
    deeper: Any = 0.0
    for step in range(round(30.0 / DT)):
        deeper = cmath.exp(1j * omega * step * DT)
        error = drawn_off(error, deeper, DT)
    for found, (size, phase_deg) in ((error.depth_m, depth), (error.sink_m_s / (1j * omega), rate)):
        assert found / deeper == pytest.approx(cmath.rect(size, math.radians(phase_deg)), abs=0.15)


def test_a_barometer_that_is_later_than_allowed_makes_depth_small_and_late():
    """What both firmwares told of a path with a period of 6 s: 0.98 of it, 20 to 25 ms late."""
    sensors, omega, told = instruments(), math.tau / 6.0, []
    for step in range(round(42.0 / DT)):
        phase = omega * step * DT
        told.append(reading(sensors, 3.0 - 0.25 * math.cos(phase)).depth_m)
    whole = np.exp(-1j * omega * DT * np.arange(round(12.0 / DT), round(42.0 / DT)))
    seen = np.mean(told[-len(whole) :] * whole) * -8.0
    assert abs(seen) == pytest.approx(0.983, abs=0.004)
    assert -np.angle(seen) / omega == pytest.approx(0.0225, abs=0.004)


def test_without_a_dvl_the_speed_error_walks_and_the_position_is_given_up():
    speeds, places = [], []
    for seed in range(200):
        errors = PositionErrors(SensorConfig(unaided_m_s=0.03), 0.05, np.random.default_rng(seed))
        for _ in range(200):
            errors.step((0.0, 0.0), locked=False)
        speeds += errors.speed_error
        places += errors.error
    assert np.std(speeds) == pytest.approx(0.03 * math.sqrt(10.0), rel=0.1)
    assert np.std(places) == pytest.approx(0.03 * math.sqrt(10.0**3 / 3), rel=0.1)
    assert errors.aided
    for _ in range(round((UNAIDED_S - 10.0) / 0.05) + 1):
        errors.step((0.0, 0.0), locked=False)
    assert not errors.aided


@pytest.mark.parametrize(
    ("turn_rad_s", "outages_per_min", "share_out"),
    [(0.0, 1.7, 0.008), (0.25, 10.0, 0.055), (0.5, 19.5, 0.105)],
)
def test_a_dvl_reports_as_one_was_recorded(turn_rad_s, outages_per_min, share_out):
    """A Water Linked A50: 6.5 reports a second, one in ten over 0.3 s late, outages by how fast it turns."""
    reporter, step_s, lasts_s = DvlReporter(DvlReports(), 0.002, np.random.default_rng(1)), 0.002, 1800.0
    steps = [reporter.report(turn_rad_s) for _ in range(round(lasts_s / step_s))]
    times_s, is_valid = zip(
        *((i * step_s, one) for i, one in enumerate(steps) if one is not None), strict=True
    )
    intervals_s, out = np.diff(times_s), ~np.array(is_valid)[1:]
    assert len(times_s) / lasts_s == pytest.approx(6.5, rel=0.05)
    assert np.median(intervals_s) == pytest.approx(0.117, abs=0.003)
    assert np.mean(intervals_s > 0.3) == pytest.approx(0.1, abs=0.02)
    assert np.sum(np.diff(out.astype(int)) > 0) * 60.0 / lasts_s == pytest.approx(outages_per_min, rel=0.2)
    assert np.sum(intervals_s[out]) / lasts_s == pytest.approx(share_out, rel=0.25)
    assert 1.8 < np.max(np.diff(np.array(times_s)[list(is_valid)])) < 3.0


def test_between_reports_the_ekf_carries_its_velocity_on_and_believes_them_as_the_firmware_does():
    """Steady state: P is the variance of the errors where velocity and reports err as much as believed."""
    config, squares, believed = DvlReports(enabled=True, unaided_m_s=BELIEVED_M_S), [], []
    for seed in range(20):
        rng = np.random.default_rng((seed, 1))
        errors = PositionErrors(SensorConfig(dvl_reports=config), 0.01, np.random.default_rng(seed))
        for step in range(3000):
            if step % 15 == 0:
                north, east = ODOMETRY_SIGMA_M_S * rng.standard_normal(2)
                errors.report((north, east))
            errors.step((0.0, 0.0), locked=False)
            if step > 500:
                squares += [v * v for v in errors.speed_error]
                believed.append(errors.p_vv)
    assert np.mean(squares) == pytest.approx(np.mean(believed), rel=0.15)


def test_fixes_bound_the_error_as_their_filter_says():
    """Steady state of a random walk in speed with fixes: P of the filter is the variance of the errors."""
    usbl = Usbl(enabled=True, period_s=1.0, sigma_m=0.4, missed=0.0)
    squares, believed = [], []
    for seed in range(40):
        errors = PositionErrors(SensorConfig(usbl=usbl, unaided_m_s=0.1), 0.1, np.random.default_rng(seed))
        for step in range(600):
            errors.step((0.0, 0.0), locked=False)
            if step > 200:
                squares += [e * e for e in errors.error]
                believed.append(errors.p_ee)
        assert errors.aided
    assert np.mean(squares) == pytest.approx(np.mean(believed), rel=0.15)
    assert math.sqrt(np.mean(squares)) < 0.4


@pytest.mark.parametrize(("seabed_m", "locked"), [(3.02, False), (10.0, True), (80.0, False), (None, True)])
def test_a_dvl_measures_within_its_range_over_the_seabed(seabed_m, locked):
    sensors = instruments(seabed_m=seabed_m, dvl=True, dvl_min_altitude_m=0.05, dvl_max_altitude_m=50.0)
    reading(sensors, seconds=UNAIDED_S + 0.1)
    assert sensors.aided == locked


def test_steel_turns_the_compass_as_a_dipole_does():
    """On the axis of a dipole its field is 2 m / r³; north of an eastward one it is −m / r³."""
    steel = Steel(enabled=True, place_m=(0.0, 0.0, 3.0), moment_ut_m3=(0.0, 80.0, 0.0))
    beside = state_of((0, 2.0, 3.0, 0, 0, 0), (0,) * 6)
    ahead = state_of((2.0, 0, 3.0, 0, 0, 0), (0,) * 6)
    assert deviation(steel, beside) == pytest.approx(math.atan2(20.0, EARTH_NORTH_UT))
    assert deviation(steel, ahead) == pytest.approx(math.atan2(-10.0, EARTH_NORTH_UT))
    far = state_of((40.0, 0, 3.0, 0, 0, 0), (0,) * 6)
    assert abs(deviation(steel, far)) < 1e-4
    sensors = instruments(steel=Steel(enabled=True, place_m=(0.0, -2.0, 3.0), moment_ut_m3=(0.0, 80.0, 0.0)))
    turned = math.atan2(20.0, EARTH_NORTH_UT) * (1.0 - math.exp(-30.0 / COMPASS_TAU_S))
    assert reading(sensors, seconds=30.0).yaw == pytest.approx(-turned, rel=0.01)


def test_the_firmware_says_when_it_loses_the_position_and_has_it_again():
    out = "sensors.dvl_defects={outage_every_s=0.01, outage_s=1e6}"
    station = Station(vehicle("sensors.dvl=true", out, "initial.eta=[0,0,3,0,0,0]"))
    heard = station.run(UNAIDED_S + 1.0)
    assert any("stopped aiding" in message.text for message in heard.of("STATUSTEXT"))
    assert station.run(1.0).of("LOCAL_POSITION_NED") == []
    fixed = Station(vehicle("sensors.usbl={enabled=true}", "initial.eta=[0,0,3,0,0,0]"))
    assert fixed.run(UNAIDED_S + 1.0).of("LOCAL_POSITION_NED")
