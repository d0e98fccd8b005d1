"""The plainest compensator: the disturbance is whatever the combined error has piled up to.

    d̂' = −k ε − ℓ d̂

with the network's leak, dead zone, projection and freeze, and its interface. It is the yardstick: near an
equilibrium a network of n logistic units is an integrator of gain η‖σ‖² ≈ η n/4.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from lab.batch.legacy.bounds import bounded
from lab.batch.legacy.compensator import dead_zone_error
from lab.batch.legacy.records import Array, Flags


@dataclass(frozen=True, slots=True)
class Integration:
    """How d̂ moves; each of the shape of ε or a scalar.

    `k` is in N/(m·s⁻¹·s) in heave; `leak` is ℓ, 1/s; `dead_zone` is the |ε| below which nothing is piled up;
    `d_max` bounds |d̂|, N or N·m.
    """

    k: Array
    leak: Array
    dead_zone: Array
    d_max: Array


class Integrator:
    """d̂ of the shape of ε: (4,), or (dives, 4) in the lab. It starts at zero: the plain law."""

    def __init__(self, integration: Integration, shape: tuple[int, ...]) -> None:
        self.integration = integration
        self._shape = shape
        self.reset()

    def reset(self) -> None:
        """Forget what was learnt."""
        self.d_hat = np.zeros(self._shape)
        self.learning_now = np.zeros(self._shape, bool)

    def inherit(self, predecessor: Self, where: Flags) -> None:
        """Take over what `predecessor` has piled up `where` it served."""
        self.seed(np.empty(0), predecessor.d_hat, where)

    def seed(self, theta: Array, d_hat: Array, where: Flags) -> None:
        """Begin with `d_hat` `where` asked; `theta` is unused."""
        del theta
        self.d_hat = np.where(where, bounded(d_hat, self.integration.d_max), self.d_hat)

    def step(self, theta: Array, eps: Array, dt_s: Array | float, adapt: Flags) -> Array:
        """Return d_hat, having learnt from `eps` for `dt_s` where `adapt` allows it; `theta` is unused.

        Where the projection holds and learning would push d̂ further outward, learning stops as well;
        `learning_now` tells where it went on.
        """
        del theta
        gains = self.integration
        self.learning_now, felt = dead_zone_error(self.d_hat, eps, adapt, gains.dead_zone, gains.d_max)
        keep = 1.0 - dt_s * gains.leak * self.learning_now
        self.d_hat = bounded(keep * self.d_hat - dt_s * gains.k * felt, gains.d_max)
        return self.d_hat

    @property
    def weight_norm(self) -> Array:
        """|d̂|, N or N·m: all that it has learnt."""
        return np.abs(self.d_hat)
