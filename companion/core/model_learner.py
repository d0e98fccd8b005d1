"""What is found of the vehicle in all four axes (`vehicle_model.py`), and the model that is in use.

Surge, sway, heave and yaw are learnt from x, y, z and psi: surge and sway share x and y by the heading. Log
gain and lag of a degree of freedom are those of its axes by cos² and sin² of the heading. All thrusters have
the lag that heave shows, which moves most: with a lag of its own each, an axis in a limit cycle may take a
strong vehicle for a late one.
"""

import math
from typing import NamedTuple

from companion.core import vehicle_model
from companion.core.observer import ObserverParameters
from companion.core.positioning import Jacobian
from companion.core.vehicle_model import Evidence, Found, ModelState, Scheduled, Tables, Used
from companion.records import PSI, Flags, Vector, VehicleModel, X, Y, Z

REPORT_TICKS = 10
"""What was found is reported every so many ticks: nothing steers by it."""

FourTables = tuple[Tables, Tables, Tables, Tables]
FourFound = tuple[Found, Found, Found, Found]
FourUsed = tuple[Used, Used, Used, Used]
FourScheduled = tuple[Scheduled, Scheduled, Scheduled, Scheduled]


class Seen(NamedTuple):
    """What one degree of freedom has shown in this tick."""

    state: ModelState
    evidence: Evidence


class LearnerMemory(NamedTuple):
    """What is remembered: `found` and `used` by axis, the rest by degree of freedom."""

    found: FourFound
    used: FourUsed
    states: tuple[ModelState, ModelState, ModelState, ModelState]
    scheduled: FourScheduled
    dof_gain: Vector
    squares: tuple[float, float]
    """cos² and sin² of the heading."""
    ticks: int
    moved: bool
    """Whether the model in use has moved since observers were looked up."""
    model: VehicleModel


def start(tables: FourTables, lag_s: float) -> LearnerMemory:
    """Return the nominal vehicle, whose thrusters lag by `lag_s`, of which nothing was found."""
    nothing, nominal = vehicle_model.nothing_found(lag_s), Used(0.0, lag_s)
    found, used = (nothing, nothing, nothing, nothing), (nominal, nominal, nominal, nominal)
    state = vehicle_model.start(0.0)
    squares = (1.0, 0.0)
    return LearnerMemory(
        found,
        used,
        (state, state, state, state),
        _schedules(tables, used),
        (1.0, 1.0, 1.0, 1.0),
        squares,
        0,
        False,
        _model(found, used, used, lag_s, lag_s),
    )


def begun(memory: LearnerMemory, where: Flags, position: Vector) -> LearnerMemory:
    """Observe degrees of freedom from known places; what was found stays."""
    x, y, z, psi = memory.states
    return _with_states(
        memory,
        (
            vehicle_model.start(position[X], x.measured) if where[X] else x,
            vehicle_model.start(position[Y], y.measured) if where[Y] else y,
            vehicle_model.start(position[Z], z.measured) if where[Z] else z,
            vehicle_model.start(position[PSI], psi.measured) if where[PSI] else psi,
        ),
    )


def turned(tables: FourTables, memory: LearnerMemory, J: Jacobian) -> LearnerMemory:
    """Take the heading of this tick, and look observers up where the model has moved."""
    squares = (J.c * J.c, J.s * J.s)
    if not math.isfinite(squares[0]):
        return memory
    if not memory.moved and _same(memory.used[X], memory.used[Y]):  # else the model turns with the heading
        return _looked_up(memory, squares, memory.scheduled, memory.dof_gain, False)
    used = _by_dof(memory.used, squares)
    x, y, z, psi = memory.scheduled
    scheduled = (
        x if vehicle_model.is_near(x, used[X]) else vehicle_model.schedule(tables[X], used[X]),
        y if vehicle_model.is_near(y, used[Y]) else vehicle_model.schedule(tables[Y], used[Y]),
        z if vehicle_model.is_near(z, used[Z]) else vehicle_model.schedule(tables[Z], used[Z]),
        psi if vehicle_model.is_near(psi, used[PSI]) else vehicle_model.schedule(tables[PSI], used[PSI]),
    )
    return _looked_up(memory, squares, scheduled, _gains(used), False)


def looked_up(tables: FourTables, memory: LearnerMemory) -> LearnerMemory:
    """Go on with other tables."""
    used = _by_dof(memory.used, memory.squares)
    return _looked_up(memory, memory.squares, _schedules(tables, used), _gains(used), False)


def seen_by(
    here: ObserverParameters,
    found: Used,
    state: ModelState,
    u: float,
    m: float,
    c: float,
    dt_s: float,
    position: float,
    rate: float,
    angular: bool,
) -> Seen:
    """Return what an observer of the vehicle that was found has seen."""
    g = math.exp(found.log_gain)
    parameters = ObserverParameters(found.lag_s, here.slow_time_s, here.by_position, here.by_rate)
    state, evidence = vehicle_model.observe(parameters, state, u, m / g, c / g, dt_s, position, rate, angular)
    return Seen(state, evidence)


