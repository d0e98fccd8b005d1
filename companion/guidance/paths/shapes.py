"""From a plan to a path: legs of smooth curves from stop to stop, each ready to be travelled.

Corners are rounded by turning the direction of travel from a to b with a smooth step β over a length 2 d:
p' = (1 − β) a + β b. The curve begins and ends d from the corner with no curvature, so that it joins the
lines twice continuously differentiable, and passes the corner at a distance of 3/8 d sin(θ/2).
"""

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

from msgspec import UNSET, UnsetType

from companion.core.bounds import wrap
from companion.guidance.paths.curve import (
    Node,
    PathCurve,
    Point,
    between,
    sampled,
    turn_along,
    turn_between,
)
from companion.guidance.paths.time_law import REFERENCE_LAG_S, PathLimits, Profile, profiled
from companion.records import ZERO, Flags, Vector, chosen
from companion.steps import Steps, finish
from companion.telemetry.plan import MAX_SEGMENTS, Circle, LawnMower, Lemniscate, PathPlan, Waypoint

CORNER_NODES, TURN_NODES, LEMNISCATE_NODES = 12, 24, 96
"""Nodes of a rounded corner, a turn of a circle, a lemniscate: within 0.01 % of the radius."""
SHARPEST_RAD = math.radians(120.0)
"""A sharper corner is no turn: the path stops there, and goes back."""
SHORTEST_M = 1e-3
"""Shortest line: a thousand times `curve.APART_M`."""


class Leg(NamedTuple):
    """A smooth curve from standstill to standstill; one that loops is closed, and has no end."""

    curve: PathCurve
    profile: Profile
    wait_s: float
    loops: bool


Bare = tuple[PathCurve, float, bool]
"""A leg before its speeds are known: its curve, how long it waits at the end, and whether it loops."""


class Path(NamedTuple):
    """What a plan describes. Degrees of freedom that are `relative` count from the start.

    Whatever a tick asks of a path is made while it is built, for it may have thousands of nodes.
    """

    plan: PathPlan
    legs: tuple[Leg, ...]
    relative: Flags
    extremes: tuple[Point, ...]
    """The places of the least and of the largest north, east and depth."""
    length_m: float
    """One lap's."""

    @property
    def laps(self) -> float:
        """How often it is travelled; infinite where it goes on until it is stopped."""
        return self.plan.laps or math.inf

    def start(self, reference: Vector) -> Vector:
        """Return what is added to every pose of a path that begins at `reference`."""
        return chosen(self.relative, reference, ZERO)

    def polyline(self, spacing_m: float) -> Iterator[Point | None]:
        """Give places of a lap, in order, no further apart than lines of `spacing_m` on a bend.

        None stands for a node that is left out.
        """
        for leg in self.legs:
            last_s = -math.inf
            for node in leg.curve:
                kept = not any(node.ddp[:3]) or node.s - last_s >= spacing_m or node.s == leg.curve.length
                last_s = node.s if kept else last_s
                yield node.p[:3] if kept else None


def build(plan: PathPlan, limits: PathLimits) -> Path:
    """Return the path of a plan; raise ValueError, with key and value, for one that cannot be travelled."""
    return finish(building(plan, limits))


