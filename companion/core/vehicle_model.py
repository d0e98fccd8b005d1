"""What the vehicle is, found while it dives: how strongly each axis answers a command, and how late.

Recursive prediction error method (Ljung 1999, ch. 11) with an observer of its own for each degree of freedom.
Two further observers are the derivatives of its prediction by the parameters. Where the innovation has the
shape of a derivative, that parameter is off. The commands come from the loop; what that does to the estimate
stands in docs/theory.md.

    m = m_n / g,  c = c_n / g          a vehicle of gain g, in units of commanded force

| symbol | meaning                                      | unit            | equation                         |
|--------|----------------------------------------------|-----------------|----------------------------------|
| g      | force per command over inertia, over nominal |                 |                                  |
| γ      | log g                                        |                 | θ = (γ, T)                       |
| T      | thruster lag                                 | s               | θ' = (R + P⁻¹)⁻¹ φᵀ S⁻¹ ν        |
| ν      | innovation of position and rate              | m, m/s; rad     | observer                         |
| φ      | derivative of the expected measurement by θ  | m, m/s; rad, …  | observer, driven as below        |
| S      | variance of ν, diagonal                      | m², m²/s²; …    | S' = (ν² − S)/SPREAD_MEMORY_S    |
| R      | information on θ                             |                 | R' = φᵀ S⁻¹ φ − R/MEMORY_S       |
| P      | what is not known beforehand                 |                 | diag(PRIOR²)                     |

φ is driven by the thrust alone, not by thrust less the estimated disturbance: that estimate carries the noise
of the measurements, which would pull g down. The observer expects more disturbance than that of the control,
so waves weigh less. What is found may stay off by more than its doubt says: S counts as DOUBTED times itself.
"""

import math
from typing import NamedTuple

from companion.core.bounds import clamped, limited, square_root
from companion.core.observer import (
    ByInterval,
    ObserverParameters,
    ObserverState,
    ObserverTable,
    at_rest,
    coefficients,
    correct,
    predict_step,
    scheduled_parameters,
)

MEMORY_S = 20.0
SPREAD_MEMORY_S = 5.0
START_SPREAD = (0.002, 0.004)
"""Innovations' standard deviation to begin with: m and m/s, rad and rad/s."""

DOUBTED = 4.0
OUTLIER = 4.0
"""Innovations beyond so many standard deviations count as these."""

PRIOR_LOG_GAIN, PRIOR_LAG_S = 0.5, 0.1
"""Standard deviations of γ and T as far as is known beforehand."""

MOST_LOG_GAIN = math.log(4.0)
LEAST_LAG_S, MOST_LAG_S = 0.04, 0.4
LOG_GAIN_PER_S, LAG_PER_S = 1.0, 0.2
"""Fastest change of γ and T."""

DISTURBANCE_RATIO = 4.0
"""Disturbance noise of this observer over that of the control."""

INFORMED = 1.0
"""Information on γ over that of PRIOR_LOG_GAIN, from which on anything is learnt."""

SURE, SURE_OF_LESS = 1.0, 2.5
TOLERATED_LOG_GAIN, TOLERATED_LAG_S = 0.1, 0.02
"""The model in use follows what was found at so many standard deviations, the tolerated ones among them. It
takes more to believe in a vehicle that answers less: more would be asked of it."""

NEAR_LOG_GAIN, NEAR_LAG_S = 0.02, 0.002
"""Observers are looked up again where the model has moved further."""

MEASURED_S, OFTEN = 0.2, 0.7
"""Nothing is learnt of data that come in less than OFTEN of the ticks of MEASURED_S."""

LAG_COUNTS = 0.3
ROUNDING = 1e-15


class ModelState(NamedTuple):
    """The observer of one degree of freedom, its derivatives by γ and T, and the innovations' variances."""

    observer: ObserverState
    by_gain: ObserverState
    by_lag: ObserverState
    position_variance: float
    rate_variance: float
    measured: float
    """The share of the last steps, over MEASURED_S, in which anything was measured."""


