"""A path or a move to one place under way: what the target of guidance follows, tick by tick."""

import math
from collections.abc import Sequence
from itertools import chain, repeat
from typing import Self

from companion.control.bounds import wrap
from companion.control.reference import ACCELERATION_LAG_S, RATE_LAG_S
from companion.control.reference import State as ReferenceState
from companion.guidance.paths.curve import straight
from companion.guidance.paths.shapes import Leg, Path
from companion.guidance.paths.time_law import Limits, TimeLaw, profiled
from companion.records import ZERO, Setpoint, Vector, vector
from companion.steps import finish

FULL_PACE_M, NO_PACE_M = 0.15, 0.5
"""A vehicle this far from its place still gets the whole speed; this far, the path waits for it."""


def pace(reference_pace: Vector, distance_m: float) -> float:
    """Return the share of a path's speed that is left: what saturates, or stays behind, is slowed."""
    behind = (NO_PACE_M - distance_m) / (NO_PACE_M - FULL_PACE_M)
    return min(*reference_pace, max(behind, 0.0))


def braked(states: Sequence[ReferenceState], accelerations: Vector) -> Vector:
    """Return where a reference that moves comes to rest without going back."""
    lag_s = RATE_LAG_S + ACCELERATION_LAG_S
    return vector(
        [
            state.x_d + state.x_d_dot * (lag_s + 0.5 * abs(state.x_d_dot) / most)
            for state, most in zip(states, accelerations, strict=True)
        ]
    )


class Course:
    """Under way once `begin` was called; before, it waits to be engaged.

    `place` is where a move goes, a path's is that of its first leg. A NaN is where it starts.
    """

    def __init__(
        self, limits: Limits, speed_mps: float, acceleration_mps2: float, *, path: Path | None = None
    ) -> None:
        self._limits, self._speed, self._acceleration = limits, speed_mps, acceleration_mps2
        self.path = path
        self.place: Vector = (math.nan,) * 4
        self.begun = self.done = False
        self.paused = False
        self.suspended = False
        """Whether somebody else moves the target: it goes back to its place before it goes on."""
        self.refused = ""
        """Why it cannot be followed from where it began."""
        self._offset = ZERO
        self._at = Setpoint(ZERO)
        """Where it is now; moves and paths end here."""
        self._approach: TimeLaw | None = None
        self._law: TimeLaw | None = None
        self._wait_s = 0.0
        legs: tuple[Leg, ...] = () if path is None else path.legs
        laps = 1 if path is None else path.plan.laps or math.inf
        self._laps = 1.0
        """Of a leg: one that loops is travelled as a single curve of so many laps."""
        if legs and legs[0].loops:
            self._laps = float(laps)
            self._legs = iter(legs)
        else:
            self._legs = chain.from_iterable(repeat(legs) if laps == math.inf else repeat(legs, int(laps)))
        self._leg: Leg | None = None
        self._passed_m = 0.0

    @classmethod
    def to(cls, place: Vector, limits: Limits, speed_mps: float, acceleration_mps2: float) -> Self:
        """Return a move to a place."""
        course = cls(limits, speed_mps, acceleration_mps2)
        course.place = place
        return course

    @property
    def wants_position(self) -> bool:
        """Whether it is about x or y."""
        return self.path is not None or not (math.isnan(self.place[0]) and math.isnan(self.place[1]))

    @property
    def length_m(self) -> float:
        """Of one lap; 0 for a move."""
        return self.path.length_m if self.path is not None else 0.0

    @property
    def progress_m(self) -> float:
        """How far along the path it is, laps included."""
        return self._passed_m + (self._law.s if self._law is not None else 0.0)

    @property
    def speed_mps(self) -> float:
        """How fast it moves along its line now."""
        law = self._approach or self._law
        return law.s_dot if law is not None else 0.0

    def begin(self, start: Vector) -> None:
        """Start from a pose at rest."""
        self.begun = True
        self._at = Setpoint(start)
        if self.path is None:
            self._go_to(vector([s if math.isnan(p) else p for s, p in zip(start, self.place, strict=True)]))
        else:
            self._offset = self.path.start(start)
            self._next_leg()

    def suspend(self) -> None:
        """Let somebody else move the target."""
        self.paused = self.suspended = True
        if self._law is not None:
            self._law.halt()

    def resume(self, start: Vector) -> None:
        """Go on, from `start` if somebody else moved the target meanwhile."""
        if self.suspended and self.begun and not self.done:
            place = self.place if self._law is None else self._moved(self._law.setpoint()).eta_d
            self._at = Setpoint(start)
            self._go_to(vector([s if math.isnan(p) else p for s, p in zip(start, place, strict=True)]))
        self.paused = self.suspended = False

    def step(self, pace: float, dt_s: float) -> Setpoint:
        """Advance by `dt_s` at `pace`; return where to be."""
        if self.paused:
            pace = 0.0
        if self._approach is not None:
            self._at = self._approach.step(pace, dt_s)
            if self._approach.arrived:
                self._approach = None
                self.done = self.path is None
        elif self._law is not None:
            self._at = self._moved(self._law.step(pace, dt_s))
            if self._law.arrived and self._leg is not None:
                self._passed_m += self._law.s
                self._wait_s, self._law = self._leg.wait_s, None
        elif self._wait_s > 0.0:
            self._wait_s -= dt_s if pace > 0.0 else 0.0
        else:
            self._next_leg()
        if self._approach is None and self._law is None:
            self._at = Setpoint(self._at.eta_d)
        return self._at

    def _next_leg(self) -> None:
        leg = self._leg = next(self._legs, None)
        if leg is None:
            self.done = True
            return
        self._law = TimeLaw(leg.profile, self._laps)
        self._go_to(self._moved(self._law.setpoint()).eta_d)

    def _go_to(self, place: Vector) -> None:
        """Begin a straight line from where it is to a place."""
        line = straight(self._at.eta_d, place)
        if line is None:
            self._approach = None
            self.done = self.path is None
        else:
            self._approach = TimeLaw(finish(profiled(line, self._speed, self._acceleration, self._limits)))

    def moved(self, place: Vector) -> Vector:
        """Return a place of the path's plan where it lies."""
        x, y, z, psi = (a + b for a, b in zip(place, self._offset, strict=True))
        return (x, y, z, wrap(psi))

    def _moved(self, setpoint: Setpoint) -> Setpoint:
        return Setpoint(self.moved(setpoint.eta_d), setpoint.eta_d_dot, setpoint.eta_d_ddot)