def building(plan: PathPlan, limits: PathLimits) -> Steps[Path]:
    """Do the same in steps: a long path takes a second."""
    shapes = [plan.circle, plan.lemniscate, plan.lawn_mower]
    given = [shape for shape in shapes if not isinstance(shape, UnsetType)]
    if (count := len(given) + bool(plan.waypoint)) != 1:
        raise ValueError(f"{count} shapes: give waypoints, or one of circle, lemniscate, lawn_mower")
    if len(plan.waypoint) > MAX_SEGMENTS:
        raise ValueError(f"waypoint: {len(plan.waypoint)} of them; {MAX_SEGMENTS} at most: divide the path")
    deep = not isinstance((plan.waypoint[0] if plan.waypoint else given[0]).depth_m, UnsetType)
    if deep and not isinstance(plan.altitude_m, UnsetType):
        raise ValueError("altitude_m: is over the ground; give no depths beside it")
    if plan.waypoint:
        bare = yield from _polyline(plan, plan.waypoint, closed=plan.closed)
    else:
        bare = yield from _shape(plan, given[0])
    legs = []
    for curve, wait_s, loops in bare:
        again = loops and plan.laps != 1
        profile = yield from profiled(curve, plan.speed_mps, plan.acceleration_mps2, limits, loops=again)
        legs.append(Leg(curve, profile, wait_s, loops))
    extremes = yield from _extremes([leg.curve for leg in legs])
    length_m = sum(leg.curve.length for leg in legs)
    if not math.isfinite(length_m):
        raise ValueError(f"the path takes {length_m:g} m: must be finite")
    given_headings = any(waypoint.heading_deg is not UNSET for waypoint in plan.waypoint)
    keeps = plan.heading == "keep" and plan.heading_deg is UNSET and not given_headings
    return Path(plan, tuple(legs), (plan.relative, plan.relative, not deep, keeps), extremes, length_m)


def _extremes(curves: Sequence[PathCurve]) -> Steps[tuple[Point, ...]]:
    """Return the six places that are furthest south, west, up, north, east and down."""
    low, high = ([curves[0][0].p[:3]] * 3 for _ in range(2))
    for curve in curves:
        for i in range(len(curve) - 1):
            a, b = curve[i], curve[i + 1]
            for place in (a.p[:3], between(a, b, 0.5 * (a.s + b.s)).p[:3], b.p[:3]):
                for axis, value in enumerate(place):
                    if value < low[axis][axis]:
                        low[axis] = place
                    if value > high[axis][axis]:
                        high[axis] = place
            yield 1
    return (*low, *high)


def _shape(plan: PathPlan, shape: Circle | Lemniscate | LawnMower) -> Steps[list[Bare]]:
    z = _depth(shape.depth_m)
    if isinstance(shape, LawnMower):
        lines = yield from _lines(shape)
        return (yield from _polyline(plan, lines, closed=False))
    if isinstance(shape, Circle):
        nodes = sampled(_round(shape, z), math.tau, TURN_NODES)
    else:
        nodes = sampled(_eight(shape, z), math.tau, LEMNISCATE_NODES)
    curve = PathCurve()
    yield from curve.join(nodes)
    yield from _turn(plan, curve, loops=True)
    return [(curve, 0.0, True)]


def _round(shape: Circle, z: float) -> Callable[[float], tuple[Point, Point, Point]]:
    """Return place and derivatives of a circle by its angle."""
    begin, way, r = math.radians(shape.start_deg), 1.0 if shape.clockwise else -1.0, shape.radius_m

    def point(t: float) -> tuple[Point, Point, Point]:
        along, across = r * math.cos(begin + way * t), r * math.sin(begin + way * t)
        place = (shape.x_m + along, shape.y_m + across, z)
        return place, (-way * across, way * along, 0.0), (-along, -across, 0.0)

    return point


def _eight(shape: Lemniscate, z: float) -> Callable[[float], tuple[Point, Point, Point]]:
    """Return place and derivatives of a lemniscate by its parameter."""
    a, b, level = 0.5 * shape.length_m, 0.5 * shape.width_m, _turned(shape.direction_deg)

    def point(t: float) -> tuple[Point, Point, Point]:
        x, y = level(a * math.sin(t), b * math.sin(2.0 * t))
        rate = level(a * math.cos(t), 2.0 * b * math.cos(2.0 * t))
        bend = level(-a * math.sin(t), -4.0 * b * math.sin(2.0 * t))
        return (shape.x_m + x, shape.y_m + y, z), (*rate, 0.0), (*bend, 0.0)

    return point