class Evidence(NamedTuple):
    """What one tick says of θ: φᵀ S⁻¹ ν, and φᵀ S⁻¹ φ."""

    gain: float
    lag: float
    gain_gain: float
    gain_lag: float
    lag_lag: float


class Found(NamedTuple):
    """What was found of one axis: θ, and R."""

    log_gain: float
    lag_s: float
    gain_gain: float
    gain_lag: float
    lag_lag: float


class Used(NamedTuple):
    """What controller and observer take one axis for: γ and T."""

    log_gain: float
    lag_s: float


NO_EVIDENCE = Evidence(0.0, 0.0, 0.0, 0.0, 0.0)


def start(position: float, measured: float = 1.0) -> ModelState:
    """Observe from a known place; `measured` is how often it was measured before."""
    q, v = START_SPREAD
    return ModelState(at_rest(position), at_rest(0.0), at_rest(0.0), q * q, v * v, measured)


def nothing_found(lag_s: float) -> Found:
    """Return the nominal vehicle, of which nothing was found."""
    return Found(0.0, lag_s, 0.0, 0.0, 0.0)


def observe(
    parameters: ObserverParameters,
    state: ModelState,
    u: float,
    m: float,
    c: float,
    dt_s: float,
    position: float,
    rate: float,
    angular: bool,
) -> tuple[ModelState, Evidence]:
    """Go on by `dt_s`, above zero, under thrust `u` to what was measured there; NaN where nothing was.

    Where less than OFTEN of the steps bring a measurement nothing is said: the Kalman gain is for each step.
    """
    some = 0.0 if math.isnan(position) and math.isnan(rate) else 1.0
    measured = state.measured + (some - state.measured) * (1.0 - math.exp(-dt_s / MEASURED_S))
    if measured < OFTEN:
        place = state.observer if math.isnan(position) else at_rest(position)
        rest = at_rest(0.0)
        return ModelState(
            place, rest, rest, state.position_variance, state.rate_variance, measured
        ), NO_EVIDENCE
    lag_s = parameters.thrust_lag_s
    model = coefficients(parameters, m, c, dt_s)
    _, keep, _, push = model
    slow = math.exp(dt_s / -parameters.slow_time_s)
    q, v, f, d, s, p = state.observer
    q_1, v_1, f_1 = predict_step(model, (q, v, f), u, d)
    observed = ObserverState(q_1, v_1, f_1, d, s * slow, p * slow)
    by_gain = _driven(model, state.by_gain, slow, push * (f + f_1), 0.0)
    more_f = (f - u) * keep * dt_s / (lag_s * lag_s)
    by_lag = _driven(model, state.by_lag, slow, push * more_f, more_f)

    nu_q, nu_v, gain_q, gain_v, lag_q, lag_v = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    spread_q, spread_v = state.position_variance, state.rate_variance
    if not math.isnan(position):
        nu_q = position - (observed.q + observed.s)
        if angular:
            nu_q = (nu_q + math.pi) % (2.0 * math.pi) - math.pi
        gain_q, lag_q = by_gain.q + by_gain.s, by_lag.q + by_lag.s
        spread_q = _spread(spread_q, nu_q, dt_s)
    if not math.isnan(rate):
        nu_v = rate - (observed.v + observed.p)
        gain_v, lag_v = by_gain.v + by_gain.p, by_lag.v + by_lag.p
        spread_v = _spread(spread_v, nu_v, dt_s)
    observed = correct(parameters, observed, nu_q, nu_v)
    by_gain = correct(parameters, by_gain, -gain_q, -gain_v)
    by_lag = correct(parameters, by_lag, -lag_q, -lag_v)
    nu_q, nu_v = limited(nu_q, OUTLIER * math.sqrt(spread_q)), limited(nu_v, OUTLIER * math.sqrt(spread_v))
    weight_q, weight_v = 1.0 / (DOUBTED * spread_q), 1.0 / (DOUBTED * spread_v)
    evidence = Evidence(
        weight_q * gain_q * nu_q + weight_v * gain_v * nu_v,
        weight_q * lag_q * nu_q + weight_v * lag_v * nu_v,
        weight_q * gain_q * gain_q + weight_v * gain_v * gain_v,
        weight_q * gain_q * lag_q + weight_v * gain_v * lag_v,
        weight_q * lag_q * lag_q + weight_v * lag_v * lag_v,
    )
    return ModelState(observed, by_gain, by_lag, spread_q, spread_v, measured), evidence


