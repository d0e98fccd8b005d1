"""Mass and damping of one degree of freedom from what was recorded, with their doubt.

Over windows of a second the momentum balance  m Δv + d1 ∫v + d2 ∫|v|v + b Δt = ∫tau  is linear in what is
looked for, and differentiates nothing: acceleration is too noisy, and the observer's is what the model says.
Thrust answers to waves and currents, so plain least squares would take those for mass. The reference knows
nothing of them: the same integrals over the desired motion serve as instruments (two-stage least squares),
and a dive in which nothing was asked to move tells nothing.

`holdfast identify`'s fits have no instruments. On the dive of `test_report.py`, true mass 32.2 kg, they found
33 ± 1.3 (manoeuvre's fit) and 37 ± 1.7 kg (fit of logs) in calm water, in waves 53 ± 5 and 96 ± 7 kg.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

WINDOW_S = 1.0
BLOCK_S = 5.0
DRAWS = 200
TRUSTED = 0.1
"""A standard deviation above this share of the value says that the dive does not tell."""


@dataclass(frozen=True)
class Identified:
    """A value, its standard deviation, and whether the dive tells it."""

    value: float
    sigma: float

    @property
    def identified(self) -> bool:
        """Whether the doubt is small beside the value, and the value possible."""
        return self.value > 0.0 and self.sigma < TRUSTED * self.value


@dataclass(frozen=True)
class IdentifiedModel:
    """Mass (kg, kg m²), linear damping (N s/m), quadratic (N s²/m²), bias (N): what a steady force it takes.

    `damping_at` is the force that the damping takes at the dive's typical speed `speed`, which is known much
    better than its two parts.
    """

    mass: Identified
    linear: Identified
    quadratic: Identified
    bias: Identified
    damping_at: Identified
    speed: float


def identify(
    t_s: Array, rate: Array, desired_rate: Array, tau: Array, delay_s: float, lag_s: float
) -> IdentifiedModel | None:
    """Fit the model to one stretch of rates (m/s, rad/s) and delivered force (N, N·m); None if too short.

    `tau` acts `delay_s` after it was sent, through a first-order lag. The doubt comes from drawing blocks of
    five seconds again and again, for neighbouring errors are correlated.
    """
    dt_s = float(np.median(np.diff(t_s))) if t_s.size > 2 else 0.0
    step = round(WINDOW_S / dt_s) if dt_s > 0.0 else 0
    if step < 2 or t_s.size < 12 * step:
        return None
    acting = _lagged(np.interp(t_s - delay_s, t_s, tau), dt_s, lag_s)
    starts = np.arange(0, t_s.size - step, step // 2)
    span_s = t_s[starts + step] - t_s[starts]
    whole = span_s < 1.2 * WINDOW_S  # not across a gap
    starts, span_s = starts[whole], span_s[whole]

    def over(values: Array) -> Array:
        sums = np.concatenate(([0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(t_s))))
        return sums[starts + step] - sums[starts]

    def momentum(v: Array) -> Array:
        return np.column_stack((v[starts + step] - v[starts], over(v), over(np.abs(v) * v), span_s))

    A, Z, b = momentum(rate), momentum(desired_rate), over(acting)
    sound = np.isfinite(A).all(axis=1) & np.isfinite(Z).all(axis=1) & np.isfinite(b)
    A, Z, b = A[sound], Z[sound], b[sound]
    block = max(1, round(2.0 * BLOCK_S / WINDOW_S))
    count = len(b) // block
    if count < 6:
        return None
    speed = float(np.sqrt(np.nanmean(rate**2)))
    rng = np.random.default_rng(0)
    fits = []
    for _ in range(DRAWS):
        rows = (block * rng.integers(0, count, count)[:, None] + np.arange(block)).ravel()
        fits.append(_two_stage(A[rows], Z[rows], b[rows]))
    found, drawn = _two_stage(A, Z, b), np.array(fits)
    sigma = _spread(drawn)
    mass, linear, quadratic, bias = (
        Identified(float(value), float(doubt)) for value, doubt in zip(found, sigma, strict=True)
    )
    at = np.array([0.0, speed, speed**2, 0.0])
    return IdentifiedModel(
        mass, linear, quadratic, bias, Identified(float(found @ at), float(_spread(drawn @ at))), speed
    )


def _two_stage(A: Array, Z: Array, b: Array) -> Array:
    """Return x of A x = b as far as the instruments Z explain A."""
    explained = Z @ np.linalg.lstsq(Z, A, rcond=None)[0]
    return np.asarray(np.linalg.lstsq(explained, b, rcond=None)[0], np.float64)


def _spread(drawn: Array) -> Array:
    """Return half of what 68 % of the draws lie in: a few wild draws do not count."""
    low, high = np.percentile(drawn, (15.9, 84.1), axis=0)
    return np.asarray(0.5 * (high - low))


def _lagged(values: Array, dt_s: float, lag_s: float) -> Array:
    """Return what a first-order lag makes of `values`."""
    keep = float(np.exp(-dt_s / lag_s)) if lag_s > 0.0 else 0.0
    out = np.empty_like(values)
    state = values[0]
    for i, value in enumerate(values):
        state = keep * state + (1.0 - keep) * value
        out[i] = state
    return out
