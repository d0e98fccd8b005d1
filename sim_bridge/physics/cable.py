"""The tether as a chain of point masses from the surface boat to the vehicle: weight, drag, tension.

| symbol | meaning | unit |
|---|---|---|
| r, v | from one node to the next, velocity | m, m/s |
| l, d | length of an unloaded segment, diameter | m |
| m | mass of a node, with the water that it takes along | kg |
| w | weight in water | N/m |
| c_n, c_t | drag coefficients across and along the cable, on d and π d | - |
| k, c | stiffness and damping of a segment | N/m, N·s/m |
| T | tension: a segment pulls and never pushes | N |

    T = max(0, k (|r| − l) + c |r|')
    m v' = Σ T r̂ + w l − ½ ρ d l (c_n |v_n| v_n + π c_t |v_t| v_t),   v relative to the water

Semi-implicit Euler, implicit in the drag. The step bounds the stiffness: k = STIFF m / dt², so that the
cable stretches more than a real one: a segment of 4 m by 0.2 % at 20 N. Nodes stay between surface and
seabed. Half a segment's weight hangs on the vehicle, half on the boat; their drag is shared among the inner
nodes. The anchor does not move, and waves do not move the cable.
"""

import math
from collections.abc import Callable
from typing import TypeAlias

from sim_bridge.physics.plant import Three
from sim_bridge.sim_config import Cable

Current: TypeAlias = Callable[[float], tuple[float, float]]
"""North and east velocity of the water (m/s) at a depth (m)."""

DENSITY = 1025.0
STIFF = 0.15
"""The chain is stable below 1 (two springs at a node: ω dt < 2)."""
DAMPING = 0.12
"""c dt / m."""


class CableChain:
    """A cable that begins as a straight line from its anchor to the vehicle, at rest."""

    def __init__(self, config: Cable, step_s: float, place: Three, seabed_m: float = math.inf) -> None:
        count = config.segments
        length_m = config.length_m / count
        carried_kg_m = math.pi / 4 * config.diameter_m**2 * DENSITY
        half = 0.5 * DENSITY * config.diameter_m * config.length_m / (count - 1)
        self._step_s = step_s
        self._seabed_m = seabed_m
        self._length_m = length_m
        self._mass_kg = (config.mass_kg_per_m + carried_kg_m) * length_m
        self._weight_n = config.weight_n_per_m * length_m
        self._stiffness = STIFF * self._mass_kg / step_s**2
        self._damping = DAMPING * self._mass_kg / step_s
        self._across = half * config.drag_across
        self._along = half * math.pi * config.drag_along
        self._places = [_between(config.anchor_m, place, i / count) for i in range(count + 1)]
        self._speeds: list[Three] = [(0.0, 0.0, 0.0)] * (count + 1)
        self.at_boat: Three = (0.0, 0.0, 0.0)
        """Force on the anchor (N, NED)."""

    def pull(self, place: Three, speed: Three, current: Current) -> Three:
        """Advance by a step; return the force on the vehicle (N), whose place and speed are in NED."""
        places, speeds = self._places, self._speeds
        places[-1], speeds[-1] = place, speed
        pulls = [self._tension(i) for i in range(len(places) - 1)]
        for i in range(1, len(places) - 1):
            self._move(i, pulls[i - 1], pulls[i], current)
        first, last, half = pulls[0], pulls[-1], 0.5 * self._weight_n
        self.at_boat = (first[0], first[1], first[2] + half)
        return -last[0], -last[1], half - last[2]

    def _tension(self, i: int) -> Three:
        """Force of segment i on its upper end (N)."""
        (x, y, z), (a, b, c) = self._places[i], self._places[i + 1]
        dx, dy, dz = a - x, b - y, c - z
        length = math.sqrt(dx * dx + dy * dy + dz * dz)
        if length <= self._length_m:
            return 0.0, 0.0, 0.0
        (u, v, w), (p, q, r) = self._speeds[i], self._speeds[i + 1]
        rate = (dx * (p - u) + dy * (q - v) + dz * (r - w)) / length
        part = max(0.0, self._stiffness * (length - self._length_m) + self._damping * rate) / length
        return part * dx, part * dy, part * dz

    def _move(
        self, i: int, above: Three, below: Three, current: Callable[[float], tuple[float, float]]
    ) -> None:
        dt, mass = self._step_s, self._mass_kg
        (x, y, z), (u, v, w) = self._places[i], self._speeds[i]
        north, east = current(z)
        u, v = u - north, v - east
        (a, b, c), (p, q, r) = self._places[i - 1], self._places[i + 1]
        tx, ty, tz = p - a, q - b, r - c
        square = tx * tx + ty * ty + tz * tz or 1.0
        along = (u * tx + v * ty + w * tz) ** 2 / square
        across = max(0.0, u * u + v * v + w * w - along)
        slow_t = 1.0 / (1.0 + dt / mass * self._along * math.sqrt(along))
        slow_n = 1.0 / (1.0 + dt / mass * self._across * math.sqrt(across))
        u += dt / mass * (below[0] - above[0])
        v += dt / mass * (below[1] - above[1])
        w += dt / mass * (below[2] - above[2] + self._weight_n)
        part = (slow_t - slow_n) * (u * tx + v * ty + w * tz) / square
        u, v, w = slow_n * u + part * tx + north, slow_n * v + part * ty + east, slow_n * w + part * tz
        z += dt * w
        if not 0.0 <= z <= self._seabed_m:
            z, w = min(max(z, 0.0), self._seabed_m), 0.0
        self._places[i] = (x + dt * u, y + dt * v, z)
        self._speeds[i] = (u, v, w)


def _between(a: Three, b: Three, part: float) -> Three:
    return a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1]), a[2] + part * (b[2] - a[2])
