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

from msgspec import UnsetType

from companion.config import Config
from companion.core.bounds import clamped, limited, wrap
from companion.core.positioning import jacobian, to_inertial
from companion.core.reference import Reference
from companion.estimation.frame import Frame
from companion.guidance.altitude import AltitudeHold
from companion.guidance.angles import HeldAngles
from companion.guidance.course import Course, braked, pace
from companion.guidance.datum import Datum, difference
from companion.guidance.fence import fence, refuse_depth
from companion.guidance.held import HORIZONTAL, HeldDofs
from companion.guidance.orders import Order, angles, place_words
from companion.guidance.paths.shapes import Path
from companion.guidance.paths.time_law import limits
from companion.guidance.pilot import NO_DEMAND, NONE, Pilot, PilotDemand
from companion.guidance.reference_history import ReferenceHistory
from companion.guidance.target import UNSET, Target, from_here, known, placed
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
    vector,
)
from companion.telemetry.commands import Goto, SetVelocity

VELOCITY_LASTS_S = 1.0


class Guidance:
    """The only owner of setpoint, target and held degrees of freedom."""

    def __init__(self, config: Config, setpoint: Setpoint) -> None:
        self._config = config
        self._pilot = Pilot(config)
        self._fence = fence(config)
        self._limits = limits(config)
        self._target = Target(self._checked(setpoint))
        self._held = HeldDofs()
        self._has_position = False
        self._here = ZERO
        """Where the vehicle was last, inside."""
        self._references = ReferenceHistory()
        self._course: Course | None = None
        self._course_number = 0
        """Which course it is: one more with each."""
        self._altitude: AltitudeHold | None = None
        self._angles = HeldAngles(config)
        self._carries_until_s = -math.inf
        """Until then the target moves on by its own rate, which the ground station gave it."""
        self._interrupted: Course | None = None
        """The path that a place or a move has replaced: `resume` takes it up again."""
        self._waits = False
        """Whether an interruption is ridden out: nothing of what is wanted changes."""
        self._frame = Frame()
        self._datum = Datum()
        """What places count from."""

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
    def wants_ground(self) -> bool:
        """Whether an altitude over the ground is to be kept."""
        return self._altitude is not None

    @property
    def doubts_range(self) -> bool:
        """Whether the depth is held because the range does not answer the vehicle's motion."""
        return self._altitude is not None and self._altitude.doubts

    @property
    def _wants_position(self) -> bool:
        course = self._course
        moves = course is not None and course.wants_position and not (course.done or course.suspended)
        return self._held.lost or moves or any(known(self.asked)[:Z])

    def aim(self, setpoint: Setpoint) -> None:
        """Take a new setpoint; its NaN targets stay what they are. It ends a path or a move.

        Raises ValueError for one that is infinite, deeper than `supervisor.max_depth_m`, or beyond the fence.
        """
        self._target.ask(self._checked(setpoint), self._frame.settled)
        self._leave_course()
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
        elif order.action == "resume":
            self._resume(reference)
        elif self._course is None or self._course.done:
            raise ValueError("there is no path and no move under way")
        else:
            self._course.paused = True

    @property
    def guided(self) -> Guided:
        """What moves the target now."""
        course, number = self._course, self._course_number
        rests = "hold" if any(self.engaged) else ""
        if self._interrupted is not None and (course is None or (course.done and not course.refused)):
            course = self._interrupted
            kind = rests
        elif course is None:
            return Guided(rests, number, altitude_m=self._altitude_m, pending=self._pending)
        elif course.done:
            kind = "refused" if course.refused else "hold"
        elif course.paused:
            kind = "paused"
        elif not course.begun or self.awaits_position:
            kind = "waiting"
        else:
            kind = "move" if course.path is None else "path"
        name = course.refused or (course.path.plan.name if course.path is not None else "")
        if kind == "hold":
            name = ""
        return Guided(
            kind,
            number,
            name,
            course.progress_m,
            course.length_m,
            course.speed_mps,
            self._altitude_m,
            course.left_m,
            course.left_s,
            self._pending,
        )

    @property
    def destination(self) -> Vector:
        """Where a move goes, NaN where none does, and of a step from here before it begins."""
        course = self._course
        known_now = course is not None and not course.done and course.place_from == "local"
        return course.place if course is not None and known_now else UNSET

    @property
    def _pending(self) -> str:
        """What it does as soon as it engages, in words; empty: it holds where it is."""
        if any(self.engaged):
            return ""
        course = self._course
        begins = course is not None and not (course.begun or course.done)
        altitude_m = math.nan if begins or self._altitude is None else self._altitude.altitude_m
        parts = [place_words(self.asked, altitude_m, self.angles)]
        if course is not None and begins:
            parts.append(f"{'wait, paused, to ' if course.paused else ''}{course.words}")
        return "; ".join(filter(None, parts))

    @property
    def path(self) -> tuple[Path, Callable[[Vector], Vector]] | None:
        """The path, and what gives its places in the EKF's frame; None where there is none."""
        course, now = self._course or self._interrupted, self._frame.now
        if course is None or course.path is None:
            return None
        began = course.frame
        if not course.begun or began == now:
            return course.path, course.moved
        return course.path, lambda place: now.outside(began.inside(course.moved(place)))

    def count_from(self, datum: Datum) -> None:
        """Take what places count from now: a path whose places are others is not resumed."""
        self._datum = datum

    def refuse(self, config: Config) -> None:
        """Raise ValueError where the present setpoint is not possible with `config`."""
        refuse_depth(self._target.asked, config)

    def retune(self, config: Config) -> None:
        """Go on with `config`."""
        self._config = config
        self._fence, self._limits = fence(config), limits(config)
        self._pilot.retune(config)

    def holdable(self, state: VehicleState) -> Flags:
        """Return the degrees of freedom that would be held if it engaged now."""
        positioned = self._positioned(state)
        return (positioned, positioned, True, self._config.vehicle.holds_heading)

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
        held, target, self._here = self._held, self._target, state.eta
        if frame.settled != self._frame.settled:
            target.translate_asked(self.engaged, frame.settled)
        self._frame = frame
        waits, self._waits = self._waits, False
        if verdict.authority == 0.0:
            self._references.clear()
            if Condition.INTERRUPTED in verdict.conditions and (waits or previous.authority > 0.0):
                self._waits = verdict.state is State.ACTIVE
            if self._waits:
                return None
            held.rest()
            target.now = Setpoint(state.eta_ahead)
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
            return None
        if waits:
            target.start = Setpoint(state.eta)
            return None
        if not previous.authority > 0.0:
            held.engage(self.holdable(state))
            target.engage(state.eta, frame.settled)
            return None
        regained = NONE
        if engage and verdict.state is State.ACTIVE:
            regained = held.regain()
            target.put(regained, state.eta)
            if self.offers_position:
                held.want_here()
        return either(regained, self._follow_position(state))

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
            return self._fenced(self._target.start)
        if verdict.state is State.ACTIVE:
            self._take_targets(events, reference)
            self._carry_on(state.t_s, dt_s)
            self._follow_course(state, reference, dt_s)
            if self._altitude is not None and self.engaged[Z]:
                self._keep_altitude(self._altitude, state.ground, dt_s)
        return self._fenced(self.target)

    def reference_now(self, ahead: Vector, state: VehicleState) -> Vector:
        """Take the reference of `state.ahead_s` from now; return that of now, taken before: inside."""
        return self._references.step(ahead, state.t_s, state.ahead_s)

    def _apply_pilot_demand(self, demand: PilotDemand, psi: float, reference: Reference, dt_s: float) -> None:
        """Release the DOFs that the pilot overrides, and move the target as the sticks say.

        `psi` is the heading where the command acts. A path is paused by any of it.
        """
        held, target, course = self._held, self._target, self._course
        if held.lost and demand.sticks is not None:
            pushed = max(abs(demand.sticks.sticks.surge), abs(demand.sticks.sticks.sway))
            held.moved_meanwhile |= pushed > self._config.supervisor.pilot_deflection
        steers = any(demand.nu) or any(demand.overridden)
        if steers:
            self._stop_carrying()
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
        there, moved = self._pilot.move(here, demand, heading, held.engaged, x_d, self._fence, dt_s)
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
            if isinstance(event, AttitudeTarget):
                if not math.isnan(event.heading):
                    self._angles.aim(event.angles)
                    self._put((math.nan, math.nan, math.nan, event.heading), Setpoint(UNSET))
                if event.climb:
                    w = -event.climb * self._config.heave.max_rate
                    self._ask_velocity(event.t_s + VELOCITY_LASTS_S, (0.0, 0.0, w, 0.0), body=False)
            elif isinstance(event, PositionTarget):
                self._take_position(event, reference)

    def _take_position(self, event: PositionTarget, reference: Reference) -> None:
        here = self._frame.settled.outside(self._standing(reference))
        x, y, z, psi = event.place
        if event.offset and not (self.engaged[X] or self._has_position):
            x, y = math.nan, math.nan
        if event.offset:
            x, y, z, _ = from_here(here, (x, y, z, math.nan), body=event.body)
        if event.turns:
            psi = wrap(here[PSI] + psi)
        place, said = (x, y, z, psi), any(known(event.velocity))
        velocity = chosen(known(event.velocity), event.velocity, ZERO)
        if any(known(place)[:PSI]):
            J = jacobian(here[PSI] if event.body else 0.0)
            acceleration = chosen(known(event.acceleration), event.acceleration, ZERO)
            self._put(place, Setpoint(UNSET, to_inertial(J, velocity), to_inertial(J, acceleration)))
            self._carries_until_s = event.t_s + VELOCITY_LASTS_S if said else -math.inf
        else:
            if not math.isnan(psi):
                self._put(place, Setpoint(UNSET))
            if said:
                self._ask_velocity(event.t_s + VELOCITY_LASTS_S, velocity, body=event.body)

    def _put(self, place: Vector, moving: Setpoint) -> None:
        """Replace the target where a place is said, outside, with the rates of `moving` within the limits."""
        settled, axes, a_max = self._frame.settled, self._config.axes, self._pilot.max_acceleration
        x, y, z, psi = place
        place = (x, y, clamped(z, 0.0, self._config.supervisor.max_depth_m), psi)
        level = min(axes[X].max_rate, axes[Y].max_rate)
        fastest = (level, level, axes[Z].max_rate, axes[PSI].max_rate)
        rate, rise = settled.inward(moving.eta_d_dot), settled.inward(moving.eta_d_ddot)
        self._leave_course()
        if not math.isnan(z):
            self._altitude = None
        self._target.ask_places(known(place), place)
        self._target.now = Setpoint(
            placed(place, self.target.eta_d, settled),
            vector(map(limited, rate, fastest)),
            vector(map(limited, rise, a_max)),
        )

    def _carry_on(self, now_s: float, dt_s: float) -> None:
        """Move a target on that came with a velocity, until it has said nothing for too long."""
        if now_s < self._carries_until_s:
            self._target.carry_on(dt_s)
        else:
            self._stop_carrying()

    def _stop_carrying(self) -> None:
        if self._carries_until_s > -math.inf:
            self._carries_until_s = -math.inf
            self._target.now = Setpoint(self.target.eta_d)

    def _keep_altitude(self, altitude: AltitudeHold, ground: Ground, dt_s: float) -> None:
        """Move the target's depth with the ground."""
        if altitude.by_hand:
            altitude.by_hand = False
            return
        heave, least_m = self._config.heave, self._config.supervisor.min_altitude_m
        start_m = self.target.eta_d[Z]
        altitude.step(ground, start_m, least_m, heave.max_rate, heave.max_acceleration, dt_s)
        shallow_m, deep_m = self._fence.depth_m
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
            course.refused, course.done = f"it cannot be followed: {error}", True
            self._target.now = Setpoint(self._standing(reference))

    def _step_course(self, course: Course, state: VehicleState, reference: Reference, dt_s: float) -> None:
        held = self.engaged[X] and self.engaged[Y]
        rests = course.wants_position and not held
        if not course.begun:
            if rests:
                return
            course.frame = self._frame.settled
            start = course.frame.outside(self._standing(reference))
            try:
                self._check_course(course, start)
            except ValueError as error:
                course.refused, course.done = str(error), True
                return
            course.begin(start)
        first = X if held else Z
        behind_m = math.dist(state.eta_ahead[first:PSI], self.target.eta_d[first:PSI])
        if self._altitude is not None:
            behind_m = max(behind_m, self._altitude.lacks_m(state.ground))
        at = course.step(0.0 if rests else pace(reference.pace, behind_m), dt_s)
        if not all(map(math.isfinite, (*at.eta_d, *at.eta_d_dot, *at.eta_d_ddot))):
            raise ValueError("its numbers are not finite")
        self._target.now = course.frame.setpoint_inside(at)

    def _follow(self, path: Path, reference: Reference) -> None:
        """Follow a path, from where it is, as soon as it may.

        Raises ValueError, with the place, for one that leaves the fence. One that counts from where it
        engages is checked then.
        """
        plan = path.plan
        self._permit_altitude(plan.altitude_m)
        self._angles.permit(angles(plan))
        course = Course(self._limits, plan.speed_mps, plan.acceleration_mps2, path=path)
        if any(self.engaged) or not any(path.relative[:PSI]):
            self._check_course(course, self._frame.settled.outside(self._standing(reference)))
        self._angles.ask(angles(plan))
        self._altitude = _altitude_of(path)
        self._set_course(course, UNSET)
        self._interrupted = None

    def _resume(self, reference: Reference) -> None:
        """Go on with what is paused, or with the path that something else has replaced.

        Raises ValueError where there is none, and where its places are not where they were.
        """
        course = self._course
        is_back = (course is None or course.done) and self._interrupted is not None
        if is_back:
            course = self._interrupted
        if course is None or course.done:
            raise ValueError("there is no path and no move under way")
        why = "" if course.datum is None else difference(course.datum, self._datum)
        if why is None:
            raise ValueError("the autopilot has not told its boot count and origin yet: try again in seconds")
        if why:
            raise ValueError(f"{why}: it cannot go on where it was interrupted. Follow it anew")
        if course.begun and not any(self.engaged):
            raise ValueError("nothing is held, and it goes on from where it is held: engage first")
        if is_back:
            self._set_course(course, UNSET)
            self._interrupted = None
        if course.path is not None:
            self._angles.ask(angles(course.path.plan))
        if course.path is not None and self._altitude is None:
            self._altitude = _altitude_of(course.path)
        course.resume(course.frame.outside(self._standing(reference)))

    def _leave_course(self) -> None:
        """End what moves the target; a path that is unfinished can be resumed."""
        course = self._course
        if course is not None and course.is_unfinished:
            course.suspend()
            self._interrupted = course
        self._course = None

    def _go_to(self, order: Goto, reference: Reference) -> None:
        """Go to a place in a straight line; coordinates that it does not name stay.

        In `order.frame` "local" it counts from the origin, else from where the move begins: "offset" north,
        east, down, or "body" forward, right, down. Raises ValueError for a place beyond the fence, for north
        or east where there never was a position, and for an altitude that is too low, or beside a depth.
        """
        course, held = Course.to(order, self._limits), angles(order)
        self._permit_altitude(order.altitude_m)
        self._angles.permit(held)
        here = self._frame.settled.outside(self._standing(reference))
        goal = course.goal(here)
        if not isinstance(order.altitude_m, UnsetType) and not math.isnan(goal[Z]):
            raise ValueError("depth_m and altitude_m: name one of them")
        level = any(known(goal)[:Z])
        unheld = any(self.engaged) and self._held.lacks_position and not self._held.lost
        if level and unheld and not self._has_position:
            raise ValueError(
                "there is no position: x and y are not held, and north and east mean nothing. Go by depth "
                "and heading, or connect a DVL, a USBL or vision that the autopilot uses (docs/guidance.md)"
            )
        if any(self.engaged) or order.frame == "local":
            self._check_course(course, here)
        self._angles.ask(held)
        if not any(known(goal)) and isinstance(order.altitude_m, UnsetType):
            return
        asked = chosen(known(goal), UNSET, self.asked)
        if not isinstance(order.altitude_m, UnsetType):
            self._altitude = AltitudeHold(order.altitude_m)
            asked = chosen((False, False, True, False), UNSET, asked)
        elif not math.isnan(goal[Z]):
            self._altitude = None
        self._leave_course()
        self._set_course(course, asked)

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
        """Stop, and hold this place, also north and east where a position has come."""
        self._leave_course()
        self._altitude = None
        if self.offers_position:
            self._held.want_here()
        self._target.hold(self._standing(reference))

    def _set_course(self, course: Course, asked: Vector) -> None:
        """Follow a course; `asked` is what is left of the setpoint."""
        self._course = course
        self._course_number += 1
        self._target.asked = Setpoint(asked)
        self._target.now = Setpoint(self.target.eta_d)

    def _fenced(self, target: Setpoint) -> Setpoint:
        """Return the target inside, held at the fence, which is where the EKF's frame is now."""
        now = self._frame.now
        outside = now.setpoint_outside(target)
        kept = self._fence.inside(outside)
        return target if kept is outside else now.setpoint_inside(kept)

    @property
    def _altitude_m(self) -> float:
        altitude = self._altitude
        return 0.0 if altitude is None or math.isnan(altitude.altitude_m) else altitude.altitude_m

    def _permit_altitude(self, altitude_m: float | UnsetType) -> None:
        least_m = self._config.supervisor.min_altitude_m
        if not isinstance(altitude_m, UnsetType) and altitude_m < least_m:
            raise ValueError(
                f"altitude_m = {altitude_m:g}: must be supervisor.min_altitude_m = {least_m:g} or more"
            )

    def _standing(self, reference: Reference) -> Vector:
        """Return where the reference comes to rest, inside; where x and y are not held, the vehicle's."""
        x, y, z, psi = braked(reference.states, self._pilot.max_acceleration)
        if not self.engaged[X]:
            x, y, _, _ = self._here
        return (x, y, z, wrap(psi))

    def _positioned(self, state: VehicleState) -> bool:
        """Tell whether a place can be held; a wrong heading pushes away from it."""
        fresh = state.ages.position_s <= self._config.supervisor.position_timeout_s
        return fresh and not state.heading_check.lost

    def _check_course(self, course: Course, start: Vector) -> None:
        """Raise ValueError for a path or a move that leaves its bounds from `start`."""
        if course.path is not None:
            if refused := self._fence.left_by(course.path, start):
                raise ValueError(refused)
            return
        goal = course.goal(start)
        self._checked(Setpoint(goal))
        if goal[Z] < 0.0:
            raise ValueError(f"depth_m: {goal[Z]:.2f} m is above the surface; must be 0 or more")

    def _checked(self, setpoint: Setpoint) -> Setpoint:
        refuse_depth(setpoint, self._config)
        if refused := self._fence.outside(setpoint.eta_d):
            raise ValueError(f"setpoint beyond the fence: {refused}")
        return setpoint


def _altitude_of(path: Path) -> AltitudeHold | None:
    altitude_m = path.plan.altitude_m
    return None if isinstance(altitude_m, UnsetType) else AltitudeHold(altitude_m)
