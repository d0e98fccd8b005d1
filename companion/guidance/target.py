"""What was asked for, and where each degree of freedom is to go: places x, y, z, psi, with rates.

| word   | meaning                                                                               | frame  |
|--------|---------------------------------------------------------------------------------------|--------|
| asked  | the operator's setpoint; NaN: where the vehicle is when it is engaged                   | EKF's  |
| now    | where each degree of freedom is to go now: what was asked, as sticks and course moved it | inside |
| start  | where it stays until it may push with all authority                                   | inside |
"""

import math

from companion.core.bounds import wrap
from companion.core.positioning import jacobian, to_inertial
from companion.estimation.frame import Offset
from companion.records import PSI, ZERO, Flags, Setpoint, Vector, X, Y, Z, chosen, vector, without

UNSET: Vector = (math.nan, math.nan, math.nan, math.nan)


class Target:
    """What is wanted. It knows no limits: guidance checks what it takes."""

    def __init__(self, setpoint: Setpoint) -> None:
        self.asked = self.now = self.start = setpoint
        self.carries_until_s = -math.inf
        """Until this time `now` moves on at the rate that the ground station gave."""

    def ask(self, setpoint: Setpoint, offset: Offset) -> None:
        """Take a setpoint; where it says nothing, the target stays."""
        self.asked = setpoint
        self.now = _filled(setpoint, self.now.eta_d, offset)

    def ask_places(self, where: Flags, eta: Vector) -> None:
        """Replace the setpoint's places there; NaN asks for nothing."""
        self.asked = self.asked._replace(eta_d=chosen(where, eta, self.asked.eta_d))

    def put(self, where: Flags, eta: Vector) -> None:
        """Replace the target's places there; its rates stay."""
        self.now = self.now._replace(eta_d=chosen(where, eta, self.now.eta_d))

    def hold(self, eta: Vector) -> None:
        """Stay at a place; ask for nothing."""
        self.asked, self.now = Setpoint(UNSET), Setpoint(eta)

    def engage(self, eta: Vector, offset: Offset) -> None:
        """Begin where the vehicle is."""
        self.start = Setpoint(eta)
        self.now = _filled(self.asked, eta, offset)

    def translate_asked(self, engaged: Flags, offset: Offset) -> None:
        """Convert what was asked for, and what is held, to the EKF's new frame."""
        held = without(engaged, vector(map(math.isnan, self.asked.eta_d)))
        self.ask_places(held, offset.outside(self.now.eta_d))

    def carry_on(self, now_s: float, dt_s: float) -> None:
        """Move the target on by its own rate and acceleration, until nothing came for too long."""
        if not now_s < self.carries_until_s:
            self.stop_carrying()
            return
        _, rate, rise = self.now
        x, y, z, psi = (at + dt_s * (v + 0.5 * dt_s * a) for at, v, a in zip(*self.now, strict=True))
        faster = vector(v + dt_s * a for v, a in zip(rate, rise, strict=True))
        self.now = Setpoint((x, y, z, wrap(psi)), faster, rise)

    def stop_carrying(self) -> None:
        """Stop, if it moved on by its own rate."""
        if self.carries_until_s > -math.inf:
            self.carries_until_s, self.now = -math.inf, Setpoint(self.now.eta_d)

    def move_depth(self, *moving: float) -> None:
        """Replace the target's depth, its rate and its acceleration."""
        self.now = Setpoint(
            *((x, y, depth, psi) for (x, y, _, psi), depth in zip(self.now, moving, strict=True))
        )


def known(eta: Vector) -> Flags:
    """Tell by degree of freedom whether a place is said."""
    x, y, z, psi = eta
    return (not math.isnan(x), not math.isnan(y), not math.isnan(z), not math.isnan(psi))


def from_here(here: Vector, step: Vector, *, body: bool) -> Vector:
    """Return the place a step from here, NaN where the step says nothing: north, or forward, and so on."""
    wanted = known(step)
    if body and (wanted[X] or wanted[Y]):
        wanted = (True, True, wanted[Z], wanted[PSI])
    by = to_inertial(jacobian(here[PSI] if body else 0.0), chosen(known(step), step, ZERO))
    x, y, z, psi = (at + far for at, far in zip(here, by, strict=True))
    return chosen(wanted, (x, y, z, wrap(psi)), UNSET)


def placed(eta: Vector, rest: Vector, offset: Offset) -> Vector:
    """Return a place inside; where it is NaN, it is that of `rest`, which is inside."""
    return offset.inside(chosen(known(eta), eta, offset.outside(rest)))


def _filled(setpoint: Setpoint, eta: Vector, offset: Offset) -> Setpoint:
    """Return the setpoint inside, with NaN places replaced by `eta`."""
    return offset.setpoint_inside(
        setpoint._replace(eta_d=chosen(known(setpoint.eta_d), setpoint.eta_d, offset.outside(eta)))
    )
