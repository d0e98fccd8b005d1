"""The plainest compensator: the disturbance is whatever the combined error has piled up to.

    d̂' = −k ε − ℓ d̂

with the network's leak, dead zone, projection and freeze. It is the yardstick: near an equilibrium a network
of n logistic units is an integrator of gain η‖σ‖² ≈ η n/4.

| symbol | key of the configuration | unit (heave; yaw)                  |
|--------|--------------------------|------------------------------------|
| k      | learning_rate            | N/m; N·m/rad                       |
| ℓ      | leak_per_s               | 1/s                                |
|        | dead_zone                | m/s; rad/s of ε                    |
| d_max  | max_disturbance          | N; N·m                             |
"""

from typing import NamedTuple

from companion.core.bounds import limited
from companion.core.compensator import Signals, dead_zone_error


class Parameters(NamedTuple):
    """How d̂ moves."""

    learning_rate: float
    leak_per_s: float
    dead_zone: float
    max_disturbance: float


class State(NamedTuple):
    """The integral, N or N·m."""

    d_hat: float


def initial(parameters: Parameters) -> State:
    """Return the plain law."""
    return State(0.0)


def step(
    parameters: Parameters, state: State, signals: Signals, learn_s: float, adapt: bool
) -> tuple[State, float, bool]:
    """Return the new state, d̂, and whether it learnt."""
    k, leak, dead_zone, d_max = parameters
    learning, error = dead_zone_error(state.d_hat, signals.eps, adapt, dead_zone, d_max)
    keep = 1.0 - learn_s * leak if learning else 1.0
    d_hat = limited(keep * state.d_hat - learn_s * k * error, d_max)
    return State(d_hat), d_hat, learning


def seed(parameters: Parameters, state: State, signals: Signals, d_hat: float) -> State:
    """Begin with `d_hat`."""
    return State(limited(d_hat, parameters.max_disturbance))


def weight_norm(state: State) -> float:
    """Return |d̂|, N or N·m: all that it has learnt."""
    return abs(state.d_hat)


def integral_gain(parameters: Parameters) -> float:
    """Return k."""
    return parameters.learning_rate
