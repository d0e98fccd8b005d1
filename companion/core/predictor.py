"""The network that predicts the disturbance of one degree of freedom to the moment when the command acts.

    d̂(t + H) = d(t) + s Wᵀ φ(θ(t))        φ = σ(Vᵀ θ) − σ(Vᵀ θ₀)        θ₀ = [1, 0, …, 0]        (eq. ann)

The observer's d is late, and the thrust that cancels it is later. The last second of d tells where waves, a
tether and a turning current go next. V is random and fixed. W learns from its own error, once the d that was
predicted has been observed: recursive least squares that forgets, with P bounded (Ljung 1999, ch. 11).
Before anything was learnt, and for a d that stays, the prediction is d itself. After a step θ is larger than
ever before; σ saturates, so the prediction stays within what was learnt.

| symbol | meaning                                                        | unit                     |
|--------|----------------------------------------------------------------|--------------------------|
| d      | disturbance as the observer has it, NED                        | N; N·m                   |
| H      | horizon: the observer's lag, delays and the thrusters' lag     | s                        |
| s      | RMS of what d rises over H, within SCALE_S                     | N; N·m                   |
| θ      | 1, d at TAPS moments before less d now, over s; how much the   | 1; the paper's scales    |
|        | reference's rate and acceleration change over H                |                          |
| W, V   | weights of the units; a column a unit, N(0, 1)                 | 1                        |
| P      | covariance of W, over the variance of d                        | 1                        |
| share  | of the prediction that is used: 0 if "d stays" was as good     |                          |
|        | within JUDGED_S                                                | 1                        |

The numbers below were tuned on vehicles of decision 44; within a factor of two of each the figures stay.
"""

import math
from typing import NamedTuple

from companion.core.bounds import clamped, limited, square_root

Inputs = tuple[float, float, float, float, float, float, float, float, float, float]
INPUTS = 10
AT_REST: Inputs = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
TAPS = 7
SPACING_S = 0.2

OF_DISTURBANCE, OF_REFERENCE = 0.5, 5.0
"""Scales of θ."""

TURN_TICKS = 4
"""The degrees of freedom learn by turns."""

MEMORY_S = 15.0
VARIANCE = 0.3
"""Variance of what the network leaves, in squares of s."""

PRIOR = 10.0
"""Variance of a weight before anything is learnt; P has no larger trace."""

SCALE_S = 10.0
FLOOR_S = 0.25
"""d rises by its random walk over this time at least: less is noise."""

JUDGED_S = 4.0
USED_FROM, USED_WHOLLY = 0.05, 0.3
"""Reduction of the squared error from which on the prediction is used; from which on wholly."""

MOST = 3.0
"""Largest rise and error that count, in s."""

SATURATED = 40.0


class Parameters(NamedTuple):
    """V and σ(Vᵀθ₀), the noise of d (N/√s), the largest d̂ (N), and which of TURN_TICKS is its turn."""

    V: tuple[Inputs, ...]
    rest: tuple[float, ...]
    disturbance_noise: float
    max_disturbance: float
    tick_s: float
    turn: int
    predicts: bool


class Moment(NamedTuple):
    """d, the reference's rate and acceleration, and what d was then predicted to rise."""

    d: float
    rate: float
    acceleration: float
    rise: float


class Predicted(NamedTuple):
    """By how much d rises until the command acts, N or N·m, ‖W‖, and whether W learns."""

    rise: float
    weight_norm: float
    learns: bool


NOTHING = Predicted(0.0, 0.0, False)
NONE = (NOTHING, NOTHING, NOTHING, NOTHING)


class State(NamedTuple):
    """The lists are values: nobody changes them. P is a row after the other."""

    past: list[Moment]
    W: list[float]
    weight_norm: float
    """‖W‖."""
    P: list[float]
    square: float
    """s²."""
    error: float
    """Mean square of what the network leaves, over s²; `constant`: of what "d stays" leaves."""
    constant: float
    ticks: int
    predicted: Predicted


def start(parameters: Parameters) -> State:
    """Return a network that has learnt nothing."""
    units = len(parameters.V)
    return State(
        past=[Moment(0.0, 0.0, 0.0, 0.0) for _ in range(0)],  # numba wants to know of what
        W=[0.0 for _ in range(units)],
        weight_norm=0.0,
        P=[PRIOR if i == j else 0.0 for i in range(units) for j in range(units)],
        square=least_square(parameters),
        error=1.0,
        constant=1.0,
        ticks=parameters.turn,
        predicted=NOTHING,
    )


def interrupted(state: State) -> State:
    """Forget the past of d; what was learnt stays."""
    return state._replace(past=state.past[:0], predicted=NOTHING) if state.past else state


def without_thrust(state: State, lost: float) -> State:
    """Take from the past of d what a motor was believed to give: no step was there."""
    return state._replace(past=[Moment(d - lost, v, a, rise) for d, v, a, rise in state.past])


