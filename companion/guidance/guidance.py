"""What is wanted, tick by tick: pilot, ground station, course and ground move the target.

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

from companion.config import Config
from companion.core.bounds import clamped, wrap
from companion.core.reference import Reference
from companion.estimation.frame import Frame
from companion.guidance.altitude import AltitudeHold
from companion.guidance.angles import HeldAngles
from companion.guidance.course import Course, braked, pace
from companion.guidance.datum import Datum, difference
from companion.guidance.fence import Bounds
from companion.guidance.held import HORIZONTAL, HeldDofs
from companion.guidance.orders import Order, angles, number_of, place_words, target_of
from companion.guidance.paths.shapes import Path
from companion.guidance.pilot import NO_DEMAND, NONE, Pilot, PilotDemand
from companion.guidance.reference_history import ReferenceHistory
from companion.guidance.target import UNSET, Target, known, placed
from companion.records import (
    LEVEL,
    PSI,
    ZERO,
    Angles,
    AttitudeTarget,
    Condition,
    Event,
    Flags,
    Ground,
    Guided,
    PositionTarget,
    Setpoint,
    State,
    Vector,
    VehicleState,
    Verdict,
    X,
    Y,
    Z,
    chosen,
    either,
)
from companion.telemetry.commands import Goto, SetVelocity

VELOCITY_LASTS_S = 1.0
"""How long a ground station's velocity lasts after its message; they come at some Hz."""
NO_COURSE = "there is no path and no move under way"


