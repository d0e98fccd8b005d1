"""The linear regressor: a compensator that knows the shape of what it does not know.

    d̂ = Wᵀ φ        φ = [1, e, ė, ẋ, ẋ|ẋ|, ẍ_d]        Ẇ = −η ε φ − ℓ W

Its terms are those by which damping, mass and weight can be off; it is the network without a hidden layer.
"""

from typing import Self

import numpy as np

from lab.batch.legacy.bounds import bounded
from lab.batch.legacy.compensator import INPUTS, dead_zone_error
from lab.batch.legacy.network import Learning
from lab.batch.legacy.records import Array, Flags


class Regressor:
    """Weights W of shape (*shape, INPUTS), zero at the start: the plain law."""

    def __init__(self, learning: Learning, shape: tuple[int, ...]) -> None:
        self.learning = learning
        self._shape = shape
        self.reset()

    def reset(self) -> None:
        """Forget what was learnt."""
        self.W = np.zeros((*self._shape, INPUTS))
        self.learning_now = np.zeros(self._shape, bool)

    def inherit(self, predecessor: Self, where: Flags) -> None:
        """Take over the weights of `predecessor` `where` it served."""
        self.W = np.where(where[..., None], predecessor.W, self.W)

    def seed(self, theta: Array, d_hat: Array, where: Flags) -> None:
        """Answer `theta` with `d_hat` `where` asked, by the smallest change of W."""
        phi = _terms(theta)
        missing = (bounded(d_hat, self.learning.d_max) - np.vecdot(self.W, phi)) * where
        self.W = self.W + (missing / np.vecdot(phi, phi))[..., None] * phi

    def step(self, theta: Array, eps: Array, dt_s: Array | float, adapt: Flags) -> Array:
        """Return d_hat, having learnt from `eps` for `dt_s` where `adapt` allows it."""
        gains = self.learning
        phi = _terms(theta)
        raw = np.vecdot(self.W, phi)
        self.learning_now, felt = dead_zone_error(raw, eps, adapt, gains.dead_zone, gains.d_max)
        keep = (1.0 - dt_s * gains.leak * self.learning_now)[..., None]
        self.W = keep * self.W - (dt_s * gains.eta * felt)[..., None] * phi
        return bounded(np.vecdot(self.W, phi), gains.d_max)

    @property
    def weight_norm(self) -> Array:
        """Euclidean norm of W, of the shape of ε."""
        return np.asarray(np.sqrt(np.vecdot(self.W, self.W)))


def _terms(theta: Array) -> Array:
    phi = theta.copy()
    phi[..., 4] = theta[..., 3] * np.abs(theta[..., 3])
    return phi
