"""What a compensator is: it estimates the disturbance d̂ that the law then cancels.

One file each: `integrator.py`, `regressor.py`, `network.py`; the extended-state observer's d comes with the
vehicle's state and needs no file. All follow the same conventions of learning, which `dead_zone_error` holds:
leak, dead zone on ε, projection |d̂| ≤ d_max without pushing further outward, freeze where not allowed.
"""

from typing import Protocol, Self

import numpy as np

from lab.batch.legacy.bounds import bounded
from lab.batch.legacy.records import Array, Flags

INPUTS = 6


class Compensator(Protocol):
    """Learns d̂ from the combined error ε, over arrays of any leading shape."""

    learning_now: Flags
    """Where it learnt at the last step; of the shape of ε."""

    @property
    def weight_norm(self) -> Array:
        """Euclidean norm of what it has learnt, of the shape of ε."""

    def reset(self) -> None:
        """Forget what was learnt."""

    def inherit(self, predecessor: Self, where: Flags) -> None:
        """Know what `predecessor`, of the same kind and size, has learnt `where` it served."""

    def seed(self, theta: Array, d_hat: Array, where: Flags) -> None:
        """Answer `theta` with `d_hat` from now on, `where` asked, by the least change of what was learnt."""

    def step(self, theta: Array, eps: Array, dt_s: Array | float, adapt: Flags) -> Array:
        """Return d̂ for inputs `theta` (…, INPUTS), having learnt from `eps` where `adapt` allows it."""


def dead_zone_error(
    d_hat: Array, eps: Array, adapt: Flags, dead_zone: Array, d_max: Array
) -> tuple[Flags, Array]:
    """Return where learning goes on, and the ε that is learnt from, zero elsewhere.

    Learning stops where the projection holds and ε would push d̂ further outward.
    """
    outward = (np.abs(d_hat) >= d_max) & (d_hat * eps < 0.0)
    learning = adapt & ~outward
    return learning, (eps - bounded(eps, dead_zone)) * learning


def inputs(e: Array, e_dot: Array, x_dot: Array, x_d_dot: Array, x_d_ddot: Array) -> Array:
    """Return θ = [1, 10 e, 5 ė, 5 ẋ, 5 ẋ_d, 5 ẍ_d] on a new last axis.

    The inputs that carry rates are what earns a network its place: a bias alone limit-cycles under delay.
    """
    theta = np.empty((*e.shape, INPUTS))
    theta[..., 0] = 0.2
    theta[..., 1] = 2.0 * e
    theta[..., 2] = e_dot
    theta[..., 3] = x_dot
    theta[..., 4] = x_d_dot
    theta[..., 5] = x_d_ddot
    theta *= 5.0
    return theta
