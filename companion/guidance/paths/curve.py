"""One representation for all paths: a curve in x, y, z, ψ through nodes, twice continuously differentiable.

A node gives the pose and its first two derivatives by the parameter s; between two nodes runs the quintic
polynomial that has both nodes' values (Hermite interpolation). On a path s is the arc length, so that
|p'| = 1 for the place; a line that mostly turns has a smaller |p'|.

| symbol    | meaning                                                     | unit              |
|-----------|-------------------------------------------------------------|-------------------|
| s         | parameter: the arc length                                   | m                 |
| p         | x, y, z, ψ; ψ is not wrapped                                | m, rad            |
| dp, ddp   | p' and p'' by s: tangent and curvature of the place         | 1, rad/m; 1/m, …  |
"""

import math
from array import array
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import islice
from typing import NamedTuple

from companion.core.bounds import wrap
from companion.records import ZERO, Vector, vector
from companion.steps import Steps

Point = tuple[float, float, float]
APART_M = 1e-6
"""Least distance of two nodes; the places of a path are a thousand times further apart."""


class Node(NamedTuple):
    """A point of a curve: s, p, p', p''."""

    s: float
    p: Vector
    dp: Vector
    ddp: Vector


class PathCurve:
    """The curve through its nodes, two or more, s increasing from 0.

    The nodes are numbers in a row, not objects: a curve of thousands is dropped at once, within a tick.
    """

    def __init__(self, nodes: Iterable[Node] = ()) -> None:
        self._s = array("d")
        self._values = array("d")
        for node in nodes:
            self._add(node)

    def __len__(self) -> int:
        return len(self._s)

    def __getitem__(self, i: int) -> Node:
        """Return a node; -1 is the last."""
        i %= len(self._s)
        x, y, z, psi, dx, dy, dz, dpsi, ddx, ddy, ddz, ddpsi = self._values[12 * i : 12 * i + 12]
        return Node(self._s[i], (x, y, z, psi), (dx, dy, dz, dpsi), (ddx, ddy, ddz, ddpsi))

    def __iter__(self) -> Iterator[Node]:
        return (self[i] for i in range(len(self)))

    @property
    def length(self) -> float:
        """Length of the curve, m."""
        return self._s[-1]

    @property
    def turn_rad(self) -> float:
        """Increase of ψ over a lap of a closed curve."""
        return self._values[-9] - self._values[3]

    def at(self, s: float) -> Node:
        """Return the point at s, limited to the curve."""
        s = min(max(s, 0.0), self.length)
        i = min(max(bisect_right(self._s, s) - 1, 0), len(self) - 2)
        return between(self[i], self[i + 1], s)

    def join(self, nodes: Iterable[Node], gap: float = 0.0) -> Steps[None]:
        """Put nodes behind the last one, which takes the place of the first of them, `gap` further on."""
        at = (self._s[-1] if self._s else 0.0) + gap
        for node in islice(nodes, 1 if self._s else 0, None):
            self._add(node._replace(s=at + node.s))
            yield 1

    def turn(self, i: int, psi: float, dpsi: float, ddpsi: float) -> None:
        """Give a node its heading."""
        self._values[12 * i + 3 : 12 * i + 12 : 4] = array("d", (psi, dpsi, ddpsi))

    def _add(self, node: Node) -> None:
        """Take a node; raise ValueError for one that is no place, or not behind the one before."""
        values, (x, y, z, _) = (*node.p, *node.dp, *node.ddp), node.p
        if not all(map(math.isfinite, (node.s, *values))):
            raise ValueError(f"no finite line leads to x {x:g}, y {y:g}, depth {z:g} m")
        if self._s and node.s < self._s[-1] + APART_M:
            raise ValueError(f"two places at x {x:g}, y {y:g} m are too close: leave one out")
        self._s.append(node.s)
        self._values.extend(values)


