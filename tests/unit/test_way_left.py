"""Way and time that are left of a path."""

import itertools
import math

import pytest
from test_paths import LIMITS, SQUARE, polyline
from test_paths import PLANS as SMOOTH

from companion.guidance.course import Course
from companion.guidance.paths.shapes import build as built
from companion.records import ZERO
from companion.telemetry.plan import Circle, PathPlan, Waypoint
from companion.telemetry.status_line import duration_text, left_text

DT_S = 0.02
STOPPING = {
    "stops": polyline(*SQUARE, closed=True, laps=2, corner_m=0.0),
    "waits": PathPlan(
        waypoint=(
            Waypoint(x_m=0.0, y_m=0.0),
            Waypoint(x_m=2.0, y_m=0.0, wait_s=7.0),
            Waypoint(x_m=2.0, y_m=3.0),
        )
    ),
    "short lines": polyline(*((0.3 * i, 0.3 * (i % 2), 2.0) for i in range(20))),
}
PLANS = {
    "lawn-mower": SMOOTH["lawn-mower"],
    "laps": PathPlan(circle=Circle(radius_m=2.0), laps=3),
    "slow": polyline((0, 0, 2), (2, 0, 2), speed_mps=0.03),
    **STOPPING,
}


def course(plan):
    return Course(LIMITS, plan.speed_mps, plan.acceleration_mps2, path=built(plan, LIMITS))


def begun(plan):
    """Return the path's course, begun where the path begins."""
    under_way = course(plan)
    under_way.begin(under_way.path.legs[0].curve[0].p)
    return under_way


def travelled(under_way, pace=1.0, longest_s=3000.0):
    """Return a row of time, way, and what was left of both, for each step until it has arrived."""
    rows: list[tuple[float, float, float, float]] = []
    while not under_way.done:
        rows.append((len(rows) * DT_S, under_way.progress_m, under_way.left_m, under_way.left_s))
        under_way.step(pace, DT_S)
        assert len(rows) * DT_S < longest_s, "it never arrives"
    return rows


@pytest.mark.parametrize("left", list(itertools.product((0.0, 3.0, math.inf, math.nan), repeat=2)))
def test_whatever_is_left_can_be_said(left):
    assert left_text(*left) == "until stopped" or all(map(math.isfinite, left))


@pytest.mark.parametrize("name", PLANS)
def test_way_and_time_that_are_left(name):
    """The time is known at once where it does not stop; else from the middle on, by the mean speed so far."""
    plan = PLANS[name]
    whole_m = course(plan).left_m
    under_way = begun(plan)
    rows = travelled(under_way)
    took_s = rows[-1][0]
    assert whole_m == pytest.approx(under_way.path.length_m * plan.laps)
    way = [progress_m for _, progress_m, _, _ in rows]
    assert way == sorted(way)
    assert all(progress_m + left_m == pytest.approx(whole_m, abs=0.01) for _, progress_m, left_m, _ in rows)
    assert (under_way.progress_m, under_way.left_m, under_way.left_s) == (pytest.approx(whole_m), 0.0, 0.0)
    for t_s, _, _, left_s in rows:
        if name not in STOPPING or t_s > 0.6 * took_s:
            assert left_s == pytest.approx(took_s - t_s, abs=0.25 * took_s)


def test_the_time_left_follows_the_pace():
    rows = travelled(begun(PLANS["laps"]), pace=0.5)
    took_s = rows[-1][0]
    t_s, _, _, left_s = next(row for row in rows if row[0] > 0.4 * took_s)
    assert left_s == pytest.approx(took_s - t_s, rel=0.06)


def test_a_path_without_an_end_has_no_time_left():
    under_way = course(PathPlan(circle=Circle(radius_m=1.0), laps=0))
    assert (under_way.left_m, under_way.left_s) == (math.inf, math.inf)
    under_way.begin(ZERO)
    for _ in range(2000):
        under_way.step(1.0, DT_S)
    assert (under_way.left_m, under_way.left_s) == (math.inf, math.inf)
    assert under_way.progress_m > 5.0


@pytest.mark.parametrize(
    ("seconds", "said"),
    [(7.4, "7 s"), (99.0, "99 s"), (100.0, "2 min"), (5930.0, "99 min"), (7500.0, "2 h 05 min")],
)
def test_a_time_to_go_is_said_as_a_person_says_it(seconds, said):
    assert duration_text(seconds) == said


def test_what_is_left_in_words():
    assert left_text(0.0, 0.0) == ""
    assert left_text(12.34, 61.0) == "12.3 m, about 61 s left"
    assert left_text(math.inf, math.inf) == "until stopped"
