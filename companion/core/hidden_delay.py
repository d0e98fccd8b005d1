"""The delay that no stamp shows: what the autopilot's own filter adds, found in the observer's innovations.

Recursive prediction error method (Ljung 1999, ch. 11) for one number of one degree of freedom, the delay x.
An observer of its own, which believes in small disturbances and so leans on the model, predicts each
measurement. The derivative of its error ν by x is the same observer driven by −u' and by no measurement.
Where ν has that shape, x is off:

| symbol | meaning                                       | unit           | equation                        |
|--------|-----------------------------------------------|----------------|---------------------------------|
| x      | hidden delay                                  | s              | x' = −ψᵀ S⁻¹ ν / (I + 1/PRIOR²) |
| ν      | innovation of position and rate               | m, m/s         | observer                        |
| ψ      | its derivative by x                           | m/s, m/s²      | ψ = ∂ν/∂x                       |
| S      | variance of ν, diagonal                       | m², m²/s²      | S' = (ν² − S)/SPREAD_MEMORY_S   |
| I      | information on x, over MEMORY_S               | 1/s²           | I' = ψᵀ S⁻¹ ψ − I/MEMORY_S      |
| u      | commanded thrust                              | N              | observer                        |

A thruster that is slower than believed looks the same, and does the same harm. Half of the delay is found
rather than too much of it: noise that went around the loop pulls it down (docs/theory.md).
"""

import math
from typing import NamedTuple

from companion.core.bounds import clamped, limited
from companion.core.observer import (
    ObserverParameters,
    ObserverState,
    Push,
    Sample,
    at_rest,
    coasted,
    coefficients,
    correct,
    innovation,
    slopes,
)
from companion.core.vehicle_model import MEMORY_S, START_SPREAD

SPREAD_MEMORY_S = 10.0
PRIOR_S = 0.02
"""Standard deviation of what is hidden, as far as is known beforehand."""

LARGEST_S = 0.1
SLEW = 0.02
"""Seconds of delay a second at most."""


class HiddenDelayState(NamedTuple):
    """What was found, `hidden_s`, 0..LARGEST_S; the two observers, and what they have shown so far."""

    hidden_s: float
    observer: ObserverState
    slope: ObserverState
    """The observer's derivative by x."""
    u: float
    """Thrust of the step before; NaN before the first."""
    information: float
    position_variance: float
    rate_variance: float


def start(position: float, hidden_s: float) -> HiddenDelayState:
    """Observe from a known place; what was found before, `hidden_s`, stays if it is finite."""
    q, v = START_SPREAD
    return HiddenDelayState(
        hidden_s=hidden_s if math.isfinite(hidden_s) else 0.0,
        observer=at_rest(position),
        slope=at_rest(0.0),
        u=math.nan,
        information=0.0,
        position_variance=q * q,
        rate_variance=v * v,
    )


def step(
    parameters: ObserverParameters, state: HiddenDelayState, push: Push, gain: float, sample: Sample
) -> HiddenDelayState:
    """Go on by a step, whose time is above zero, to what was measured at its end.

    Without commands that vary `hidden_s` stays as it is.
    """
    u, dt_s = push.u, push.dt_s
    u_slope = 0.0 if math.isnan(state.u) else (state.u - u) / dt_s
    model = coefficients(push, gain, parameters.thrust_lag_s, dt_s)
    slow = math.exp(dt_s / -parameters.slow_time_s)
    observed, slope = coasted(model, slow, state.observer, u), coasted(model, slow, state.slope, u_slope)
    nu_q, nu_v = innovation(observed, sample, False)
    of_q, of_v = slopes(slope, sample)
    psi_q, psi_v = -of_q, -of_v
    spread_q = _spread(state.position_variance, nu_q, dt_s)
    spread_v = _spread(state.rate_variance, nu_v, dt_s)
    weighed_q, weighed_v = psi_q / spread_q, psi_v / spread_v
    information = state.information * math.exp(-dt_s / MEMORY_S) + (weighed_q * psi_q + weighed_v * psi_v)
    wanted = -(weighed_q * nu_q + weighed_v * nu_v) / (information + 1.0 / (PRIOR_S * PRIOR_S))
    return HiddenDelayState(
        hidden_s=clamped(state.hidden_s + limited(wanted, SLEW * dt_s), 0.0, LARGEST_S),
        observer=correct(parameters, observed, nu_q, nu_v),
        slope=correct(parameters, slope, psi_q, psi_v),
        u=u,
        information=information,
        position_variance=spread_q,
        rate_variance=spread_v,
    )


def _spread(variance: float, nu: float, dt_s: float) -> float:
    return variance if nu == 0.0 else variance + (nu * nu - variance) * (dt_s / SPREAD_MEMORY_S)
