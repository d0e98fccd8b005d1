"""The motion of all degrees of freedom: samples and commands in, where they are now and `ahead_s` later out.

An observer for each is brought on to its newest samples, under the thrust that was in force, and predicts
from there through the commands that are still under way.
"""

import math
from typing import NamedTuple

from companion.core import command_history, hidden_delay, model_learner, observer, vehicle_model
from companion.core.bounds import clamped, wrap
from companion.core.command_history import SentCommand
from companion.core.hidden_delay import HiddenDelayState
from companion.core.model_learner import LearnerMemory, Seen
from companion.core.observer import ByInterval, ObserverParameters, ObserverState
from companion.core.oscillation import mean_disturbance, scaled_disturbance
from companion.core.positioning import (
    Model,
    coriolis_and_damping,
    drag_coefficient,
    inertia,
    jacobian,
    to_body,
)
from companion.core.vehicle_model import NO_EVIDENCE, ModelState, Tables, Used
from companion.records import PSI, ZERO, Flags, Vector, X, Y, Z

PREDICTION_STEP_S = 0.035
SHORTEST_S = 1e-9

MAX_GAP_S = 0.5
"""Over a longer gap rates tell nothing: the first sample after it starts again."""

ZERO_MOVED_M = 0.05
"""A disarmed vehicle whose depth jumps by more has a new zero, as arming makes one: that is no motion."""

BELIEVABLE = 1e9
"""m, m/s, N or N·m: an estimate that is larger has diverged, for telemetry is bounded where it is decoded. It
counts as NaN, so that nothing computed from an estimate overflows: `**` would raise."""

MAX_EXTRAPOLATION_S = (0.06, 0.06, 0.045, 0.03)
"""How far, s, samples of each DOF are extrapolated to the observer's moment by its own rates. Further, its
error would feed itself: with the shipped noises it grows from 0.06 s on, in yaw from 0.035 s."""


class Measured(NamedTuple):
    """The newest samples of one degree of freedom since the last tick, and when they were true; NaN: none."""

    position: float
    position_s: float
    rate: float
    rate_s: float


NOTHING = Measured(math.nan, math.nan, math.nan, math.nan)
FourMeasured = tuple[Measured, Measured, Measured, Measured]


class Interval(NamedTuple):
    """Ticks since position and rate of one degree of freedom were measured."""

    position: float
    rate: float


EACH_TICK = Interval(0.0, 0.0)
FourIntervals = tuple[Interval, Interval, Interval, Interval]


class Observers(NamedTuple):
    """What is known of the vehicle and its sensors beforehand."""

    model: Model
    tables: tuple[Tables, Tables, Tables, Tables]
    hidden: ObserverParameters
    finds_hidden: bool
    hidden_s: float
    """Hidden delay that is known beforehand."""
    lag_s: float
    """Of the nominal thrusters."""
    adapts: bool
    """Whether what is found of the vehicle is used."""
    sensor_delay_s: Vector
    tick_s: float


class ObserversMemory(NamedTuple):
    """What is remembered."""

    states: tuple[ObserverState, ObserverState, ObserverState, ObserverState]
    observed_s: Vector
    """When each was last observed; −∞ before the first time."""
    mean_d: Vector
    since: FourIntervals
    hidden: HiddenDelayState
    learner: LearnerMemory
    eta: Vector
    commands: list[SentCommand]


class Inputs(NamedTuple):
    """What a tick knows before it observes."""

    now_s: float
    measured: FourMeasured
    begins: Vector
    """Where a degree of freedom begins again, as it was not measured for long; NaN where it does not."""
    stale: Flags
    telemetry_s: float
    command_s: float
    ahead_s: float
    armed: bool
    positioned: bool
    """Whether there ever was a horizontal position."""
    learns: Flags
    """By axis, whether our commands alone move it: then its gain and lag are learnt."""
    attitude: tuple[float, float, float, float, float]
    """Roll, pitch (rad) and p, q, r (rad/s), as they were measured last."""
    voltage_v: float


