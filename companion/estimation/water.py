"""The current: the motion of the water that explains the force on the vehicle by the nominal damping.

| symbol | meaning                                                               | unit |
|--------|-----------------------------------------------------------------------|------|
| F      | force of the water on the hull, body: damping of v plus disturbance    | N    |
| v_r    | velocity through the water: d1 v_r + d2 v_r |v_r| = F, by axis         | m/s  |
| v_c    | current, v − v_r, the mean of MEAN_S                                   | m/s  |

What else pulls (a tether) counts as water: the doubt has it, that of the damping, and the spread of v_c.
"""

import math
from typing import NamedTuple

from companion.core.observers import Estimates
from companion.core.positioning import Model, coriolis_and_damping, jacobian, to_body, to_inertial
from companion.records import PSI, Current, Vector, X, Y

MEAN_S = 5.0
"""The current is a mean over this time, longer than a wave; before that there is none."""

KEPT_S = 10.0
"""A current that was not measured for longer is unknown."""

CORRELATED_S = 1.0
"""Correlation time of what is no current; on a real BlueROV2 Heavy in a tank 0.6 to 0.8 s."""

TETHER_N = 2.0
"""Pull of a tether: the simulated one pulls with 1 to 2 N."""

DAMPING_SHARE = 0.2
"""Share of the velocity through the water that is in doubt, because the damping is."""

USUAL_S, DRIFT_MPS = 120.0, 0.1
"""Time over which a current is steady, and the largest error of a velocity."""

UNKNOWN = Current(math.nan, math.nan, math.nan)


class _Mean(NamedTuple):
    """Mean of v_c, north and east, of its squared deviation, and of the squared doubt."""

    north: float = 0.0
    east: float = 0.0
    spread: float = 0.0
    doubt: float = 0.0


class Water:
    """Finds the current from tick to tick."""

    def __init__(self) -> None:
        self._mean = _Mean()
        self._usual = 0j
        self._seen_s = self._unseen_s = 0.0

    @property
    def drift(self) -> complex:
        """Error of the measured velocity if the current is the usual one, north + i east, m/s."""
        more = complex(self._mean.north, self._mean.east) - self._usual
        return more if abs(more) < DRIFT_MPS else DRIFT_MPS * more / abs(more)

    def step(
        self,
        model: Model,
        motion: Estimates,
        gain: Vector,
        dt_s: float,
        seen: bool,
        still: tuple[float, float] = (0.0, 0.0),
    ) -> Current:
        """Take a tick; `seen` tells that our commands alone push, and that x and y are measured.

        `gain` is the force per command over inertia, by DOF in NED; `still` is the velocity of what rests
        in the EKF's frame, north and east.
        """
        if not seen or not dt_s > 0.0:
            self._unseen_s += dt_s
            if self._unseen_s > KEPT_S:
                self._mean, self._seen_s = _Mean(), 0.0
            return self._current()
        self._unseen_s = 0.0
        J, eta_dot, disturbance = jacobian(motion.eta[PSI]), motion.eta_dot, motion.disturbance
        nu = to_body(J, eta_dot)
        h_x, h_y, _, _ = coriolis_and_damping(model, J, nu)
        x, y = h_x + gain[X] * disturbance[X], h_y + gain[Y] * disturbance[Y]
        surge_n, sway_n, _, _ = to_body(J, (x, y, 0.0, 0.0))
        through, doubt = [], 0.0
        for axis, force in enumerate((surge_n, sway_n)):
            speed = _speed(model, axis, abs(force))
            more = _speed(model, axis, abs(force) + TETHER_N)
            through.append(math.copysign(speed, force))
            doubt += (more - speed) ** 2 + (DAMPING_SHARE * speed) ** 2
        u, v, _, _ = to_inertial(J, (through[0], through[1], 0.0, 0.0))
        self._seen_s += dt_s
        share = min(1.0, dt_s / min(self._seen_s, MEAN_S))
        north, east, spread, old_doubt = self._mean
        dn, de = eta_dot[0] - still[0] - u - north, eta_dot[1] - still[1] - v - east
        self._mean = _Mean(
            north + share * dn,
            east + share * de,
            spread + share * (dn * dn + de * de - spread),
            old_doubt + share * (doubt - old_doubt),
        )
        mean = complex(self._mean.north, self._mean.east)
        self._usual += (mean - self._usual) * min(1.0, dt_s / min(self._seen_s, USUAL_S))
        return self._current()

    def _current(self) -> Current:
        if self._seen_s < MEAN_S:
            return UNKNOWN
        north, east, spread, doubt = self._mean
        return Current(north, east, math.sqrt(doubt + spread * CORRELATED_S / (2.0 * MEAN_S)))


def _speed(model: Model, axis: int, force_n: float) -> float:
    """Return the speed through the water, m/s, whose damping is `force_n`, 0 or more."""
    d1, d2 = model.d1[axis], model.d2[axis]
    if d2 <= 0.0:
        return force_n / d1 if d1 > 0.0 else 0.0
    return (math.sqrt(d1 * d1 + 4.0 * d2 * force_n) - d1) / (2.0 * d2)
