"""The delay that no stamp shows: what the autopilot's own filter adds, found in the observer's innovations.

Recursive prediction error method (Ljung 1999, ch. 11) for one number of one degree of freedom, the delay x.
An observer of its own, which believes in small disturbances and so leans on the model, predicts each
measurement. The derivative of its error ν by x is the same observer driven by −u' and by no measurement.
Where ν has that shape, x is off. What another gain or another drag explains of ν is not taken for delay: both
are parameters of the same regression, of which x alone is used (decision 49).

| symbol | meaning                                       | unit           | equation                        |
|--------|-----------------------------------------------|----------------|---------------------------------|
| x      | hidden delay                                  | s              | x' = [(I + P⁻¹)⁻¹ ψᵀ S⁻¹ ν]_x   |
| ν      | innovation of position and rate               | m, m/s         | observer                        |
| ψ      | what is expected, by x, log gain and log drag | m/s, m/s²; …   | ψ = −∂ν/∂(x, γ, log b)          |
| S      | variance of ν, diagonal                       | m², m²/s²      | S' = (ν² − S)/SPREAD_MEMORY_S   |
| I      | information, over MEMORY_S                    | 1/s²; …        | I' = ψᵀ S⁻¹ ψ − I/MEMORY_S      |
| P      | what is not known beforehand                  |                | diag(PRIOR²)                    |
| u      | commanded thrust                              | N              | observer                        |

A thruster that is slower than the model in use looks the same.
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
    differentiated,
    innovation,
)
from companion.core.vehicle_model import (
    KNOWN_GAIN,
    START_SPREAD,
    Found,
    Theta,
    evidence_of,
    remembered,
    solved,
    without_drag,
)

SPREAD_MEMORY_S = 10.0
PRIOR_S = 0.02
"""Standard deviation of the hidden delay before anything is found."""
KNOWN_DELAY = 1.0 / (PRIOR_S * PRIOR_S)

LARGEST_S = 0.04
"""As much is hidden by the autopilot's filter and by sensors that have no stamps; motors that start late look
like more, and samples that were dated back for them threw vehicles off their place (decision 49)."""
SLEW = 0.02
"""Seconds of delay a second at most."""


class HiddenDelayState(NamedTuple):
    """What was found, `hidden_s`; the observers, and what they have shown so far."""

    hidden_s: float
    observer: ObserverState
    by_delay: ObserverState
    """Its derivative by x; the next two by γ and log b."""
    by_gain: ObserverState
    by_drag: ObserverState
    u: float
    """Thrust of the step before; NaN before the first."""
    found: Found
    """I, of which T is the delay."""
    position_variance: float
    rate_variance: float


def start(position: float, hidden_s: float) -> HiddenDelayState:
    """Observe from a known place; what was found before, `hidden_s`, stays if it is finite."""
    q, v = START_SPREAD
    return HiddenDelayState(
        hidden_s=hidden_s if math.isfinite(hidden_s) else 0.0,
        observer=at_rest(position),
        by_delay=at_rest(0.0),
        by_gain=at_rest(0.0),
        by_drag=at_rest(0.0),
        u=math.nan,
        found=Found(Theta(0.0, 0.0), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        position_variance=q * q,
        rate_variance=v * v,
    )


def step(
    parameters: ObserverParameters,
    state: HiddenDelayState,
    push: Push,
    gain: float,
    lag_s: float,
    sample: Sample,
    known_s: float,
) -> HiddenDelayState:
    """Go on by a step, whose time is above zero, to what was measured at its end.

    No more is found than LARGEST_S, or `known_s`, which was known beforehand, where that is more.
    Without commands that vary `hidden_s` stays as it is.
    """
    u, dt_s, f, v = push.u, push.dt_s, state.observer.f, state.observer.v
    u_slope = 0.0 if math.isnan(state.u) else (state.u - u) / dt_s
    model = coefficients(push, gain, lag_s, dt_s)
    slow = math.exp(dt_s / -parameters.slow_time_s)
    observed = coasted(model, slow, state.observer, u)
    by_delay, of_delay = differentiated(parameters, model, slow, state.by_delay, sample, u_slope, 0.0, 0.0)
    pushed = model[3] * (f + observed.f)
    by_gain, of_gain = differentiated(parameters, model, slow, state.by_gain, sample, 0.0, pushed, 0.0)
    dragged = model[3] * (push.c / gain) * (v + observed.v)
    by_drag, of_drag = differentiated(parameters, model, slow, state.by_drag, sample, 0.0, -dragged, 0.0)
    nu_q, nu_v = innovation(observed, sample, False)
    spread_q = _spread(state.position_variance, nu_q, dt_s)
    spread_v = _spread(state.rate_variance, nu_v, dt_s)
    said = evidence_of((nu_q, nu_v), (spread_q, spread_v), of_gain, of_delay, of_drag)
    found = remembered(state.found, said, dt_s)
    gain, both, delay, by_gain_alone, by_delay_alone = without_drag(found, said)
    _, wanted = solved(gain + KNOWN_GAIN, delay + KNOWN_DELAY, both, by_gain_alone, by_delay_alone)
    return HiddenDelayState(
        hidden_s=clamped(state.hidden_s + limited(wanted, SLEW * dt_s), 0.0, max(LARGEST_S, known_s)),
        observer=correct(parameters, observed, nu_q, nu_v),
        by_delay=by_delay,
        by_gain=by_gain,
        by_drag=by_drag,
        u=u,
        found=found,
        position_variance=spread_q,
        rate_variance=spread_v,
    )


def _spread(variance: float, nu: float, dt_s: float) -> float:
    return variance if nu == 0.0 else variance + (nu * nu - variance) * (dt_s / SPREAD_MEMORY_S)
