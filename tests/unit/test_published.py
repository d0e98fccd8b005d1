"""`holdfast bench published`: what is ported of others' scenarios, and how their metrics are computed."""

import math

import numpy as np
import pytest

from companion.records import PSI
from lab.studies.courses import Track, recorded
from lab.studies.published import (
    DEPTH,
    FIRST_SEED,
    LATE,
    RMS,
    SATURATION_N,
    START_S,
    GymSea,
    Published,
    PublishedDive,
    Pushed,
    believable,
    circle,
    constant,
    eight,
    extra_thruster,
    gym_current,
    gym_path,
    gym_water,
    periodic,
    scenes,
    sensed,
)
from lab.study import parser_of
from sim_bridge.physics.plant import state_of

LEVEL = state_of((0.0, 0.0, 2.0, 0.0, 0.0, 0.0), (0.0,) * 6)
PATH_SEA = GymSea(2.0, 12.0, 3.3, 0.5, 0.7, 0.02, 0.01, 0.3)


def study(*options):
    return Published(parser_of(Published, "").parse_args(list(options)))


@pytest.mark.parametrize(("target", "fastest_m_s"), [(gym_path, 0.218), (circle, 1.5), (eight, 1.414)])
def test_a_reference_says_its_own_velocity_and_acceleration(target, fastest_m_s):
    times = np.arange(0.0, 60.0, 0.005)
    targets = [target(t_s) for t_s in times.tolist()]
    eta, rate, faster = (
        np.array([getattr(one, key) for one in targets]) for key in ("eta_d", "eta_d_dot", "eta_d_ddot")
    )
    eta[:, PSI] = np.unwrap(eta[:, PSI])
    smooth = np.abs(times - 10.0) > 0.02
    smooth[[0, -1]] = False
    np.testing.assert_allclose(np.gradient(eta, times, axis=0)[smooth], rate[smooth], atol=1e-3)
    straight = np.gradient(rate, times, axis=0)[:, :PSI]
    np.testing.assert_allclose(straight[smooth], faster[smooth, :PSI], atol=1e-3)
    assert np.linalg.norm(rate[:, :3], axis=1).max() == pytest.approx(fastest_m_s, abs=2e-3)


def test_the_gym_water_has_their_strength_and_turns_with_the_vehicle():
    """Figures of their own model with their seed: RMS 0.196, largest 0.475 m/s."""
    water = gym_current(PATH_SEA, 100.0)
    along = water @ np.full(2, math.sqrt(0.5))
    assert np.sqrt(np.mean(along**2)) == pytest.approx(0.196, abs=0.001)
    assert np.abs(along).max() == pytest.approx(0.475, abs=0.001)
    east = state_of((0.0, 0.0, 2.0, 0.0, 0.0, 0.5 * math.pi), (0.0,) * 6)
    flowing = gym_water(PATH_SEA, 100.0)
    force, (north_m_s, east_m_s) = flowing(50.0, LEVEL)
    assert force == (0.0, 0.0, 0.0)
    assert flowing(50.0, east)[1] == pytest.approx((-east_m_s, north_m_s))


def test_the_extra_thruster_pushes_with_its_part_of_what_two_thrusters_give():
    assert pytest.approx(79.8) == SATURATION_N
    step, sine = extra_thruster(0.9), extra_thruster(0.9, 10.0)
    down_n = [step(t_s, LEVEL)[0][2] for t_s in (4.9, 7.0, 34.9, 37.0)]
    assert down_n == pytest.approx([0.0, 71.8, 71.8, 0.0], abs=0.1)
    assert sine(2.5, LEVEL)[0][2] == pytest.approx(71.8, abs=0.1)


def test_the_periodic_force_is_of_three_to_six_newton():
    forces = np.array([periodic(t_s, LEVEL)[0] for t_s in np.arange(0.0, 60.0, 0.02).tolist()])
    assert 5.5 < np.abs(forces).max() <= 6.0
    crest = np.array([periodic((i + 0.5) * math.pi / 2.5, LEVEL)[0] for i in range(40)])
    assert np.abs(crest).min() >= 3.0


