"""The delay that no stamp shows: what the autopilot's own filter adds, found in the observer's innovations.

Recursive prediction error method (Ljung 1999, ch. 11) for one number, the delay x. An observer of its own,
which believes in small disturbances and so leans on the model, predicts each measurement; the derivative of
its error ν by x is the same observer driven by −u' and by no measurement. Where ν has that shape, x is off:

    ψ = ∂ν/∂x        I' = ψᵀ S⁻¹ ψ − I/T        x' = −ψᵀ S⁻¹ ν / (I + I₀)

A slower thruster than believed looks alike, and does the same harm. It tends to find half of what is there
rather than too much: noise that went around the loop pulls it down (docs/theory.md).
"""

import numpy as np

from lab.batch.legacy.observer import Noise, Observer
from lab.batch.legacy.records import Array

MEMORY_S = 20.0
SPREAD_MEMORY_S = 10.0
PRIOR_S = 0.02
"""Standard deviation of what is hidden, as far as is known beforehand."""

LARGEST_S = 0.1
SLEW = 0.02
"""Seconds of delay a second at most."""

START_SPREAD = (0.002, 0.004)
"""Innovations' standard deviation to begin with, m and m/s."""


class HiddenDelay:
    """Finds `hidden_s` of one degree of freedom, for vehicles of any leading shape (…).

    `hidden_s` stays between 0 and LARGEST_S; without commands that vary it stays as it is.
    """

    def __init__(self, m: Array, c: Array, thrust_lag_s: float, noise: Noise, dt_s: float) -> None:
        """Take inertia, drag and noise of the degree of freedom, (1,) each, and the tick `dt_s`."""
        self._observer = Observer(m, c, thrust_lag_s, noise, dt_s)
        self.hidden_s: Array = np.zeros(())
        self.restart(0.0)

    def restart(self, position: Array | float) -> None:
        """Observe anew from a known place (…); what was found stays where it is finite and the shape does."""
        start = np.asarray(position, float)
        self._observer.x = np.zeros((2, *start.shape, 1, 6))  # the observer, and its derivative by x
        self._observer.x[0, ..., 0, 0] = start
        self._u: Array | None = None
        self._information = np.zeros(start.shape)
        self._variance = np.broadcast_to(np.square(START_SPREAD), (*start.shape, 2))
        if self.hidden_s.shape != start.shape or not np.isfinite(self.hidden_s).all():
            self.hidden_s = np.zeros(start.shape)

    def step(self, u: Array, m: Array, c: Array, dt_s: Array, measured: Array) -> None:
        """Go on by `dt_s` (…), above zero, under thrust `u` (…) to position and rate `measured` (…, 2) there.

        Inertia `m` and drag `c` are (…); what was not measured is NaN.
        """
        u = np.asarray(u)
        slope = ((u if self._u is None else self._u) - u) / dt_s
        self._u = u
        observer = self._observer
        observer.advance(np.array((u, slope))[..., None], m[..., None], c[..., None], dt_s[..., None])
        error = -observer.expected
        error[0] += measured[..., None, :]
        error = np.where(np.isnan(error[0]), 0.0, error)
        observer.correct(error)
        nu, psi = error[..., 0, :]
        self._variance = (
            self._variance + (nu != 0.0) * (nu * nu - self._variance) * (dt_s / SPREAD_MEMORY_S)[..., None]
        )
        weighed = psi / self._variance
        self._information = self._information * np.exp(-dt_s / MEMORY_S) + np.vecdot(weighed, psi)
        wanted = -np.vecdot(weighed, nu) / (self._information + PRIOR_S**-2)
        change = np.minimum(np.maximum(wanted, -SLEW * dt_s), SLEW * dt_s)
        self.hidden_s = np.minimum(np.maximum(self.hidden_s + change, 0.0), LARGEST_S)
