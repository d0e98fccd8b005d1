"""A path or a move to one place under way: what the target of guidance follows, tick by tick."""

import math
from collections.abc import Sequence
from typing import Self

from companion.core.bounds import wrap
from companion.core.reference import ReferenceState
from companion.estimation.frame import Offset
from companion.guidance.orders import place
from companion.guidance.paths.curve import straight
from companion.guidance.paths.shapes import Path
from companion.guidance.paths.time_law import REFERENCE_LAG_S, PathLimits, TimeLaw, profiled
from companion.guidance.target import UNSET, from_here, known
from companion.records import ZERO, Setpoint, Vector, chosen, vector
from companion.steps import finish
from companion.telemetry.operator_commands import Follow, Goto, in_words

FULL_PACE_M, NO_PACE_M = 0.15, 0.5
"""A vehicle this far from its place still gets the whole speed; this far, the path waits for it."""

PRIOR_S = 10.0
"""The remaining time comes from the mean speed, as if the plan's speed had lasted for this time before."""


def pace(reference_pace: Vector, distance_m: float) -> float:
    """Return the share of a path's speed: less if thrust saturates or the vehicle stays behind."""
    behind = (NO_PACE_M - distance_m) / (NO_PACE_M - FULL_PACE_M)
    return min(*reference_pace, max(behind, 0.0))


def braked(states: Sequence[ReferenceState], accelerations: Vector) -> Vector:
    """Return where a reference that moves comes to rest without going back."""
    return vector(
        [
            state.x_d + state.x_d_dot * (REFERENCE_LAG_S + 0.5 * abs(state.x_d_dot) / most)
            for state, most in zip(states, accelerations, strict=True)
        ]
    )


