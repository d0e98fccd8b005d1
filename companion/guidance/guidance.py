"""What is wanted, tick by tick: each source in turn moves the target that the one before it left.

| source                            | file                | moves the target                                |
|-----------------------------------|---------------------|-------------------------------------------------|
| the operator's setpoint           | `target.py`         | where it was asked to go; else it stays         |
| the pilot's sticks, a velocity    | `pilot.py`          | of the axes that they move                      |
| the ground station's targets      | `ground_station.py` | in one step, and on by their velocity           |
| the course: a path or a move      | `course.py`         | along a line, with bounded acceleration         |
| an altitude                       | `altitude.py`       | its depth, with the ground                      |
| the fence                         | `fence.py`          | back inside                                     |

`sources.py` says which of them there are; `operator.py` takes orders.
"""

import math
from collections.abc import Sequence

from companion.config import Config
from companion.core.actuation import NONE
from companion.estimation.frame import Frame, Offset
from companion.guidance import ground_station, operator
from companion.guidance.course import Course, pace
from companion.guidance.fence import Bounds
from companion.guidance.held import HORIZONTAL
from companion.guidance.orders import Order
from companion.guidance.pilot import NO_DEMAND, PilotDemand
from companion.guidance.reference_history import ReferenceHistory
from companion.guidance.sources import Here, Sources
from companion.guidance.target import UNSET, placed
from companion.records import (
    LEVEL,
    PSI,
    ZERO,
    Condition,
    Event,
    Flags,
    Ground,
    Setpoint,
    State,
    VehicleState,
    Verdict,
    X,
    Y,
    Z,
    either,
)


