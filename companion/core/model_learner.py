"""What is found of the vehicle in all four axes (`vehicle_model.py`), and the observers for the model in use.

Surge, sway, heave and yaw are learnt from x, y, z and psi: surge and sway share x and y by the heading. Log
gain and lag of a degree of freedom are those of its axes by cos² and sin² of the heading. All thrusters have
the lag that heave shows, which moves most: with a lag of its own each, an axis in a limit cycle may take a
strong vehicle for a late one.
"""

import math
from typing import NamedTuple

from companion.core import vehicle_model
from companion.core.four import Four, each, each_of_two
from companion.core.observer import (
    ByInterval,
    ObserverParameters,
    ObserverTable,
    Push,
    Sample,
    scheduled_parameters,
)
from companion.core.positioning import Jacobian
from companion.core.vehicle_model import (
    NO_EVIDENCE,
    Evidence,
    Found,
    ModelState,
    Theta,
)
from companion.records import PSI, Flags, Vector, VehicleModel, X, Y, Z, vector

REPORT_TICKS = 10
"""Ticks between two reports of what was found: no control uses them."""

SURE_OF_LESS = (2.5, 2.5, 3.5, 1.5)
"""Standard deviations from which on surge, sway, heave and yaw count as answering less: more would be
asked of them. Waves look like a vehicle that answers less, in heave by a quarter (decision 49)."""

NEAR_LOG_GAIN, NEAR_LAG_S = 0.02, 0.002
"""Observers are looked up again where the model has moved further."""


class Tables(NamedTuple):
    """Observers of one degree of freedom by gain and lag: those of the control, and the one in here."""

    control: Four[ObserverTable]
    """For each of `observer.INTERVALS`."""
    here: ObserverTable


class LookedUp(NamedTuple):
    """Both observers' parameters of one degree of freedom, and the model for which they were looked up."""

    at: Theta
    control: ByInterval
    here: ObserverParameters


class Schedule(NamedTuple):
    """The model in use by degree of freedom, and the observers for it."""

    used: Four[Theta]
    """By axis: of these it was made."""
    squares: tuple[float, float]
    """cos² and sin² of the heading."""
    gain: Vector
    dofs: Four[LookedUp]


class Shown(NamedTuple):
    """What one degree of freedom shows in a tick: the nominal vehicle's push, and what was measured then."""

    push: Push
    """Of no time where nothing is to be learnt."""
    sample: Sample


class LearnerMemory(NamedTuple):
    """What is remembered: `found` and `used` by axis, the rest by degree of freedom."""

    found: Four[Found]
    used: Four[Theta]
    states: Four[ModelState]
    schedule: Schedule
    ticks: int
    model: VehicleModel


def start(tables: Four[Tables], lag_s: float) -> LearnerMemory:
    """Return the nominal vehicle, whose thrusters lag by `lag_s`, of which nothing was found."""
    nominal = Theta(0.0, lag_s)
    nothing, state = Found(nominal, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), vehicle_model.start(0.0)
    found, used = (nothing, nothing, nothing, nothing), (nominal, nominal, nominal, nominal)
    return LearnerMemory(
        found=found,
        used=used,
        states=(state, state, state, state),
        schedule=looked_up(tables, used, (1.0, 0.0)),
        ticks=0,
        model=_model(found, used, used),
    )