def _spread(variance: float, nu: float, dt_s: float) -> float:
    """Return the variance of an innovation after one more; an outlier counts as OUTLIER deviations.

    One of exactly zero counts for nothing: telemetry that is constant to the last bit shows no noise.
    """
    if nu == 0.0:
        return variance
    most = OUTLIER * OUTLIER * variance
    squared = nu * nu
    return variance + ((squared if squared < most else most) - variance) * (dt_s / SPREAD_MEMORY_S)


def _driven(
    model: tuple[float, float, float, float], slope: ObserverState, slow: float, more_v: float, more_f: float
) -> ObserverState:
    """Let a derivative go on, which gains `more_v` and `more_f` beside the model's own motion."""
    q, v, f = predict_step(model, (slope.q, slope.v, slope.f), 0.0, slope.d)
    return ObserverState(
        q + model[0] * more_v, v + more_v, f + more_f, slope.d, slope.s * slow, slope.p * slow
    )


def mixed(one: Evidence, share: float, other: Evidence, other_share: float) -> Evidence:
    """Return what two degrees of freedom say of an axis, of which each has a share (cos², sin²)."""
    squared, other_squared = share * share, other_share * other_share
    return Evidence(
        share * one.gain + other_share * other.gain,
        share * one.lag + other_share * other.lag,
        squared * one.gain_gain + other_squared * other.gain_gain,
        squared * one.gain_lag + other_squared * other.gain_lag,
        squared * one.lag_lag + other_squared * other.lag_lag,
    )


def learn(found: Found, evidence: Evidence, dt_s: float) -> Found:
    """Take in the evidence of one tick; θ stays where it is too little."""
    keep = math.exp(-dt_s / MEMORY_S)
    gain_gain = keep * found.gain_gain + evidence.gain_gain
    gain_lag = keep * found.gain_lag + evidence.gain_lag
    lag_lag = keep * found.lag_lag + evidence.lag_lag
    log_gain, lag_s = found.log_gain, found.lag_s
    known = 1.0 / (PRIOR_LOG_GAIN * PRIOR_LOG_GAIN)
    if gain_gain > INFORMED * known:
        a, b = gain_gain + known, lag_lag + 1.0 / (PRIOR_LAG_S * PRIOR_LAG_S)
        determinant = _determinant(a, b, gain_lag)
        more = (b * evidence.gain - gain_lag * evidence.lag) / determinant
        later_s = (a * evidence.lag - gain_lag * evidence.gain) / determinant
        lag_s = clamped(found.lag_s + limited(later_s, LAG_PER_S * dt_s), LEAST_LAG_S, MOST_LAG_S)
        if lag_s == found.lag_s:
            more = evidence.gain / a
        log_gain = clamped(
            found.log_gain + limited(more, LOG_GAIN_PER_S * dt_s), -MOST_LOG_GAIN, MOST_LOG_GAIN
        )
    if not math.isfinite(log_gain + lag_s + gain_gain + lag_lag):
        return found
    return Found(log_gain, lag_s, gain_gain, gain_lag, lag_lag)


def learn_gain(found: Found, evidence: Evidence, of_lag: Found, dt_s: float) -> Found:
    """Take in the evidence of one tick on γ alone; T is what `of_lag` found of it."""
    gain_gain = math.exp(-dt_s / MEMORY_S) * found.gain_gain + evidence.gain_gain
    known = 1.0 / (PRIOR_LOG_GAIN * PRIOR_LOG_GAIN)
    log_gain = found.log_gain
    if gain_gain > INFORMED * known:
        more = limited(evidence.gain / (gain_gain + known), LOG_GAIN_PER_S * dt_s)
        log_gain = clamped(log_gain + more, -MOST_LOG_GAIN, MOST_LOG_GAIN)
    if not math.isfinite(log_gain + gain_gain):
        return found
    return Found(log_gain, of_lag.lag_s, gain_gain, 0.0, of_lag.lag_lag)


