"""P-PI: what most autopilots fly. Position error to a wanted velocity, velocity error to an acceleration.

    v_t = ẋ_d − k_p e        τ = m (ẍ_d + k_v (v_t − ẋ) + i)        i' = k_i (v_t − ẋ)

It knows the mass but not the drag, which its integral has to find. A compensator's d̂ is added to τ.

| symbol | key of the configuration       | unit  |
|--------|--------------------------------|-------|
| k_p    | laws.ppi.k_p                   | 1/s   |
| k_v    | laws.ppi.k_v                   | 1/s   |
| k_i    | laws.ppi.k_i                   | 1/s²  |
| m i    | bounded by max_disturbance     | N     |
"""

from typing import NamedTuple

from companion.core.bounds import limited
from companion.core.law import Motion
from companion.core.schedule import KAPPA_POWER, LAMBDA_POWER


class Parameters(NamedTuple):
    """Gains, and the bound of the integral's force."""

    k_p: float
    k_v: float
    k_i: float
    max_disturbance: float


class State(NamedTuple):
    """m i, N; it stands where the command was cut off."""

    force: float


def initial(parameters: Parameters) -> State:
    """Return an empty integral."""
    return State(0.0)


def step(parameters: Parameters, state: State, motion: Motion, dt_s: float) -> tuple[State, float, float]:
    """Return the force for this tick."""
    share, m = motion.share, motion.m
    lacking = -(motion.e_dot + parameters.k_p * share**LAMBDA_POWER * motion.e)
    force = state.force
    if motion.free:
        grown = force + dt_s * parameters.k_i * share * share * m * lacking
        force = limited(grown, parameters.max_disturbance)
    wanted, d_hat = motion.x_d_ddot + parameters.k_v * share**KAPPA_POWER * lacking, force + motion.d_hat
    return State(force), m * wanted + d_hat, d_hat
