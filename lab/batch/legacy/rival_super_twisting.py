"""Super-twisting: a second-order sliding mode on the paper's ε, with a linear term (Moreno 2009).

    τ = k + h + m (ẍ_d − λ ė − κ ε − k₁ φ(ε)) + w        w' = −m k₂ sgn(ε)

Both roots of noise are rounded off within ±δ: φ(ε) = ε/√(|ε| + δ), sgn(ε) = ε/(|ε| + δ). With k₁ = k₂ = 0
it is the plain law.
"""

from dataclasses import dataclass

import numpy as np

from lab.batch.legacy.bounds import bounded
from lab.batch.legacy.controller import KAPPA_POWER, LAMBDA_POWER, LEARNING_POWER
from lab.batch.legacy.records import Array
from lab.batch.legacy.rival_law import Forces, Motion

ROUNDING_M_S = 0.01


@dataclass(frozen=True, slots=True)
class TwistGains:
    """λ, κ (1/s), k₁ (m^½/s^{3/2}), k₂ (m/s²), bound on w (N). Scalars, or of the motion's shape."""

    lam: Array | float
    kappa: Array | float
    k_1: Array | float
    k_2: Array | float
    d_max: float


class SuperTwisting:
    """The law; w stands where the command was cut off."""

    def __init__(self, gains: TwistGains) -> None:
        self._gains = gains
        self.reset()

    def reset(self) -> None:
        """Empty the integral of signs."""
        self._w: Array = np.zeros(())

    def step(self, motion: Motion, dt_s: float) -> Forces:
        """Return the force for this tick."""
        gains, m = self._gains, motion.inertia
        lam, harder = gains.lam * motion.share**LAMBDA_POWER, motion.share**KAPPA_POWER
        eps = motion.e_dot + lam * motion.e
        near = np.abs(eps) + ROUNDING_M_S
        turned = dt_s * gains.k_2 * motion.share**LEARNING_POWER * m * eps / near * motion.free
        self._w = bounded(self._w - turned, np.asarray(gains.d_max))
        pull = lam * motion.e_dot + harder * (gains.kappa * eps + gains.k_1 * eps / np.sqrt(near))
        return Forces(motion.drag + m * motion.x_d_ddot, -m * pull, self._w)
