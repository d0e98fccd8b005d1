"""What the vehicle is, found while it dives: how strongly each axis answers a command, and how late.

Recursive prediction error method (Ljung 1999, ch. 11) with an observer of its own for each degree of freedom.
Three further observers are the derivatives of its prediction by the parameters. Where the innovation has the
shape of a derivative, that parameter is off. What the closed loop does to the estimate: docs/theory.md.

    m = m_n / g,  c = b c_n / g          a vehicle of gain g, in units of commanded force

| symbol | meaning                                      | unit            | equation                         |
|--------|----------------------------------------------|-----------------|----------------------------------|
| g      | force per command over inertia, over nominal |                 |                                  |
| γ      | log g                                        |                 | θ = (γ, T)                       |
| T      | thruster lag                                 | s               | θ' = (R + P⁻¹)⁻¹ φᵀ S⁻¹ ν        |
| b      | drag over the model's, 1 in the observer     |                 | φ and R have it as a third       |
| ν      | innovation of position and rate              | m, m/s; rad     | observer                         |
| φ      | derivative of the expected measurement by θ  | m, m/s; rad, …  | observer, driven as below        |
| S      | variance of ν, diagonal                      | m², m²/s²; …    | S' = (ν² − S)/SPREAD_MEMORY_S    |
| R      | information on θ                             |                 | R' = φᵀ S⁻¹ φ − R/MEMORY_S       |
| P      | what is not known beforehand                 |                 | diag(PRIOR²)                     |

φ is driven by the thrust without its answer to the disturbance, as it was when the command left
(`Push.own`): with it, thrust that counters a wave looks like thrust that moves nothing. b is not estimated:
what it explains of ν is taken for neither γ nor T. Without it, drag that the model lacks counts as inertia
wherever the vehicle moves (decision 49).
"""

import math
from typing import NamedTuple

from companion.core.bounds import clamped, limited, square_root
from companion.core.observer import (
    ObserverParameters,
    ObserverState,
    Pair,
    Push,
    Sample,
    at_rest,
    coasted,
    coefficients,
    correct,
    differentiated,
    innovation,
)

MEMORY_S = 20.0
SPREAD_MEMORY_S = 20.0
START_SPREAD = (0.002, 0.004)
"""Innovations' standard deviation to begin with: m and m/s, rad and rad/s."""

DOUBTED = 4.0
"""Factor on S: the error of what is found may be larger than its doubt says."""

OUTLIER = 4.0
"""Innovations beyond this many standard deviations are limited to them."""

PRIOR_LOG_GAIN, PRIOR_LAG_S, PRIOR_LOG_DRAG = 0.5, 0.1, 1.0
"""Standard deviations of γ, T and log b as far as is known beforehand."""
KNOWN_GAIN, KNOWN_LAG = 1.0 / (PRIOR_LOG_GAIN * PRIOR_LOG_GAIN), 1.0 / (PRIOR_LAG_S * PRIOR_LAG_S)
KNOWN_DRAG = 1.0 / (PRIOR_LOG_DRAG * PRIOR_LOG_DRAG)
"""P⁻¹."""

MOST_LOG_GAIN = math.log(4.0)
LEAST_LAG_S, MOST_LAG_S = 0.01, 0.4
LOG_GAIN_PER_S, LAG_PER_S = 3.0, 0.6
"""Fastest change of γ and T: a limit cycle of a strong vehicle lasts for a second."""

QUICK_SHARE = 0.2
"""Share of the derivative by T, −s/(1 + T s)², that passes one lag instead of two. At the 7 Hz at which a
vehicle without lag cycles, a T of 0.15 s turns the derivative by 80° against what is measured: with two lags
a cycle moved T up, not down."""

DISTURBANCE_RATIO = (4.0, 4.0, 1.0, 1.0)
"""Disturbance noise of this observer over that of the control, of x, y, z and psi: horizontally waves may
exceed the thrust, and weigh less with more of it."""

INFORMED = 0.3
"""Information on γ over that of PRIOR_LOG_GAIN, from which on anything is learnt."""

TOLERATED_LOG_GAIN, TOLERATED_LAG_S = 0.05, 0.02
"""The model in use may be this far from what was found, beside its standard deviation."""

