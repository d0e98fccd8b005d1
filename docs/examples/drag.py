"""A bias and the quadratic drag that the model lacks: d̂ = b + c ẋ|ẋ|."""

from typing import NamedTuple

from companion.core.bounds import limited
from companion.core.compensator import Signals, dead_zone_error


class Parameters(NamedTuple):
    learning_rate: float
    leak_per_s: float
    dead_zone: float
    max_disturbance: float
    drag_share: float = 4.0


class State(NamedTuple):
    bias: float
    drag: float


def initial(parameters: Parameters) -> State:
    return State(0.0, 0.0)


def answer(state: State, signals: Signals) -> float:
    return state.bias + state.drag * signals.x_dot * abs(signals.x_dot)


def step(
    parameters: Parameters, state: State, signals: Signals, learn_s: float, adapt: bool
) -> tuple[State, float, bool]:
    d_max = parameters.max_disturbance
    learning, error = dead_zone_error(answer(state, signals), signals.eps, adapt, parameters.dead_zone, d_max)
    if learning:
        keep = 1.0 - learn_s * parameters.leak_per_s
        gain = learn_s * parameters.learning_rate * error
        more = parameters.drag_share * signals.x_dot * abs(signals.x_dot)
        state = State(keep * state.bias - gain, keep * state.drag - gain * more)
    return state, limited(answer(state, signals), d_max), learning


def seed(parameters: Parameters, state: State, signals: Signals, d_hat: float) -> State:
    return State(state.bias + d_hat - answer(state, signals), state.drag)


def weight_norm(state: State) -> float:
    return (state.bias * state.bias + state.drag * state.drag) ** 0.5


def integral_gain(parameters: Parameters) -> float:
    return parameters.learning_rate
