"""The linear regressor: a compensator that knows the shape of what it does not know.

    d̂ = Wᵀ φ        φ = [1, 10 e, 5 ė, 5 ẋ, 5 ẋ |5 ẋ|, 5 ẍ_d]        Ẇ = −η ε φ − ℓ W

Its terms are those by which damping, mass and weight can be off; it is the network without a hidden layer.
Beside the observer, which knows what is constant, φ begins with 0 in place of 1 (as in `network.py`).

| symbol | key of the configuration | unit (heave; yaw)                  |
|--------|--------------------------|------------------------------------|
| η      | learning_rate            | N/m; N·m/rad                       |
| ℓ      | leak_per_s               | 1/s                                |
|        | dead_zone                | m/s; rad/s of ε                    |
| d_max  | max_disturbance          | N; N·m                             |
"""

from typing import NamedTuple

from companion.core.bounds import limited, square_root
from companion.core.compensator import Inputs, Signals, dead_zone_error, inputs


class Parameters(NamedTuple):
    """How the weights move."""

    learning_rate: float
    leak_per_s: float
    dead_zone: float
    max_disturbance: float
    beside_observer: bool = False


class State(NamedTuple):
    """A weight a term, N or N·m."""

    W: Inputs


def initial(parameters: Parameters) -> State:
    """Return the plain law."""
    return State((0.0, 0.0, 0.0, 0.0, 0.0, 0.0))


def step(
    parameters: Parameters, state: State, signals: Signals, learn_s: float, adapt: bool
) -> tuple[State, float, bool]:
    """Return the new state, d̂, and whether it learnt."""
    eta, leak, dead_zone, d_max, beside_observer = parameters
    phi = terms(signals, beside_observer)
    learning, error = dead_zone_error(dot(state.W, phi), signals.eps, adapt, dead_zone, d_max)
    if learning:
        state = State(moved(1.0 - learn_s * leak, state.W, -learn_s * eta * error, phi))
    return state, limited(dot(state.W, phi), d_max), learning


def seed(parameters: Parameters, state: State, signals: Signals, d_hat: float) -> State:
    """Answer these signals with `d_hat`, by the smallest change of W; beside the observer stay as it is."""
    if parameters.beside_observer:
        return state
    phi = terms(signals, beside_observer=False)
    missing = (limited(d_hat, parameters.max_disturbance) - dot(state.W, phi)) / dot(phi, phi)
    return State(moved(1.0, state.W, missing, phi))


def weight_norm(state: State) -> float:
    """Return the Euclidean norm of W."""
    return square_root(dot(state.W, state.W))


def integral_gain(parameters: Parameters) -> float:
    """Return η: the constant term's. Beside the observer it is less."""
    return parameters.learning_rate


def terms(signals: Signals, beside_observer: bool) -> Inputs:
    """Return φ."""
    one, e, e_dot, x_dot, _, x_d_ddot = inputs(signals)
    return (0.0 if beside_observer else one, e, e_dot, x_dot, x_dot * abs(x_dot), x_d_ddot)


def dot(a: Inputs, b: Inputs) -> float:
    """Return aᵀ b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[4] * b[4] + a[5] * b[5]


def moved(keep: float, W: Inputs, gain: float, phi: Inputs) -> Inputs:
    """Return keep W + gain φ."""
    return (
        keep * W[0] + gain * phi[0],
        keep * W[1] + gain * phi[1],
        keep * W[2] + gain * phi[2],
        keep * W[3] + gain * phi[3],
        keep * W[4] + gain * phi[4],
        keep * W[5] + gain * phi[5],
    )
