"""What a learnt policy sees and does: its action takes the place of the law's feedback.

    τ = k + h + m ẍ_d + d̂ + u        u = SHARE · max_force · action        −1 ≤ action ≤ 1

`lab.training` trains with these functions, and a rival such as `ppo.py` steers with them.

| seen                 | meaning                                                        |
|----------------------|----------------------------------------------------------------|
| e, ė, ẋ, ẍ_d         | of `companion.control.law.Motion`                              |
| d̂, k + h, m, share   | likewise                                                       |
| thrust               | what is believed to be there: what was asked for, with the lag |
| asked                | the force that was asked for in the last tick                  |
"""

from typing import NamedTuple

from companion.control.bounds import limited
from companion.control.law import Motion, Terms
from lab.rivals.thrust import there

SHARE = 0.3
"""Of an axis' max_force: the largest feedback."""

Observation = tuple[float, float, float, float, float, float, float, float, float, float]
OBSERVED = 10


class Parameters(NamedTuple):
    """`lag_s` is the thrusters' lag; `lead_s` is how far beyond its arrival a command is looked at."""

    max_force: float
    lag_s: float
    lead_s: float


class State(NamedTuple):
    """What was asked for, and the thrust that is believed to be there, N."""

    asked: float
    thrust: float


def initial(parameters: Parameters) -> State:
    """Return a state in which nothing was asked for."""
    return State(0.0, 0.0)


def observation(parameters: Parameters, state: State, motion: Motion, dt_s: float) -> Observation:
    """Return what a policy sees of one degree of freedom."""
    _, thrust = there(state.asked, state.thrust, parameters.lag_s, parameters.lead_s, dt_s)
    return (
        motion.e,
        motion.e_dot,
        motion.x_dot,
        motion.x_d_ddot,
        motion.d_hat,
        motion.k_plus_h,
        motion.m,
        motion.share,
        thrust,
        state.asked,
    )


def answered(parameters: Parameters, state: State, terms: Terms, dt_s: float) -> State:
    """Return what is remembered of a force that was asked for."""
    thrust, _ = there(state.asked, state.thrust, parameters.lag_s, parameters.lead_s, dt_s)
    return State(limited(terms.feedforward + terms.feedback + terms.d_hat, parameters.max_force), thrust)


def terms_of(parameters: Parameters, motion: Motion, action: float) -> Terms:
    """Return the force for an action within ±1: it is the feedback, beside the model's forces and d̂."""
    feedforward = motion.k_plus_h + motion.m * motion.x_d_ddot
    return Terms(feedforward, SHARE * parameters.max_force * limited(action, 1.0), motion.d_hat)
