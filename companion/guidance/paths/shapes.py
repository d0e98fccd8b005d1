"""From a plan to a path: legs of smooth curves from stop to stop, each ready to be travelled.

Corners are rounded by turning the direction of travel from a to b with a smooth step β over a length 2 d:
p' = (1 − β) a + β b. The curve begins and ends d from the corner with no curvature, so that it joins the
lines twice continuously differentiable, and passes the corner at a distance of 3/8 d sin(θ/2).
"""

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import accumulate, pairwise
from typing import NamedTuple

from msgspec import UNSET, UnsetType

from companion.core.bounds import wrap
from companion.guidance.paths.curve import (
    Curve,
    Node,
    Point,
    between,
    sampled,
    straight,
    turn_along,
    turn_between,
)
from companion.guidance.paths.time_law import LOOKS_AHEAD_S, Limits, Profile, profiled
from companion.records import ZERO, Flags, Vector
from companion.steps import Steps, finish
from companion.telemetry.plan import MAX_SEGMENTS, Circle, LawnMower, Lemniscate, PathPlan, Waypoint

CORNER_NODES = 12
TURN_NODES = 24
"""Nodes of a rounded corner, and of a whole turn of a circle: closer than 0.01 % of the radius."""

LEMNISCATE_NODES = 96
SHARPEST_RAD = math.radians(120.0)
"""A sharper corner is no turn: the path stops there, and goes back."""

SHORTEST_M = 1e-3


class Leg(NamedTuple):
    """A smooth curve from standstill to standstill; one that loops is closed, and has no end."""

    curve: Curve
    profile: Profile
    wait_s: float
    loops: bool
    turn_s: float
    """How long it takes to its start from the end of the one before, about: where that stopped, it turns."""


class _Bare(NamedTuple):
    """A leg before its speeds are known."""

    curve: Curve
    wait_s: float
    loops: bool


class Path(NamedTuple):
    """What a plan describes. Degrees of freedom that are `relative` count from the start.

    Whatever a tick asks of a path is made while it is built, for it may have thousands of nodes.
    """

    plan: PathPlan
    legs: tuple[Leg, ...]
    relative: Flags
    length_m: float
    """One lap's."""
    extremes: tuple[Point, ...]
    """The places of the least and of the largest north, east and depth."""
    ends_m: tuple[float, ...]
    ends_s: tuple[float, ...]
    """Where along a lap, and about when, each leg ends, with what it waits there."""

    @property
    def duration_s(self) -> float:
        """One lap's, about."""
        return self.ends_s[-1]

    def laps_s(self, laps: float) -> float:
        """Return how long so many further laps take after one, about."""
        return laps * (self.legs[0].turn_s + self.duration_s)

    @property
    def laps(self) -> float:
        """How often it is travelled; infinite where it goes on until it is stopped."""
        return self.plan.laps or math.inf

    @property
    def closed(self) -> bool:
        """Whether a lap ends where it begins."""
        first, last = self.legs[0].curve[0].p, self.legs[-1].curve[-1].p
        return math.dist(first[:3], last[:3]) < 0.01

    def start(self, reference: Vector) -> Vector:
        """Return what is added to every pose of a path that begins at `reference`."""
        x, y, z, psi = (at if counts else 0.0 for at, counts in zip(reference, self.relative, strict=True))
        return (x, y, z, psi)

    def polyline(self, spacing_m: float) -> Iterator[Point | None]:
        """Give places of a lap, in order, no further apart than lines of `spacing_m` on a bend.

        None stands for a node that is left out.
        """
        for leg in self.legs:
            last_s = -math.inf
            for node in leg.curve:
                straight = not any(node.ddp[:3])
                if straight or node.s - last_s >= spacing_m or node.s == leg.curve.length:
                    last_s = node.s
                    yield node.p[:3]
                else:
                    yield None


def build(plan: PathPlan, limits: Limits) -> Path:
    """Return the path of a plan; raise ValueError, with key and value, for one that cannot be travelled."""
    return finish(building(plan, limits))


