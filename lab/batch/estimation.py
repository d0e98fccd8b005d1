"""The estimator of one degree of freedom without MAVLink: observer, model, the commands that were sent."""

import math
from typing import NamedTuple

from companion.control.bounds import clamped, wrap
from companion.control.oscillation import mean_disturbance, scaled_disturbance
from companion.estimation import observer, vehicle_model
from companion.estimation.observer import ObserverParameters, ObserverState
from companion.estimation.vehicle_model import Found, ModelState, Scheduled, Used
from lab.batch.settings import Dof
from lab.batch.vehicle import TICK_S, Rows, Timing

HEAVE, YAW = 0, 1
"""Columns of the commanded thrusts; two further are their sums."""


class Observed(NamedTuple):
    """What the estimator remembers of a degree of freedom: when it was observed last counts in ticks."""

    state: ObserverState
    at: float
    mean_d: float
    model: ModelState
    found: Found
    used: Used
    scheduled: Scheduled


class Estimate(NamedTuple):
    """Position and rate of a degree of freedom when a command sent now acts, and its disturbance."""

    q: float
    v: float
    d: float


def first_observed(dof: Dof, position: float) -> Observed:
    """Observe the nominal vehicle from a known place."""
    nominal = Used(0.0, dof.lag_s)
    return Observed(
        observer.at_rest(position),
        math.inf,
        0.0,
        vehicle_model.start(position),
        vehicle_model.nothing_found(dof.lag_s),
        nominal,
        vehicle_model.schedule(dof.tables, nominal),
    )


def given(commands: Rows, column: int, tick: int, at: float) -> float:
    """Return what the commands gave until `at`, N·ticks: times count in ticks.

    The command of tick i is sent at i, and the newest is that before `tick`.
    """
    i = min(math.floor(at), tick - 1)
    if i < 0:
        return 0.0
    return float(commands[i, 2 + column] + commands[i, column] * (at - i))


def record(commands: Rows, tick: int, down: float, turn: float) -> None:
    """Write down what a command gives, and what all before it gave until then."""
    commands[tick, HEAVE], commands[tick, YAW] = down, turn
    if tick > 0:
        commands[tick, 2 + HEAVE] = commands[tick - 1, 2 + HEAVE] + commands[tick - 1, HEAVE]
        commands[tick, 2 + YAW] = commands[tick - 1, 2 + YAW] + commands[tick - 1, YAW]


def rescheduled(dof: Dof, before: Observed) -> Observed:
    """Look the observers up where the model has moved (`ModelLearner.turn`)."""
    if vehicle_model.is_near(before.scheduled, before.used):
        return before
    return Observed(
        before.state,
        before.at,
        before.mean_d,
        before.model,
        before.found,
        before.used,
        vehicle_model.schedule(dof.tables, before.used),
    )


def observe(
    at: Timing,
    dof: Dof,
    before: Observed,
    commands: Rows,
    column: int,
    tick: int,
    until: float,
    m: float,
    c: float,
    position: float,
    rate: float,
    adapts: bool,
    of_lag: Found,
) -> tuple[Observed, float, float, float, float]:
    """Bring an observer on to `until` and correct it (`Observers._observe`, `ModelLearner`).

    m and c are the nominal vehicle's; `of_lag` is what heave found of the lag.

    Return it, the thrust that was in force, for how long (s), and what was measured, brought to that moment.
    """
    command = at.command_s / TICK_S
    since = min(before.at, until)
    dt_s = (until - since) * TICK_S
    thrust = 0.0
    if until > since:
        thrust = given(commands, column, tick, until - command) - given(
            commands, column, tick, since - command
        )
        thrust /= until - since
    parameters, gain = before.scheduled.control, math.exp(before.used.log_gain)
    m_eff, c_eff = m / gain, c / gain
    state = observer.advance(parameters, before.state, thrust, m_eff, c_eff, dt_s)
    expected, rates = observer.expected(state), observer.rates(state, m_eff, c_eff)
    most_s = dof.max_extrapolation_s
    later_s = clamped(at.believed_age_s - at.telemetry_s - 0.5 * TICK_S, -most_s, most_s)
    position, rate = position + rates[0] * later_s, rate + rates[1] * later_s
    missed = position - expected[0]
    if dof.reference.angular:
        missed = wrap(missed)
    state = observer.correct(parameters, state, missed, rate - expected[1])
    mean_d = mean_disturbance(before.mean_d, state.d, TICK_S)
    model, found, used = before.model, before.found, before.used
    if adapts and dt_s > 0.0:
        g, here = math.exp(found.log_gain), before.scheduled.here
        slow = ObserverParameters(found.lag_s, here.slow_time_s, here.by_position, here.by_rate)
        model, evidence = vehicle_model.observe(
            slow, model, thrust, m / g, c / g, dt_s, position, rate, dof.reference.angular
        )
        if evidence.gain_gain > 0.0:
            if dof.reference.angular:
                found = vehicle_model.learn_gain(found, evidence, of_lag, TICK_S)
            else:
                found = vehicle_model.learn(found, evidence, TICK_S)
            used = vehicle_model.follow(used, found)
    now = Observed(state, until, mean_d, model, found, used, before.scheduled)
    return now, thrust, dt_s, position, rate


def predict(
    dof: Dof,
    now: Observed,
    used: Used,
    d_share: float,
    commands: Rows,
    column: int,
    tick: int,
    since: float,
    ahead_s: float,
    steps: int,
    m: float,
    c: float,
) -> Estimate:
    """Predict through the commands on their way, the first of which was sent at `since`, `ahead_s` on.

    `used` is the model of the tick before; m and c are the nominal vehicle's.
    """
    step_s, gain = ahead_s / steps, math.exp(used.log_gain)
    model = observer.coefficients(now.scheduled.control, m / gain, c / gain, step_s)
    d_hat = scaled_disturbance(now.mean_d, now.state.d, d_share)
    motion = (now.state.q, now.state.v, now.state.f)
    before = given(commands, column, tick, since)
    for k in range(steps):
        after = given(commands, column, tick, since + (k + 1) * (step_s / TICK_S))
        motion = observer.predict_step(model, motion, (after - before) * (TICK_S / step_s), d_hat)
        before = after
    return Estimate(motion[0], motion[1], now.state.d)


def less_disturbed(observed: Observed, lost: float) -> Observed:
    """Take from d what a motor was believed to give (`Observers.lose`)."""
    q, v, f, d, s, p = observed.state
    return Observed(
        ObserverState(q, v, f, d - lost, s, p),
        observed.at,
        observed.mean_d - lost,
        observed.model,
        observed.found,
        observed.used,
        observed.scheduled,
    )
