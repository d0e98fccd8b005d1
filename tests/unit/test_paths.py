"""Geometry and time law of paths: continuous, within their limits, closed where they say so."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from companion.config import load_config
from companion.core.reference import ACCELERATION_LAG_S
from companion.guidance.paths.shapes import build as built
from companion.guidance.paths.time_law import TimeLaw, limits, profiled
from companion.steps import finish
from companion.telemetry.plan import Circle, LawnMower, Lemniscate, PathPlan, Waypoint

DT_S = 0.02
LIMITS = limits(load_config())


def build(plan):
    return built(plan, LIMITS)


def polyline(*places, **keys):
    points = tuple(Waypoint(x_m=x, y_m=y, depth_m=z) for x, y, z in places)
    return PathPlan(waypoint=points, **keys)


SQUARE = ((0, 0, 2), (4, 0, 2), (4, 4, 2), (0, 4, 2))
PLANS = {
    "circle": PathPlan(circle=Circle(radius_m=2.0, depth_m=3.0)),
    "counter-clockwise": PathPlan(circle=Circle(radius_m=1.0, clockwise=False), heading="keep"),
    "lemniscate": PathPlan(lemniscate=Lemniscate(length_m=4.0, width_m=2.0, depth_m=2.0, direction_deg=30.0)),
    "lawn-mower": PathPlan(lawn_mower=LawnMower(length_m=6.0, width_m=3.0, spacing_m=1.5, depth_m=2.0)),
    "square": polyline(*SQUARE, closed=True),
    "open": polyline((0, 0, 2), (5, 0, 2), (5, 3, 4), (8, 3, 4), corner_m=1.0),
    "fixed heading": polyline(*SQUARE, heading_deg=45.0),
    "headings": PathPlan(
        waypoint=(
            Waypoint(x_m=0.0, y_m=0.0, heading_deg=0.0),
            Waypoint(x_m=4.0, y_m=0.0),
            Waypoint(x_m=4.0, y_m=4.0, heading_deg=170.0),
            Waypoint(x_m=0.0, y_m=4.0, heading_deg=-170.0),
        )
    ),
    "a corner that nearly turns back": polyline((0, 0, 2), (4, 0, 2), (2.5, 3, 2), corner_m=0.3),
    "fast": polyline((0, 0, 2), (9, 0, 2), (9, 9, 2), speed_mps=2.0, acceleration_mps2=1.0),
}


def travelled(curve, plan, laps=1.0, pace=lambda t: 1.0, longest_s=600.0):
    limited = profiled(curve, plan.speed_mps, plan.acceleration_mps2, LIMITS, loops=laps > 1)
    profile = finish(limited)
    law = TimeLaw(profile, laps)
    rows = [law.setpoint()]
    while not law.arrived:
        rows.append(law.step(pace(len(rows) * DT_S), DT_S))
        assert len(rows) * DT_S < longest_s, "it never arrives"
    eta, rate, acc = (
        np.array([getattr(row, name) for row in rows]) for name in ("eta_d", "eta_d_dot", "eta_d_ddot")
    )
    eta[:, 3] = np.unwrap(eta[:, 3])
    return eta, rate, acc


def continuous(eta, rate, acc):
    """Rates are the derivatives of poses and accelerations of rates, and none of the three jumps."""
    middle = 0.5 * (rate[1:] + rate[:-1])
    np.testing.assert_allclose(np.diff(eta, axis=0) / DT_S, middle, atol=0.01)
    np.testing.assert_allclose(np.diff(rate, axis=0) / DT_S, 0.5 * (acc[1:] + acc[:-1]), atol=0.05)
    jerk_limited = 2.0 * DT_S / (ACCELERATION_LAG_S + DT_S)
    assert np.abs(np.diff(acc[:, :3], axis=0)).max() < jerk_limited * np.abs(acc[:, :3]).max() + 0.002


@pytest.mark.parametrize("name", PLANS)
def test_a_path_is_continuous_and_keeps_its_limits(name):
    plan = PLANS[name]
    most = min(plan.acceleration_mps2, LIMITS.acceleration)
    for leg in build(plan).legs:
        eta, rate, acc = travelled(leg.curve, plan)
        continuous(eta, rate, acc)
        assert np.linalg.norm(rate[:, :3], axis=1).max() <= plan.speed_mps + 1e-6
        assert np.hypot(rate[:, 0], rate[:, 1]).max() <= LIMITS.level + 1e-6
        assert np.abs(rate[:, 2]).max() <= LIMITS.vertical + 1e-6
        assert np.abs(rate[:, 3]).max() <= LIMITS.turn + 1e-6
        assert np.linalg.norm(acc[:, :3], axis=1).max() <= most * 1.02
        for rows in (rate, acc):
            assert np.abs(rows[0]).max() < 1e-9
            assert np.abs(rows[-1, :3]).max() < 0.01


@pytest.mark.parametrize("name", ["circle", "counter-clockwise", "lemniscate", "square"])
def test_a_closed_path_ends_where_it_begins_with_the_same_direction_and_curvature(name):
    (leg,) = build(PLANS[name]).legs
    first, last = leg.curve.at(0.0), leg.curve.at(leg.curve.length)
    for key in ("p", "dp", "ddp"):
        np.testing.assert_allclose(getattr(first, key)[:3], getattr(last, key)[:3], atol=1e-9)
    assert leg.loops
    eta, rate, acc = travelled(leg.curve, PLANS[name], laps=2.0)
    continuous(eta, rate, acc)
    np.testing.assert_allclose(eta[-1, :3], eta[0, :3], atol=0.005)


def test_shapes_are_where_they_should_be():
    def places(name):
        return np.concatenate([travelled(leg.curve, PLANS[name])[0] for leg in build(PLANS[name]).legs])

    circle = places("circle")
    np.testing.assert_allclose(np.hypot(circle[:, 0], circle[:, 1]), 2.0, atol=1e-4)
    np.testing.assert_allclose(circle[0, :3], [2.0, 0.0, 3.0])
    assert circle[20:200, 1].min() > 0.0, "clockwise, seen from above: from north to east"
    eight = places("lemniscate")
    along = eight[:, 0] * math.cos(math.radians(30)) + eight[:, 1] * math.sin(math.radians(30))
    assert (along.min(), along.max()) == pytest.approx((-2.0, 2.0), abs=1e-3)
    mower = places("lawn-mower")
    assert (mower[:, 0].max(), mower[:, 1].max()) == pytest.approx((6.0, 3.0), abs=0.01)


def test_a_corner_is_rounded_and_no_further_from_the_waypoint_than_said():
    d = 0.8
    (leg,) = build(polyline((0, 0, 2), (4, 0, 2), (4, 4, 2), corner_m=d)).legs
    places = np.array([leg.curve.at(s).p[:3] for s in np.linspace(0.0, leg.curve.length, 500)])
    nearest = np.linalg.norm(places - [4.0, 0.0, 2.0], axis=1).min()
    assert nearest == pytest.approx(3 / 8 * d * math.sin(math.pi / 4), abs=1e-3)


def test_without_a_corner_it_stops_at_the_waypoint_and_waits():
    plan = PathPlan(
        waypoint=(
            Waypoint(x_m=0.0, y_m=0.0),
            Waypoint(x_m=2.0, y_m=0.0, wait_s=5.0),
            Waypoint(x_m=2.0, y_m=2.0),
        )
    )
    path = build(plan)
    assert [leg.wait_s for leg in path.legs] == [5.0, 0.0]
    assert path.legs[0].curve.at(9.0).p[:2] == (2.0, 0.0)
    assert path.relative == (False, False, True, False), "no depth was given: that of the start"


def test_the_heading_follows_the_path_or_the_waypoints():
    (leg,) = build(PLANS["circle"]).legs
    eta, rate, _ = travelled(leg.curve, PLANS["circle"])
    moving = np.hypot(rate[:, 0], rate[:, 1]) > 0.01
    course = np.unwrap(np.arctan2(rate[moving, 1], rate[moving, 0]))
    np.testing.assert_allclose(eta[moving, 3] - course, 0.0, atol=0.01)
    (leg,) = build(PLANS["headings"]).legs
    assert math.degrees(leg.curve.at(0.0).p[3]) == pytest.approx(0.0)
    assert math.degrees(leg.curve.at(leg.curve.length).p[3]) == pytest.approx(190.0), "the short way"


def test_a_slower_pace_slows_it_and_none_stops_it_where_it_is_without_a_jump():
    plan = PLANS["lemniscate"]
    curve = build(plan).legs[0].curve

    def pace(t_s):
        return 0.0 if 12.0 < t_s < 30.0 else 0.4 if t_s > 30.0 else 1.0

    eta, rate, acc = travelled(curve, plan, pace=pace)
    continuous(eta, rate, acc)
    speed = np.linalg.norm(rate[:, :3], axis=1)
    t_s = DT_S * np.arange(len(speed))
    assert speed[(t_s > 20.0) & (t_s < 30.0)].max() < 0.005
    assert speed[(t_s > 40.0) & (t_s < 60.0)].min() > 0.05
    assert speed[t_s > 36.0].max() <= 0.4 * plan.speed_mps + 1e-3


@pytest.mark.parametrize(
    ("plan", "said"),
    [
        (PathPlan(), "0 shapes"),
        (polyline((0, 0, 1)), "want at least 2"),
        (polyline((0, 0, 1), (0, 0, 1)), r"waypoint\[0\] and the next are the same place"),
        (
            PathPlan(waypoint=(Waypoint(x_m=0.0, y_m=0.0, depth_m=1.0), Waypoint(x_m=1.0, y_m=0.0))),
            r"waypoint\[1\].depth_m",
        ),
        (PathPlan(circle=Circle(radius_m=1.0), lemniscate=Lemniscate(length_m=1.0, width_m=1.0)), "2 shapes"),
        (PathPlan(lawn_mower=LawnMower(length_m=1.0, width_m=900.0, spacing_m=0.1)), "lawn_mower.spacing_m"),
    ],
)
def test_what_is_no_path_is_refused_with_the_key(plan, said):
    with pytest.raises(ValueError, match=said):
        build(plan)


places = st.tuples(st.floats(-9, 9), st.floats(-9, 9), st.floats(1, 9))
NEARLY_MEET = [(0, 0, 3), (0.0201, 0, 3), (0.0201, 0.02, 3), (0.04, 0.02, 3), (0.04, 0.0403, 3)]
"""Corners with less than a millimetre between two of them."""


@example([(0, 0, 3), (0, 1, 3), (0, 0, 1), (0, 1, 1)], 1, True, "keep")  # two corners meet in the middle
@example([(1, 0, 1.03125), (1, 0, 1), (0, 0, 1.5)], 1, False, "along")  # a corner shorter than the look-ahead
@example(
    [(0, 0, 3), (0, 0.004, 3), (0, -1, 1)], 1, False, "keep"
)  # one that is over before the speed follows
@example(NEARLY_MEET, 2, False, "along")
@given(
    st.lists(places, min_size=3, max_size=5),
    st.just(0.0) | st.floats(0.001, 2),
    st.booleans(),
    st.sampled_from(["along", "keep"]),
)
def test_any_polyline_is_continuous_and_keeps_its_limits(points, corner_m, closed, heading):
    plan = polyline(*points, corner_m=corner_m, closed=closed, heading=heading, speed_mps=0.5)
    try:
        path = build(plan)
    except ValueError:
        return
    ends = [leg.curve[-1].p[:3] for leg in path.legs]
    begins = [leg.curve[0].p[:3] for leg in path.legs]
    for end, begin in zip(ends, begins[1:], strict=False):
        np.testing.assert_allclose(end, begin, atol=1e-9)
    assert not closed or math.dist(ends[-1], begins[0]) < 0.01
    for leg in path.legs:
        for node, after in pairwise(leg.curve):
            assert math.hypot(*node.dp[:3]) == pytest.approx(1.0, abs=1e-9)
            assert math.hypot(*leg.curve.at(0.5 * (node.s + after.s)).dp[:3]) == pytest.approx(1.0, abs=0.01)
        law = TimeLaw(leg.profile)
        before = law.setpoint()
        for _ in range(250):
            now = law.step(1.0, DT_S)
            assert math.hypot(*now.eta_d_dot[:3]) <= LIMITS.vertical + LIMITS.level
            assert math.hypot(*now.eta_d_ddot[:3]) <= plan.acceleration_mps2 * 1.05
            assert math.dist(now.eta_d[:3], before.eta_d[:3]) <= 0.5 * DT_S + 1e-6
            before = now
