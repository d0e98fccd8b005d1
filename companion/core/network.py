"""The three-layer network that learns the disturbance on-line (eq. ann).

d̂ = Wᵀ σ(Vᵀ θ): V feeds the hidden layer and W the output (the paper's text swaps the two), σ is the logistic
function. Back-propagation of the combined error ε, with leak, dead zone, projection and freeze:

    Ẇ = −η ε σ − ℓ W                    V̇ = −η_V ε θ (W ∘ σ')ᵀ − ℓ (V − V(0))

The sign follows from m ε̇ = −m κ ε + d̂ − d*: a positive ε asks for a smaller d̂.

It is the paper's, alone (`network`). Beside the observer another one predicts (`predictor.py`).

| symbol | key of the configuration | unit (heave; yaw)                          |
|--------|--------------------------|--------------------------------------------|
| η      | learning_rate            | N/m; N·m/rad                               |
| η_V    | hidden_learning_rate     | 1/m; 0 freezes the hidden layer            |
| ℓ      | leak_per_s               | 1/s                                        |
|        | dead_zone                | m/s; rad/s of ε                            |
| d_max  | max_disturbance          | N; N·m                                     |
| V(0)   | network.units, .seed     | `hidden`: a column a unit, each N(0, 1)    |
| θ      |                          | `compensator.inputs`                       |
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from companion.core.bounds import limited, square_root
from companion.core.compensator import Inputs, Signals, dead_zone_error, inputs

SATURATED = 40.0
"""e⁻ˣ of more would only make σ smaller."""


class Parameters(NamedTuple):
    """How the weights move; `hidden` is V(0), a column for each unit."""

    learning_rate: float
    hidden_learning_rate: float
    leak_per_s: float
    dead_zone: float
    max_disturbance: float
    hidden: tuple[Inputs, ...]


class State(NamedTuple):
    """W, a weight a unit (N; N·m), and V, a column a unit. The lists are values: nobody changes them."""

    W: list[float]
    V: list[Inputs]


def parameters(values: Mapping[str, Any]) -> Parameters:
    """Return parameters with V(0) = `hidden`, the same on every axis."""
    return Parameters(**{name: values[name] for name in Parameters._fields})


def initial(parameters: Parameters) -> State:
    """Return W = 0, so that an untrained network is the plain law."""
    V = [(v[0], v[1], v[2], v[3], v[4], v[5]) for v in parameters.hidden]
    return State([0.0 for _ in V], V)


def step(
    parameters: Parameters, state: State, signals: Signals, learn_s: float, adapt: bool
) -> tuple[State, float, bool]:
    """Return the new state, d̂, and whether it learnt."""
    return learnt(parameters, state, inputs(signals), signals.eps, learn_s, adapt)


def learnt(
    parameters: Parameters, state: State, theta: Inputs, eps: float, learn_s: float, adapt: bool
) -> tuple[State, float, bool]:
    """Return what `step` does, for any inputs θ: eq. ann."""
    eta, eta_V, leak, dead_zone, d_max, V_0 = parameters
    W, V = state
    sigma = sigmoid(V, theta)
    learning, error = dead_zone_error(dot(W, sigma), eps, adapt, dead_zone, d_max)
    if learning:
        keep, gain, gain_V = 1.0 - learn_s * leak, learn_s * eta * error, learn_s * eta_V * error
        if eta_V > 0.0:
            pull = [gain_V * (W[j] * sigma[j] * (1.0 - sigma[j])) for j in range(len(W))]
            V = [back_propagated(V[j], V_0[j], keep, pull[j], theta) for j in range(len(V))]
        W = [keep * W[j] - gain * sigma[j] for j in range(len(W))]
    return State(W, V), limited(dot(W, sigma), d_max), learning


def seed(parameters: Parameters, state: State, signals: Signals, d_hat: float) -> State:
    """Answer these signals with `d_hat`, by the smallest change of W."""
    sigma = sigmoid(state.V, inputs(signals))
    missing = (limited(d_hat, parameters.max_disturbance) - dot(state.W, sigma)) / dot(sigma, sigma)
    return State([state.W[j] + missing * sigma[j] for j in range(len(sigma))], state.V)


def weight_norm(state: State) -> float:
    """Return the Euclidean norm of W."""
    return square_root(dot(state.W, state.W))


def integral_gain(parameters: Parameters) -> float:
    """Return η n/4: the outputs of n units are ½ at rest."""
    return 0.25 * len(parameters.hidden) * parameters.learning_rate


def sigmoid(V: Sequence[Inputs], theta: Inputs) -> list[float]:
    """Return σ(Vᵀ θ)."""
    a, b, c, d, e, f = theta
    summed = [v[0] * a + v[1] * b + v[2] * c + v[3] * d + v[4] * e + v[5] * f for v in V]
    return [1.0 / (1.0 + math.exp(-x if not x < -SATURATED else SATURATED)) for x in summed]


def dot(a: Sequence[float], b: Sequence[float]) -> float:
    """Return aᵀ b."""
    total = 0.0
    for i in range(len(a)):
        total += a[i] * b[i]
    return total


def back_propagated(v: Inputs, v_0: Inputs, keep: float, pull: float, theta: Inputs) -> Inputs:
    """Return a column of V, drawn toward its start and moved against θ."""
    return (
        keep * (v[0] - v_0[0]) + v_0[0] - pull * theta[0],
        keep * (v[1] - v_0[1]) + v_0[1] - pull * theta[1],
        keep * (v[2] - v_0[2]) + v_0[2] - pull * theta[2],
        keep * (v[3] - v_0[3]) + v_0[3] - pull * theta[3],
        keep * (v[4] - v_0[4]) + v_0[4] - pull * theta[4],
        keep * (v[5] - v_0[5]) + v_0[5] - pull * theta[5],
    )
