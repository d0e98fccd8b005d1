"""`holdfast lab bench tank` and `reality`: what is drawn, and how a dive is judged."""

import math

import numpy as np
import pytest

from companion.records import State
from lab.studies.reality import Reality
from lab.studies.tank import Tank
from lab.studies.unlike import FIRST_SEED, HELD, TURNED_OVER, RealDive, path
from lab.study import parser_of

SCENARIOS = [(kind, water) for kind in (Tank, Reality) for water in kind.waters]


def study(kind, *options):
    return kind(parser_of(kind, "").parse_args(list(options)))


@pytest.mark.parametrize(("kind", "water"), SCENARIOS)
def test_the_same_case_is_the_same_vehicle_and_another_seed_another(kind, water):
    bench = study(kind, "--seeds", "2", "--scenarios", water)
    first = bench.cases()[-1]
    again, other = bench.situation(first), bench.situation(first._replace(seed=first.seed + 1))
    assert bench.situation(first).plant == again.plant
    assert again.plant != other.plant


def test_a_vehicle_of_reality_lies_between_the_models_and_the_tank():
    bench = study(Reality)
    assert len(bench.cases()) == 60
    for case in bench.cases():
        plant = bench.situation(case).plant
        (share,) = plant.thrusters.gain
        inertia = (plant.hull.mass_kg + plant.hull.added_mass[2]) / share
        assert 20.0 < inertia < 95.0
        assert 0.0 <= plant.thrusters.start_s <= 0.25
        assert 0.0 <= plant.thrusters.horizontal_m[2] <= 0.1
        assert plant.sensors.dvl


def test_the_path_moves_by_half_a_metre_and_says_its_own_rate():
    times = np.arange(0.0, 30.0, 0.01)
    depth = np.array([path(t_s).eta_d[2] for t_s in times])
    rate = np.array([path(t_s).eta_d_dot[2] for t_s in times])
    assert np.ptp(depth) == pytest.approx(0.5, abs=1e-4)
    np.testing.assert_allclose(np.gradient(depth, times)[1:-1], rate[1:-1], atol=2e-3)


def test_one_vehicle_that_turned_over_fails_the_study_and_stands_in_the_table(capsys):
    from rich.console import Console

    bench = study(Tank, "--scenarios", "place", "--rows", "heavy", "--seeds", "2")
    rows = [
        RealDive("heavy", "place", 0.0, FIRST_SEED + i)._asdict()
        | {"depth_sd_mm": 3.0, "place_rms_mm": 30.0 + i, "heading_rms_deg": 0.1, "tilt_deg": 5.0}
        | {"believed_rms_mm": 20.0, "outcome": outcome}
        for i, outcome in enumerate((HELD, TURNED_OVER))
    ]
    assert bench.failed(rows)
    assert not bench.failed(rows[:1])
    (line,) = bench.summary(rows)["rows"]
    assert line[:2] == ["heavy, place", "1 of 2, 1 turned over"]
    assert line[3] == "30.5/31.0 (goal –/40)"
    Console(width=200).print(*bench.tables(rows))
    assert "1 turned over" in capsys.readouterr().out


def test_what_was_not_held_has_no_figure():
    bench = study(Reality, "--seeds", "1", "--scenarios", "light-waves")
    assert not bench.situation(bench.cases()[0]).plant.sensors.dvl
    assert math.isnan(Reality.goals["heavy", "light-waves"]["depth_sd_mm"][1])


@pytest.mark.parametrize(
    ("kind", "case"),
    [
        (Tank, RealDive("tank-heavy", "place", 0.0, 9005)),
        (Tank, RealDive("heavy", "place", 0.0, 9007)),
        (Reality, RealDive("heavy", "rough", 0.0, 9017)),
    ],
)
def test_a_vehicle_whose_lever_is_another_one_misses_no_motor(kind, case):
    """A moment of the water, or of a lever that is not there, was taken for a dead motor.

    The allocation around a motor that pushes turned the vehicle over, or tilted it by 27°.
    """
    steps = study(kind).ticks(case, lasts_s=8.0)
    assert steps[-1].sample.verdict.state is State.ACTIVE
    assert not any(step.sample.state.dead_motor for step in steps)