class Motion(NamedTuple):
    """Pose and rate now, both `ahead_s` later, the disturbance, and the newest innovation; NED, ψ wrapped."""

    eta: Vector
    eta_dot: Vector
    eta_ahead: Vector
    eta_dot_ahead: Vector
    disturbance: Vector
    innovation: Vector


class Vehicle(NamedTuple):
    """What moves it, NED, from when to when it is observed, and in how many steps it is predicted."""

    m: Vector
    c: Vector
    forces: Vector
    from_s: Vector
    to_s: Vector
    steps: int


class Observing(NamedTuple):
    """One degree of freedom: its observers, what was found of it, and what is known from before."""

    control: ByInterval
    here: ObserverParameters
    found: Used
    gain: float
    m: float
    c: float
    force: float
    from_s: float
    to_s: float
    mean_d: float
    since: Interval
    q: float


class One(NamedTuple):
    """What observing one degree of freedom gives."""

    state: ObserverState
    hidden: HiddenDelayState
    innovation: float
    q: float
    q_dot: float
    q_ahead: float
    q_dot_ahead: float
    disturbance: float
    mean_d: float
    since: Interval


def start(observers: Observers) -> ObserversMemory:
    """Know nothing of motion and vehicle, and have sent nothing."""
    hidden = hidden_delay.start(0.0, observers.hidden_s)
    return restarted(hidden, model_learner.start(observers.tables, observers.lag_s))


def restarted(hidden: HiddenDelayState, learner: LearnerMemory) -> ObserversMemory:
    """Forget motion and commands; what was found of vehicle and delay stays."""
    rest = observer.at_rest(0.0)
    never = -math.inf
    return ObserversMemory(
        (rest, rest, rest, rest),
        (never, never, never, never),
        ZERO,
        (EACH_TICK, EACH_TICK, EACH_TICK, EACH_TICK),
        hidden_delay.start(0.0, hidden.hidden_s),
        model_learner.begun(learner, (True, True, True, True), ZERO),
        ZERO,
        command_history.start(),
    )


def step(
    observers: Observers, memory: ObserversMemory, inputs: Inputs, d_share: Vector = (1.0, 1.0, 1.0, 1.0)
) -> tuple[ObserversMemory, Motion]:
    """Bring each observer on to the newest measurements and predict from there to now and ahead.

    What is `stale` rests where it was. `d_share`, by DOF, is what the controller scales d̂ by: the predicted d
    is scaled by the same.
    """
    states, hidden, learner = _rested(memory, inputs)
    J = jacobian(states[PSI].q)
    nu = to_body(J, (states[X].v, states[Y].v, states[Z].v, states[PSI].v))
    m, c = inertia(observers.model, J), drag_coefficient(observers.model, J, nu)
    forces = coriolis_and_damping(observers.model, J, nu)
    learner = model_learner.turned(observers.tables, learner, J)

    from_s, to_s = _moments(observers, memory, inputs, hidden.hidden_s)
    oldest_s = min(to_s[X], to_s[Y], to_s[Z], to_s[PSI])
    steps = max(1, math.ceil(_to_go(inputs.now_s, inputs.ahead_s, oldest_s) / PREDICTION_STEP_S))
    vehicle = Vehicle(m, c, forces, from_s, to_s, steps)
    x, of_x = _one(observers, memory, learner, vehicle, inputs, X, states[X], hidden, d_share[X])
    y, of_y = _one(observers, memory, learner, vehicle, inputs, Y, states[Y], hidden, d_share[Y])
    z, of_z = _one(observers, memory, learner, vehicle, inputs, Z, states[Z], hidden, d_share[Z])
    psi, of_psi = _one(observers, memory, learner, vehicle, inputs, PSI, states[PSI], hidden, d_share[PSI])
    learner = model_learner.learnt(
        learner,
        (of_x, of_y, of_z, of_psi),
        inputs.learns,
        observers.adapts,
        observers.lag_s,
        observers.tick_s,
    )
    motion = Motion(
        (x.q, y.q, z.q, wrap(psi.q)),
        (x.q_dot, y.q_dot, z.q_dot, psi.q_dot),
        (x.q_ahead, y.q_ahead, z.q_ahead, wrap(psi.q_ahead)),
        (x.q_dot_ahead, y.q_dot_ahead, z.q_dot_ahead, psi.q_dot_ahead),
        (x.disturbance, y.disturbance, z.disturbance, psi.disturbance),
        (x.innovation, y.innovation, z.innovation, psi.innovation),
    )
    return ObserversMemory(
        (x.state, y.state, z.state, psi.state),
        to_s,
        (x.mean_d, y.mean_d, z.mean_d, psi.mean_d),
        (x.since, y.since, z.since, psi.since),
        z.hidden,
        learner,
        (x.q, y.q, z.q, psi.q),
        memory.commands,
    ), motion