def learnt(
    memory: LearnerMemory,
    seen: tuple[Seen, Seen, Seen, Seen],
    learns: Flags,
    adapts: bool,
    nominal_lag_s: float,
    dt_s: float,
) -> LearnerMemory:
    """Learn from what all degrees of freedom have shown in this tick, axis by axis where `learns`."""
    cos, sin = memory.squares
    x, y, z, psi = seen
    surge, sway, heave, yaw = memory.found
    of_surge = vehicle_model.mixed(x.evidence, cos, y.evidence, sin)
    of_sway = vehicle_model.mixed(x.evidence, sin, y.evidence, cos)
    learns_surge = learns[X] and of_surge.gain_gain > 0.0
    learns_sway = learns[Y] and of_sway.gain_gain > 0.0
    learns_heave = learns[Z] and z.evidence.gain_gain > 0.0
    learns_yaw = learns[PSI] and psi.evidence.gain_gain > 0.0
    if learns_surge:
        surge = vehicle_model.learn_gain(surge, of_surge, heave, dt_s)
    if learns_sway:
        sway = vehicle_model.learn_gain(sway, of_sway, heave, dt_s)
    if learns_heave:
        heave = vehicle_model.learn(heave, z.evidence, dt_s)
    if learns_yaw:
        yaw = vehicle_model.learn_gain(yaw, psi.evidence, heave, dt_s)
    found, before = (surge, sway, heave, yaw), memory.used
    used = (
        vehicle_model.follow(before[X], surge) if adapts and learns_surge else before[X],
        vehicle_model.follow(before[Y], sway) if adapts and learns_sway else before[Y],
        vehicle_model.follow(before[Z], heave) if adapts and learns_heave else before[Z],
        vehicle_model.follow(before[PSI], yaw) if adapts and learns_yaw else before[PSI],
    )
    ticks = memory.ticks + 1
    stays = _same(used[X], before[X]) and _same(used[Y], before[Y])
    stays = stays and _same(used[Z], before[Z]) and _same(used[PSI], before[PSI])
    moved = memory.moved or not stays
    model = memory.model
    if moved or not _same(used[X], used[Y]) or ticks % REPORT_TICKS == 0:
        longest_s = vehicle_model.longest_lag_s(heave) if adapts else nominal_lag_s
        model = _model(found, used, _by_dof(used, memory.squares), nominal_lag_s, longest_s)
    return LearnerMemory(
        found,
        used,
        (x.state, y.state, z.state, psi.state),
        memory.scheduled,
        memory.dof_gain,
        memory.squares,
        ticks,
        moved,
        model,
    )


def _same(first: Used, second: Used) -> bool:
    return first.log_gain == second.log_gain and first.lag_s == second.lag_s


def found_of(memory: LearnerMemory, dof: int) -> Used:
    """Return what was found of a degree of freedom."""
    one = memory.found[dof]
    if dof in (Z, PSI):
        return Used(one.log_gain, one.lag_s)
    surge, sway = memory.found[X], memory.found[Y]
    return _mixed(
        Used(surge.log_gain, surge.lag_s), Used(sway.log_gain, sway.lag_s), memory.squares, dof == X
    )


def _by_dof(used: FourUsed, squares: tuple[float, float]) -> FourUsed:
    surge, sway, heave, yaw = used
    return (_mixed(surge, sway, squares, True), _mixed(surge, sway, squares, False), heave, yaw)


def _mixed(surge: Used, sway: Used, squares: tuple[float, float], is_x: bool) -> Used:
    cos, sin = squares if is_x else (squares[1], squares[0])
    return Used(
        cos * surge.log_gain + sin * sway.log_gain,
        cos * surge.lag_s + sin * sway.lag_s,
    )


def _schedules(tables: FourTables, used: FourUsed) -> FourScheduled:
    return (
        vehicle_model.schedule(tables[X], used[X]),
        vehicle_model.schedule(tables[Y], used[Y]),
        vehicle_model.schedule(tables[Z], used[Z]),
        vehicle_model.schedule(tables[PSI], used[PSI]),
    )


def _gains(used: FourUsed) -> Vector:
    return (
        math.exp(used[X].log_gain),
        math.exp(used[Y].log_gain),
        math.exp(used[Z].log_gain),
        math.exp(used[PSI].log_gain),
    )


def _model(
    found: FourFound, used: FourUsed, by_dof: FourUsed, nominal_lag_s: float, longest_lag_s: float
) -> VehicleModel:
    """Return what is in use and what was found, as a record."""
    (gain_x, lag_x), (gain_y, lag_y) = vehicle_model.doubt(found[X]), vehicle_model.doubt(found[Y])
    (gain_z, lag_z), (gain_psi, lag_psi) = vehicle_model.doubt(found[Z]), vehicle_model.doubt(found[PSI])
    return VehicleModel(
        _gains(used),
        (used[X].lag_s, used[Y].lag_s, used[Z].lag_s, used[PSI].lag_s),
        (
            math.exp(found[X].log_gain),
            math.exp(found[Y].log_gain),
            math.exp(found[Z].log_gain),
            math.exp(found[PSI].log_gain),
        ),
        (found[X].lag_s, found[Y].lag_s, found[Z].lag_s, found[PSI].lag_s),
        (gain_x, gain_y, gain_z, gain_psi),
        (lag_x, lag_y, lag_z, lag_psi),
        _gains(by_dof),
        (
            vehicle_model.later_s(by_dof[X], nominal_lag_s),
            vehicle_model.later_s(by_dof[Y], nominal_lag_s),
            vehicle_model.later_s(by_dof[Z], nominal_lag_s),
            vehicle_model.later_s(by_dof[PSI], nominal_lag_s),
        ),
        longest_lag_s,
    )


def _with_states(
    memory: LearnerMemory, states: tuple[ModelState, ModelState, ModelState, ModelState]
) -> LearnerMemory:
    return LearnerMemory(
        memory.found,
        memory.used,
        states,
        memory.scheduled,
        memory.dof_gain,
        memory.squares,
        memory.ticks,
        memory.moved,
        memory.model,
    )


def _looked_up(
    memory: LearnerMemory,
    squares: tuple[float, float],
    scheduled: FourScheduled,
    dof_gain: Vector,
    moved: bool,
) -> LearnerMemory:
    return LearnerMemory(
        memory.found,
        memory.used,
        memory.states,
        scheduled,
        dof_gain,
        squares,
        memory.ticks,
        moved,
        memory.model,
    )