class Course:
    """A path or a move. It waits to be engaged until `begin` is called.

    `place` is the end of a move; a NaN stands for its start. Until it begins, it counts from `place_from`, as
    `Goto.frame` says: "from here" means from where the move begins.
    """

    def __init__(
        self, limits: PathLimits, speed_mps: float, acceleration_mps2: float, *, path: Path | None = None
    ) -> None:
        self._limits, self._speed, self._acceleration = limits, speed_mps, acceleration_mps2
        self.path = path
        self.words = "" if path is None else in_words(Follow(path=path.plan))
        self.place = UNSET
        self.place_from = "local"
        self.begun = self.done = False
        self.paused = False
        self.suspended = False
        """Whether somebody else moves the target: it goes back to its place before it goes on."""
        self.refused = ""
        """Why it cannot be followed from where it began."""
        self.frame = Offset()
        """The frame of its places: the EKF's when the course began."""
        self.displaced = ""
        """Why its places are not where they were when it began."""
        self._offset = ZERO
        self._at = Setpoint(ZERO)
        """Where it is now; moves and paths end here."""
        self._approach: TimeLaw | None = None
        self._law: TimeLaw | None = None
        self._wait_s = 0.0
        self._laps = path.laps if path is not None and path.legs[0].loops else 1.0
        """Laps of a leg: a closed one is travelled as a single curve of this many laps."""
        self._number, self._passed_m = -1, 0.0
        """Which leg, laps included, and how long those behind it were."""
        self._whole_m = self._moved_s = 0.0
        """How far it was when it began, and how long it has moved, without the time of a pause."""
        self._fastest = speed_mps if path is None else max(leg.profile.max_speed for leg in path.legs)

    @classmethod
    def to(cls, order: Goto, limits: PathLimits) -> Self:
        """Return a move to a place."""
        course = cls(limits, order.speed_mps, order.acceleration_mps2)
        course.place, course.place_from, course.words = place(order), order.frame, in_words(order)
        return course

    @classmethod
    def none(cls, limits: PathLimits) -> Self:
        """Return the course in place of none: one that is over."""
        course = cls(limits, 1.0, 1.0)
        course.done = True
        return course

    def goal(self, start: Vector) -> Vector:
        """Return where a move that begins at `start` goes, NaN where it stays."""
        if self.place_from == "local":
            return self.place
        return from_here(start, self.place, body=self.place_from == "body")

    @property
    def wants_position(self) -> bool:
        """Whether it is about x or y."""
        return self.path is not None or any(known(self.place)[:2])

    @property
    def moves(self) -> bool:
        """Whether it moves the target: it is not over, and nobody else does."""
        return not (self.done or self.suspended)

    @property
    def destination(self) -> Vector:
        """End of a move; NaN without one, and for a step from here before it begins."""
        return self.place if self.place_from == "local" and not self.done else UNSET

    def kind(self, *, waits: bool, holds: bool) -> str:
        """Return what it does, as `Guided.kind`; `waits` for a position, and whether anything is held."""
        if self.done:
            return "refused" if self.refused else "hold" if holds else ""
        if self.paused:
            return "paused"
        if waits or not self.begun:
            return "waiting"
        return "move" if self.path is None else "path"

    @property
    def name(self) -> str:
        """The path's, or why it is refused; empty for a move, and at its end."""
        if self.done or self.path is None:
            return self.refused
        return self.path.plan.name

    @property
    def length_m(self) -> float:
        """Length of one lap, m; 0 for a move."""
        return self.path.length_m if self.path is not None else 0.0

    @property
    def progress_m(self) -> float:
        """How far along the path it is, laps included."""
        return self._passed_m + (self._law.s if self._law is not None else 0.0)

    @property
    def left_m(self) -> float:
        """How far it still is to the end, with the way to the path."""
        approach_m = self._approach.left_m if self._approach is not None else 0.0
        if self.path is None or self.done:
            return approach_m
        return approach_m + max(self.path.laps * self.path.length_m - self.progress_m, 0.0)

    @property
    def left_s(self) -> float:
        """About how long that takes at the mean speed until now."""
        left_m = self.left_m
        if math.isinf(left_m):
            return left_m
        moved_m = max(self._whole_m - left_m, 0.0) if self.begun else 0.0
        return left_m * (self._moved_s + PRIOR_S) / (moved_m + self._fastest * PRIOR_S)

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
            self.place, self.place_from = self.goal(start), "local"
            self._go_to(chosen(known(self.place), self.place, start))
        else:
            self._offset = self.path.start(start)
            self._next_leg()
        self._whole_m = self.left_m

    def suspend(self) -> None:
        """Let somebody else move the target."""
        self.paused = self.suspended = True
        if self._law is not None:
            self._law.halt()

    def resume(self, start: Vector) -> None:
        """Go on, from `start` if somebody else moved the target meanwhile."""
        if self.suspended and self.begun and not self.done:
            goal = self.place if self.path is None else self._at.eta_d
            if self._law is not None:
                goal = self._moved(self._law.setpoint()).eta_d
            self._at = Setpoint(start)
            self._go_to(chosen(known(goal), goal, start))
        self.paused = self.suspended = False

    def step(self, pace: float, dt_s: float) -> Setpoint:
        """Advance by `dt_s` at `pace`; return where to be."""
        if self.paused:
            pace = 0.0
        else:
            self._moved_s += dt_s
        if self._approach is not None:
            self._at = self._approach.step(pace, dt_s)
            if self._approach.arrived:
                self._approach = None
                self.done = self.path is None
        elif self._law is not None:
            self._at = self._moved(self._law.step(pace, dt_s))
            if self._law.arrived and self.path is not None:
                leg = self.path.legs[self._number % len(self.path.legs)]
                self._passed_m += leg.curve.length * self._laps
                self._wait_s, self._law = leg.wait_s, None
        elif self._wait_s > 0.0:
            self._wait_s -= dt_s if pace > 0.0 else 0.0
        else:
            self._next_leg()
        if self._approach is None and self._law is None:
            self._at = Setpoint(self._at.eta_d)
        return self._at

    def _next_leg(self) -> None:
        self._number += 1
        lap, i = divmod(self._number, len(self.path.legs)) if self.path is not None else (0, 0)
        if self.path is None or (lap and lap * self._laps >= self.path.laps):
            self.done = True
            return
        self._law = TimeLaw(self.path.legs[i].profile, self._laps)
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