def _rested(
    memory: ObserversMemory, inputs: Inputs
) -> tuple[
    tuple[ObserverState, ObserverState, ObserverState, ObserverState], HiddenDelayState, LearnerMemory
]:
    """Put at rest the degrees of freedom that begin again, and those that are stale."""
    begins, stale, eta = inputs.begins, inputs.stale, memory.eta
    x = eta[X] if stale[X] else begins[X]
    y = eta[Y] if stale[Y] else begins[Y]
    z = eta[Z] if stale[Z] else begins[Z]
    psi = eta[PSI] if stale[PSI] else begins[PSI]
    rests = (not math.isnan(x), not math.isnan(y), not math.isnan(z), not math.isnan(psi))
    if not (rests[X] or rests[Y] or rests[Z] or rests[PSI]):
        return memory.states, memory.hidden, memory.learner
    hidden = memory.hidden
    if not math.isnan(begins[Z]):
        hidden = hidden_delay.start(begins[Z], hidden.hidden_s)
    states = (
        observer.at_rest(x) if rests[X] else memory.states[X],
        observer.at_rest(y) if rests[Y] else memory.states[Y],
        observer.at_rest(z) if rests[Z] else memory.states[Z],
        observer.at_rest(psi) if rests[PSI] else memory.states[PSI],
    )
    return states, hidden, model_learner.begun(memory.learner, rests, (x, y, z, psi))


def _moments(
    observers: Observers, memory: ObserversMemory, inputs: Inputs, hidden_s: float
) -> tuple[Vector, Vector]:
    """Return when each DOF was last observed, and when its newest measurements were true."""
    now_s, sensor_s = inputs.now_s, observers.sensor_delay_s
    newest_s = now_s - inputs.telemetry_s - 0.5 * observers.tick_s
    to_s = (
        newest_s - sensor_s[X],
        newest_s - sensor_s[Y],
        newest_s - sensor_s[Z] - hidden_s,
        newest_s - sensor_s[PSI],
    )
    from_s = memory.observed_s
    if to_s[Z] - from_s[Z] > MAX_GAP_S or from_s[Z] > now_s:
        from_s = to_s
    observed_s = (
        min(max(from_s[X], to_s[X]), now_s),
        min(max(from_s[Y], to_s[Y]), now_s),
        min(max(from_s[Z], to_s[Z]), now_s),
        min(max(from_s[PSI], to_s[PSI]), now_s),
    )
    return from_s, observed_s


def _to_go(now_s: float, ahead_s: float, observed_s: float) -> float:
    return max(now_s - observed_s + ahead_s, 0.0)