def _determinant(a: float, b: float, c: float) -> float:
    """Return a b − c² of a matrix that is positive definite: above zero, whatever rounding leaves."""
    most = a * b
    return max(most - c * c, ROUNDING * most)


def covariance(found: Found) -> tuple[float, float, float]:
    """Return (R + P⁻¹)⁻¹: variance of γ, covariance, variance of T."""
    a = found.gain_gain + 1.0 / (PRIOR_LOG_GAIN * PRIOR_LOG_GAIN)
    b = found.lag_lag + 1.0 / (PRIOR_LAG_S * PRIOR_LAG_S)
    determinant = _determinant(a, b, found.gain_lag)
    return b / determinant, -found.gain_lag / determinant, a / determinant


def doubt(found: Found) -> tuple[float, float]:
    """Return the standard deviations of γ and T."""
    gain, _, lag = covariance(found)
    return square_root(gain), square_root(lag)


def longest_lag_s(found: Found) -> float:
    """Return the lag that was found and its standard deviation more, s."""
    return found.lag_s + doubt(found)[1]


def follow(used: Used, found: Found) -> Used:
    """Return the model to use: the one in use as long as it may be true, else nearer to what was found.

    It goes along the straight line to θ until θ is so many standard deviations away.
    """
    gain, both, lag = covariance(found)
    gain = gain + TOLERATED_LOG_GAIN * TOLERATED_LOG_GAIN
    lag = lag + TOLERATED_LAG_S * TOLERATED_LAG_S
    off, off_s = used.log_gain - found.log_gain, used.lag_s - found.lag_s
    determinant = _determinant(gain, lag, both)
    squared = (lag * off * off - 2.0 * both * off * off_s + gain * off_s * off_s) / determinant
    sure = SURE_OF_LESS if off > 0.0 else SURE
    if not squared > sure * sure:
        return used
    share = sure / math.sqrt(squared)
    return Used(found.log_gain + share * off, found.lag_s + share * off_s)


class Tables(NamedTuple):
    """Observers of one degree of freedom by gain and lag: those of the control, and the one in here."""

    control: tuple[ObserverTable, ObserverTable, ObserverTable, ObserverTable]
    """For each of `observer.INTERVALS`."""
    here: ObserverTable


class Scheduled(NamedTuple):
    """Both observers' parameters, and the model for which they were looked up."""

    at: Used
    control: ByInterval
    here: ObserverParameters


def schedule(tables: Tables, used: Used) -> Scheduled:
    """Look up both observers for a model."""
    one, two, three, four = tables.control
    return Scheduled(
        used,
        (
            scheduled_parameters(one, used.log_gain, used.lag_s),
            scheduled_parameters(two, used.log_gain, used.lag_s),
            scheduled_parameters(three, used.log_gain, used.lag_s),
            scheduled_parameters(four, used.log_gain, used.lag_s),
        ),
        scheduled_parameters(tables.here, used.log_gain, used.lag_s),
    )


def is_near(scheduled: Scheduled, used: Used) -> bool:
    """Tell whether the observers that were looked up are as good for the model in use now."""
    at = scheduled.at
    return abs(used.log_gain - at.log_gain) <= NEAR_LOG_GAIN and abs(used.lag_s - at.lag_s) <= NEAR_LAG_S


def later_s(used: Used, nominal_lag_s: float) -> float:
    """Return the delay (s) for which gains are drawn back beside the loop's own.

    A lag beyond the nominal one counts for a part: the prediction makes up for the rest.
    """
    return LAG_COUNTS * (used.lag_s - nominal_lag_s) if used.lag_s > nominal_lag_s else 0.0