MEASURED_S, OFTEN = 0.2, 0.7
"""Nothing is learnt of data that come in less than OFTEN of the ticks of MEASURED_S."""

ROUNDING = 1e-15
"""Of a double: some units of its last place, 2.2e-16."""


class Theta(NamedTuple):
    """The model of a vehicle that is in use, or was found: γ and T."""

    log_gain: float
    lag_s: float


class Evidence(NamedTuple):
    """What one tick says of γ, T and log b: φᵀ S⁻¹ ν, and φᵀ S⁻¹ φ."""

    gain: float
    lag: float
    drag: float
    gain_gain: float
    gain_lag: float
    gain_drag: float
    lag_lag: float
    lag_drag: float
    drag_drag: float


class Found(NamedTuple):
    """What was found of one axis: θ, and R."""

    theta: Theta
    gain_gain: float
    gain_lag: float
    gain_drag: float
    lag_lag: float
    lag_drag: float
    drag_drag: float


class ModelState(NamedTuple):
    """The observer of one degree of freedom, its derivatives, and the innovations' variances."""

    observer: ObserverState
    by_gain: ObserverState
    by_lag: ObserverState
    by_drag: ObserverState
    position_variance: float
    rate_variance: float
    measured: float
    """The share of the last steps, over MEASURED_S, in which anything was measured."""


