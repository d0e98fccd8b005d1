"""L1 adaptive control: a fast velocity predictor finds the disturbance, a low-pass filter lets it in.

    predictor   v̂' = (f − k − h − σ)/m − a ṽ          ṽ = v̂ − ẋ
    adaptation  σ = m a e^{−a T} ṽ/(1 − e^{−a T})      piecewise constant: undoes ṽ within one tick T
    filter      d̂' = ω (σ − d̂)
    law         τ = k + h + m (ẍ_d − λ ė − κ ε) + d̂

(Hovakimyan and Cao, L1 Adaptive Control Theory, 2010, ch. 3.3.) The disturbance has the paper's sign.

| symbol | meaning                                                  | key, or unit                          |
|--------|----------------------------------------------------------|---------------------------------------|
| λ, κ   | of the law, 1/s                                          | lambda_per_s, kappa_per_s             |
| ω      | how fast the filter follows, 1/s                         | laws.l1.omega                         |
| f      | thrust there: what was asked for, through the lag, N     | max_force, thrusters.lag_s, .lead_s   |
| d̂      | the disturbance as it is let in, N                       | bounded by max_disturbance            |
| a      | the predictor's own pole                                 | 1/s                                   |
"""

import math
from typing import NamedTuple

from companion.core.bounds import limited
from companion.core.law import Motion, Terms, law_with
from lab.rivals.thrust import there

PREDICTOR_PER_S = 1.0


class Parameters(NamedTuple):
    """`lag_s` is the thrusters' lag; `lead_s` is how far beyond its arrival a command is looked at."""

    omega: float
    max_disturbance: float
    max_force: float
    lag_s: float
    lead_s: float


class State(NamedTuple):
    """Predictor, thrust and filter; `started` is false before the first tick."""

    started: bool
    v: float
    """v̂ at the last tick, m/s."""
    pull: float
    """What of v̂' is not thrust, m/s²."""
    asked: float
    thrust: float
    d_hat: float


def initial(parameters: Parameters) -> State:
    """Return a state that knows of no disturbance and of no motion."""
    return State(False, 0.0, 0.0, 0.0, 0.0, 0.0)


def step(parameters: Parameters, state: State, motion: Motion, dt_s: float) -> tuple[State, Terms]:
    """Return the force for this tick; where the command was cut off the predictor only follows."""
    m = motion.m
    lagging, thrust = there(state.asked, state.thrust, parameters.lag_s, parameters.lead_s, dt_s)
    v_hat = motion.x_dot
    if state.started and motion.free:
        v_hat = state.v + dt_s * (thrust / m + state.pull)
    ahead = v_hat - motion.x_dot
    keep = math.exp(-PREDICTOR_PER_S * dt_s)
    sigma = m * PREDICTOR_PER_S * ahead * keep / (1.0 - keep) if dt_s > 0.0 else 0.0
    d_hat = state.d_hat
    if motion.free:
        let_in = 1.0 - math.exp(-parameters.omega * motion.share * motion.share * dt_s)
        d_hat = limited(d_hat + let_in * (sigma - d_hat), parameters.max_disturbance)
    terms = law_with(motion, d_hat)
    pull = -(motion.k_plus_h + sigma) / m - PREDICTOR_PER_S * ahead
    asked = limited(terms.feedforward + terms.feedback + d_hat, parameters.max_force)
    return State(True, v_hat, pull, asked, lagging, d_hat), terms