def _one(
    observers: Observers,
    memory: ObserversMemory,
    learner: LearnerMemory,
    vehicle: Vehicle,
    inputs: Inputs,
    dof: int,
    state: ObserverState,
    hidden: HiddenDelayState,
    d_share: float,
) -> tuple[One, Seen]:
    """Bring one degree of freedom on to its newest measurements; predict from there."""
    scheduled = learner.scheduled[dof]
    at = Observing(
        scheduled.control,
        scheduled.here,
        model_learner.found_of(learner, dof),
        learner.dof_gain[dof],
        vehicle.m[dof],
        vehicle.c[dof],
        vehicle.forces[dof],
        vehicle.from_s[dof],
        vehicle.to_s[dof],
        memory.mean_d[dof],
        memory.since[dof],
        memory.eta[dof],
    )
    return _observed(
        at,
        inputs.measured[dof],
        inputs.stale[dof],
        learner.states[dof],
        state,
        hidden,
        observers.hidden,
        observers.finds_hidden,
        observers.tick_s,
        memory.commands,
        dof,
        inputs.now_s,
        inputs.command_s,
        inputs.ahead_s,
        inputs.armed,
        inputs.positioned,
        vehicle.steps,
        d_share,
    )


def _observed(
    at: Observing,
    sample: Measured,
    stale: bool,
    seen: ModelState,
    state: ObserverState,
    hidden: HiddenDelayState,
    of_hidden: ObserverParameters,
    finds_hidden: bool,
    tick_s: float,
    commands: list[SentCommand],
    dof: int,
    now_s: float,
    command_s: float,
    ahead_s: float,
    armed: bool,
    positioned: bool,
    steps: int,
    d_share: float,
) -> tuple[One, Seen]:
    """Bring one degree of freedom on under the thrust that was in force, correct it, and predict."""
    if stale:
        mean_d = mean_disturbance(at.mean_d, 0.0, tick_s)
        return One(state, hidden, 0.0, at.q, 0.0, at.q, 0.0, 0.0, mean_d, EACH_TICK), Seen(seen, NO_EVIDENCE)
    to_go_s = _to_go(now_s, ahead_s, at.to_s)
    step_s, since_s = to_go_s / steps, at.to_s - command_s
    thrusts = command_history.mean_thrusts(commands, dof, at.from_s - command_s, since_s, step_s, steps)
    thrust, dt_s = thrusts[0], at.to_s - at.from_s

    m_eff, c_eff = at.m / at.gain, at.c / at.gain
    state = observer.advance(at.control[0], state, thrust, m_eff, c_eff, dt_s)
    since = Interval(at.since.position + 1.0, at.since.rate + 1.0)
    gains = observer.at_intervals(at.control, since.position, since.rate)
    expected, rates = observer.expected(state), observer.rates(state, m_eff, c_eff)
    most_s = MAX_EXTRAPOLATION_S[dof]
    position, rate, missed, missed_rate = math.nan, math.nan, 0.0, 0.0
    if not math.isnan(sample.position):
        position = sample.position + rates[0] * clamped(at.to_s - sample.position_s, -most_s, most_s)
        missed = position - expected[0]
        if dof == PSI:
            missed = wrap(missed)
        elif dof == Z and abs(missed) > ZERO_MOVED_M and not armed:
            state = ObserverState(state.q + missed, state.v, state.f, state.d, state.s, state.p)
            hidden = hidden_delay.start(position, hidden.hidden_s)
            seen = vehicle_model.start(position, seen.measured)
            position, missed = math.nan, 0.0
    if not math.isnan(sample.rate):
        rate = sample.rate + rates[1] * clamped(at.to_s - sample.rate_s, -most_s, most_s)
        missed_rate = rate - expected[1]
    state = observer.correct(gains, state, missed, missed_rate)
    since = Interval(
        since.position if math.isnan(sample.position) else 0.0,
        since.rate if math.isnan(sample.rate) else 0.0,
    )
    if not is_believable(state):
        lost = math.nan
        return One(state, hidden, missed, lost, lost, lost, lost, lost, at.mean_d, since), Seen(
            seen, NO_EVIDENCE
        )
    evidence = NO_EVIDENCE
    if dt_s > 0.0:
        seen, evidence = model_learner.seen_by(
            at.here, at.found, seen, thrust, at.m, at.c, dt_s, position, rate, dof == PSI
        )
        if dof == Z and finds_hidden:
            hidden = hidden_delay.step(of_hidden, hidden, thrust, m_eff, c_eff, dt_s, position, rate)

    mean_d = mean_disturbance(at.mean_d, state.d, tick_s)
    model = observer.coefficients(at.control[0], m_eff, c_eff, step_s)
    d_hat = scaled_disturbance(mean_d, state.d, d_share)
    trajectory = observer.predict(model, state, thrusts[1:], d_hat)
    q, q_dot = interpolate(trajectory, (now_s - at.to_s) / max(step_s, SHORTEST_S))
    q_ahead, q_dot_ahead, _ = trajectory[-1]
    # What of k + h the observer's diagonal drag leaves out it takes for disturbance.
    left_out = at.force / at.gain - c_eff * state.v if positioned else 0.0
    one = One(state, hidden, missed, q, q_dot, q_ahead, q_dot_ahead, state.d - left_out, mean_d, since)
    return one, Seen(seen, evidence)


