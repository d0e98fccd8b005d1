"""The motion of all degrees of freedom: samples and commands in, where they are now and `ahead_s` later out.

An observer for each is brought on to its newest samples, under the thrust that was in force, and predicts
from there through the commands that are still under way.
"""

import math
from typing import NamedTuple

from companion.core import command_history, hidden_delay, model_learner, observer, predictor
from companion.core.bounds import clamped, wrap
from companion.core.command_history import SentCommand
from companion.core.four import Four, each, each_of_two
from companion.core.hidden_delay import HiddenDelayState
from companion.core.model_learner import LearnerMemory, Schedule, Shown, Tables
from companion.core.observer import ByInterval, ObserverParameters, ObserverState, Push, Sample
from companion.core.oscillation import mean_disturbance, scaled_disturbance
from companion.core.positioning import (
    Jacobian,
    Model,
    coriolis_and_damping,
    drag_coefficient,
    inertia,
    jacobian,
    to_body,
)
from companion.core.predictor import Predicted
from companion.records import PSI, Flags, Vector, X, Y, Z, vector

PREDICTION_STEP_S = 0.035
"""Largest step of the prediction, far below the thrusters' lag (0.15 s)."""

SHORTEST_S = 1e-9

MAX_GAP_S = 0.5
"""Over a longer gap rates tell nothing: the first sample after it starts again."""

BELIEVABLE = 1e9
"""m, m/s, N or N·m: an estimate that is larger has diverged, for telemetry is bounded where it is decoded. It
counts as NaN, so that nothing computed from an estimate overflows: `**` would raise."""

MAX_EXTRAPOLATION_S = (0.06, 0.06, 0.045, 0.03)
"""How far, s, samples of each DOF are extrapolated to the observer's moment by its own rates. Further, its
error would feed itself: with the shipped noises it grows from 0.06 s on, in yaw from 0.035 s."""


Timed = tuple[float, float]
"""The newest value of a tick, NaN where none came, and when it was true."""


class Observers(NamedTuple):
    """What is known of the vehicle and its sensors beforehand."""

    model: Model
    tables: Four[Tables]
    hidden: ObserverParameters
    hidden_s: float
    """Hidden delay that is known beforehand."""
    lag_s: float
    """Lag of the nominal thrusters."""
    adapts: bool
    """Whether what is found of the vehicle is used."""
    sensor_delay_s: Vector
    tick_s: float
    predictors: Four[predictor.Parameters]
    d_lag_s: Vector
    """Lag of the observer's d for the nominal vehicle."""


class Feedback(NamedTuple):
    """What the controller makes of d, and how its references move where the command acts."""

    d_share: Vector
    """Factor on d̂; the d of the prediction has the same."""
    rates: Vector
    accelerations: Vector
    saturated: Flags


NO_FEEDBACK = Feedback(
    d_share=(1.0, 1.0, 1.0, 1.0),
    rates=(0.0, 0.0, 0.0, 0.0),
    accelerations=(0.0, 0.0, 0.0, 0.0),
    saturated=(False, False, False, False),
)


class DofMemory(NamedTuple):
    """What is remembered of one degree of freedom."""

    state: ObserverState
    observed_s: float
    """The time of `state`; −∞ before the first."""
    mean_d: float
    since: tuple[float, float]
    """Ticks since position and rate were measured."""
    q: float
    """Where it was in the last tick."""
    predictor: predictor.State


class ObserversMemory(NamedTuple):
    """What is remembered."""

    dofs: Four[DofMemory]
    hidden: HiddenDelayState
    learner: LearnerMemory
    commands: list[SentCommand]


class Inputs(NamedTuple):
    """What a tick knows before it observes."""

    now_s: float
    positions: Four[Timed]
    rates: Four[Timed]
    begins: Vector
    """Where a degree of freedom begins again: not measured for long, or from another zero; else NaN."""
    stale: Flags
    telemetry_s: float
    command_s: float
    ahead_s: float
    positioned: bool
    """Whether there ever was a horizontal position."""
    learns: Flags
    """By axis, whether our commands alone move it: then its gain and lag are learnt."""
    attitude: tuple[float, float, float, float, float]
    """Roll, pitch (rad) and p, q, r (rad/s), as they were measured last."""
    voltage_v: float


