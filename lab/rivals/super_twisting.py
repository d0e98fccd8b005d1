"""Super-twisting: a second-order sliding mode on the paper's ε, with a linear term (Moreno 2009).

    τ = k + h + m (ẍ_d − λ ė − κ ε − k₁ φ(ε)) + w        w' = −m k₂ sgn(ε)

Both roots of noise are rounded off within ±δ: φ(ε) = ε/√(|ε| + δ), sgn(ε) = ε/(|ε| + δ). With k₁ = k₂ = 0
it is the plain law.

| symbol | key of the configuration   | unit        |
|--------|----------------------------|-------------|
| λ, κ   | lambda_per_s, kappa_per_s  | 1/s         |
| k₁     | laws.super_twisting.k_1    | m^½/s^{3/2} |
| k₂     | laws.super_twisting.k_2    | m/s²        |
| w      | bounded by max_disturbance | N           |
"""

import math
from typing import NamedTuple

from companion.core.bounds import limited
from companion.core.law import Motion, Terms
from companion.core.schedule import KAPPA_POWER

ROUNDING_M_S = 0.01


class Parameters(NamedTuple):
    """Gains, and the bound of w."""

    k_1: float
    k_2: float
    max_disturbance: float


class State(NamedTuple):
    """The integral of signs, N; it stands where the command was cut off."""

    w: float


def initial(parameters: Parameters) -> State:
    """Return an empty integral."""
    return State(0.0)


def step(parameters: Parameters, state: State, motion: Motion, dt_s: float) -> tuple[State, Terms]:
    """Return the force for this tick."""
    m, share = motion.m, motion.share
    eps = motion.e_dot + motion.lam * motion.e
    near = abs(eps) + ROUNDING_M_S
    w = state.w
    if motion.free:
        turned = dt_s * parameters.k_2 * share * share * m * eps / near
        w = limited(w - turned, parameters.max_disturbance)
    rounded = parameters.k_1 * share**KAPPA_POWER * eps / math.sqrt(near)
    pull = motion.lam * motion.e_dot + motion.kappa * eps + rounded
    return State(w), Terms(motion.k_plus_h + m * motion.x_d_ddot, -m * pull, w)