def step(
    parameters: Parameters, state: State, d: float, rate: float, acceleration: float, horizon_s: float
) -> State:
    """Take a tick's d, with the reference where the command acts; predict what d rises over the horizon."""
    if not parameters.predicts:
        return state
    spacing = max(1, round(SPACING_S / parameters.tick_s))
    ticks = max(1, round(horizon_s / parameters.tick_s))
    reach = max(TAPS * spacing, ticks)
    past = state.past[-(reach + ticks) :]
    past.append(Moment(d, rate, acceleration, 0.0))
    now = len(past) - 1
    learns = now >= reach + ticks
    if learns and state.ticks % TURN_TICKS == 0:
        then = past[now - ticks]
        rose = d - then.d
        state = judged(parameters, state, rose, rose - then.rise)
        theta = inputs(past, now - ticks, spacing, ticks, OF_DISTURBANCE / math.sqrt(state.square))
        state = learnt(parameters, state, hidden(parameters, theta), rose)
    rise = 0.0
    if now >= reach:
        scale = math.sqrt(state.square)
        phi = hidden(parameters, inputs(past, now, spacing, ticks, OF_DISTURBANCE / scale))
        rise = limited(scale * limited(dot(state.W, 0, phi), MOST), parameters.max_disturbance)
        past[now] = Moment(d, rate, acceleration, rise)
    predicted = Predicted(share(state) * rise, state.weight_norm, learns)
    return state._replace(past=past, ticks=state.ticks + 1, predicted=predicted)


def judged(parameters: Parameters, state: State, rose: float, error: float) -> State:
    """Compare what d rose with the prediction of then, and with none."""
    dt_s, floor = TURN_TICKS * parameters.tick_s, least_square(parameters)
    square = state.square + (max(rose * rose, floor) - state.square) * (dt_s / SCALE_S)
    passes, most = dt_s / JUDGED_S, MOST * MOST
    return state._replace(
        square=square,
        error=state.error + (min(error * error / square, most) - state.error) * passes,
        constant=state.constant + (min(rose * rose / square, most) - state.constant) * passes,
    )


def learnt(parameters: Parameters, state: State, phi: list[float], rose: float) -> State:
    """Learn W from what d rose: recursive least squares. P forgets, but not beyond what it began with."""
    n, W, P = len(phi), state.W, state.P
    keep = math.exp(-TURN_TICKS * parameters.tick_s / MEMORY_S)
    P_phi = [dot(P, i * n, phi) for i in range(n)]
    weight = 1.0 / (keep * VARIANCE + dot(P_phi, 0, phi))
    error = weight * (limited(rose / math.sqrt(state.square), MOST) - dot(W, 0, phi))
    trace = -weight * dot(P_phi, 0, P_phi)
    for i in range(n):
        trace += P[i * n + i]
    grows = 1.0 / keep if trace < keep * PRIOR * n else PRIOR * n / trace
    W = [W[i] + P_phi[i] * error for i in range(n)]
    P = [grows * (P[i * n + j] - weight * (P_phi[i] * P_phi[j])) for i in range(n) for j in range(n)]
    return state._replace(W=W, weight_norm=square_root(dot(W, 0, W)), P=P)


def share(state: State) -> float:
    """Return the share of the prediction that is used, 0..1."""
    spared = 1.0 - state.error / state.constant if state.error < state.constant else 0.0
    return clamped((spared - USED_FROM) / (USED_WHOLLY - USED_FROM), 0.0, 1.0)


def inputs(past: list[Moment], at: int, spacing: int, ticks: int, per_n: float) -> Inputs:
    """Return θ of the moment `at`."""
    now, before = past[at], past[at - ticks]
    d = now.d
    return (
        1.0,
        per_n * (past[at - spacing].d - d),
        per_n * (past[at - 2 * spacing].d - d),
        per_n * (past[at - 3 * spacing].d - d),
        per_n * (past[at - 4 * spacing].d - d),
        per_n * (past[at - 5 * spacing].d - d),
        per_n * (past[at - 6 * spacing].d - d),
        per_n * (past[at - TAPS * spacing].d - d),
        OF_REFERENCE * (now.rate - before.rate),
        OF_REFERENCE * (now.acceleration - before.acceleration),
    )


def hidden(parameters: Parameters, theta: Inputs) -> list[float]:
    """Return φ(θ)."""
    a, b, c, d, e, f, g, h, i, j = theta
    x = [
        v[0] * a
        + v[1] * b
        + v[2] * c
        + v[3] * d
        + v[4] * e
        + v[5] * f
        + v[6] * g
        + v[7] * h
        + v[8] * i
        + v[9] * j
        for v in parameters.V
    ]
    rest = parameters.rest
    return [
        1.0 / (1.0 + math.exp(-x[k] if not x[k] < -SATURATED else SATURATED)) - rest[k] for k in range(len(x))
    ]


def dot(a: list[float], first: int, b: list[float]) -> float:
    """Return the sum of products of `b` with as many of `a`, from the `first` on."""
    total = 0.0
    for i in range(len(b)):
        total += a[first + i] * b[i]
    return total


def least_square(parameters: Parameters) -> float:
    """Return the least s²: what d rises by its own noise."""
    return FLOOR_S * parameters.disturbance_noise * parameters.disturbance_noise