class Outlook(NamedTuple):
    """What the observers expect of the samples of a tick."""

    depth_m: float
    sink_mps: float
    hidden_s: float
    believable: bool
    """Whether all estimates are finite, and have not diverged."""


class Estimates(NamedTuple):
    """Pose and rate now, both `ahead_s` later, the disturbance, and the newest innovation; NED, ψ wrapped."""

    eta: Vector
    eta_dot: Vector
    ahead_s: float
    """Time until a command that is sent now acts."""
    eta_ahead: Vector
    eta_dot_ahead: Vector
    disturbance: Vector
    predicted: Four[Predicted]
    """What the disturbance rises until the command acts."""
    innovation: Vector
    delay_s: float
    """Delay of the whole loop."""
    gain: Vector
    """Of the vehicle, by degree of freedom."""


class Now(NamedTuple):
    """What all degrees of freedom share in a tick: m, c and k + h (NED), and the times of their observers."""

    m: Vector
    c: Vector
    forces: Vector
    from_s: Vector
    to_s: Vector
    steps: int
    """Number of steps of the prediction."""


class Moving(NamedTuple):
    """Where one degree of freedom is now and ahead, its disturbance, and its newest innovation."""

    q: float
    q_dot: float
    q_ahead: float
    q_dot_ahead: float
    disturbance: float
    predicted: Predicted
    innovation: float


NO_PUSH = Push(0.0, 1.0, 0.0, 0.0, 0.0)
NOTHING_SHOWN = Shown(push=NO_PUSH, sample=Sample(math.nan, math.nan))


def start(observers: Observers) -> ObserversMemory:
    """Begin: motion and vehicle are unknown, nothing was sent."""
    hidden = hidden_delay.start(0.0, observers.hidden_s)
    return ObserversMemory(
        dofs=each(_unknown, each(predictor.start, observers.predictors)),
        hidden=hidden,
        learner=model_learner.start(observers.tables, observers.lag_s),
        commands=command_history.start(),
    )


def outlook(memory: ObserversMemory) -> Outlook:
    """Return what the next samples should show."""
    depth_m, sink_mps = observer.expected(memory.dofs[Z].state)
    believable = all(map(is_believable, [dof.state for dof in memory.dofs]))
    return Outlook(depth_m, sink_mps, memory.hidden.hidden_s, believable)


def restarted(memory: ObserversMemory) -> ObserversMemory:
    """Forget motion and commands; what was found of vehicle, delay and disturbance stays."""
    x, y, z, psi = memory.dofs
    return ObserversMemory(
        dofs=each(_unknown, (x.predictor, y.predictor, z.predictor, psi.predictor)),
        hidden=hidden_delay.start(0.0, memory.hidden.hidden_s),
        learner=model_learner.begun(memory.learner, (0.0, 0.0, 0.0, 0.0)),
        commands=command_history.start(),
    )


def _unknown(predicting: predictor.State) -> DofMemory:
    """Return what is remembered of one whose place is not known."""
    return _stays(0.0, observer.at_rest(0.0), -math.inf, 0.0, predictor.interrupted(predicting))


def step(
    observers: Observers, memory: ObserversMemory, inputs: Inputs, feedback: Feedback = NO_FEEDBACK
) -> tuple[ObserversMemory, Estimates]:
    """Bring each observer on to the newest measurements and predict from there to now and ahead.

    What is `stale` rests where it was.
    """
    memory = _rested(memory, inputs)
    J = jacobian(memory.dofs[PSI].state.q)
    schedule = model_learner.turned(observers.tables, memory.learner, J)
    now = _now(observers, memory, inputs, J)
    observed = [_observed(observers, memory, schedule, now, inputs, feedback, dof) for dof in range(4)]
    shown = vector([one for _, _, one in observed])
    learner = model_learner.learnt(
        memory.learner,
        schedule,
        shown,
        inputs.learns,
        observers.adapts,
        observers.tick_s,
    )
    return ObserversMemory(
        dofs=vector([one for one, _, _ in observed]),
        hidden=_hidden(observers, memory.hidden, shown[Z], schedule),
        learner=learner,
        commands=memory.commands,
    ), _estimates(
        [moving for _, moving, _ in observed],
        inputs.ahead_s,
        inputs.telemetry_s + inputs.command_s + memory.hidden.hidden_s,
        learner.model.dof_gain,
    )