def between(a: Node, b: Node, s: float) -> Node:
    """Return the point at s on the quintic polynomial from `a` to `b`."""
    h = b.s - a.s
    u = (s - a.s) / h
    p, dp, ddp = [], [], []
    for p0, p1, v0, v1, a0, a1 in zip(a.p, b.p, a.dp, b.dp, a.ddp, b.ddp, strict=True):
        c1, c2 = h * v0, 0.5 * h * h * a0
        d, e, f = p1 - p0 - c1 - c2, h * v1 - c1 - 2.0 * c2, h * h * a1 - 2.0 * c2
        c3, c4, c5 = 10.0 * d - 4.0 * e + 0.5 * f, -15.0 * d + 7.0 * e - f, 6.0 * d - 3.0 * e + 0.5 * f
        p.append(p0 + u * (c1 + u * (c2 + u * (c3 + u * (c4 + u * c5)))))
        dp.append((c1 + u * (2.0 * c2 + u * (3.0 * c3 + u * (4.0 * c4 + u * 5.0 * c5)))) / h)
        ddp.append((2.0 * c2 + u * (6.0 * c3 + u * (12.0 * c4 + u * 20.0 * c5))) / (h * h))
    return Node(s, vector(p), vector(dp), vector(ddp))


METRES_PER_RAD = 0.5
"""How much of s a turn on the spot counts for."""


def straight(start: Vector, end: Vector) -> PathCurve | None:
    """Return a straight line that turns by the short way, smoothly; None where both poses are the same."""
    step = (end[0] - start[0], end[1] - start[1], end[2] - start[2])
    turn = wrap(end[3] - start[3])
    s = max(math.hypot(*step), METRES_PER_RAD * abs(turn))
    if s < 1e-3:
        return None
    dp = (step[0] / s, step[1] / s, step[2] / s, 0.0)
    return PathCurve([Node(0.0, start, dp, ZERO), Node(s, (*end[:3], start[3] + turn), dp, ZERO)])


def sampled(point: Callable[[float], tuple[Point, Point, Point]], end: float, count: int) -> Iterator[Node]:
    """Give `count` + 1 nodes of a curve that is given by another parameter t from 0 to `end`.

    `point` gives the place and its first two derivatives by t; ψ stays 0.
    """
    dt = end / count
    s, previous_speed = 0.0, 0.0
    for k in range(count + 1):
        p, p_t, p_tt = point(k * dt)
        speed = math.hypot(*p_t)
        if k:
            _, middle, _ = point((k - 0.5) * dt)
            s += (previous_speed + 4.0 * math.hypot(*middle) + speed) * dt / 6.0
        previous_speed = speed
        x, y, z = (v / speed for v in p_t)
        along = sum(a * v for a, v in zip(p_tt, p_t, strict=True)) / (speed * speed)
        kx, ky, kz = ((a - along * v) / (speed * speed) for a, v in zip(p_tt, p_t, strict=True))
        yield Node(s, (*p, 0.0), (x, y, z, 0.0), (kx, ky, kz, 0.0))


def turn_along(curve: PathCurve, *, loops: bool) -> Steps[None]:
    """Turn ψ along the path, 0 where it begins vertically."""
    psi = 0.0
    headings, bends, s = array("d"), array("d"), array("d")
    for node in curve:
        (tx, ty, _, _), (kx, ky, _, _) = node.dp, node.ddp
        level = tx * tx + ty * ty
        if level > 1e-6:
            psi += wrap(math.atan2(ty, tx) - psi)
        headings.append(psi)
        bends.append((tx * ky - ty * kx) / level if level > 1e-6 else 0.0)
        s.append(node.s)
        yield 1
    last = len(curve) - 1
    for k in range(len(curve)):
        previous, following = max(k - 1, 0), min(k + 1, last)
        span = s[following] - s[previous]
        if loops and k in (0, last):
            previous, following = last - 1, 1
            span = s[-1] - s[-2] + s[1]
        curve.turn(k, headings[k], bends[k], (bends[following] - bends[previous]) / span)
        yield 1


def turn_between(curve: PathCurve, stations: Sequence[tuple[float, float]]) -> Steps[None]:
    """Turn ψ smoothly from station to station: (s, ψ), s increasing."""
    i = 0
    for k, node in enumerate(curve):
        yield 1
        while i + 1 < len(stations) and stations[i + 1][0] <= node.s:
            i += 1
        (s, psi), (s_next, psi_next) = stations[i], stations[min(i + 1, len(stations) - 1)]
        h = s_next - s
        if h <= 0.0 or node.s < s:
            curve.turn(k, psi, 0.0, 0.0)
            continue
        u, step = (node.s - s) / h, psi_next - psi
        share, rate = u**3 * (10.0 - 15.0 * u + 6.0 * u * u), 30.0 * u * u * (1.0 - u) ** 2
        bend = 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u)
        curve.turn(k, psi + step * share, step * rate / h, step * bend / (h * h))