def is_believable(state: ObserverState) -> bool:
    """Tell whether an estimate is finite, and has not diverged."""
    return abs(state.q) + abs(state.v) + abs(state.f) + abs(state.d) < BELIEVABLE


def interpolate(trajectory: list[observer.Motion], step_index: float) -> tuple[float, float]:
    """Return position and rate on a trajectory, `step_index` steps after its start."""
    i = min(max(int(step_index), 0), len(trajectory) - 2)
    (q_0, v_0, _), (q_1, v_1, _) = trajectory[i], trajectory[i + 1]
    share = step_index - i
    return q_0 + share * (q_1 - q_0), v_0 + share * (v_1 - v_0)


def sent(memory: ObserversMemory, t_s: float, tau_ned: Vector) -> ObserversMemory:
    """Note the thrust (N, N·m) that a command gives which was sent at `t_s`."""
    return _with_commands(memory, command_history.appended(memory.commands, t_s, tau_ned))


def _with_commands(memory: ObserversMemory, commands: list[SentCommand]) -> ObserversMemory:
    return ObserversMemory(
        memory.states,
        memory.observed_s,
        memory.mean_d,
        memory.since,
        memory.hidden,
        memory.learner,
        memory.eta,
        commands,
    )


def without(memory: ObserversMemory, tau_ned: Vector) -> ObserversMemory:
    """Take from thrust and d what a motor that gives no thrust was believed to give, N and N·m.

    The commands on their way give it neither: in d alone it would be a step that is not there.
    """
    x, y, z, psi = memory.states
    mean_d = memory.mean_d
    return ObserversMemory(
        (
            observer.without(x, tau_ned[X]),
            observer.without(y, tau_ned[Y]),
            observer.without(z, tau_ned[Z]),
            observer.without(psi, tau_ned[PSI]),
        ),
        memory.observed_s,
        (
            mean_d[X] - tau_ned[X],
            mean_d[Y] - tau_ned[Y],
            mean_d[Z] - tau_ned[Z],
            mean_d[PSI] - tau_ned[PSI],
        ),
        memory.since,
        memory.hidden,
        memory.learner,
        memory.eta,
        command_history.without(memory.commands, tau_ned),
    )


def retuned(observers: Observers, memory: ObserversMemory) -> ObserversMemory:
    """Go on from the present estimate with another model, other noises and sensor delays."""
    return memory._replace(learner=model_learner.looked_up(observers.tables, memory.learner))


def forgotten(observers: Observers, memory: ObserversMemory) -> ObserversMemory:
    """Take the vehicle for the nominal one again."""
    return memory._replace(learner=model_learner.start(observers.tables, observers.lag_s))