def building(plan: PathPlan, limits: Limits) -> Steps[Path]:
    """Do the same in steps: a long path takes a second."""
    shapes = [plan.circle, plan.lemniscate, plan.lawn_mower]
    given = [shape for shape in shapes if not isinstance(shape, UnsetType)]
    count = len(given) + bool(plan.waypoint)
    if count != 1:
        raise ValueError(f"{count} shapes: give waypoints, or one of circle, lemniscate, lawn_mower")
    if len(plan.waypoint) > MAX_SEGMENTS:
        raise ValueError(f"waypoint: {len(plan.waypoint)} of them; {MAX_SEGMENTS} at most: divide the path")
    deep = not isinstance((plan.waypoint[0] if plan.waypoint else given[0]).depth_m, UnsetType)
    if deep and not isinstance(plan.altitude_m, UnsetType):
        raise ValueError("altitude_m: is over the ground; give no depths beside it")
    if plan.waypoint:
        legs = yield from _polyline(plan, plan.waypoint, closed=plan.closed)
    else:
        legs = yield from _shape(plan, given[0])
    keeps = plan.heading == "keep" and isinstance(plan.heading_deg, UnsetType) and not _has_headings(plan)
    ready = []
    speed, acceleration = plan.speed_mps, plan.acceleration_mps2
    before = legs[-1].curve
    for curve, wait_s, loops in legs:
        profile = yield from profiled(curve, speed, acceleration, limits, loops=loops and plan.laps != 1)
        turn, turn_s = straight(before[-1].p, curve[0].p), 0.0
        if turn is not None:
            turn_s = (yield from profiled(turn, speed, acceleration, limits)).duration_s
        ready.append(Leg(curve, profile, wait_s, loops, turn_s))
        before = curve
    extremes = yield from _extremes([leg.curve for leg in legs])
    ends_m = tuple(accumulate(leg.curve.length for leg in legs))
    times_s = [leg.turn_s + leg.profile.duration_s + leg.wait_s for leg in ready]
    ends_s = tuple(accumulate([times_s[0] - ready[0].turn_s, *times_s[1:]]))
    if not math.isfinite(ends_m[-1] + ends_s[-1] + ready[0].turn_s):
        raise ValueError(f"the path takes {ends_m[-1]:g} m and {ends_s[-1]:g} s: must be finite")
    relative = (plan.relative, plan.relative, not deep, keeps)
    return Path(plan, tuple(ready), relative, ends_m[-1], extremes, ends_m, ends_s)


def _extremes(curves: Sequence[Curve]) -> Steps[tuple[Point, ...]]:
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


def _shape(plan: PathPlan, shape: Circle | Lemniscate | LawnMower) -> Steps[list[_Bare]]:
    z = _depth(shape.depth_m)
    if isinstance(shape, LawnMower):
        lines = yield from _lines(shape)
        return (yield from _polyline(plan, lines, closed=False))
    if isinstance(shape, Circle):
        nodes = sampled(_round(shape, z), 0.0, math.tau, TURN_NODES)
    else:
        nodes = sampled(_eight(shape, z), 0.0, math.tau, LEMNISCATE_NODES)
    curve = Curve()
    yield from curve.join(nodes)
    yield from _turn(plan, curve, loops=True)
    return [_Bare(curve, 0.0, loops=True)]


def _round(shape: Circle, z: float) -> Callable[[float], tuple[Point, Point, Point]]:
    begin, way = math.radians(shape.start_deg), 1.0 if shape.clockwise else -1.0
    r = shape.radius_m

    def point(t: float) -> tuple[Point, Point, Point]:
        c, s = math.cos(begin + way * t), math.sin(begin + way * t)
        return (
            (shape.x_m + r * c, shape.y_m + r * s, z),
            (-way * r * s, way * r * c, 0.0),
            (-r * c, -r * s, 0.0),
        )

    return point


def _eight(shape: Lemniscate, z: float) -> Callable[[float], tuple[Point, Point, Point]]:
    a, b, angle = 0.5 * shape.length_m, 0.5 * shape.width_m, math.radians(shape.direction_deg)
    c, s = math.cos(angle), math.sin(angle)

    def level(along: float, across: float) -> tuple[float, float]:
        return c * along - s * across, s * along + c * across

    def point(t: float) -> tuple[Point, Point, Point]:
        x, y = level(a * math.sin(t), b * math.sin(2.0 * t))
        return (
            (shape.x_m + x, shape.y_m + y, z),
            (*level(a * math.cos(t), 2.0 * b * math.cos(2.0 * t)), 0.0),
            (*level(-a * math.sin(t), -4.0 * b * math.sin(2.0 * t)), 0.0),
        )

    return point


def _lines(shape: LawnMower) -> Steps[list[Waypoint]]:
    angle = math.radians(shape.direction_deg)
    c, s = math.cos(angle), math.sin(angle)
    gaps = math.ceil(shape.width_m / shape.spacing_m - 1e-9)
    if 2 * (gaps + 1) > MAX_SEGMENTS:
        raise ValueError(
            f"lawn_mower.spacing_m = {shape.spacing_m:g}: makes {gaps + 1} lines; "
            f"{MAX_SEGMENTS // 2} at most: choose a larger one, or divide the area"
        )
    points = []
    for k in range(gaps + 1):
        yield 1
        across = shape.width_m * k / gaps
        ends = (0.0, shape.length_m) if k % 2 == 0 else (shape.length_m, 0.0)
        points += [
            Waypoint(
                x_m=shape.x_m + c * along - s * across,
                y_m=shape.y_m + s * along + c * across,
                depth_m=shape.depth_m,
            )
            for along in ends
        ]
    return points