def _turned(direction_deg: float) -> Callable[[float, float], tuple[float, float]]:
    """Return what turns a step along and across a direction into one north and east."""
    c, s = math.cos(math.radians(direction_deg)), math.sin(math.radians(direction_deg))
    return lambda along, across: (c * along - s * across, s * along + c * across)


def _lines(shape: LawnMower) -> Steps[list[Waypoint]]:
    level = _turned(shape.direction_deg)
    gaps = math.ceil(shape.width_m / shape.spacing_m - 1e-9)
    if 2 * (gaps + 1) > MAX_SEGMENTS:
        raise ValueError(
            f"lawn_mower.spacing_m = {shape.spacing_m:g}: makes {gaps + 1} lines; "
            f"{MAX_SEGMENTS // 2} at most: choose a larger one, or divide the area"
        )
    points = []
    for k in range(gaps + 1):
        yield 1
        for along in (0.0, shape.length_m) if k % 2 == 0 else (shape.length_m, 0.0):
            x, y = level(along, shape.width_m * k / gaps)
            points.append(Waypoint(x_m=shape.x_m + x, y_m=shape.y_m + y, depth_m=shape.depth_m))
    return points


def _polyline(plan: PathPlan, waypoints: Sequence[Waypoint], *, closed: bool) -> Steps[list[Bare]]:
    """Return the legs of a polyline: it stops at waypoints without a corner, and where it waits."""
    edges = yield from _edges(waypoints, closed=closed)
    count = len(waypoints)
    reach: list[float | None] = [0.0] * count
    for k in range(0 if closed else 1, count if closed else count - 1):
        reach[k] = _reach(plan, waypoints[k], *edges[k - 1], edges[k][1])
        yield 1
    loops = closed and 0.0 not in reach
    if not loops:
        reach[0] = 0.0
    headings = [_radians(waypoint.heading_deg) for waypoint in waypoints]
    psi = next((given for given in headings if given is not None), None)
    legs: list[Bare] = []
    curve, stations = PathCurve(), [(0.0, headings[0])]
    here = _towards(*edges[0], reach[0] or 0.0)
    for k, (previous, at) in enumerate(edges, start=1):
        if math.dist(previous, at) < SHORTEST_M:
            raise ValueError(f"waypoint[{k - 1}] and the next are the same place: {at[0]:g}, {at[1]:g}")
        k %= count
        d = reach[k] or 0.0
        turns_at = _towards(at, previous, d)
        yield from curve.join(_line(here, turns_at, _direction(previous, at)))
        gap, here = math.dist(here, turns_at), _towards(at, edges[k % len(edges)][1], d)
        station = curve.length
        if d:
            corner = list(_corner(previous, at, edges[k][1], d))
            yield CORNER_NODES
            station += 0.5 * corner[-1].s
            yield from curve.join(corner, gap if gap < SHORTEST_M else 0.0)
        stations.append((station, headings[k]))
        if reach[k] == 0.0 or (loops and k == 0):
            stations.append((curve.length, headings[k]))
            psi = yield from _turn(plan, curve, stations, psi, loops=loops)
            legs.append((curve, waypoints[k].wait_s, loops))
            curve, stations = PathCurve(), [(0.0, headings[k])]
    return legs


def _edges(waypoints: Sequence[Waypoint], *, closed: bool) -> Steps[list[tuple[Point, Point]]]:
    """Return the lines between waypoints; raise ValueError for too few."""
    points: list[Point] = []
    for k in range(len(waypoints)):
        points.append(_place(waypoints, k))
        yield 1
    edges = [*pairwise(points), *([(points[-1], points[0])] if closed else [])]
    if not edges or (closed and len(points) < 3):
        raise ValueError(f"{len(points)} waypoints: want at least {3 if closed else 2}")
    return edges


