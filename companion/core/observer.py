"""The delay-compensating observer of one degree of freedom: position, rate, thrust and disturbance.

It lives in the past, at the moment its newest measurement was true, runs there on the commands that were then
in force, and predicts forward through the commands on their way. A Kalman filter with tabled gains on

    q' = v      v' = (f − c v − d)/m      f' = (u − f)/T      d' = 0      s' = −s/T_n      p' = −p/T_n

measured as q + s and v + p, where s and p are the slow noise that an EKF's depth and climb carry.

| symbol   | meaning                            | unit        | equation                                |
|----------|------------------------------------|-------------|-----------------------------------------|
| q, v     | position and rate (NED, heading)   | m, m/s; rad | q₁ = q + h/2 (v + v₁)                   |
|          |                                    |             | (m + h c) v₁ = m v + h/2 (f + f₁ − 2 d) |
| f, u     | thrust now, thrust commanded (NED) | N; N·m      | f₁ = u + (f − u) exp(−h/T)              |
| m, c     | inertia, drag coefficient          | kg, N/(m/s) | positioning.Model                       |
| d        | disturbance, the paper's sign      | N; N·m      | eq. rov: m ẍ = τ − k − h − d            |
| s, p     | slow noise of position and rate    | m, m/s; rad | s₁ = s exp(−h/T_n), p likewise          |
| h        | a step                             | s           |                                         |
| T, T_n   | thrust lag, time of the slow noise | s           |                                         |
| e_q, e_v | innovation: measured − expected    | m, m/s; rad | x₁ = x + K (e_q, e_v)ᵀ                  |
| K        | Kalman gain, a column each for     |             | Riccati equation, for the time since    |
|          | position and rate                  |             | each was measured last                  |
"""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from companion.core.bounds import clamped, wrap

INTERVALS = (1, 4, 12, 25)
"""Ticks between two measurements for which Kalman gains are computed. With the gain of one tick the observers
of heave and yaw diverge where the rate comes every tenth."""

Point = tuple[float, float, float]
"""q, v and f: a plain tuple, for it is made in every step of every prediction."""
StepCoefficients = tuple[float, float, float, float]
"""The model over one step: h/2, what is kept of f and of v, and what 2 N give v."""
Six = tuple[float, float, float, float, float, float]
"""What an ObserverState has, in its order."""
Pair = tuple[float, float]
"""Of position and rate."""


class ObserverState(NamedTuple):
    """What is estimated, as in the table above, in that order: one made by keywords takes twice as long."""

    q: float
    v: float
    f: float
    d: float
    s: float
    p: float


class Push(NamedTuple):
    """What moves the nominal vehicle over a step: mean commanded thrust, inertia, drag coefficient.

    `own` is the thrust less what of it answers a disturbance.
    """

    u: float
    m: float
    c: float
    dt_s: float
    own: float


class Sample(NamedTuple):
    """Position and rate as they were measured at the observer's time; NaN where they were not."""

    position: float
    rate: float


class ObserverParameters(NamedTuple):
    """T, T_n and the Kalman gain K by columns: what the state gains for an innovation of 1."""

    thrust_lag_s: float
    slow_time_s: float
    by_position: ObserverState
    by_rate: ObserverState


ByInterval = tuple[ObserverParameters, ObserverParameters, ObserverParameters, ObserverParameters]
"""One set of parameters for each of INTERVALS."""

FiveNodes = tuple[float, float, float, float, float]


class ObserverTable(NamedTuple):
    """Kalman gains over log g and thruster lag: a vehicle of gain g has m/g and c/g.

    A row holds K by columns; 5 i + j is the row of log gain i and lag j. The lab gives an array for them.
    """

    log_gains: FiveNodes
    lags_s: FiveNodes
    slow_time_s: float
    rows: Sequence[Sequence[float]]


def at_rest(position: float) -> ObserverState:
    """Return the state of one whose place is known and nothing else."""
    return ObserverState(position, 0.0, 0.0, 0.0, 0.0, 0.0)


def coefficients(push: Push, gain: float, lag_s: float, dt_s: float) -> StepCoefficients:
    """Return the model of a vehicle of this gain and lag over a step of `dt_s`, not below zero."""
    m, half_s = push.m / gain, 0.5 * dt_s
    damped = m + dt_s * (push.c / gain)
    return half_s, math.exp(dt_s / -lag_s), m / damped, half_s / damped


def predict_step(step: StepCoefficients, motion: Point, u: float, d: float) -> Point:
    """Return the motion one step later: exact in the thrust lag, implicit in the drag, else trapezoidal."""
    half_s, keep, coast, push = step
    q, v, f = motion
    f_next = u + (f - u) * keep
    v_next = coast * v + push * (f + f_next - 2.0 * d)
    return (q + half_s * (v + v_next), v_next, f_next)


def predict(step: StepCoefficients, state: ObserverState, thrusts: Iterable[float], d: float) -> list[Point]:
    """Return the trajectory through the commanded `thrusts`: the motion now, and after each of them.

    `d` takes the place of the estimated disturbance.
    """
    motion = (state.q, state.v, state.f)
    trajectory = [motion]
    for u in thrusts:
        motion = predict_step(step, motion, u, d)
        trajectory.append(motion)
    return trajectory