def place_forgotten(memory: LearnerMemory, lag_s: float) -> LearnerMemory:
    """Use the nominal vehicle's surge and sway again, whose thrusters lag by `lag_s`."""
    nominal = Theta(0.0, lag_s)
    nothing = Found(nominal, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    _, _, heave, yaw = memory.found
    _, _, of_heave, of_yaw = memory.used
    return memory._replace(found=(nothing, nothing, heave, yaw), used=(nominal, nominal, of_heave, of_yaw))


def begun(memory: LearnerMemory, positions: Vector) -> LearnerMemory:
    """Observe degrees of freedom from known places, where they are not NaN; what was found stays."""
    return memory._replace(states=each_of_two(_begun, memory.states, positions))


def _begun(state: ModelState, position: float) -> ModelState:
    return state if math.isnan(position) else vehicle_model.start(position, state.measured)


def looked_up(tables: Four[Tables], used: Four[Theta], squares: tuple[float, float]) -> Schedule:
    """Return the observers for the model in use."""
    at = by_dof(used, squares)
    return Schedule(
        used=used,
        squares=squares,
        gain=_gains(at),
        dofs=each_of_two(_looked_up, tables, at),
    )


def turned(tables: Four[Tables], memory: LearnerMemory, J: Jacobian) -> Schedule:
    """Return the schedule for the heading of this tick; observers are looked up where the model has moved."""
    old, used = memory.schedule, memory.used
    squares = (J.c * J.c, J.s * J.s)
    if not math.isfinite(squares[0]):
        return old
    if used == old.used and used[X] == used[Y]:  # else the model turns with the heading
        return Schedule(used=used, squares=squares, gain=old.gain, dofs=old.dofs)
    at = by_dof(used, squares)
    return Schedule(
        used=used,
        squares=squares,
        gain=_gains(at),
        dofs=vector([_near(tables[dof], old.dofs[dof], at[dof]) for dof in range(4)]),
    )


def _near(tables: Tables, last: LookedUp, theta: Theta) -> LookedUp:
    """Return the observers that were looked up last as long as they are as good for this model."""
    off, off_s = abs(theta.log_gain - last.at.log_gain), abs(theta.lag_s - last.at.lag_s)
    return last if off <= NEAR_LOG_GAIN and off_s <= NEAR_LAG_S else _looked_up(tables, theta)


def _looked_up(tables: Tables, theta: Theta) -> LookedUp:
    log_gain, lag_s = theta
    return LookedUp(
        at=theta,
        control=each(scheduled_parameters, tables.control, log_gain, lag_s),
        here=scheduled_parameters(tables.here, log_gain, lag_s),
    )


def learnt(
    memory: LearnerMemory,
    schedule: Schedule,
    shown: Four[Shown],
    learns: Flags,
    adapts: bool,
    dt_s: float,
) -> LearnerMemory:
    """Learn from what all degrees of freedom show in this tick, axis by axis where `learns`."""
    squares = schedule.squares
    thetas = by_dof(vector([one.theta for one in memory.found]), squares)
    dofs, states = schedule.dofs, memory.states
    seen = vector([_seen(dofs[i].here, thetas[i], states[i], shown[i], i == PSI) for i in range(4)])
    found, used, ticks = list(memory.found), list(memory.used), memory.ticks + 1
    for axis in range(4):
        evidence = _of_axis(seen, squares, axis) if learns[axis] else NO_EVIDENCE
        if evidence.gain_gain > 0.0:
            if axis == Z:
                found[Z] = vehicle_model.learn(found[Z], evidence, dt_s)
            else:
                found[axis] = vehicle_model.learn_gain(found[axis], evidence, found[Z], dt_s)
            if adapts:
                used[axis] = vehicle_model.follow(used[axis], found[axis], SURE_OF_LESS[axis])
    model, now_found, now_used = memory.model, vector(found), vector(used)
    if now_used != schedule.used or used[X] != used[Y] or ticks % REPORT_TICKS == 0:
        model = _model(now_found, now_used, by_dof(now_used, squares))
    return LearnerMemory(
        found=now_found,
        used=now_used,
        states=vector([state for state, _ in seen]),
        schedule=schedule,
        ticks=ticks,
        model=model,
    )


def _seen(
    here: ObserverParameters, found: Theta, state: ModelState, shown: Shown, angular: bool
) -> tuple[ModelState, Evidence]:
    """Return what an observer of the vehicle that was found sees, and what that says of the vehicle."""
    if not shown.push.dt_s > 0.0:
        return state, NO_EVIDENCE
    return vehicle_model.observe(here, found, state, shown.push, shown.sample, angular)


def _of_axis(seen: Four[tuple[ModelState, Evidence]], squares: tuple[float, float], axis: int) -> Evidence:
    """Return the evidence of all degrees of freedom on one axis."""
    if axis in (Z, PSI):
        return seen[axis][1]
    cos, sin = squares if axis == X else (squares[1], squares[0])
    return vehicle_model.shared(seen[X][1], cos, seen[Y][1], sin)


def by_dof(thetas: Four[Theta], squares: tuple[float, float]) -> Four[Theta]:
    """Return the model of each degree of freedom, from those of the axes."""
    surge, sway, heave, yaw = thetas
    cos, sin = squares
    x = Theta(log_gain=cos * surge.log_gain + sin * sway.log_gain, lag_s=cos * surge.lag_s + sin * sway.lag_s)
    y = Theta(log_gain=sin * surge.log_gain + cos * sway.log_gain, lag_s=sin * surge.lag_s + cos * sway.lag_s)
    return (x, y, heave, yaw)


def _gains(thetas: Four[Theta]) -> Vector:
    return vector([math.exp(theta.log_gain) for theta in thetas])


def _model(found: Four[Found], used: Four[Theta], at: Four[Theta]) -> VehicleModel:
    """Return what is in use, by axis and by degree of freedom (`at`), and what was found, as a record."""
    thetas, doubts = vector([one.theta for one in found]), each(vehicle_model.doubt, found)
    return VehicleModel(
        gain=_gains(used),
        lag_s=vector([theta.lag_s for theta in used]),
        found_gain=_gains(thetas),
        found_lag_s=vector([theta.lag_s for theta in thetas]),
        log_gain_doubt=vector([gain for gain, _ in doubts]),
        lag_doubt_s=vector([lag for _, lag in doubts]),
        dof_gain=_gains(at),
    )