def _rested(memory: ObserversMemory, inputs: Inputs) -> ObserversMemory:
    """Put at rest the degrees of freedom that begin again, and those that are stale."""
    begins, stale, dofs = inputs.begins, inputs.stale, memory.dofs
    places = vector([_place(dofs[dof], begins[dof], stale[dof]) for dof in range(4)])
    if math.isnan(places[X]) and math.isnan(places[Y]) and math.isnan(places[Z]) and math.isnan(places[PSI]):
        return memory
    hidden = memory.hidden
    if not math.isnan(begins[Z]):
        hidden = hidden_delay.start(begins[Z], hidden.hidden_s)
    learner = model_learner.begun(memory.learner, places)
    return memory._replace(dofs=each_of_two(_resting, dofs, places), hidden=hidden, learner=learner)


def _place(memory: DofMemory, begins: float, stale: bool) -> float:
    """Return where a degree of freedom begins again, or stays from now on; NaN where it does neither."""
    return begins if not stale else math.nan if memory.state == observer.at_rest(memory.q) else memory.q


def _resting(memory: DofMemory, position: float) -> DofMemory:
    """Return a degree of freedom at rest at a position; as it is where that is NaN."""
    return memory if math.isnan(position) else memory._replace(state=observer.at_rest(position))


def _now(observers: Observers, memory: ObserversMemory, inputs: Inputs, J: Jacobian) -> Now:
    """Return what all degrees of freedom share."""
    x, y, z, psi = memory.dofs
    nu = to_body(J, (x.state.v, y.state.v, z.state.v, psi.state.v))
    from_s = (x.observed_s, y.observed_s, z.observed_s, psi.observed_s)
    now_s, sensor_s = inputs.now_s, observers.sensor_delay_s
    newest_s = now_s - inputs.telemetry_s - 0.5 * observers.tick_s
    true_s = (
        newest_s - sensor_s[X],
        newest_s - sensor_s[Y],
        newest_s - sensor_s[Z] - memory.hidden.hidden_s,
        newest_s - sensor_s[PSI],
    )
    if true_s[Z] - from_s[Z] > MAX_GAP_S or from_s[Z] > now_s:
        from_s = true_s
    to_s = vector([min(max(from_s[dof], true_s[dof]), now_s) for dof in range(4)])
    longest_s = _to_go(now_s, inputs.ahead_s, min(to_s[X], to_s[Y], to_s[Z], to_s[PSI]))
    return Now(
        m=inertia(observers.model, J),
        c=drag_coefficient(observers.model, J, nu),
        forces=coriolis_and_damping(observers.model, J, nu),
        from_s=from_s,
        to_s=to_s,
        steps=max(1, math.ceil(longest_s / PREDICTION_STEP_S)),
    )


def _to_go(now_s: float, ahead_s: float, observed_s: float) -> float:
    return max(now_s - observed_s + ahead_s, 0.0)


