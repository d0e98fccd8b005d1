"""PD: τ = k + h + m (ẍ_d − 2 ζ ω ė − ω² e) + d̂."""

from typing import NamedTuple

from companion.core.law import Motion


class Parameters(NamedTuple):
    omega: float = 6.0
    zeta: float = 1.0


class State(NamedTuple):
    pass


def initial(parameters: Parameters) -> State:
    return State()


def step(parameters: Parameters, state: State, motion: Motion, dt_s: float) -> tuple[State, float, float]:
    omega = parameters.omega * motion.share
    pull = 2.0 * parameters.zeta * omega * motion.e_dot + omega * omega * motion.e
    tau = motion.k_plus_h + motion.m * (motion.x_d_ddot - pull) + motion.d_hat
    return state, tau, motion.d_hat
