"""What is wanted: the setpoint, the target of now, the degrees of freedom that are held, the pilot's demand.

| word      | meaning                                                                            |
|-----------|------------------------------------------------------------------------------------|
| setpoint  | what the operator asked for; NaN: where the vehicle is when it is engaged           |
| target    | where each degree of freedom is to go now: the setpoint, as the pilot's sticks moved it |
| engaged   | degrees of freedom that the law holds                                               |
| released  | those that the pilot took back since it engaged; engaging again holds them again    |
| course    | a path, or a move to a place, that moves the target                                |

Without a position x and y are let go, and taken up again where something wants them: a place that was held
when the position was lost, a setpoint, a course.
"""

import math
from collections.abc import Sequence

from msgspec import UnsetType
from msgspec.structs import replace

from companion.config import Config
from companion.control.bounds import clamped, wrap
from companion.control.frames import shifted
from companion.control.positioning import jacobian, to_body, to_inertial
from companion.control.reference import ReferenceModel
from companion.guidance.altitude import AltitudeHold
from companion.guidance.course import Course, braked, pace
from companion.guidance.fence import fence, open_water
from companion.guidance.fixes import PositionFixes
from companion.guidance.paths.shapes import Path
from companion.guidance.paths.time_law import limits
from companion.guidance.pilot import NO_DEMAND, NONE, Pilot, PilotDemand
from companion.guidance.reference_history import ReferenceHistory
from companion.records import (
    PSI,
    ZERO,
    Event,
    Flags,
    FrameShift,
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

UNSET: Vector = (math.nan, math.nan, math.nan, math.nan)
HORIZONTAL: Flags = (True, True, False, False)
VELOCITY_LASTS_S = 1.0
POSITION_SETTLES_S = 0.5
"""A position that came back is taken up after this long: the estimate has found its velocity by then."""


class Guidance:
    """The only owner of setpoint, target and held degrees of freedom."""

    def __init__(self, config: Config, setpoint: Setpoint) -> None:
        self._config = config
        self._pilot = Pilot(config)
        self._fence = fence(config)
        self._limits = limits(config)
        self._setpoint = self._target = self._checked(setpoint)
        self._start = self._target
        """Where it stays until it may push with all authority."""
        self.engaged = NONE
        self._released = NONE
        self._references = ReferenceHistory()
        self._course: Course | None = None
        self.course_number = 0
        """Which course it is: one more with each."""
        self._altitude: AltitudeHold | None = None
        self._lost = False
        """Whether x and y were held when the position was lost."""
        self._moved_meanwhile = False
        """Whether the pilot has steered in surge or sway since then."""
        self._unpositioned_t_s = -math.inf
        self._fixes = PositionFixes()
        self._velocity: tuple[float, Vector, bool] = (-math.inf, ZERO, True)
        """Until when the ground station asks for a velocity, and whether it is along the vehicle's axes."""
        self._psi = 0.0

    @property
    def target(self) -> Setpoint:
        """Where it is to go: x, y, z, psi, with rates and accelerations."""
        return self._target

    @property
    def asked(self) -> Vector:
        """What the operator asked for, NaN where nothing: it holds again after engaging."""
        return self._setpoint.eta_d

    @property
    def awaits_position(self) -> bool:
        """Whether x and y are wanted, and are not held for want of a position."""
        return self._wants_position and not self.engaged[X] and not self._released[X]

    @property
    def wants_ground(self) -> bool:
        """Whether an altitude over the ground is to be kept."""
        return self._altitude is not None

    @property
    def _wants_position(self) -> bool:
        course = self._course
        moves = course is not None and course.wants_position and not (course.done or course.suspended)
        return self._lost or moves or not all(map(math.isnan, self._setpoint.eta_d[:Z]))

    def aim(self, setpoint: Setpoint) -> None:
        """Take a new setpoint; its NaN targets stay what they are. It ends a path or a move.

        Raises ValueError for one that is infinite, deeper than `supervisor.max_depth_m`, or beyond the fence.
        """
        self._setpoint = self._checked(setpoint)
        self._course = None
        if not math.isnan(setpoint.eta_d[Z]):
            self._altitude = None
        self._target = _filled(setpoint, self._target.eta_d)

    def follow(self, path: Path, reference: ReferenceModel) -> None:
        """Follow a path, from where it is, as soon as it may.

        Raises ValueError, with the place, for one that leaves the fence. One that counts from where it
        engages is checked then.
        """
        self._permit_altitude(path.plan.altitude_m)
        known = any(self.engaged) or not any(path.relative[:PSI])
        if known and (refused := self._leaves(path, path.start(self._standing(reference)))):
            raise ValueError(refused)
        plan = path.plan
        self._altitude = None if isinstance(plan.altitude_m, UnsetType) else AltitudeHold(plan.altitude_m)
        self._set_course(Course(self._limits, plan.speed_mps, plan.acceleration_mps2, path=path), UNSET)

    def go_to(self, place: Vector, order: Goto, reference: ReferenceModel) -> None:
        """Go to a place in a straight line; its NaN coordinates stay.

        In `order.frame` "local" it counts from the origin, else from where the vehicle is: "offset" north,
        east, down, or "body" forward, right, down. Raises ValueError for a place beyond the fence, and for
        an altitude that is too low, or given beside a depth.
        """
        frame = order.frame
        self._permit_altitude(order.altitude_m)
        if not isinstance(order.altitude_m, UnsetType) and not math.isnan(place[Z]):
            raise ValueError("depth_m and altitude_m: name one of them")
        if frame != "local":
            place = _from_here(self._standing(reference), place, body=frame == "body")
        self._checked(Setpoint(place))
        if place[Z] < 0.0:
            raise ValueError(f"depth_m: {place[Z]:.2f} m is above the surface; must be 0 or more")
        asked = chosen(_known(place), UNSET, self._setpoint.eta_d)
        if not isinstance(order.altitude_m, UnsetType):
            self._altitude = AltitudeHold(order.altitude_m)
            asked = chosen((False, False, True, False), UNSET, asked)
        elif not math.isnan(place[Z]):
            self._altitude = None
        self._set_course(Course.to(place, self._limits, order.speed_mps, order.acceleration_mps2), asked)

    def move_at(self, order: SetVelocity, now_s: float) -> None:
        """Move at a velocity; where it ends, the place is held. Raises ValueError while nothing is held."""
        if not any(self.engaged):
            raise ValueError("velocity: nothing is held; engage first")
        rate = math.radians(order.heading_rate_degps)
        velocity = (order.forward_mps, order.right_mps, order.down_mps, rate)
        self._velocity = (now_s + order.lasts_s, velocity, order.frame == "body")

    def hold(self, reference: ReferenceModel) -> None:
        """Stop here, and hold this place."""
        self._course = self._altitude = None
        self._setpoint = Setpoint(UNSET)
        self._target = Setpoint(self._standing(reference))

    def pause(self) -> None:
        """Let the path wait. Raises ValueError where there is none."""
        self._under_way().paused = True

    def resume(self, reference: ReferenceModel) -> None:
        """Let the path go on. Raises ValueError where there is none."""
        self._under_way().resume(self._standing(reference))

    @property
    def guided(self) -> Guided:
        """What moves the target now."""
        course, number = self._course, self.course_number
        if course is None:
            return Guided("hold" if any(self.engaged) else "", number, altitude_m=self._altitude_m)
        kind = "move" if course.path is None else "path"
        if course.done:
            kind = "refused" if course.refused else "hold"
        elif course.paused:
            kind = "paused"
        elif not course.begun or self.awaits_position:
            kind = "waiting"
        name = course.refused or (course.path.plan.name if course.path is not None else "")
        return Guided(
            kind, number, name, course.progress_m, course.length_m, course.speed_mps, self._altitude_m
        )

    @property
    def path(self) -> tuple[Path, Vector] | None:
        """The path, and what its places are moved by; None where there is none."""
        course = self._course
        return None if course is None or course.path is None else (course.path, course.offset)

    def refuse(self, config: Config) -> None:
        """Raise ValueError where the present setpoint is not possible with `config`."""
        checked(self._setpoint, config.supervisor.max_depth_m)

    def retune(self, config: Config) -> None:
        """Go on with `config`."""
        self._config = config
        self._fence, self._limits = fence(config), limits(config)
        self._pilot.retune(config)

    def holdable(self, state: VehicleState) -> Flags:
        """Return the degrees of freedom that would be held if it engaged now."""
        positioned = self._positioned(state)
        return (positioned, positioned, True, self._config.vehicle.holds_heading)

    def pilot_demand(self, now_s: float, dt_s: float, events: Sequence[Event]) -> PilotDemand:
        """Return what the pilot demands this tick."""
        until_s, velocity, body = self._velocity
        if now_s < until_s:
            nu = velocity if body else to_body(jacobian(self._psi), velocity)
            self._pilot.ask(until_s, nu)
        return self._pilot.step(now_s, dt_s, events, self.engaged, self._target.eta_d[Z])

    def update(self, before: Verdict, verdict: Verdict, state: VehicleState, *, engage: bool) -> Flags | None:
        """Take this tick's permission; `engage` tells that the operator asks for it now.

        Return the degrees of freedom that are held anew, whose reference starts where the vehicle is; None
        where all of it rests there.
        """
        if verdict.authority == 0.0:
            self._references.clear()
            self.engaged = NONE
            self._fixes.forget()
            self._lost = False
            self._target = Setpoint(state.eta_ahead)
            if self._altitude is not None:
                self._altitude.rest()
            if verdict.state is State.FAULT:
                self._course = self._altitude = None
            elif self._course is not None and self._course.begun:
                self._course.suspend()
            return None
        if not before.authority > 0.0:
            self.engaged, self._released = self.holdable(state), NONE
            self._start = Setpoint(state.eta)
            self._target = _filled(self._setpoint, self._start.eta_d)
            return None
        regained = NONE
        if engage and verdict.state is State.ACTIVE:
            regained, self._released = self._released, NONE
            self._target = replace(self._target, eta_d=chosen(regained, state.eta, self._target.eta_d))
            self.engaged = either(self.engaged, regained)
        return either(regained, self._follow_position(state))

    def _follow_position(self, state: VehicleState) -> Flags:
        """Let x and y go without a position; return them when they are taken up, as something wants them."""
        if not self._positioned(state):
            self._unpositioned_t_s = state.t_s
            if self.engaged[X] or self.engaged[Y]:
                self.engaged = (False, False, self.engaged[Z], self.engaged[PSI])
                self._lost, self._moved_meanwhile = True, False
            return NONE
        settled = state.t_s - self._unpositioned_t_s >= POSITION_SETTLES_S
        if not (self.awaits_position and settled):
            return NONE
        if not self._lost or self._moved_meanwhile:
            asked = UNSET if self._moved_meanwhile else self._setpoint.eta_d
            here = chosen(_known(asked), asked, state.eta)
            self._target = replace(self._target, eta_d=chosen(HORIZONTAL, here, self._target.eta_d))
            self._setpoint = replace(self._setpoint, eta_d=chosen(HORIZONTAL, asked, self._setpoint.eta_d))
        self._lost = False
        self.engaged = either(self.engaged, HORIZONTAL)
        return HORIZONTAL

    def apply_pilot_demand(
        self, demand: PilotDemand, psi: float, reference: ReferenceModel, dt_s: float
    ) -> None:
        """Release the DOFs that the pilot overrides, and move the target as the sticks say.

        `psi` is the heading where the command acts. A path is paused by any of it.
        """
        if demand is NO_DEMAND:
            return
        if self._lost and demand.sticks is not None:
            pushed = max(abs(demand.sticks.sticks.surge), abs(demand.sticks.sticks.sway))
            self._moved_meanwhile |= pushed > self._config.supervisor.pilot_deflection
        course = self._course
        steers = any(demand.nu) or any(demand.overridden)
        if steers and course is not None and not (course.done or course.suspended):
            course.suspend()
            self._target = Setpoint(self._standing(reference))
        overridden = demand.overridden
        x, y, z, psi_held = (held and not lost for held, lost in zip(self.engaged, overridden, strict=True))
        self.engaged = (x, y, z, psi_held)
        self._released = either(self._released, overridden)
        self._target, moved = self._pilot.move(
            self._target, demand, psi, self.engaged, reference.x_d, self._fence, dt_s
        )
        if self._altitude is not None and (moved[Z] or overridden[Z]):
            self._altitude.take()
        eta_d = chosen(either(moved, overridden), UNSET, self._setpoint.eta_d)
        self._setpoint = replace(self._setpoint, eta_d=eta_d)

    def take_targets(self, events: Sequence[Event], verdict: Verdict, reference: ReferenceModel) -> None:
        """Take the ground station's position targets, where all authority is there.

        A place replaces the target, no further than the fence. A velocity moves it until VELOCITY_LASTS_S
        after the message.
        """
        if verdict.state is not State.ACTIVE or verdict.authority < 1.0:
            return
        for event in events:
            if not isinstance(event, PositionTarget):
                continue
            if any(_known(event.place)):
                here = self._standing(reference)
                place = _from_here(here, event.place, body=event.body) if event.offset else event.place
                x, y, z, psi = place
                place = (x, y, clamped(z, 0.0, self._config.supervisor.max_depth_m), psi)
                self._course = None
                if not math.isnan(place[Z]):
                    self._altitude = None
                self._setpoint = replace(
                    self._setpoint, eta_d=chosen(_known(place), place, self._setpoint.eta_d)
                )
                self._target = Setpoint(chosen(_known(place), place, self._target.eta_d))
            else:
                velocity = chosen(_known(event.velocity), event.velocity, ZERO)
                self._velocity = (event.t_s + VELOCITY_LASTS_S, velocity, event.body)

    def advance(self, verdict: Verdict, state: VehicleState, reference: ReferenceModel, dt_s: float) -> None:
        """Move the target along the course, and with the ground, where all authority is there."""
        self._psi = state.eta_ahead[PSI]
        if verdict.state is not State.ACTIVE or verdict.authority < 1.0:
            return
        approaches = self._course is not None and self._course.approaches
        if not approaches and (back := self._fixes.made_good(dt_s)) is not None:
            self._move_places(back)
        self._follow_course(state, reference, dt_s)
        if self._altitude is not None and self.engaged[Z]:
            self._keep_altitude(self._altitude, state.ground, dt_s)

    def _keep_altitude(self, altitude: AltitudeHold, ground: Ground, dt_s: float) -> None:
        """Move the target's depth with the ground."""
        if altitude.by_hand:
            altitude.by_hand = False
            return
        heave, limits = self._config.heave, self._config.supervisor
        bounds = self._fence or open_water(self._config)
        start_m = self._target.eta_d[Z]
        altitude.step(ground, start_m, limits.min_altitude_m, heave.max_rate, heave.max_acceleration, dt_s)
        shallow_m, deep_m = bounds.depth_m
        altitude.bound(max(shallow_m, 0.0), deep_m)
        depth = (altitude.depth_m, altitude.rate_mps, altitude.acceleration_mps2)
        eta, eta_dot, eta_ddot = (
            (x, y, of_depth, psi)
            for (x, y, _, psi), of_depth in zip(
                (self._target.eta_d, self._target.eta_d_dot, self._target.eta_d_ddot), depth, strict=True
            )
        )
        self._target = Setpoint(eta, eta_dot, eta_ddot)

    def _follow_course(self, state: VehicleState, reference: ReferenceModel, dt_s: float) -> None:
        """Move the target along the course."""
        course = self._course
        if course is None or course.done or course.suspended:
            return
        held = self.engaged[X] and self.engaged[Y]
        rests = course.wants_position and not held
        if not course.begun:
            if rests:
                return
            start = self._standing(reference)
            if course.path is not None and (refused := self._leaves(course.path, course.path.start(start))):
                course.refused, course.done = refused, True
                return
            course.begin(start)
        first = X if held else Z
        behind_m = math.dist(state.eta_ahead[first:PSI], self._target.eta_d[first:PSI])
        if self._altitude is not None:
            behind_m = max(behind_m, self._altitude.lacks_m(state.ground))
        self._target = course.step(0.0 if rests else pace(reference.pace, behind_m), dt_s)

    def target_now(self, verdict: Verdict) -> Setpoint:
        """Return where the reference goes: while authority grows, it stays where it engaged."""
        growing = verdict.state is State.ACTIVE and verdict.authority < 1.0
        target = self._start if growing else self._target
        return target if self._fence is None else self._fence.inside(target)

    def shift(self, shift: FrameShift, state: VehicleState) -> None:
        """Hold the same physical place and direction in the frame of a reset estimate.

        A jump of the position that is a fix, not a reset, is made good slowly (`PositionFixes`).
        """
        self._move_places(shift)
        self._references.shift(shift, state.eta)
        self._fixes.jumped(shift, state.t_s, held=self.engaged[X])

    def _move_places(self, shift: FrameShift) -> None:
        """Shift what is wanted: target, start, course, and what was asked for and is held."""
        self._target = replace(self._target, eta_d=shifted(shift, self._target.eta_d))
        self._start = replace(self._start, eta_d=shifted(shift, self._start.eta_d))
        if self._course is not None:
            self._course.shift(shift)
        moved = [
            held if engaged and math.isfinite(asked) else asked
            for engaged, held, asked in zip(
                self.engaged, self._target.eta_d, self._setpoint.eta_d, strict=True
            )
        ]
        self._setpoint = replace(self._setpoint, eta_d=vector(moved))

    def reference_now(self, ahead: Vector, state: VehicleState) -> Vector:
        """Take the reference of `state.ahead_s` from now; return that of now, which was taken before."""
        return self._references.step(ahead, state.t_s, state.ahead_s)

    def _set_course(self, course: Course, asked: Vector) -> None:
        """Follow a course; `asked` is what is left of the setpoint."""
        self._course = course
        self.course_number += 1
        self._setpoint = Setpoint(asked)
        self._target = Setpoint(self._target.eta_d)

    def _under_way(self) -> Course:
        if self._course is None or self._course.done:
            raise ValueError("there is no path and no move under way")
        return self._course

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

    def _standing(self, reference: ReferenceModel) -> Vector:
        """Return where the reference comes to rest."""
        x, y, z, psi = braked(reference.states, self._pilot.max_acceleration)
        return (x, y, z, wrap(psi))

    def _positioned(self, state: VehicleState) -> bool:
        return state.ages.position_s <= self._config.supervisor.position_timeout_s

    def _checked(self, setpoint: Setpoint) -> Setpoint:
        checked(setpoint, self._config.supervisor.max_depth_m)
        bounds = self._fence
        if bounds is not None:
            known = chosen(_known(setpoint.eta_d), setpoint.eta_d, bounds.middle)
            if refused := bounds.outside(known[:PSI]):
                raise ValueError(f"setpoint beyond the fence: {refused}")
        return setpoint

    def _leaves(self, path: Path, offset: Vector) -> str:
        """Return where a path leaves the fence first, in words; "" where it stays inside."""
        bounds = self._fence or open_water(self._config)
        for place in path.places():
            moved = [a + b for a, b in zip(place, offset, strict=False)]
            if refused := bounds.outside(moved):
                x, y, z = moved
                return f"the path leaves the fence at x {x:.2f}, y {y:.2f}, depth {z:.2f} m: {refused}"
        return ""


def checked(setpoint: Setpoint, max_depth_m: float) -> Setpoint:
    """Return a setpoint; raise ValueError for one that is infinite, or deeper than `max_depth_m`."""
    motion = (*setpoint.eta_d_dot, *setpoint.eta_d_ddot)
    infinite = any(map(math.isinf, setpoint.eta_d)) or not all(map(math.isfinite, motion))
    if infinite or setpoint.eta_d[Z] > max_depth_m:
        raise ValueError(
            f"setpoint {list(setpoint.eta_d)} (x, y, depth, heading): must be finite, "
            f"and no deeper than supervisor.max_depth_m = {max_depth_m:g}"
        )
    return setpoint


def _from_here(here: Vector, step: Vector, *, body: bool) -> Vector:
    """Return the place a step from here, NaN where the step says nothing: north, or forward, and so on."""
    wanted = _known(step)
    if body and (wanted[X] or wanted[Y]):
        wanted = (True, True, wanted[Z], wanted[PSI])
    by = to_inertial(jacobian(here[PSI] if body else 0.0), chosen(_known(step), step, ZERO))
    x, y, z, psi = (at + far for at, far in zip(here, by, strict=True))
    return chosen(wanted, (x, y, z, wrap(psi)), UNSET)


def _known(eta: Vector) -> Flags:
    x, y, z, psi = eta
    return (not math.isnan(x), not math.isnan(y), not math.isnan(z), not math.isnan(psi))


def _filled(setpoint: Setpoint, eta: Vector) -> Setpoint:
    """Return the setpoint with NaN targets replaced by `eta`."""
    x, y, z, psi = map(math.isnan, setpoint.eta_d)
    return replace(setpoint, eta_d=chosen((x, y, z, psi), eta, setpoint.eta_d))