NO_EVIDENCE = Evidence(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def start(position: float, measured: float = 1.0) -> ModelState:
    """Observe from a known place; `measured` is how often it was measured before."""
    (q, v), rest = START_SPREAD, at_rest(0.0)
    return ModelState(
        observer=at_rest(position),
        by_gain=rest,
        by_lag=rest,
        by_drag=rest,
        position_variance=q * q,
        rate_variance=v * v,
        measured=measured,
    )


def observe(
    parameters: ObserverParameters, theta: Theta, state: ModelState, push: Push, sample: Sample, angular: bool
) -> tuple[ModelState, Evidence]:
    """Go on by a step, whose time is above zero, to what was measured at its end, with a vehicle of θ.

    Where less than OFTEN of the steps bring a measurement nothing is said: the Kalman gain is for each step.
    """
    dt_s, spread_q, spread_v = push.dt_s, state.position_variance, state.rate_variance
    some = 0.0 if math.isnan(sample.position) and math.isnan(sample.rate) else 1.0
    measured = state.measured + (some - state.measured) * (1.0 - math.exp(-dt_s / MEASURED_S))
    if measured < OFTEN:
        place, rest = sample.position, at_rest(0.0)
        observed = state.observer if math.isnan(place) else at_rest(place)
        return ModelState(observed, rest, rest, rest, spread_q, spread_v, measured), NO_EVIDENCE
    u, own, lag_s, slow = push.u, push.own, theta.lag_s, math.exp(dt_s / -parameters.slow_time_s)
    gain, was_f = math.exp(theta.log_gain), state.by_gain.f
    model = coefficients(push, gain, lag_s, dt_s)
    _, keep, _, pushed = model
    observed = coasted(model, slow, state.observer, u)
    more_f = (1.0 - QUICK_SHARE) * (was_f - own) * keep * dt_s / (lag_s * lag_s)
    quick = QUICK_SHARE * (was_f + (own + (was_f - own) * keep) - 2.0 * own) / lag_s
    dragged = pushed * (push.c / gain) * (state.observer.v + observed.v)
    by_gain, of_gain = differentiated(parameters, model, slow, state.by_gain, sample, own, 0.0, 0.0)
    by_lag, of_lag = differentiated(
        parameters, model, slow, state.by_lag, sample, 0.0, pushed * (more_f + quick), more_f
    )
    by_drag, of_drag = differentiated(parameters, model, slow, state.by_drag, sample, 0.0, -dragged, 0.0)
    nu_q, nu_v = innovation(observed, sample, angular)
    spread_q, spread_v = _spread(spread_q, nu_q, dt_s), _spread(spread_v, nu_v, dt_s)
    observed = correct(parameters, observed, nu_q, nu_v)
    after = ModelState(observed, by_gain, by_lag, by_drag, spread_q, spread_v, measured)
    nu = limited(nu_q, OUTLIER * math.sqrt(spread_q)), limited(nu_v, OUTLIER * math.sqrt(spread_v))
    return after, evidence_of(nu, (DOUBTED * spread_q, DOUBTED * spread_v), of_gain, of_lag, of_drag)


def evidence_of(nu: Pair, variance: Pair, of_gain: Pair, of_lag: Pair, of_drag: Pair) -> Evidence:
    """Return what an innovation ν of this variance says, where φ is `of_gain`, `of_lag` and `of_drag`."""
    (nu_q, nu_v), weight_q, weight_v = nu, 1.0 / variance[0], 1.0 / variance[1]
    (gain_q, gain_v), (lag_q, lag_v), (drag_q, drag_v) = of_gain, of_lag, of_drag
    return Evidence(
        gain=weight_q * gain_q * nu_q + weight_v * gain_v * nu_v,
        lag=weight_q * lag_q * nu_q + weight_v * lag_v * nu_v,
        drag=weight_q * drag_q * nu_q + weight_v * drag_v * nu_v,
        gain_gain=weight_q * gain_q * gain_q + weight_v * gain_v * gain_v,
        gain_lag=weight_q * gain_q * lag_q + weight_v * gain_v * lag_v,
        gain_drag=weight_q * gain_q * drag_q + weight_v * gain_v * drag_v,
        lag_lag=weight_q * lag_q * lag_q + weight_v * lag_v * lag_v,
        lag_drag=weight_q * lag_q * drag_q + weight_v * lag_v * drag_v,
        drag_drag=weight_q * drag_q * drag_q + weight_v * drag_v * drag_v,
    )


def _spread(variance: float, nu: float, dt_s: float) -> float:
    """Return the variance of an innovation after one more; an outlier counts as OUTLIER deviations.

    One of exactly zero counts for nothing: telemetry that is constant to the last bit shows no noise.
    """
    if nu == 0.0:
        return variance
    most = OUTLIER * OUTLIER * variance
    squared = nu * nu
    return variance + ((squared if squared < most else most) - variance) * (dt_s / SPREAD_MEMORY_S)


def shared(one: Evidence, share: float, other: Evidence, other_share: float) -> Evidence:
    """Return what two degrees of freedom say of an axis, of which each has a share (cos², sin²)."""
    squared, other_squared = share * share, other_share * other_share
    return Evidence(
        gain=share * one.gain + other_share * other.gain,
        lag=share * one.lag + other_share * other.lag,
        drag=share * one.drag + other_share * other.drag,
        gain_gain=squared * one.gain_gain + other_squared * other.gain_gain,
        gain_lag=squared * one.gain_lag + other_squared * other.gain_lag,
        gain_drag=squared * one.gain_drag + other_squared * other.gain_drag,
        lag_lag=squared * one.lag_lag + other_squared * other.lag_lag,
        lag_drag=squared * one.lag_drag + other_squared * other.lag_drag,
        drag_drag=squared * one.drag_drag + other_squared * other.drag_drag,
    )


def remembered(found: Found, evidence: Evidence, dt_s: float) -> Found:
    """Return what is known after a tick: R' = φᵀ S⁻¹ φ − R/MEMORY_S."""
    keep = math.exp(-dt_s / MEMORY_S)
    return Found(
        theta=found.theta,
        gain_gain=keep * found.gain_gain + evidence.gain_gain,
        gain_lag=keep * found.gain_lag + evidence.gain_lag,
        gain_drag=keep * found.gain_drag + evidence.gain_drag,
        lag_lag=keep * found.lag_lag + evidence.lag_lag,
        lag_drag=keep * found.lag_drag + evidence.lag_drag,
        drag_drag=keep * found.drag_drag + evidence.drag_drag,
    )


def without_drag(found: Found, evidence: Evidence) -> tuple[float, float, float, float, float]:
    """Return information and evidence on γ and T alone: what the drag may explain is left out."""
    drag = found.drag_drag + KNOWN_DRAG
    of_gain, of_lag = found.gain_drag / drag, found.lag_drag / drag
    return (
        found.gain_gain - of_gain * found.gain_drag,
        found.gain_lag - of_gain * found.lag_drag,
        found.lag_lag - of_lag * found.lag_drag,
        evidence.gain - of_gain * evidence.drag,
        evidence.lag - of_lag * evidence.drag,
    )


def learn(found: Found, evidence: Evidence, dt_s: float) -> Found:
    """Take in the evidence of one tick; θ stays where it is too little."""
    after = remembered(found, evidence, dt_s)
    gain_gain, gain_lag, lag_lag, of_gain, of_lag = without_drag(after, evidence)
    log_gain, lag_s = found.theta
    if gain_gain > INFORMED * KNOWN_GAIN:
        a, b = gain_gain + KNOWN_GAIN, lag_lag + KNOWN_LAG
        more, later_s = solved(a, b, gain_lag, of_gain, of_lag)
        lag_s = clamped(lag_s + limited(later_s, LAG_PER_S * dt_s), LEAST_LAG_S, MOST_LAG_S)
        if lag_s == found.theta.lag_s:
            more = of_gain / a
        log_gain = _more_gain(log_gain, more, dt_s)
    if not math.isfinite(log_gain + lag_s + gain_gain + lag_lag):
        return found
    return after._replace(theta=Theta(log_gain, lag_s))


def learn_gain(found: Found, evidence: Evidence, of_lag: Found, dt_s: float) -> Found:
    """Take in the evidence of one tick on γ alone; T is what `of_lag` found of it."""
    after = remembered(found, evidence, dt_s)
    gain_gain, _, _, of_gain, _ = without_drag(after, evidence)
    log_gain = found.theta.log_gain
    if gain_gain > INFORMED * KNOWN_GAIN:
        log_gain = _more_gain(log_gain, of_gain / (gain_gain + KNOWN_GAIN), dt_s)
    if not math.isfinite(log_gain + gain_gain):
        return found
    theta = Theta(log_gain, of_lag.theta.lag_s)
    return after._replace(theta=theta, gain_lag=0.0, lag_lag=of_lag.lag_lag, lag_drag=0.0)


def _more_gain(log_gain: float, more: float, dt_s: float) -> float:
    return clamped(log_gain + limited(more, LOG_GAIN_PER_S * dt_s), -MOST_LOG_GAIN, MOST_LOG_GAIN)


def solved(a: float, b: float, c: float, of_gain: float, of_lag: float) -> Pair:
    """Return (R + P⁻¹)⁻¹ φᵀ S⁻¹ ν, where R + P⁻¹ has a and b on its diagonal and c beside it."""
    determinant = _determinant(a, b, c)
    return (b * of_gain - c * of_lag) / determinant, (a * of_lag - c * of_gain) / determinant


def _determinant(a: float, b: float, c: float) -> float:
    """Return a b − c² of a matrix that is positive definite: above zero, whatever rounding leaves."""
    most = a * b
    return max(most - c * c, ROUNDING * most)


def covariance(found: Found) -> tuple[float, float, float]:
    """Return (R + P⁻¹)⁻¹: variance of γ, covariance, variance of T."""
    gain_gain, gain_lag, lag_lag, _, _ = without_drag(found, NO_EVIDENCE)
    a, b = gain_gain + KNOWN_GAIN, lag_lag + KNOWN_LAG
    determinant = _determinant(a, b, gain_lag)
    return b / determinant, -gain_lag / determinant, a / determinant


def doubt(found: Found) -> tuple[float, float]:
    """Return the standard deviations of γ and T."""
    gain, _, lag = covariance(found)
    return square_root(gain), square_root(lag)


def follow(used: Theta, found: Found, sure_of_less: float) -> Theta:
    """Return the model to use: the one in use as long as it may be true, else nearer to what was found.

    It goes along the straight line to θ until θ is one standard deviation away, or `sure_of_less`.
    """
    gain, both, lag = covariance(found)
    gain = gain + TOLERATED_LOG_GAIN * TOLERATED_LOG_GAIN
    lag = lag + TOLERATED_LAG_S * TOLERATED_LAG_S
    theta = found.theta
    off, off_s = used.log_gain - theta.log_gain, used.lag_s - theta.lag_s
    determinant = _determinant(gain, lag, both)
    squared = (lag * off * off - 2.0 * both * off * off_s + gain * off_s * off_s) / determinant
    sure = sure_of_less if off > 0.0 else 1.0
    if not squared > sure * sure:
        return used
    share = sure / math.sqrt(squared)
    return Theta(theta.log_gain + share * off, theta.lag_s + share * off_s)