def _reach(plan: PathPlan, waypoint: Waypoint, previous: Point, at: Point, following: Point) -> float | None:
    """Return how far from a waypoint its turn begins; 0 where it stops there, None where it goes straight.

    It stops where a turn would be over before the speed can follow it.
    """
    a, b = _direction(previous, at), _direction(at, following)
    half_turn = math.atan2(math.dist(a, b), math.hypot(*(p + q for p, q in zip(a, b, strict=True))))
    corner = plan.corner_m if isinstance(waypoint.corner_m, UnsetType) else waypoint.corner_m
    if waypoint.wait_s > 0.0 or 2.0 * half_turn > SHARPEST_RAD:
        return 0.0
    if half_turn < 1e-6:
        return None
    d = min(corner, 0.5 * math.dist(previous, at), 0.5 * math.dist(at, following))
    return d if d > plan.acceleration_mps2 * REFERENCE_LAG_S**2 else 0.0


def _corner(previous: Point, at: Point, following: Point, d: float) -> Iterator[Node]:
    a, b = _direction(previous, at), _direction(at, following)
    begin = _towards(at, previous, d)

    def point(t: float) -> tuple[Point, Point, Point]:
        beta, rate = t * t * (3.0 - 2.0 * t), 6.0 * t * (1.0 - t)
        whole = t**3 * (1.0 - 0.5 * t)
        p, v, acc = [], [], []
        for p0, a_i, b_i in zip(begin, a, b, strict=True):
            p.append(p0 + 2.0 * d * ((t - whole) * a_i + whole * b_i))
            v.append(2.0 * d * ((1.0 - beta) * a_i + beta * b_i))
            acc.append(2.0 * d * rate * (b_i - a_i))
        return (p[0], p[1], p[2]), (v[0], v[1], v[2]), (acc[0], acc[1], acc[2])

    return sampled(point, 1.0, CORNER_NODES)


def _line(begin: Point, end: Point, along: Point) -> list[Node]:
    """Return the straight part of an edge whose direction is `along`: one node where two corners meet."""
    s = math.dist(begin, end)
    places = ((0.0, begin),) if s < SHORTEST_M else ((0.0, begin), (s, end))
    return [Node(at, (*place, 0.0), (*along, 0.0), ZERO) for at, place in places]


def _direction(begin: Point, end: Point) -> Point:
    s = math.dist(begin, end) or 1.0
    return ((end[0] - begin[0]) / s, (end[1] - begin[1]) / s, (end[2] - begin[2]) / s)


def _towards(begin: Point, end: Point, d: float) -> Point:
    x, y, z = _direction(begin, end)
    return (begin[0] + d * x, begin[1] + d * y, begin[2] + d * z)


def _turn(
    plan: PathPlan,
    curve: PathCurve,
    stations: Sequence[tuple[float, float | None]] = (),
    last_psi: float | None = None,
    *,
    loops: bool,
) -> Steps[float | None]:
    """Give the curve its headings, and return the last: of waypoints, a fixed one, or along the path."""
    fixed = _radians(plan.heading_deg)
    if last_psi is not None:
        known = {}
        for s, psi in [(0.0, last_psi), *stations]:
            yield 1
            if psi is not None:
                last_psi += wrap(psi - last_psi)
                known[s] = last_psi
        yield from turn_between(curve, list(known.items()))
    elif fixed is not None:
        yield from turn_between(curve, [(0.0, fixed)])
    elif plan.heading == "along":
        yield from turn_along(curve, loops=loops)
    return last_psi


def _radians(degrees: float | UnsetType) -> float | None:
    return None if isinstance(degrees, UnsetType) else math.radians(degrees)


def _place(waypoints: Sequence[Waypoint], k: int) -> Point:
    waypoint = waypoints[k]
    if isinstance(waypoint.depth_m, UnsetType) != isinstance(waypoints[0].depth_m, UnsetType):
        raise ValueError(f"waypoint[{k}].depth_m: give a depth to all waypoints, or to none")
    return (waypoint.x_m, waypoint.y_m, _depth(waypoint.depth_m))


def _depth(depth_m: float | UnsetType) -> float:
    return 0.0 if isinstance(depth_m, UnsetType) else depth_m
