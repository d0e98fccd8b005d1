"""What may move the target: setpoint, course, altitude, angles. A new one ends those that it replaces.

| word      | meaning                                                                            |
|-----------|------------------------------------------------------------------------------------|
| setpoint  | what the operator asked for (`target.py`)                                           |
| target    | where each degree of freedom is to go now                                           |
| engaged   | degrees of freedom that the law holds (`held.py`)                                   |
| released  | those that the pilot took back since it engaged; engaging again holds them again    |
| course    | a path, or a move to a place, that moves the target (`course.py`)                   |

Whatever moves is in the frame inside (`estimation.frame`). What an operator, a path and the fence say is in
the EKF's: a place is taken by the offset of that moment, and then stays where it lies.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from companion.config import Config
from companion.core.bounds import clamped, wrap
from companion.core.reference import Reference
from companion.estimation.frame import Frame
from companion.guidance.altitude import AltitudeHold
from companion.guidance.angles import HeldAngles
from companion.guidance.course import Course, braked
from companion.guidance.fence import Bounds
from companion.guidance.held import HeldDofs
from companion.guidance.orders import place_words
from companion.guidance.paths.shapes import Path
from companion.guidance.pilot import PilotControl
from companion.guidance.target import Target, known, placed
from companion.records import Event, GlobalOrigin, Guided, Reboot, Setpoint, Vector, X, Z


class Here(NamedTuple):
    """Where vehicle and reference are now, inside, and where the EKF's frame lies."""

    t_s: float
    eta: Vector
    reference: Reference
    frame: Frame


class Sources:
    """All that is wanted, and by whom the target is moved."""

    def __init__(self, config: Config, setpoint: Setpoint) -> None:
        self.bounds = Bounds(config)
        self.target = Target(self.bounds.checked(setpoint))
        self.held = HeldDofs()
        self.pilot = PilotControl(config)
        self.angles = HeldAngles(config)
        self.altitude: AltitudeHold | None = None
        self.course = Course.none(self.bounds.limits)
        self._number = 0
        """Number of the course; each new one increases it by one."""
        self._origin_deg: tuple[float, float] | None = None

    def standing(self, here: Here) -> Vector:
        """Return where the reference comes to rest, inside; where x and y are not held, the vehicle's."""
        x, y, z, psi = braked(here.reference.states, self.bounds.max_acceleration)
        if not self.held.engaged[X]:
            x, y, _, _ = here.eta
        return (x, y, z, wrap(psi))

    def standing_outside(self, here: Here) -> Vector:
        """Return the same in the EKF's frame."""
        return here.frame.settled.outside(self.standing(here))

    def aim(self, setpoint: Setpoint, frame: Frame) -> None:
        """Take a new setpoint; its NaN targets stay what they are. It ends a path or a move.

        Raises ValueError for one that is infinite, deeper than `supervisor.max_depth_m`, or beyond the fence.
        """
        self.target.ask(self.bounds.checked(setpoint), frame.settled)
        self._end(setpoint.eta_d)

    def put(self, target: Setpoint, frame: Frame, carries_until_s: float = -math.inf) -> None:
        """Replace the target where a place is said, outside, with its rates within the limits."""
        settled, (x, y, z, psi) = frame.settled, target.eta_d
        place = (x, y, clamped(z, 0.0, self.bounds.config.supervisor.max_depth_m), psi)
        self._end(place)
        self.target.ask_places(known(place), place)
        there = placed(place, self.target.now.eta_d, settled)
        rate, rise = settled.inward(target.eta_d_dot), settled.inward(target.eta_d_ddot)
        self.target.now = self.bounds.slowed(Setpoint(there, rate, rise))
        self.target.carries_until_s = carries_until_s

    def ask_velocity(self, until_s: float, velocity: Vector, frame: Frame, *, body: bool) -> None:
        """Move at a velocity until then, along the vehicle's axes or in the EKF's frame."""
        self.pilot.ask(until_s, velocity if body else frame.settled.inward(velocity), body=body)

    def _end(self, eta: Vector) -> None:
        """End the course, and where a depth is said the altitude."""
        self.course = Course.none(self.bounds.limits)
        if not math.isnan(eta[Z]):
            self.altitude = None

    def begin(self, course: Course, asked: Vector) -> None:
        """Follow a course; `asked` is the rest of the setpoint."""
        self.course, self._number = course, self._number + 1
        self.target.asked, self.target.now = Setpoint(asked), Setpoint(self.target.now.eta_d)

    def hold_here(self, here: Here) -> None:
        """Stop, and hold this place, also north and east where a position has come; a path can be resumed."""
        self.suspend()
        self.altitude = None
        if self.offers_position:
            self.held.want_here()
        self.target.hold(self.standing(here))

    def suspend(self) -> None:
        """Let a path that has begun be resumed later; end a move."""
        course = self.course
        if course.path is not None and course.begun and not course.done:
            course.suspend()
        else:
            self.course = Course.none(self.bounds.limits)

    def hear(self, events: Sequence[Event]) -> None:
        """Note that x and y have another meaning: a course that has begun is not resumed then."""
        for event in events:
            if isinstance(event, Reboot):
                self.course.displaced = "the autopilot was restarted meanwhile: x and y count from elsewhere"
            elif isinstance(event, GlobalOrigin):
                if self._origin_deg not in (None, event.place_deg):
                    self.course.displaced = "the EKF's origin is another"
                self._origin_deg = event.place_deg

    # What is told of it

    @property
    def awaits_position(self) -> bool:
        """Whether x and y are wanted, and are not held for want of a position."""
        return self.held.lacks_position and self._wants_position

    @property
    def offers_position(self) -> bool:
        """Whether a position came while others are held, and nothing wants x and y."""
        unheld = any(self.held.engaged) and self.held.lacks_position
        return self.held.has_position and unheld and not self._wants_position

    @property
    def _wants_position(self) -> bool:
        moves = self.course.moves and self.course.wants_position
        return self.held.lost or moves or any(known(self.target.asked.eta_d)[:Z])

    @property
    def guided(self) -> Guided:
        """What moves the target now."""
        course, altitude = self.course, self.altitude
        holds = any(self.held.engaged)
        return Guided(
            kind=course.kind(waits=self.awaits_position, holds=holds),
            number=self._number,
            name=course.name,
            progress_m=course.progress_m,
            length_m=course.length_m,
            speed_mps=course.speed_mps,
            altitude_m=0.0 if altitude is None or math.isnan(altitude.altitude_m) else altitude.altitude_m,
            left_m=course.left_m,
            left_s=course.left_s,
            pending="" if holds else self._pending,
        )

    @property
    def _pending(self) -> str:
        """What it does as soon as it engages, in words; empty: it holds where it is."""
        course = self.course
        begins = "" if course.begun or course.done else course.words
        altitude_m = math.nan if begins or self.altitude is None else self.altitude.altitude_m
        waits = "wait, paused, to " if course.paused and begins else ""
        places = place_words(self.target.asked.eta_d, altitude_m, self.angles.asked)
        return "; ".join(filter(None, (places, waits + begins)))

    def path(self, frame: Frame) -> tuple[Path, Callable[[Vector], Vector]] | None:
        """Return the path, and what gives its places in the EKF's frame; None where there is none."""
        course, now = self.course, frame.now
        if course.path is None:
            return None
        began = course.frame if course.begun else now
        return course.path, lambda place: now.outside(began.inside(course.moved(place)))