def test_a_push_begins_with_the_reference():
    scene = scenes()["circle"]
    sea = Pushed(scene.plant, FIRST_SEED, constant)
    assert sea.step(START_S - 0.01, 0.0, LEVEL)[0] == (0.0, 0.0, 0.0)
    assert sea.step(START_S, 0.0, LEVEL)[0] == (10.0, 10.0, 10.0)


def test_the_metrics_are_theirs():
    scene = scenes()["station"]
    t_s = np.arange(START_S, START_S + scene.lasts_s, 0.02)
    reference = np.array([scene.aim(moment).eta_d for moment in t_s.tolist()])
    late = t_s >= START_S + 20.0
    off = np.where(late[:, None], (0.003, 0.004, 0.012, 0.0), (0.0, 0.0, 0.039, 0.0))
    nothing = np.zeros((len(t_s), 2))
    still = np.zeros(len(t_s), dtype=bool)
    track = Track(t_s, reference * 0.0, reference + off, nothing, nothing[:, 0], nothing, still, held=True)
    figures = scene.figures(track)
    assert figures[LATE] == pytest.approx(13.0)
    assert figures[RMS] == pytest.approx(math.sqrt(0.5 * (13.0**2 + 39.0**2)), rel=1e-3)
    assert figures[DEPTH] == pytest.approx(math.sqrt(0.5 * (12.0**2 + 39.0**2)), rel=1e-3)


def test_without_noise_the_known_delays_stay():
    ours, exact = (sensed(scenes()["path"], row) for row in ("sensors", "no noise"))
    assert ours.dvl
    assert exact.dvl_drift_m == exact.depth_slow_m == exact.climb_white_m_s == exact.gyro_white_rad_s == 0.0
    assert exact.dvl_delay_s == ours.dvl_delay_s > 0.0


def test_thrust_of_seven_tenths_is_believed_to_be_more_mass():
    plant = scenes()["path"].plant
    (gain,) = plant.thrusters.gain
    assert gain == pytest.approx(40.0 / 51.5)
    assert believable(plant).hull.mass_kg == pytest.approx(15.22 / gain)
    assert believable(plant).hull.quadratic_damping[2] == pytest.approx(73.37135 / gain)


def test_a_short_dive_is_held_and_stands_in_the_table():
    bench = study("--scenarios", "thruster-60", "--rows", "sensors")
    steps = bench.ticks(PublishedDive("thruster-60", "sensors", FIRST_SEED), -18.0)
    assert steps[-1].t_s == pytest.approx(START_S - 18.0, abs=0.1)
    assert steps[-1].sample.verdict.reason == "engaged"
    rows = [
        PublishedDive("thruster-60", "sensors", 1)._asdict() | {DEPTH: 5.0, "accused": False, "held": True}
    ]
    (line,) = bench.summary(rows)["rows"]
    assert line[1:6] == ["least 10, most 40", "**5**", "–", "–", "0.50, 0.12"]
    accused = bench.summary([rows[0] | {"accused": True}])["rows"]
    assert accused[0][2] == "**5 ‡**"
    handed_over = bench.summary([rows[0] | {"held": False}])["rows"]
    assert handed_over[0][2] == "**5 †**"
    assert not bench.failed(rows)
    assert bench.failed([rows[0] | {"held": False}])


def test_the_water_of_the_path_is_no_dead_motor():
    """Motor 2 was found dead: the vehicle's inertia is 25 times the believed one."""
    steps = study().ticks(PublishedDive("path", "no noise", 9002), 5.0)
    assert not any(step.sample.state.dead_motor for step in steps)


def test_a_current_that_turns_with_the_vehicle_does_not_mislead():
    """Motor 2 was found dead, and a gain of 0.37 found for surge and sway, with which they oscillated."""
    steps = study().ticks(PublishedDive("path", "true model", 9001), 68.0)
    assert not any(step.sample.state.dead_motor for step in steps)
    assert scenes()["path"].figures(recorded(steps[-2000:]))[RMS] < 8.0
