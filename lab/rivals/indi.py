"""Incremental nonlinear dynamic inversion: the law asks for a change of thrust, from a measured acceleration.

    τ = f_f + m (ν − a_f)       ν = ẍ_d − λ ė − κ ε
    v_f' = ω (ẋ − v_f) = a_f    f_f' = ω (f − f_f)      one filter for both, so that they stay synchronous

(Sieberling, Chu and Mulder, J. Guid. Control Dyn. 2010, 33, 1732.) What f_f − m a_f differs from the model's
k + h is told as d̂, with the paper's sign: so the force is that of the law with this d̂. A compensator's d̂
belongs to the model: it is added at once, and what is measured is taken less it, through the same filter.

| symbol | meaning                                                  | key, or unit                          |
|--------|----------------------------------------------------------|---------------------------------------|
| λ, κ   | of the law, 1/s                                          | lambda_per_s, kappa_per_s             |
| ω      | of the filters, 1/s                                      | laws.indi.omega                       |
| f      | thrust there: what was asked for, through the lag, N     | max_force, thrusters.lag_s, .lead_s   |
| a_f    | acceleration, filtered                                   | m/s²                                  |
| d̂      | the disturbance, N                                       | bounded by max_disturbance            |
"""

import math
from typing import NamedTuple

from companion.core.bounds import limited
from companion.core.law import Motion, law_with
from lab.rivals.thrust import there


class Parameters(NamedTuple):
    """`lag_s` is the thrusters' lag; `lead_s` is how far beyond its arrival a command is looked at."""

    omega: float
    max_disturbance: float
    max_force: float
    lag_s: float
    lead_s: float


class State(NamedTuple):
    """v_f (m/s), f_f and the compensator's d̂ filtered (N); `started` is false where they begin again."""

    started: bool
    v: float
    f: float
    d: float
    asked: float
    thrust: float
    d_hat: float


def initial(parameters: Parameters) -> State:
    """Return a state that knows of no disturbance and of no motion."""
    return State(False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def step(parameters: Parameters, state: State, motion: Motion, dt_s: float) -> tuple[State, float, float]:
    """Return the force for this tick and its d̂; where the command was cut off the filters begin again."""
    m = motion.m
    lagging, thrust = there(state.asked, state.thrust, parameters.lag_s, parameters.lead_s, dt_s)
    v, f, d, d_hat = motion.x_dot, thrust, motion.d_hat, state.d_hat
    if state.started and motion.free and dt_s > 0.0:
        new = 1.0 - math.exp(-parameters.omega * motion.share * motion.share * dt_s)
        v, f = state.v + new * (motion.x_dot - state.v), state.f + new * (thrust - state.f)
        d = state.d + new * (motion.d_hat - state.d)
        measured = f - m * (v - state.v) / dt_s - motion.k_plus_h
        d_hat = limited(measured - d + motion.d_hat, parameters.max_disturbance)
    tau = law_with(motion, d_hat)
    asked = limited(tau, parameters.max_force)
    return State(motion.free, v, f, d, asked, lagging, d_hat), tau, d_hat