class Guidance:
    """The only owner of setpoint, target and held degrees of freedom."""

    def __init__(self, config: Config, setpoint: Setpoint) -> None:
        self._bounds = Bounds(config)
        self._pilot = Pilot(config)
        self._target = Target(self._bounds.checked(setpoint))
        self._held = HeldDofs()
        self._angles = HeldAngles(config)
        self._altitude: AltitudeHold | None = None
        self._course: Course | None = None
        self._course_number = 0
        """Which course it is: one more with each."""
        self._references = ReferenceHistory()
        self._has_position = False
        self._here = ZERO
        """Where the vehicle was last, inside."""
        self._waits = False
        """Whether an interruption is ridden out: nothing of what is wanted changes."""
        self._frame = Frame()
        self._datum = Datum()
        """What places count from."""

    # What it says of itself

    @property
    def target(self) -> Setpoint:
        """Where it is to go, inside: x, y, z, psi, with rates and accelerations."""
        return self._target.now

    @property
    def asked(self) -> Vector:
        """What the operator asked for, NaN where nothing: it holds again after engaging."""
        return self._target.asked.eta_d

    @property
    def angles(self) -> Angles:
        """The angles of roll and pitch that were asked for."""
        return self._angles.asked

    @property
    def engaged(self) -> Flags:
        """The degrees of freedom that the law holds."""
        return self._held.engaged

    @property
    def awaits_position(self) -> bool:
        """Whether x and y are wanted, and are not held for want of a position."""
        return self._held.lacks_position and self._wants_position

    @property
    def offers_position(self) -> bool:
        """Whether a position came while others are held, and nothing wants x and y."""
        unheld = any(self.engaged) and self._held.lacks_position
        return self._has_position and unheld and not self._wants_position

    @property
    def _wants_position(self) -> bool:
        course = self._course
        moves = course is not None and course.wants_position and not (course.done or course.suspended)
        return self._held.lost or moves or any(known(self.asked)[:Z])

    @property
    def wants_ground(self) -> bool:
        """Whether an altitude over the ground is to be kept."""
        return self._altitude is not None

    @property
    def doubts_range(self) -> bool:
        """Whether the depth is held because the range does not answer the vehicle's motion."""
        return self._altitude is not None and self._altitude.doubts

    @property
    def guided(self) -> Guided:
        """What moves the target now."""
        course, altitude = self._course, self._altitude
        return Guided(
            kind=("hold" if any(self.engaged) else "")
            if course is None
            else course.kind(self.awaits_position),
            number=self._course_number,
            name="" if course is None else course.name,
            progress_m=0.0 if course is None else course.progress_m,
            length_m=0.0 if course is None else course.length_m,
            speed_mps=0.0 if course is None else course.speed_mps,
            altitude_m=0.0 if altitude is None or math.isnan(altitude.altitude_m) else altitude.altitude_m,
            left_m=0.0 if course is None else course.left_m,
            left_s=0.0 if course is None else course.left_s,
            pending=self._pending,
        )

    @property
    def _pending(self) -> str:
        """What it does as soon as it engages, in words; empty: it holds where it is."""
        if any(self.engaged):
            return ""
        course = self._course
        begins = "" if course is None or course.begun or course.done else course.words
        altitude_m = math.nan if begins or self._altitude is None else self._altitude.altitude_m
        waits = "wait, paused, to " if course is not None and course.paused and begins else ""
        return "; ".join(filter(None, (place_words(self.asked, altitude_m, self.angles), waits + begins)))

    @property
    def destination(self) -> Vector:
        """Where a move goes, NaN where none does, and of a step from here before it begins."""
        course = self._course
        return (
            course.place if course is not None and course.place_from == "local" and not course.done else UNSET
        )

    @property
    def path(self) -> tuple[Path, Callable[[Vector], Vector]] | None:
        """The path, and what gives its places in the EKF's frame; None where there is none."""
        course, now = self._course, self._frame.now
        if course is None or course.path is None:
            return None
        began = course.frame if course.begun else now
        return course.path, lambda place: now.outside(began.inside(course.moved(place)))

    # What an operator orders

    def aim(self, setpoint: Setpoint) -> None:
        """Take a new setpoint; its NaN targets stay what they are. It ends a path or a move.

        Raises ValueError for one that is infinite, deeper than `supervisor.max_depth_m`, or beyond the fence.
        """
        self._target.ask(self._bounds.checked(setpoint), self._frame.settled)
        self._course = None
        if not math.isnan(setpoint.eta_d[Z]):
            self._altitude = None

    def guide(self, order: Order, now_s: float, reference: Reference) -> None:
        """Take a path, a move, or what to do with them. Raises ValueError for what is not possible."""
        if isinstance(order, Path):
            self._follow(order, reference)
        elif isinstance(order, Goto):
            self._go_to(order, reference)
        elif isinstance(order, SetVelocity):
            self._move_at(order, now_s)
        elif order.action == "hold":
            self._hold_here(reference)
        elif self._course is None or self._course.done:
            raise ValueError(NO_COURSE)
        elif order.action == "resume":
            self._resume(self._course, reference)
        else:
            self._course.paused = True

    def _follow(self, path: Path, reference: Reference) -> None:
        """Follow a path, from where it is, as soon as it may.

        Raises ValueError, with the place, for one that leaves the fence. One that counts from where it
        engages is checked then.
        """
        plan = path.plan
        self._bounds.permit_altitude(plan.altitude_m)
        self._angles.permit(angles(plan))
        course = Course(self._bounds.limits, plan.speed_mps, plan.acceleration_mps2, path=path)
        if any(self.engaged) or not any(path.relative[:PSI]):
            self._bounds.check(course, self._standing_outside(reference))
        self._angles.ask(angles(plan))
        self._altitude = AltitudeHold.of(number_of(plan.altitude_m))
        self._begin(course, UNSET)

    def _go_to(self, order: Goto, reference: Reference) -> None:
        """Go to a place in a straight line; coordinates that it does not name stay.

        In `order.frame` "local" it counts from the origin, else from where the move begins: "offset" north,
        east, down, or "body" forward, right, down. Raises ValueError for a place beyond the fence, for north
        or east where there never was a position, and for an altitude that is too low, or beside a depth.
        """
        course, held, altitude_m = (
            Course.to(order, self._bounds.limits),
            angles(order),
            number_of(order.altitude_m),
        )
        self._bounds.permit_altitude(order.altitude_m)
        self._angles.permit(held)
        here = self._standing_outside(reference)
        goal = course.goal(here)
        named = known((goal[X], goal[Y], altitude_m if math.isnan(goal[Z]) else goal[Z], goal[PSI]))
        if not math.isnan(altitude_m) and not math.isnan(goal[Z]):
            raise ValueError("depth_m and altitude_m: name one of them")
        unheld = any(self.engaged) and self._held.lacks_position and not self._held.lost
        if any(named[:Z]) and unheld and not self._has_position:
            raise ValueError(
                "there is no position: x and y are not held, and north and east mean nothing. Go by depth "
                "and heading, or connect a DVL, a USBL or vision that the autopilot uses (docs/guidance.md)"
            )
        if any(self.engaged) or order.frame == "local":
            self._bounds.check(course, here)
        self._angles.ask(held)
        if not any(named):
            return
        if named[Z]:
            self._altitude = AltitudeHold.of(altitude_m)
        self._begin(course, chosen(named, UNSET, self.asked))

    def _move_at(self, order: SetVelocity, now_s: float) -> None:
        """Move at a velocity; where it ends, the place is held. Raises ValueError while nothing is held."""
        if not any(self.engaged):
            raise ValueError("velocity: nothing is held; engage first")
        rate = math.radians(order.heading_rate_degps)
        velocity = (order.forward_mps, order.right_mps, order.down_mps, rate)
        self._ask_velocity(now_s + order.lasts_s, velocity, body=order.frame == "body")

    def _ask_velocity(self, until_s: float, velocity: Vector, *, body: bool) -> None:
        inside = velocity if body else self._frame.settled.inward(velocity)
        self._pilot.ask(until_s, inside, body=body)

    def _hold_here(self, reference: Reference) -> None:
        """Stop, and hold this place, also north and east where a position has come; a path can be resumed."""
        if self._course is not None and self._course.is_unfinished:
            self._course.suspend()
        else:
            self._course = None
        self._altitude = None
        if self.offers_position:
            self._held.want_here()
        self._target.hold(self._standing(reference))

    def _resume(self, course: Course, reference: Reference) -> None:
        """Go on with what is paused. Raises ValueError where its places are not where they were."""
        why = "" if course.datum is None else difference(course.datum, self._datum)
        if why is None:
            raise ValueError("the autopilot has not told its boot count and origin yet: try again in seconds")
        if why:
            raise ValueError(f"{why}: it cannot go on where it was interrupted. Follow it anew")
        if course.begun and not any(self.engaged):
            raise ValueError("nothing is held, and it goes on from where it is held: engage first")
        if course.path is not None:
            self._angles.ask(angles(course.path.plan))
            self._altitude = self._altitude or AltitudeHold.of(number_of(course.path.plan.altitude_m))
        course.resume(course.frame.outside(self._standing(reference)))

    def _begin(self, course: Course, asked: Vector) -> None:
        """Follow a course; `asked` is what is left of the setpoint."""
        self._course, self._course_number = course, self._course_number + 1
        self._target.asked, self._target.now = Setpoint(asked), Setpoint(self.target.eta_d)

    # What changes between ticks

    def count_from(self, datum: Datum) -> None:
        """Take what places count from now: a path whose places are others is not resumed."""
        self._datum = datum

    def refuse(self, config: Config) -> None:
        """Raise ValueError where the present setpoint is not possible with `config`."""
        Bounds(config).refuse_depth(self._target.asked)

    def retune(self, config: Config) -> None:
        """Go on with `config`."""
        self._bounds = Bounds(config)
        self._pilot.retune(config)

    # Who may hold what

    def holdable(self, state: VehicleState) -> Flags:
        """Return the degrees of freedom that would be held if it engaged now."""
        positioned = self._positioned(state)
        return (positioned, positioned, True, self._bounds.config.vehicle.holds_heading)

    def _positioned(self, state: VehicleState) -> bool:
        """Tell whether a place can be held; a wrong heading pushes away from it."""
        fresh = state.ages.position_s <= self._bounds.config.supervisor.position_timeout_s
        return fresh and not state.heading_check.lost

    def pilot_demand(self, state: VehicleState, dt_s: float, events: Sequence[Event]) -> PilotDemand:
        """Return what the pilot demands this tick."""
        return self._pilot.step(state, dt_s, events, self.engaged, self.target.eta_d[Z])

    def update(
        self, previous: Verdict, verdict: Verdict, state: VehicleState, frame: Frame, *, engage: bool
    ) -> Flags | None:
        """Take this tick's permission and offset; `engage` tells that the operator asks for it now.

        Return the degrees of freedom that are held again, whose reference starts where the vehicle is; None
        where all of them rest there.
        """
        target, self._here = self._target, state.eta
        if frame.settled != self._frame.settled:
            target.translate_asked(self.engaged, frame.settled)
        self._frame = frame
        waits, self._waits = self._waits, False
        if verdict.authority == 0.0:
            self._rest(previous, verdict, state, waited=waits)
            return None
        if waits:
            target.start = Setpoint(state.eta)
            return None
        if not previous.authority > 0.0:
            self._held.engage(self.holdable(state))
            target.engage(state.eta, frame.settled)
            return None
        regained = NONE
        if engage and verdict.state is State.ACTIVE:
            regained = self._held.regain()
            target.put(regained, state.eta)
            if self.offers_position:
                self._held.want_here()
        return either(regained, self._follow_position(state))

    def _rest(self, previous: Verdict, verdict: Verdict, state: VehicleState, *, waited: bool) -> None:
        """Hold nothing; while an interruption is ridden out, nothing of what is wanted changes."""
        self._references.clear()
        if Condition.INTERRUPTED in verdict.conditions and (waited or previous.authority > 0.0):
            self._waits = verdict.state is State.ACTIVE
        if self._waits:
            return
        self._held.rest()
        self._target.now = Setpoint(state.eta_ahead)
        if previous.authority > 0.0:
            self._angles.asked = LEVEL
            self._pilot.ask(-math.inf, ZERO, body=True)
        if self._altitude is not None:
            self._altitude.rest()
        if self._course is not None and self._course.begun:
            self._course.suspend()
        if verdict.state is State.FAULT and previous.state is not State.FAULT:
            self._altitude = None
            if self._course is not None and not self._course.is_unfinished:
                self._course = None

    def _follow_position(self, state: VehicleState) -> Flags:
        """Let x and y go without a position; return them when they are taken up, as something wants them."""
        held, target = self._held, self._target
        self._has_position = self._positioned(state) and held.settled(state.t_s)
        if not self._positioned(state):
            held.lose_position(state.t_s)
            return NONE
        if not (self.awaits_position and held.settled(state.t_s)):
            return NONE
        if held.moved_meanwhile:
            target.ask_places(HORIZONTAL, UNSET)
        if held.moved_meanwhile or not held.lost:
            target.put(HORIZONTAL, placed(self.asked, state.eta, self._frame.settled))
        return held.take_up_position()

    # What moves the target

    def step(
        self,
        demand: PilotDemand,
        events: Sequence[Event],
        verdict: Verdict,
        state: VehicleState,
        reference: Reference,
        dt_s: float,
    ) -> Setpoint:
        """Move the target by what pilot, ground station, course and ground ask for; return where to go.

        While authority grows the vehicle stays where it engaged.
        """
        if demand is not NO_DEMAND:
            self._apply_pilot_demand(demand, state.eta_ahead[PSI], reference, dt_s)
        if verdict.state is State.ACTIVE and verdict.authority < 1.0:
            return self._bounds.fenced(self._target.start, self._frame.now)
        if verdict.state is State.ACTIVE:
            self._take_targets(events, reference)
            self._target.carry_on(state.t_s, dt_s)
            self._follow_course(state, reference, dt_s)
            if self._altitude is not None and self.engaged[Z]:
                self._keep_altitude(self._altitude, state.ground, dt_s)
        return self._bounds.fenced(self.target, self._frame.now)

    def reference_now(self, ahead: Vector, state: VehicleState) -> Vector:
        """Take the reference of `state.ahead_s` from now; return that of now, taken before: inside."""
        return self._references.step(ahead, state.t_s, state.ahead_s)

    def _standing(self, reference: Reference) -> Vector:
        """Return where the reference comes to rest, inside; where x and y are not held, the vehicle's."""
        x, y, z, psi = braked(reference.states, self._bounds.max_acceleration)
        if not self.engaged[X]:
            x, y, _, _ = self._here
        return (x, y, z, wrap(psi))

    def _standing_outside(self, reference: Reference) -> Vector:
        return self._frame.settled.outside(self._standing(reference))

    def _apply_pilot_demand(self, demand: PilotDemand, psi: float, reference: Reference, dt_s: float) -> None:
        """Release the DOFs that the pilot overrides, and move the target as the sticks say.

        `psi` is the heading where the command acts. A path is paused by any of it.
        """
        held, target, course = self._held, self._target, self._course
        if held.lost and demand.sticks is not None:
            pushed = max(abs(demand.sticks.sticks.surge), abs(demand.sticks.sticks.sway))
            held.moved_meanwhile |= pushed > self._bounds.config.supervisor.pilot_deflection
        steers = any(demand.nu) or any(demand.overridden)
        if steers:
            target.stop_carrying()
        if steers and course is not None and not (course.done or course.suspended):
            course.suspend()
            target.now = Setpoint(self._standing(reference))
        if demand.sticks is not None:
            self._angles.turn(demand.sticks.sticks, dt_s)
        if demand.hold and any(self.engaged):
            self._hold_here(reference)
        held.release(demand.overridden)
        now = self._frame.now
        here = now.setpoint_outside(target.now)
        heading, x_d = now.heading_outside(psi), now.outside(reference.x_d)
        there, moved = self._pilot.move(here, demand, heading, held.engaged, x_d, self._bounds, dt_s)
        if there is not here:
            target.now = now.setpoint_inside(there)
        taken = either(moved, demand.overridden)
        if self._altitude is not None and taken[Z]:
            self._altitude.take()
        target.ask_places(taken, UNSET)

    def _take_targets(self, events: Sequence[Event], reference: Reference) -> None:
        """Take the ground station's targets.

        A place replaces the target, no further than the fence; with a velocity beside it, it moves on. A
        velocity moves it until VELOCITY_LASTS_S after the message. Angles are held as far as they can be.
        """
        for event in events:
            until_s = event.t_s + VELOCITY_LASTS_S
            if isinstance(event, AttitudeTarget):
                if not math.isnan(event.heading):
                    self._angles.aim(event.angles)
                    self._put(Setpoint((math.nan, math.nan, math.nan, event.heading)), -math.inf)
                if event.climb:
                    w = -event.climb * self._bounds.config.heave.max_rate
                    self._ask_velocity(until_s, (0.0, 0.0, w, 0.0), body=False)
            elif isinstance(event, PositionTarget):
                here, moves = self._standing_outside(reference), any(known(event.velocity))
                at = target_of(event, here, positioned=self.engaged[X] or self._has_position)
                if any(known(at.eta_d)[:PSI]):
                    self._put(at, until_s if moves else -math.inf)
                    continue
                if not math.isnan(at.eta_d[PSI]):
                    self._put(Setpoint(at.eta_d), -math.inf)
                if moves:
                    velocity = chosen(known(event.velocity), event.velocity, ZERO)
                    self._ask_velocity(until_s, velocity, body=event.body)

    def _put(self, target: Setpoint, carries_until_s: float) -> None:
        """Replace the target where a place is said, outside, with its rates within the limits."""
        settled, (x, y, z, psi) = self._frame.settled, target.eta_d
        place = (x, y, clamped(z, 0.0, self._bounds.config.supervisor.max_depth_m), psi)
        self._course = None
        if not math.isnan(z):
            self._altitude = None
        self._target.ask_places(known(place), place)
        there = placed(place, self.target.eta_d, settled)
        rate, rise = settled.inward(target.eta_d_dot), settled.inward(target.eta_d_ddot)
        self._target.now = self._bounds.slowed(Setpoint(there, rate, rise))
        self._target.carries_until_s = carries_until_s

    def _keep_altitude(self, altitude: AltitudeHold, ground: Ground, dt_s: float) -> None:
        """Move the target's depth with the ground."""
        if altitude.by_hand:
            altitude.by_hand = False
            return
        config, start_m = self._bounds.config, self.target.eta_d[Z]
        heave, least_m = config.heave, config.supervisor.min_altitude_m
        altitude.step(ground, start_m, least_m, heave.max_rate, heave.max_acceleration, dt_s)
        shallow_m, deep_m = self._bounds.fence.depth_m
        altitude.bound(max(shallow_m, 0.0), deep_m)
        self._target.move_depth(*altitude.target)

    def _follow_course(self, state: VehicleState, reference: Reference, dt_s: float) -> None:
        """Move the target along the course; one that leads nowhere ends here."""
        course = self._course
        if course is None or course.done or course.suspended:
            return
        course.datum = self._datum
        try:
            self._step_course(course, state, reference, dt_s)
        except (ArithmeticError, ValueError) as error:
            course.refuse(f"it cannot be followed: {error}" if course.begun else str(error))
            if course.begun:
                self._target.now = Setpoint(self._standing(reference))

    def _step_course(self, course: Course, state: VehicleState, reference: Reference, dt_s: float) -> None:
        held = self.engaged[X] and self.engaged[Y]
        rests = course.wants_position and not held
        if not course.begun:
            if rests:
                return
            course.frame = self._frame.settled
            start = self._standing_outside(reference)
            self._bounds.check(course, start)
            course.begin(start)
        first = X if held else Z
        behind_m = math.dist(state.eta_ahead[first:PSI], self.target.eta_d[first:PSI])
        if self._altitude is not None:
            behind_m = max(behind_m, self._altitude.lacks_m(state.ground))
        at = course.step(0.0 if rests else pace(reference.pace, behind_m), dt_s)
        if not all(map(math.isfinite, (*at.eta_d, *at.eta_d_dot, *at.eta_d_ddot))):
            raise ValueError("its numbers are not finite")
        self._target.now = course.frame.setpoint_inside(at)