def advance(parameters: ObserverParameters, state: ObserverState, push: Push, gain: float) -> ObserverState:
    """Run the model of a vehicle of this gain over a step, whose time is not below zero."""
    model = coefficients(push, gain, parameters.thrust_lag_s, push.dt_s)
    return coasted(model, math.exp(push.dt_s / -parameters.slow_time_s), state, push.u)


def coasted(step: StepCoefficients, slow: float, state: ObserverState, u: float) -> ObserverState:
    """Run the model over a step of these coefficients; `slow` is what is kept of the slow noise."""
    q, v, f, d, s, p = state
    q, v, f = predict_step(step, (q, v, f), u, d)
    return ObserverState(q, v, f, d, s * slow, p * slow)


def expected(state: ObserverState) -> tuple[float, float]:
    """Return what the sensors should show at the observer's time: position and rate."""
    return (state.q + state.s, state.v + state.p)


def innovation(state: ObserverState, sample: Sample, angular: bool) -> Pair:
    """Return measured minus expected; zero where nothing was measured."""
    e_q = 0.0 if math.isnan(sample.position) else sample.position - (state.q + state.s)
    e_v = 0.0 if math.isnan(sample.rate) else sample.rate - (state.v + state.p)
    return (wrap(e_q) if angular else e_q, e_v)


def correct(parameters: ObserverParameters, state: Six, e_q: float, e_v: float) -> ObserverState:
    """Take in the innovation of position and rate. Written out, for it runs 18 times a tick."""
    q, v, f, d, s, p = state
    q_q, v_q, f_q, d_q, s_q, p_q = parameters.by_position
    q_v, v_v, f_v, d_v, s_v, p_v = parameters.by_rate
    return ObserverState(
        q + (q_q * e_q + q_v * e_v),
        v + (v_q * e_q + v_v * e_v),
        f + (f_q * e_q + f_v * e_v),
        d + (d_q * e_q + d_v * e_v),
        s + (s_q * e_q + s_v * e_v),
        p + (p_q * e_q + p_v * e_v),
    )


def differentiated(
    parameters: ObserverParameters,
    step: StepCoefficients,
    slow: float,
    slope: ObserverState,
    sample: Sample,
    u: float,
    more_v: float,
    more_f: float,
) -> tuple[ObserverState, Pair]:
    """Return an observer's derivative by a parameter after a step, and that of what the sensors should show.

    It goes on as `coasted`, gains `more_v` and `more_f` beside, and is corrected where something was
    measured; elsewhere the second is zero.
    """
    q, v, f, d, s, p = slope
    q, v, f = predict_step(step, (q, v, f), u, d)
    q, v, f, s, p = q + step[0] * more_v, v + more_v, f + more_f, s * slow, p * slow
    of_position = 0.0 if math.isnan(sample.position) else q + s
    of_rate = 0.0 if math.isnan(sample.rate) else v + p
    return correct(parameters, (q, v, f, d, s, p), -of_position, -of_rate), (of_position, of_rate)


def rates(state: ObserverState, push: Push, gain: float) -> tuple[float, float]:
    """Return q' and v' at the observer's time."""
    return (state.v, (state.f - push.c / gain * state.v - state.d) / (push.m / gain))


def at_intervals(parameters: ByInterval, of_position: float, of_rate: float) -> ObserverParameters:
    """Return the parameters for a position and a rate by the number of ticks since each was measured."""
    every_tick = parameters[0]
    if of_position <= 1.0 and of_rate <= 1.0:
        return every_tick
    i, share_q = _between(INTERVALS, of_position)
    j, share_v = _between(INTERVALS, of_rate)
    return ObserverParameters(
        thrust_lag_s=every_tick.thrust_lag_s,
        slow_time_s=every_tick.slow_time_s,
        by_position=_mixed(parameters[i].by_position, parameters[i + 1].by_position, share_q),
        by_rate=_mixed(parameters[j].by_rate, parameters[j + 1].by_rate, share_v),
    )


def scheduled_parameters(table: ObserverTable, log_gain: float, lag_s: float) -> ObserverParameters:
    """Return the parameters for a gain and a lag (s), between those of the table."""
    i, right = _between(table.log_gains, log_gain)
    j, up = _between(table.lags_s, lag_s)
    a, b = (1.0 - right) * (1.0 - up), (1.0 - right) * up
    c, d = right * (1.0 - up), right * up
    at = len(table.lags_s) * i + j
    one, two = table.rows[at], table.rows[at + 1]
    three, four = table.rows[at + len(table.lags_s)], table.rows[at + len(table.lags_s) + 1]
    columns = [a * one[k] + b * two[k] + c * three[k] + d * four[k] for k in range(12)]
    return ObserverParameters(
        thrust_lag_s=lag_s,
        slow_time_s=table.slow_time_s,
        by_position=_state(columns[:6]),
        by_rate=_state(columns[6:]),
    )


def _mixed(one: ObserverState, other: ObserverState, share: float) -> ObserverState:
    return _state([one[i] + share * (other[i] - one[i]) for i in range(6)])


def _state(values: Sequence[float]) -> ObserverState:
    q, v, f, d, s, p = values
    return ObserverState(q, v, f, d, s, p)


def _between(nodes: Sequence[float], at: float) -> tuple[int, float]:
    """Return the interval of the nodes in which `at` lies, and where in it, 0..1."""
    i = 0
    while i < len(nodes) - 2 and nodes[i + 1] < at:
        i += 1
    width = nodes[i + 1] - nodes[i]
    return i, clamped((at - nodes[i]) / width, 0.0, 1.0) if width > 0.0 else 0.0
