"""P-PI: what most autopilots fly. Position error to a wished velocity, velocity error to an acceleration.

    v_t = ẋ_d − k_p e        τ = m (ẍ_d + k_v (v_t − ẋ) + i)        i' = k_i (v_t − ẋ)

It knows the mass but not the drag, which its integral has to find.
"""

from dataclasses import dataclass

import numpy as np

from lab.batch.legacy.bounds import bounded
from lab.batch.legacy.controller import KAPPA_POWER, LAMBDA_POWER, LEARNING_POWER
from lab.batch.legacy.records import Array
from lab.batch.legacy.rival_law import Forces, Motion


@dataclass(frozen=True, slots=True)
class PPIGains:
    """k_p, k_v (1/s) and k_i (1/s²); `d_max` (N) bounds the integral. Scalars, or of the motion's shape."""

    k_p: Array | float
    k_v: Array | float
    k_i: Array | float
    d_max: float


class PPI:
    """The cascade; its integral stands where the command was cut off."""

    def __init__(self, gains: PPIGains) -> None:
        self._gains = gains
        self.reset()

    def reset(self) -> None:
        """Empty the integral."""
        self._integral: Array = np.zeros(())

    def step(self, motion: Motion, dt_s: float) -> Forces:
        """Return the force for this tick."""
        gains, m = self._gains, motion.inertia
        k_p, k_v = gains.k_p * motion.share**LAMBDA_POWER, gains.k_v * motion.share**KAPPA_POWER
        k_i = gains.k_i * motion.share**LEARNING_POWER
        lacking = -(motion.e_dot + k_p * motion.e)
        grown = self._integral + dt_s * k_i * m * lacking * motion.free
        self._integral = bounded(grown, np.asarray(gains.d_max))
        return Forces(m * motion.x_d_ddot, m * k_v * lacking, self._integral)