def _observed(
    observers: Observers,
    memory: ObserversMemory,
    schedule: Schedule,
    now: Now,
    inputs: Inputs,
    feedback: Feedback,
    dof: int,
) -> tuple[DofMemory, Moving, Shown]:
    """Advance, correct and predict one degree of freedom."""
    was, from_s, to_s, tick_s = memory.dofs[dof], now.from_s[dof], now.to_s[dof], observers.tick_s
    if inputs.stale[dof]:
        mean_d = mean_disturbance(was.mean_d, 0.0, tick_s)
        rests = _stays(was.q, was.state, to_s, mean_d, predictor.interrupted(was.predictor))
        return rests, _still(was.q, 0.0, 0.0), NOTHING_SHOWN
    sent_s, step_s = inputs.command_s, _to_go(inputs.now_s, inputs.ahead_s, to_s) / now.steps
    thrusts, answered = command_history.mean_thrusts(
        memory.commands, dof, from_s - sent_s, to_s - sent_s, step_s, now.steps
    )
    push = Push(thrusts[0], now.m[dof], now.c[dof], to_s - from_s, thrusts[0] - answered)
    gain, control = schedule.gain[dof], schedule.dofs[dof].control
    state, since, innovation, shown = _corrected(control, was, push, gain, inputs, to_s, dof)
    if not is_believable(state):
        shown = Shown(push=NO_PUSH, sample=shown.sample)
        mean_d, moving = was.mean_d, _still(math.nan, math.nan, innovation)
        predicting = predictor.interrupted(was.predictor)
    else:
        mean_d = mean_disturbance(was.mean_d, state.d, tick_s)
        model = observer.coefficients(push, gain, control[0].thrust_lag_s, step_s)
        to_go_s = step_s * now.steps
        horizon_s = observers.d_lag_s[dof] + to_go_s + control[0].thrust_lag_s
        predicting = _predicting(observers, was.predictor, inputs, feedback, dof, state.d, horizon_s)
        predicted = predicting.predicted
        meanwhile = predicted.rise * ((observers.d_lag_s[dof] + 0.5 * to_go_s) / horizon_s)
        d_hat = scaled_disturbance(mean_d, state.d + meanwhile, feedback.d_share[dof])
        trajectory = observer.predict(model, state, thrusts[1:], d_hat)
        q, q_dot = interpolate(trajectory, (inputs.now_s - to_s) / max(step_s, SHORTEST_S))
        # What of k + h the observer's diagonal drag leaves out it takes for disturbance.
        left_out = now.forces[dof] / gain - push.c / gain * state.v if inputs.positioned else 0.0
        q_ahead, q_dot_ahead, _ = trajectory[-1]
        moving = Moving(q, q_dot, q_ahead, q_dot_ahead, state.d - left_out, predicted, innovation)
    return DofMemory(state, to_s, mean_d, since, moving.q, predicting), moving, shown


def _predicting(
    observers: Observers,
    state: predictor.State,
    inputs: Inputs,
    feedback: Feedback,
    dof: int,
    d: float,
    horizon_s: float,
) -> predictor.State:
    """Predict d where our commands alone move the vehicle, and are not cut off: there d is the water's."""
    free = inputs.learns[dof] and (dof > Y or (inputs.learns[X] and inputs.learns[Y]))
    if not free or feedback.saturated[dof]:
        return predictor.interrupted(state)
    rate, acceleration = feedback.rates[dof], feedback.accelerations[dof]
    return predictor.step(observers.predictors[dof], state, d, rate, acceleration, horizon_s)


def _corrected(
    control: ByInterval, was: DofMemory, push: Push, gain: float, inputs: Inputs, to_s: float, dof: int
) -> tuple[ObserverState, tuple[float, float], float, Shown]:
    """Advance under the thrust that was in force; take in the samples, extrapolated to that moment.

    Return the observer, the ticks since position and rate were measured, the innovation, and what is shown.
    """
    state = observer.advance(control[0], was.state, push, gain)
    (measured, measured_s), (measured_rate, rate_s) = inputs.positions[dof], inputs.rates[dof]
    of_position, of_rate = was.since[0] + 1.0, was.since[1] + 1.0
    gains = observer.at_intervals(control, of_position, of_rate)
    (q_dot, v_dot), most_s = observer.rates(state, push, gain), MAX_EXTRAPOLATION_S[dof]
    sample = Sample(
        measured + q_dot * clamped(to_s - measured_s, -most_s, most_s),
        measured_rate + v_dot * clamped(to_s - rate_s, -most_s, most_s),
    )
    e_q, e_v = observer.innovation(state, sample, dof == PSI)
    since = (
        of_position if math.isnan(measured) else 0.0,
        of_rate if math.isnan(measured_rate) else 0.0,
    )
    shown = Shown(push, sample)
    return observer.correct(gains, state, e_q, e_v), since, e_q, shown


def _stays(
    q: float, state: ObserverState, to_s: float, mean_d: float, predicting: predictor.State
) -> DofMemory:
    """Return what is remembered of one that was not observed."""
    return DofMemory(state=state, observed_s=to_s, mean_d=mean_d, since=(0.0, 0.0), q=q, predictor=predicting)


def _still(q: float, rest: float, innovation: float) -> Moving:
    """Return one that stays at q; `rest` is its rates and its disturbance."""
    return Moving(q, rest, q, rest, rest, predictor.NOTHING, innovation)


