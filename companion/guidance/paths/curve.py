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
from bisect import bisect_right
from collections.abc import Callable, Sequence
from typing import NamedTuple

from companion.control.bounds import wrap
from companion.records import ZERO, Vector, vector

Point = tuple[float, float, float]


class Node(NamedTuple):
    """A point of a curve: s, p, p', p''."""

    s: float
    p: Vector
    dp: Vector
    ddp: Vector


class Curve:
    """The curve through `nodes`, two or more, s increasing from 0."""

    def __init__(self, nodes: Sequence[Node]) -> None:
        self.nodes = nodes
        self._s = [node.s for node in nodes]
        self.length = nodes[-1].s
        self.turn_rad = nodes[-1].p[3] - nodes[0].p[3]
        """By how much ψ is larger after a lap of a closed curve."""

    def at(self, s: float) -> Node:
        """Return the point at s, limited to the curve."""
        s = min(max(s, 0.0), self.length)
        i = min(max(bisect_right(self._s, s) - 1, 0), len(self.nodes) - 2)
        return between(self.nodes[i], self.nodes[i + 1], s)


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


def straight(start: Vector, end: Vector) -> Curve | None:
    """Return a straight line that turns by the short way, smoothly; None where both poses are the same."""
    step = (end[0] - start[0], end[1] - start[1], end[2] - start[2])
    turn = wrap(end[3] - start[3])
    s = max(math.hypot(*step), METRES_PER_RAD * abs(turn))
    if s < 1e-3:
        return None
    dp = (step[0] / s, step[1] / s, step[2] / s, 0.0)
    return Curve([Node(0.0, start, dp, ZERO), Node(s, (*end[:3], start[3] + turn), dp, ZERO)])


def sampled(
    point: Callable[[float], tuple[Point, Point, Point]], start: float, end: float, count: int
) -> list[Node]:
    """Return `count` + 1 nodes of a curve that is given by another parameter t from `start` to `end`.

    `point` gives the place and its first two derivatives by t; ψ stays 0.
    """
    dt = (end - start) / count
    nodes = []
    s, before = 0.0, 0.0
    for k in range(count + 1):
        p, p_t, p_tt = point(start + k * dt)
        speed = math.hypot(*p_t)
        if k:
            _, middle, _ = point(start + (k - 0.5) * dt)
            s += (before + 4.0 * math.hypot(*middle) + speed) * abs(dt) / 6.0
        before = speed
        x, y, z = (v / math.copysign(speed, dt) for v in p_t)
        along = sum(a * v for a, v in zip(p_tt, p_t, strict=True)) / (speed * speed)
        kx, ky, kz = ((a - along * v) / (speed * speed) for a, v in zip(p_tt, p_t, strict=True))
        nodes.append(Node(s, (*p, 0.0), (x, y, z, 0.0), (kx, ky, kz, 0.0)))
    return nodes


def joined(nodes: list[Node], more: Sequence[Node]) -> None:
    """Put `more` behind `nodes`, whose last one is the first of `more`."""
    at = nodes[-1].s if nodes else 0.0
    nodes += [node._replace(s=at + node.s) for node in (more[1:] if nodes else more)]


def turned_along(nodes: Sequence[Node], *, loops: bool) -> list[Node]:
    """Return the nodes with ψ along the path, 0 where it begins vertically."""
    psi = 0.0
    found = []
    for node in nodes:
        (tx, ty, _, _), (kx, ky, _, _) = node.dp, node.ddp
        level = tx * tx + ty * ty
        if level > 1e-6:
            psi += wrap(math.atan2(ty, tx) - psi)
        found.append((psi, (tx * ky - ty * kx) / level if level > 1e-6 else 0.0))
    turned = []
    for k, node in enumerate(nodes):
        before, after = max(k - 1, 0), min(k + 1, len(nodes) - 1)
        span = nodes[after].s - nodes[before].s
        if loops and k in (0, len(nodes) - 1):
            before, after = len(nodes) - 2, 1
            span = nodes[-1].s - nodes[-2].s + nodes[1].s
        bend = (found[after][1] - found[before][1]) / span
        turned.append(_with_heading(node, *found[k], bend))
    return turned


def turned_between(nodes: Sequence[Node], stations: Sequence[tuple[float, float]]) -> list[Node]:
    """Return the nodes with ψ going smoothly from station to station: (s, ψ), s increasing."""
    turned, i = [], 0
    for node in nodes:
        while i + 1 < len(stations) and stations[i + 1][0] <= node.s:
            i += 1
        (s, psi), (s_next, psi_next) = stations[i], stations[min(i + 1, len(stations) - 1)]
        h = s_next - s
        if h <= 0.0 or node.s < s:
            turned.append(_with_heading(node, psi, 0.0, 0.0))
            continue
        u, step = (node.s - s) / h, psi_next - psi
        share, rate = u**3 * (10.0 - 15.0 * u + 6.0 * u * u), 30.0 * u * u * (1.0 - u) ** 2
        bend = 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u)
        turned.append(_with_heading(node, psi + step * share, step * rate / h, step * bend / (h * h)))
    return turned


def _with_heading(node: Node, psi: float, dpsi: float, ddpsi: float) -> Node:
    return Node(node.s, (*node.p[:3], psi), (*node.dp[:3], dpsi), (*node.ddp[:3], ddpsi))
