"""`holdfast lab bench reality`: what is drawn, and how a dive is judged."""

import math

import pytest

from companion.records import State
from lab.studies.reality import FIRST_SEED, HELD, TURNED_OVER, RealDive, Reality
from lab.study import parser_of


def study(*options):
    return Reality(parser_of(Reality).parse_args(options))


@pytest.mark.parametrize("late", ["", "-late"])
def test_one_vehicle_that_turned_over_fails_the_study_and_stands_in_the_table(late):
    bench = study("--scenarios", f"tank-place{late}", "--rows", "heavy", "--seeds", "2")
    rows = [
        RealDive("heavy", f"tank-place{late}", FIRST_SEED + i)._asdict()
        | {"depth_sd_mm": 3.0, "place_rms_mm": 30.0 + i, "heading_rms_deg": 0.1, "tilt_deg": 5.0}
        | {"believed_rms_mm": math.nan, "outcome": outcome}
        for i, outcome in enumerate((HELD, TURNED_OVER))
    ]
    assert bench.failed(rows)
    assert not bench.failed(rows[:1])
    table = bench.summary(rows)
    (line,) = table["rows"]
    assert line[:2] == [f"heavy, tank-place{late}", "1 of 2, 1 turned over"]
    assert line[3] == "30.5/30.9/31.0"
    assert len(table["columns"]) == len(line) == 6, "what no dive has is no column"


@pytest.mark.parametrize(
    "case",
    [
        RealDive("tank-heavy", "tank-place", 9005),
        RealDive("heavy", "tank-place", 9007),
        RealDive("heavy", "rough", 9017),
    ],
    ids=str,
)
def test_a_vehicle_whose_lever_is_another_one_misses_no_motor(case):
    """A moment of the water, or of a lever that is not there, looked like a dead motor.

    The allocation around a motor that pushes turned the vehicle over, or tilted it by 27°.
    """
    steps = study("--rows", case.preset, "--scenarios", case.water).ticks(case, lasts_s=8.0)
    assert steps[-1].sample.verdict.state is State.ACTIVE
    assert not any(step.sample.state.dead_motor for step in steps)
