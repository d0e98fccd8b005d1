"""The three-layer network that learns the disturbance on-line (eq. ann), one for each degree of freedom.

d̂ = Wᵀ σ(Vᵀ θ): V feeds the hidden layer and W the output (the paper's text swaps the two), σ is the logistic
function. Back-propagation of the combined error ε, with leak, dead zone, projection and freeze:

    Ẇ = −η ε σ − ℓ W                    V̇ = −η_V ε θ (W ∘ σ')ᵀ − ℓ (V − V(0))

The sign follows from m ε̇ = −m κ ε + d̂ − d*: a positive ε asks for a smaller d̂.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from lab.batch.legacy.bounds import bounded
from lab.batch.legacy.compensator import dead_zone_error
from lab.batch.legacy.records import Array, Flags

SATURATED_SIGMOID = 40.0


@dataclass(frozen=True, slots=True)
class Learning:
    """How the weights move; each of the shape of ε or a scalar.

    `eta` is η, N/(m·s⁻¹·s) in heave; `eta_v` is η_V (0 freezes the hidden layer); `leak` is ℓ, 1/s;
    `dead_zone` is the |ε| below which nothing is learnt; `d_max` bounds |d̂|, N or N·m.
    """

    eta: Array
    eta_v: Array
    leak: Array
    dead_zone: Array
    d_max: Array


class Network:
    """Weights and their on-line back-propagation; `shape` is that of ε: (4,), or (dives, 4) in the lab.

    W starts at zero, so that an untrained network is the plain law; V ~ N(0, 1) from `seed`, the same for
    every member of `shape`.
    """

    def __init__(
        self, learning: Learning, shape: tuple[int, ...], inputs: int, units: int, seed: int
    ) -> None:
        self.learning = learning
        self._V_start = np.random.default_rng(seed).standard_normal((inputs, units))
        self._shape = shape
        self._deep = bool(np.any(np.asarray(learning.eta_v)))
        self.reset()

    def reset(self) -> None:
        """Forget what was learnt."""
        self.W = np.zeros((*self._shape, self._V_start.shape[1]))
        self.V = np.broadcast_to(self._V_start, (*self._shape, *self._V_start.shape))
        self.learning_now = np.zeros(self._shape, bool)

    def inherit(self, predecessor: Self, where: Flags) -> None:
        """Take over both layers of `predecessor`, of the same size and seed, `where` it served."""
        self.W = np.where(where[..., None], predecessor.W, self.W)
        self.V = np.where(where[..., None, None], predecessor.V, self.V)

    def seed(self, theta: Array, d_hat: Array, where: Flags) -> None:
        """Answer `theta` with `d_hat` `where` asked, by the smallest change of W."""
        sigma = self._hidden(theta)
        missing = (bounded(d_hat, self.learning.d_max) - np.vecdot(self.W, sigma)) * where
        self.W = self.W + (missing / np.vecdot(sigma, sigma))[..., None] * sigma

    def step(self, theta: Array, eps: Array, dt_s: Array | float, adapt: Flags) -> Array:
        """Return d_hat, having learnt from `eps` for `dt_s` where `adapt` allows it.

        `theta` has shape (*shape, inputs). Where the projection holds and learning would push d̂ further
        outward, learning stops as well; `learning_now` tells where it went on.
        """
        gains = self.learning
        sigma = self._hidden(theta)
        raw = np.vecdot(self.W, sigma)
        self.learning_now, felt = dead_zone_error(raw, eps, adapt, gains.dead_zone, gains.d_max)
        if self.learning_now.any():
            keep = (1.0 - dt_s * gains.leak * self.learning_now)[..., None]
            if self._deep:
                slope = self.W * sigma * (1.0 - sigma)
                step_v = (
                    (dt_s * gains.eta_v * felt)[..., None, None] * theta[..., :, None] * slope[..., None, :]
                )
                self.V = keep[..., None] * (self.V - self._V_start) + self._V_start - step_v
            self.W = keep * self.W - (dt_s * gains.eta * felt)[..., None] * sigma
            raw = np.vecdot(self.W, sigma)
        return bounded(raw, gains.d_max)

    def _hidden(self, theta: Array) -> Array:
        return np.asarray(1.0 / (1.0 + np.exp(np.minimum(-np.vecmat(theta, self.V), SATURATED_SIGMOID))))

    @property
    def weight_norm(self) -> Array:
        """Euclidean norm of W, of the shape of ε."""
        return np.asarray(np.sqrt(np.vecdot(self.W, self.W)))
