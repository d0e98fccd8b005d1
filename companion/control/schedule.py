"""Gains against delay: how far they are drawn back where the loop is later than they are meant for.

| symbol     | meaning                                                              | unit |
|------------|----------------------------------------------------------------------|------|
| lam, kappa | λ, κ of the law                                                      | 1/s  |
| share      | the delay that the gains bear over the delay that there is, 1 at most |      |

The powers of `share` keep a gain margin of 2 at a known total delay (docs/theory.md).
"""

from typing import NamedTuple

LAMBDA_POWER, KAPPA_POWER, LEARNING_POWER = 0.6, 1.4, 2.0
LEAST_DELAY_S = 1e-3


class Gains(NamedTuple):
    """λ and κ of one degree of freedom, and the delay in all that they bear, s."""

    lam: float
    kappa: float
    bear_s: float


def scheduled(gains: Gains, delay_s: float, gain_scale: float) -> tuple[float, float, float, float]:
    """Return λ, κ, the share of its learning rate that a compensator keeps, and `share`, for such a loop.

    It is `delay_s` late; `gain_scale` is what an oscillation leaves of the gains.
    """
    share = gains.bear_s / (LEAST_DELAY_S if delay_s < LEAST_DELAY_S else delay_s)
    share = gain_scale * (1.0 if share > 1.0 else share)
    return gains.lam * share**LAMBDA_POWER, gains.kappa * share**KAPPA_POWER, share**LEARNING_POWER, share