def _hidden(
    observers: Observers, hidden: HiddenDelayState, shown: Shown, schedule: Schedule
) -> HiddenDelayState:
    """Look for hidden delay in what depth shows."""
    if not shown.push.dt_s > 0.0:
        return hidden
    gain, lag_s = schedule.gain[Z], schedule.dofs[Z].control[0].thrust_lag_s
    return hidden_delay.step(
        observers.hidden, hidden, shown.push, gain, lag_s, shown.sample, observers.hidden_s
    )


def _estimates(dofs: list[Moving], ahead_s: float, delay_s: float, gain: Vector) -> Estimates:
    x, y, z, psi = dofs
    return Estimates(
        eta=(x.q, y.q, z.q, wrap(psi.q)),
        eta_dot=(x.q_dot, y.q_dot, z.q_dot, psi.q_dot),
        ahead_s=ahead_s,
        eta_ahead=(x.q_ahead, y.q_ahead, z.q_ahead, wrap(psi.q_ahead)),
        eta_dot_ahead=(x.q_dot_ahead, y.q_dot_ahead, z.q_dot_ahead, psi.q_dot_ahead),
        disturbance=(x.disturbance, y.disturbance, z.disturbance, psi.disturbance),
        predicted=(x.predicted, y.predicted, z.predicted, psi.predicted),
        innovation=(x.innovation, y.innovation, z.innovation, psi.innovation),
        delay_s=delay_s,
        gain=gain,
    )


def is_believable(state: ObserverState) -> bool:
    """Tell whether an estimate is finite, and has not diverged."""
    return abs(state.q) + abs(state.v) + abs(state.f) + abs(state.d) < BELIEVABLE


def interpolate(trajectory: list[observer.Point], step_index: float) -> tuple[float, float]:
    """Return position and rate on a trajectory, `step_index` steps after its start."""
    i = min(max(int(step_index), 0), len(trajectory) - 2)
    (q_0, v_0, _), (q_1, v_1, _) = trajectory[i], trajectory[i + 1]
    share = step_index - i
    return q_0 + share * (q_1 - q_0), v_0 + share * (v_1 - v_0)


def sent(memory: ObserversMemory, t_s: float, tau_ned: Vector, d_hat: Vector) -> ObserversMemory:
    """Note the thrust (N, N·m) of a command that was sent at `t_s`; `d_hat` of it answers a disturbance."""
    return memory._replace(commands=command_history.appended(memory.commands, t_s, tau_ned, d_hat))


def without_thrust(memory: ObserversMemory, tau_ned: Vector) -> ObserversMemory:
    """Take from thrust and d what a motor that gives no thrust was believed to give, N and N·m.

    The commands on their way give it neither: in d alone it would be a step that is not there.
    """
    dofs = each_of_two(_without_thrust, memory.dofs, tau_ned)
    return memory._replace(dofs=dofs, commands=command_history.without_thrust(memory.commands, tau_ned))


def _without_thrust(memory: DofMemory, lost: float) -> DofMemory:
    state = memory.state._replace(f=memory.state.f - lost, d=memory.state.d - lost)
    predicting = predictor.without_thrust(memory.predictor, lost)
    return memory._replace(state=state, mean_d=memory.mean_d - lost, predictor=predicting)


def undisturbed(memory: ObserversMemory) -> ObserversMemory:
    """Forget d: what drove the vehicle was a motor that pushes the other way."""
    return memory._replace(dofs=each(_undisturbed, memory.dofs))


def _undisturbed(memory: DofMemory) -> DofMemory:
    predicting = predictor.interrupted(memory.predictor)
    return memory._replace(state=memory.state._replace(d=0.0), mean_d=0.0, predictor=predicting)


def retuned(observers: Observers, memory: ObserversMemory) -> ObserversMemory:
    """Go on from the present estimate with another model, other noises and sensor delays."""
    learner, old = memory.learner, memory.learner.schedule
    schedule = model_learner.looked_up(observers.tables, learner.used, old.squares)
    return memory._replace(learner=learner._replace(schedule=schedule))


def forgotten(observers: Observers, memory: ObserversMemory) -> ObserversMemory:
    """Use the nominal vehicle again."""
    return memory._replace(learner=model_learner.start(observers.tables, observers.lag_s))


def place_forgotten(observers: Observers, memory: ObserversMemory) -> ObserversMemory:
    """Use the nominal vehicle's surge and sway again: with a wrong heading they were found wrong."""
    return memory._replace(learner=model_learner.place_forgotten(memory.learner, observers.lag_s))
