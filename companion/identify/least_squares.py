"""The parameters of the smallest sum of squared residuals, within bounds (Levenberg, Marquardt).

The residuals come in parts: some parameters are shared by all, others are each part's own.
"""

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np

from companion.records import Array

Residuals = Callable[[Array], Array]
Bounds = tuple[Array, Array]
ROUNDS, TOLERANCE = 40, 1e-5
"""It ends once a round lowers the sum of squares by less than this share."""
DAMPINGS: Final = (1e-3, 1e-1, 1e1, 1e3)


class Found(NamedTuple):
    """By part the parameters (parts, n), the residuals, and their Jacobian (residuals, shared and own)."""

    theta: Array
    r: list[Array]
    J: list[Array]
    columns: list[list[int]]
    """By part the places of its free parameters among all: first the shared ones, then each part's own."""
    free: int
    """How many parameters are free."""


def least_squares(
    parts: Sequence[Residuals],
    theta: Array,
    free: tuple[Sequence[int], Sequence[int]],
    steps: Array,
    bounds_at: Callable[[Array], Bounds],
    progress: Callable[[float], None] = lambda share: None,
    pull: Array | float = 0.0,
) -> Found:
    """Search from `theta` on.

    Args:
        parts: each gives its residuals at its parameters.
        theta: where all begin; what is not `free` stays.
        free: numbers of the parameters that are looked for: shared ones, and each part's own.
        steps: small changes of each, for the slope.
        bounds_at: gives the least and the largest parameters of a round that begins at these (parts, n).
        progress: is told a share of 1.
        pull: by parameter, how much of a residual a part has for each unit that it is away from zero.

    """
    shared, own = ([*numbers] for numbers in free)
    numbers, count = [*shared, *own], len(shared) + len(parts) * len(own)
    columns = [
        [*range(len(shared)), *range(len(shared) + i * len(own), len(shared) + (i + 1) * len(own))]
        for i in range(len(parts))
    ]
    theta, pull = np.tile(theta, (len(parts), 1)), np.broadcast_to(pull, theta.shape)

    def cost(theta: Array, r: Sequence[Array]) -> float:
        return float(sum(one @ one for one in r) + np.sum((pull * theta) ** 2))

    r = [part(row) for part, row in zip(parts, theta, strict=True)]
    for done in range(ROUNDS):
        progress(done / ROUNDS)
        least, most = bounds_at(theta)
        J = [_jacobian(*each, numbers, steps, most) for each in zip(parts, theta, r, strict=True)]
        before = cost(theta, r)
        curvature, gradient = _sums(columns, J, r, count)
        for row, places in zip(theta, columns, strict=True):
            curvature[places, places] += pull[numbers] ** 2
            gradient[places] += pull[numbers] ** 2 * row[numbers]
        values = np.concatenate((theta[0, shared], theta[:, own].ravel()))
        ends = [np.concatenate((end[shared], np.tile(end[own], len(parts)))) for end in (least, most)]
        stays = ((values <= ends[0]) & (gradient > 0.0)) | ((values >= ends[1]) & (gradient < 0.0))
        curvature[stays], gradient[stays] = np.eye(count)[stays], 0.0
        for damping in DAMPINGS:
            damped = curvature + damping * np.diag(np.diag(curvature) + 1e-12)
            step = np.linalg.lstsq(damped, -gradient, rcond=None)[0]
            tried = theta.copy()
            for row, places in zip(tried, columns, strict=True):
                row[numbers] += step[places]
            tried[:, numbers] = np.clip(tried, least, most)[:, numbers]
            after = [part(row) for part, row in zip(parts, tried, strict=True)]
            if (now := cost(tried, after)) < before:
                break
        else:
            return Found(theta, r, J, columns, count)
        theta, r = tried, after
        if now > (1.0 - TOLERANCE) * before:
            break
    most = bounds_at(theta)[1]
    J = [_jacobian(*each, numbers, steps, most) for each in zip(parts, theta, r, strict=True)]
    return Found(theta, r, J, columns, count)


def jackknife(found: Found, blocks: Sequence[Array]) -> Array:
    """Return the covariance of the free parameters; errors within a block may be correlated as they like.

    It is the scatter of what is found when each block is left out, to first order (Quenouille, Biometrika,
    1956). `blocks` numbers by part the block of each of the equally long pieces of its residuals.
    """
    sums = []
    for J, r, places, block in zip(found.J, found.r, found.columns, blocks, strict=True):
        rows = np.repeat(block, r.size // block.size)
        sums += [_sums([places], [J[rows == one]], [r[rows == one]], found.free) for one in np.unique(block)]
    curvature = np.sum([A for A, _ in sums], axis=0)
    changes = np.array([np.linalg.lstsq(curvature - A, g, rcond=1e-12)[0] for A, g in sums])
    centred = changes - changes.mean(axis=0)
    return np.asarray((len(sums) - 1) / len(sums) * centred.T @ centred)


def _sums(
    columns: Sequence[Sequence[int]], J: Sequence[Array], r: Sequence[Array], count: int
) -> tuple[Array, Array]:
    """Return JᵀJ and Jᵀr of parts."""
    curvature, gradient = np.zeros((count, count)), np.zeros(count)
    for places, of_part, residuals in zip(columns, J, r, strict=True):
        curvature[np.ix_(places, places)] += of_part.T @ of_part
        gradient[places] += of_part.T @ residuals
    return curvature, gradient


def _jacobian(
    residuals: Residuals, theta: Array, r: Array, numbers: Sequence[int], steps: Array, most: Array
) -> Array:
    columns = []
    for i in numbers:
        other = theta.copy()
        other[i] += steps[i] if theta[i] + steps[i] <= most[i] else -steps[i]
        columns.append((residuals(other) - r) / (other[i] - theta[i]))
    return np.column_stack(columns)