def _polyline(plan: PathPlan, waypoints: Sequence[Waypoint], *, closed: bool) -> Steps[list[_Bare]]:
    """Return the legs of a polyline: it stops at waypoints without a corner, and where it waits."""
    points: list[Point] = []
    for k in range(len(waypoints)):
        points.append(_place(waypoints, k))
        yield 1
    edges = [*pairwise(points), *([(points[-1], points[0])] if closed else [])]
    if not edges or (closed and len(points) < 3):
        raise ValueError(f"{len(points)} waypoints: want at least {3 if closed else 2}")
    for k, (p, q) in enumerate(edges):
        if math.dist(p, q) < SHORTEST_M:
            raise ValueError(f"waypoint[{k}] and the next are the same place: {p[0]:g}, {p[1]:g}")
        yield 1
    count = len(points)
    reach: list[float | None] = [0.0] * count
    for k in range(0 if closed else 1, count if closed else count - 1):
        reach[k] = _reach(plan, waypoints[k], *edges[k - 1], edges[k][1])
        yield 1
    loops = closed and 0.0 not in reach
    if not loops:
        reach[0] = 0.0
    headings = [_heading(plan, waypoint) for waypoint in waypoints]
    psi = next((given for given in headings if given is not None), None)
    legs: list[_Bare] = []
    curve = Curve()
    here = _towards(points[0], edges[0][1], reach[0] or 0.0)
    stations = [(0.0, headings[0])]
    for k, (previous, at) in enumerate(edges, start=1):
        k %= count
        d = reach[k]
        turns_at = _towards(at, previous, d or 0.0)
        yield from curve.join(_line(here, turns_at, _direction(previous, at)))
        gap = math.dist(here, turns_at)
        here = at
        if d:
            following = edges[k][1]
            corner: list[Node] = []
            for node in _corner(previous, at, following, d):
                corner.append(node)
                yield 1
            stations.append((curve.length + 0.5 * corner[-1].s, headings[k]))
            yield from curve.join(corner, gap if gap < SHORTEST_M else 0.0)
            here = _towards(at, following, d)
        else:
            stations.append((curve.length, headings[k]))
        if d == 0.0 or (loops and k == 0):
            stations.append((curve.length, headings[k]))
            psi = yield from _turn_by(plan, curve, stations, psi, loops=loops)
            legs.append(_Bare(curve, waypoints[k].wait_s, loops))
            curve, stations = Curve(), [(0.0, headings[k])]
    return legs


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
    return d if d > plan.acceleration_mps2 * LOOKS_AHEAD_S**2 else 0.0


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

    return sampled(point, 0.0, 1.0, CORNER_NODES)


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


def _turn(plan: PathPlan, curve: Curve, *, loops: bool) -> Steps[None]:
    if not isinstance(plan.heading_deg, UnsetType):
        yield from turn_between(curve, [(0.0, math.radians(plan.heading_deg))])
    elif plan.heading == "along":
        yield from turn_along(curve, loops=loops)


def _turn_by(
    plan: PathPlan,
    curve: Curve,
    stations: Sequence[tuple[float, float | None]],
    last_psi: float | None,
    *,
    loops: bool,
) -> Steps[float | None]:
    """Give the curve its headings; return the last of those that waypoints give."""
    if last_psi is None:
        yield from _turn(plan, curve, loops=loops)
        return None
    known: list[tuple[float, float]] = []
    for s, psi in [(0.0, last_psi), *stations]:
        yield 1
        if psi is not None:
            last_psi += wrap(psi - last_psi)
            if known and s <= known[-1][0]:
                known[-1] = (s, last_psi)
            else:
                known.append((s, last_psi))
    yield from turn_between(curve, known)
    return last_psi


def _heading(plan: PathPlan, waypoint: Waypoint) -> float | None:
    return None if isinstance(waypoint.heading_deg, UnsetType) else math.radians(waypoint.heading_deg)


def _has_headings(plan: PathPlan) -> bool:
    return any(waypoint.heading_deg is not UNSET for waypoint in plan.waypoint)


def _place(waypoints: Sequence[Waypoint], k: int) -> Point:
    waypoint = waypoints[k]
    if isinstance(waypoint.depth_m, UnsetType) != isinstance(waypoints[0].depth_m, UnsetType):
        raise ValueError(f"waypoint[{k}].depth_m: give a depth to all waypoints, or to none")
    return (waypoint.x_m, waypoint.y_m, _depth(waypoint.depth_m))


def _depth(depth_m: float | UnsetType) -> float:
    return 0.0 if isinstance(depth_m, UnsetType) else depth_m
