"""A law whose feedback comes from outside: NaN leaves it to the paper's law."""

import math
from typing import NamedTuple

from companion.control.law import Motion, Terms, law_with
from lab.rivals import policy
from lab.rivals.policy import Observation, Parameters, answered, observation, terms_of

NOTHING_SEEN: Observation = (0.0,) * 10


class State(NamedTuple):
    """The action for the next tick, what the last one saw, and what `policy` remembers."""

    action: float
    seen: Observation
    remembered: policy.State


def initial(parameters: Parameters) -> State:
    """Return the state before the first tick."""
    return State(math.nan, NOTHING_SEEN, policy.initial(parameters))


def step(parameters: Parameters, state: State, motion: Motion, dt_s: float) -> tuple[State, Terms]:
    """Return the force for this tick."""
    seen = observation(parameters, state.remembered, motion, dt_s)
    if math.isnan(state.action):
        terms = law_with(motion, motion.d_hat)
    else:
        terms = terms_of(parameters, motion, state.action)
    return State(state.action, seen, answered(parameters, state.remembered, terms, dt_s)), terms
