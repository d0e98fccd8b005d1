"""The parameters of the smallest sum of squared residuals, within bounds (Levenberg, Marquardt)."""

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np

from companion.records import Array

Residuals = Callable[[Array], Array]
Bounds = tuple[Array, Array]
ROUNDS, TOLERANCE = 40, 1e-6
"""It ends once a round lowers the sum of squares by less than this share."""
DAMPINGS: Final = (1e-3, 1e-1, 1e1, 1e3)


class Found(NamedTuple):
    """Parameters, the Jacobian (n, free) there, and the residuals (n,)."""

    theta: Array
    J: Array
    r: Array


def least_squares(
    residuals: Residuals,
    theta: Array,
    free: Sequence[int],
    steps: Array,
    bounds_at: Callable[[Array], Bounds],
    progress: Callable[[float], None] = lambda share: None,
) -> Found:
    """Search from `theta` on.

    Args:
        residuals: gives the residuals at parameters.
        theta: where it begins; what is not `free` stays.
        free: numbers of the parameters that are looked for.
        steps: small changes of each, for the slope.
        bounds_at: gives the least and the largest parameters of a round that begins at these.
        progress: is told a share of 1.

    """
    r = residuals(theta)
    for done in range(ROUNDS):
        progress(done / ROUNDS)
        least, most = bounds_at(theta)
        at = Found(theta, _jacobian(residuals, theta, r, free, steps, most), r)
        better = _better(residuals, at, free, least, most)
        if better is None:
            return at
        theta, r = better
        if float(r @ r) > (1.0 - TOLERANCE) * float(at.r @ at.r):
            break
    return Found(theta, _jacobian(residuals, theta, r, free, steps, bounds_at(theta)[1]), r)


def sandwich(found: Found, block: Array) -> Array:
    """Return the covariance of the free parameters; errors within a block may be correlated as they like.

    `block` numbers the block of each of the equally long parts that the residuals consist of. (White,
    Econometrica, 1980; Liang and Zeger, Biometrika, 1986.)
    """
    free = found.J.shape[1]
    scores = (found.J * found.r[:, None]).reshape(block.size, -1, free).sum(axis=1)
    blocks, which = np.unique(block, return_inverse=True)
    sums = np.zeros((blocks.size, free))
    np.add.at(sums, which, scores)
    inverse = np.linalg.pinv(found.J.T @ found.J, hermitian=True)
    return np.asarray(inverse @ (sums.T @ sums) @ inverse)


def _better(
    residuals: Residuals, at: Found, free: Sequence[int], least: Array, most: Array
) -> tuple[Array, Array] | None:
    """Return parameters with a smaller sum of squares, and their residuals; None where there are none."""
    gradient, curvature = at.J.T @ at.r, at.J.T @ at.J
    for damping in DAMPINGS:
        damped = curvature + damping * np.diag(np.diag(curvature) + 1e-12)
        tried = at.theta.copy()
        tried[free] += np.linalg.lstsq(damped, -gradient, rcond=None)[0]
        tried[free] = np.clip(tried[free], least[free], most[free])
        r = residuals(tried)
        if r @ r < at.r @ at.r:
            return tried, r
    return None


def _jacobian(
    residuals: Residuals, theta: Array, r: Array, free: Sequence[int], steps: Array, most: Array
) -> Array:
    columns = []
    for i in free:
        other = theta.copy()
        other[i] += steps[i] if theta[i] + steps[i] <= most[i] else -steps[i]
        columns.append((residuals(other) - r) / (other[i] - theta[i]))
    return np.column_stack(columns)
