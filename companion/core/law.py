"""The Lyapunov-based law of the paper for one degree of freedom.

Another law may take its place on an axis: one file, which defines, as this one does,

    Parameters   a NamedTuple of numbers, each named as a key of the axis or of `[laws.NAME]`
    State        a NamedTuple of what it remembers
    initial      State at rest, from Parameters
    step         State, τ, and the d̂ that τ answers, after one tick of Motion

| symbol  | meaning                                          | unit (heave; yaw)    | source      |
|---------|--------------------------------------------------|----------------------|-------------|
| e       | x̃ = x − x_d, x where the next command acts       | m; rad               | sec. 2      |
| lam     | λ, the slope of the error surface                | 1/s                  | eq. 2       |
| eps     | ε = ė + λ e, the combined error                  | m/s; rad/s           | eq. 2       |
| kappa   | κ, how fast ε decays                             | 1/s                  | eq. 5       |
| m       | m̄, inertia with added mass                       | kg; kg·m²            | eq. rov     |
| k, h    | Coriolis and damping forces                      | N; N·m               | eq. rov     |
| d_hat   | d̂, estimated disturbance, m ẍ = τ − k − h − d    | N; N·m               | eq. ann     |
| tau     | τ, the control force                             | N; N·m               | eq. lei2    |
"""

from collections.abc import Callable
from typing import Any, NamedTuple

from companion.core.schedule import Gains


def rov_law(
    k_plus_h: float,
    d_hat: float,
    m: float,
    x_d_ddot: float,
    e_dot: float,
    eps: float,
    lam: float,
    kappa: float,
) -> float:
    """Return τ (eqs. lei1, lei2).

    It is eq. 5 for n = 2, f = −(k + h)/m, b = 1/m. The paper prints the last term as −κ ε; eq. 5 divides by b
    and so gives −m κ ε, the only form with which its figures hold.
    """
    return k_plus_h + d_hat + m * (x_d_ddot - lam * e_dot) - m * kappa * eps


class Motion(NamedTuple):
    """What a user's law gets: one degree of freedom where the next command acts, NED, SI units.

    `e`, `e_dot` are measured − desired; `m` and `k_plus_h` are the nominal model's; `d_hat` is what the axis'
    compensators estimate; `gains` are reduced for delay and oscillation already, by powers of
    `share` (0..1, `schedule.py`). If not `free`, the last command was limited or is not in force:
    then learn nothing.
    """

    e: float
    e_dot: float
    eps: float
    x_dot: float
    x_d_ddot: float
    m: float
    k_plus_h: float
    d_hat: float
    gains: Gains
    share: float
    free: bool


def law_with(motion: Motion, d_hat: float) -> float:
    """Return τ of `rov_law` for a motion, with another d̂."""
    at, gains = motion, motion.gains
    return rov_law(at.k_plus_h, d_hat, at.m, at.x_d_ddot, at.e_dot, at.eps, gains.lam, gains.kappa)


class ChosenLaw(NamedTuple):
    """A law as an axis uses it: its functions and its parameters."""

    initial: Callable[[Any], Any]
    step: Callable[[Any, Any, Motion, float], tuple[Any, float, float]]
    parameters: Any


class Parameters(NamedTuple):
    """The paper's law needs none of its own: λ and κ come with Motion."""


class State(NamedTuple):
    """It remembers nothing."""


def initial(parameters: Parameters) -> State:
    """Return nothing remembered."""
    return State()


def step(parameters: Parameters, state: State, motion: Motion, dt_s: float) -> tuple[State, float, float]:
    """Return τ of `rov_law`, with the compensators' d̂."""
    return state, law_with(motion, motion.d_hat), motion.d_hat