class Guidance:
    """Who holds what by this tick's permission, and where it is to go."""

    def __init__(self, config: Config, setpoint: Setpoint) -> None:
        self.sources = Sources(config, setpoint)
        self.references = ReferenceHistory()
        """References of what was held, for the record of each tick."""
        self._settled = Offset()
        """The frame of the places that were asked for."""
        self._waits = False
        """Whether a short interruption lasts: nothing of what is wanted changes."""

    @property
    def target(self) -> Setpoint:
        """Where it is to go, inside: x, y, z, psi, with rates and accelerations."""
        return self.sources.target.now

    @property
    def engaged(self) -> Flags:
        """The degrees of freedom that the law holds."""
        return self.sources.held.engaged

    def guide(self, order: Order, here: Here) -> None:
        """Take a path, a move, or what to do with them. Raises ValueError for what is not possible."""
        operator.take(order, self.sources, here)

    def refuse(self, config: Config) -> None:
        """Raise ValueError where the present setpoint is not possible with `config`."""
        Bounds(config).refuse_depth(self.sources.target.asked)

    def retune(self, config: Config) -> None:
        """Go on with `config`."""
        self.sources.bounds = Bounds(config)
        self.sources.pilot.retune(config)

    # Who may hold what

    def holdable(self, state: VehicleState) -> Flags:
        """Return the degrees of freedom that would be held if it engaged now."""
        positioned = self._positioned(state)
        return (positioned, positioned, True, self.sources.bounds.config.vehicle.holds_heading)

    def _positioned(self, state: VehicleState) -> bool:
        """Tell whether a place can be held; a wrong heading pushes away from it."""
        fresh = state.ages.position_s <= self.sources.bounds.config.supervisor.position_timeout_s
        return fresh and not state.heading_check.lost

    def update(
        self, previous: Verdict, verdict: Verdict, state: VehicleState, frame: Frame, *, engage: bool
    ) -> Flags | None:
        """Take this tick's permission and offset; `engage` tells that the operator asks for it now.

        Return the degrees of freedom that are held again, whose reference starts where the vehicle is; None
        where all of them rest there.
        """
        sources, held, target = self.sources, self.sources.held, self.sources.target
        if frame.settled != self._settled:
            self._settled = frame.settled
            target.translate_asked(held.engaged, frame.settled)
        waits, self._waits = self._waits, False
        if verdict.authority == 0.0:
            self._rest(previous, verdict, state, waited=waits)
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
            if sources.offers_position:
                held.want_here()
        return either(regained, self._follow_position(state, frame.settled))

    def _rest(self, previous: Verdict, verdict: Verdict, state: VehicleState, *, waited: bool) -> None:
        """Hold nothing; during a short interruption nothing of what is wanted changes."""
        self.references.clear()
        if Condition.INTERRUPTED in verdict.conditions and (waited or previous.authority > 0.0):
            self._waits = verdict.state is State.ACTIVE
        if self._waits:
            return
        sources = self.sources
        sources.held.rest()
        sources.target.now = Setpoint(state.eta_ahead)
        if previous.authority > 0.0:
            sources.angles.asked = LEVEL
            sources.pilot.ask(-math.inf, ZERO, body=True)
        if sources.altitude is not None:
            sources.altitude.rest()
        if sources.course.begun:
            sources.course.suspend()
        if verdict.state is State.FAULT and previous.state is not State.FAULT:
            sources.altitude = None
            sources.suspend()

    def _follow_position(self, state: VehicleState, settled: Offset) -> Flags:
        """Release x and y without a position; return them when they are held again for something."""
        sources, held, target = self.sources, self.sources.held, self.sources.target
        held.follow_position(state.t_s, positioned=self._positioned(state))
        if not (held.has_position and sources.awaits_position):
            return NONE
        if held.moved_meanwhile:
            target.ask_places(HORIZONTAL, UNSET)
        if held.moved_meanwhile or not held.lost:
            target.put(HORIZONTAL, placed(target.asked.eta_d, state.eta, settled))
        return held.take_up_position()

    # What moves the target

    def pilot_demand(self, state: VehicleState, dt_s: float, events: Sequence[Event]) -> PilotDemand:
        """Return what the pilot demands this tick."""
        return self.sources.pilot.step(state, dt_s, events, self.engaged, self.target.eta_d[Z])

    def step(
        self,
        demand: PilotDemand,
        events: Sequence[Event],
        verdict: Verdict,
        state: VehicleState,
        here: Here,
        dt_s: float,
    ) -> Setpoint:
        """Return where to go: what the sources make of the target, one after the other.

        While authority grows the vehicle stays where it engaged.
        """
        sources, target = self.sources, self.sources.target
        sources.hear(events)
        by_hand = demand is not NO_DEMAND and self._apply_pilot_demand(
            demand, state.eta_ahead[PSI], here, dt_s
        )
        if verdict.state is State.ACTIVE and verdict.authority < 1.0:
            return sources.bounds.fenced(target.start, here.frame.now)
        if verdict.state is State.ACTIVE:
            ground_station.take(events, sources, here)
            target.carry_on(state.t_s, dt_s)
            if sources.course.moves:
                self._follow_course(sources.course, state, here, dt_s)
            if self.engaged[Z] and not by_hand:
                self._keep_altitude(state.ground, dt_s)
        return sources.bounds.fenced(target.now, here.frame.now)

    def _apply_pilot_demand(self, demand: PilotDemand, psi: float, here: Here, dt_s: float) -> bool:
        """Release the DOFs that the pilot overrides, and move the target as the sticks say.

        Return whether he moves an altitude that is kept. `psi` is the heading where the command acts. A path
        is paused by any of it.
        """
        sources, held, target = self.sources, self.sources.held, self.sources.target
        if held.lost and demand.sticks is not None:
            pushed = max(abs(demand.sticks.sticks.surge), abs(demand.sticks.sticks.sway))
            held.moved_meanwhile |= pushed > sources.bounds.config.supervisor.pilot_deflection
        steers = any(demand.nu) or any(demand.overridden)
        if steers:
            target.stop_carrying()
        if steers and sources.course.moves:
            sources.course.suspend()
            target.now = Setpoint(sources.standing(here))
        if demand.sticks is not None:
            sources.angles.turn(demand.sticks.sticks, dt_s)
        if demand.hold and any(held.engaged):
            sources.hold_here(here)
        held.release(demand.overridden)
        now = here.frame.now
        before = now.setpoint_outside(target.now)
        heading, x_d = now.heading_outside(psi), now.outside(here.reference.x_d)
        there, moved = sources.pilot.move(before, demand, heading, held.engaged, x_d, sources.bounds, dt_s)
        if there is not before:
            target.now = now.setpoint_inside(there)
        taken = either(moved, demand.overridden)
        target.ask_places(taken, UNSET)
        if sources.altitude is None or not taken[Z]:
            return False
        sources.altitude.take()
        return True

    def _keep_altitude(self, ground: Ground, dt_s: float) -> None:
        """Move the target's depth with the ground."""
        altitude, bounds, target = self.sources.altitude, self.sources.bounds, self.sources.target
        if altitude is None:
            return
        heave, least_m = bounds.config.heave, bounds.config.supervisor.min_altitude_m
        altitude.step(ground, target.now.eta_d[Z], least_m, heave.max_rate, heave.max_acceleration, dt_s)
        shallow_m, deep_m = bounds.fence.depth_m
        altitude.bound(max(shallow_m, 0.0), deep_m)
        target.move_depth(*altitude.target)

    def _follow_course(self, course: Course, state: VehicleState, here: Here, dt_s: float) -> None:
        """Move the target along the course; one that leads nowhere ends here."""
        try:
            self._step_course(course, state, here, dt_s)
        except (ArithmeticError, ValueError) as error:
            course.refused = f"it cannot be followed: {error}" if course.begun else str(error)
            course.done = True
            if course.begun:
                self.sources.target.now = Setpoint(self.sources.standing(here))

    def _step_course(self, course: Course, state: VehicleState, here: Here, dt_s: float) -> None:
        sources, held = self.sources, self.engaged[X] and self.engaged[Y]
        rests = course.wants_position and not held
        if not course.begun:
            if rests:
                return
            course.frame = here.frame.settled
            start = sources.standing_outside(here)
            sources.bounds.check(course, start)
            course.begin(start)
        first = X if held else Z
        behind_m = math.dist(state.eta_ahead[first:PSI], self.target.eta_d[first:PSI])
        if sources.altitude is not None:
            behind_m = max(behind_m, sources.altitude.lacks_m(state.ground))
        at = course.step(0.0 if rests else pace(here.reference.pace, behind_m), dt_s)
        if not all(map(math.isfinite, (*at.eta_d, *at.eta_d_dot, *at.eta_d_ddot))):
            raise ValueError("its numbers are not finite")
        sources.target.now = course.frame.setpoint_inside(at)
