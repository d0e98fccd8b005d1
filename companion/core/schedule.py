"""Gains against delay: how far they are reduced where the loop is later than they tolerate.

| symbol     | meaning                                                              | unit |
|------------|----------------------------------------------------------------------|------|
| lam, kappa | λ, κ of the law                                                      | 1/s  |
| share      | the delay that the gains tolerate over the present delay, 1 at most   |      |

The powers of `share` keep a gain margin of 2 at a known total delay (docs/theory.md).
"""

from typing import NamedTuple

LAMBDA_POWER, KAPPA_POWER = 0.6, 1.4
LEAST_DELAY_S = 1e-3

D_HAT_TOLERATED_S = 0.2
"""Delay that d̂ tolerates: with more, a vehicle of less gain rings (docs/theory.md)."""


class Gains(NamedTuple):
    """λ and κ of one degree of freedom, and the delay that they tolerate (s)."""

    lam: float
    kappa: float
    tolerated_s: float


class ScheduledGains(NamedTuple):
    """What is left of the gains of a degree of freedom; of a compensator's learning rate, `share` squared."""

    gains: Gains
    share: float
    d_share: float
    """Factor on d̂ (`oscillation.scaled_disturbance`) and on the damping term."""


NO_GAINS = ScheduledGains(gains=Gains(lam=0.0, kappa=0.0, tolerated_s=0.0), share=0.0, d_share=0.0)


def scheduled(gains: Gains, delay_s: float, gain_scale: float) -> ScheduledGains:
    """Return what is left in a loop that is `delay_s` late; `gain_scale` is what an oscillation leaves."""
    delay_s = LEAST_DELAY_S if delay_s < LEAST_DELAY_S else delay_s
    share = gain_scale * _share(gains.tolerated_s, delay_s)
    return ScheduledGains(
        gains=Gains(
            lam=gains.lam * share**LAMBDA_POWER,
            kappa=gains.kappa * share**KAPPA_POWER,
            tolerated_s=gains.tolerated_s,
        ),
        share=share,
        d_share=gain_scale * _share(D_HAT_TOLERATED_S, delay_s),
    )


def _share(tolerated_s: float, late_s: float) -> float:
    return 1.0 if late_s < tolerated_s else tolerated_s / late_s
