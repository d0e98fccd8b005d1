"""The parameters of the smallest sum of squared residuals, within bounds (Levenberg, Marquardt).

The residuals come in parts, each with its row of parameters: some are the same in all rows, others its own.
"""

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np

from companion.arrays import Array

Residuals = Callable[[Array], Array]
Bounds = tuple[Array, Array]
ROUNDS, TOLERANCE = 40, 1e-5
"""It ends once a round lowers the sum of squares by less than this share."""
DAMPINGS: Final = (1e-3, 1e-1, 1e1, 1e3)


class Solution(NamedTuple):
    """The parameters (parts, n), and by part the residuals and their slopes (residuals, free parameters)."""

    theta: Array
    r: list[Array]
    J: list[Array]


class _Problem(NamedTuple):
    parts: Sequence[Residuals]
    columns: list[tuple[list[int], int]]
    """Each free parameter: its parts and its number."""
    steps: Array
    pull: Array

    def residuals(self, theta: Array) -> list[Array]:
        return [part(row) for part, row in zip(self.parts, theta, strict=True)]

    def cost(self, theta: Array, r: Sequence[Array]) -> float:
        return float(sum(one @ one for one in r) + np.sum((self.pull * theta) ** 2))

    def slopes(self, theta: Array, r: Sequence[Array], most: Array) -> list[Array]:
        J = [np.zeros((one.size, len(self.columns))) for one in r]
        for column, (rows, i) in enumerate(self.columns):
            for k in rows:
                other = theta[k].copy()
                other[i] += self.steps[i] if other[i] + self.steps[i] <= most[i] else -self.steps[i]
                J[k][:, column] = (self.parts[k](other) - r[k]) / (other[i] - theta[k, i])
        return J

    def gauss_newton(self, theta: Array, r: Sequence[Array], bounds: Bounds) -> tuple[Array, Array]:
        """Return curvature and gradient; what a bound holds is left out."""
        least, most = bounds
        curvature, gradient = _sums(self.slopes(theta, r, most), r)
        for column, (rows, i) in enumerate(self.columns):
            curvature[column, column] += len(rows) * self.pull[i] ** 2
            gradient[column] += self.pull[i] ** 2 * theta[rows, i].sum()
            value, downhill = theta[rows[0], i], gradient[column] > 0.0
            if (downhill and value <= least[i]) or (gradient[column] < 0.0 and value >= most[i]):
                curvature[column], gradient[column] = np.eye(len(self.columns))[column], 0.0
        return curvature, gradient


def least_squares(
    parts: Sequence[Residuals],
    theta: Array,
    free: tuple[Sequence[int], Sequence[int]],
    steps: Array,
    bounds_at: Callable[[Array], Bounds],
    pull: Array | None = None,
) -> Solution:
    """Search from `theta` on, where all parts begin; what is not `free` (shared, and each part's own) stays.

    `steps` are small changes for the slope, `bounds_at` gives the least and the largest parameters of a round
    that begins at these (parts, n), `pull` how much of a residual a part has for each unit away from zero.
    """
    columns = [([*range(len(parts))], i) for i in free[0]]
    columns += [([k], i) for k in range(len(parts)) for i in free[1]]
    problem = _Problem(parts, columns, steps, np.zeros(theta.size) if pull is None else pull)
    theta = np.tile(theta, (len(parts), 1))
    r = problem.residuals(theta)
    for _ in range(ROUNDS):
        least, most = bounds_at(theta)
        before = problem.cost(theta, r)
        curvature, gradient = problem.gauss_newton(theta, r, (least, most))
        for damping in DAMPINGS:
            damped = curvature + damping * np.diag(np.diag(curvature) + 1e-12)
            changes, tried = np.linalg.lstsq(damped, -gradient, rcond=None)[0], theta.copy()
            for change, (rows, i) in zip(changes, columns, strict=True):
                tried[rows, i] = np.clip(theta[rows, i] + change, least[i], most[i])
            after = problem.residuals(tried)
            if (now := problem.cost(tried, after)) < before:
                break
        else:
            break
        theta, r = tried, after
        if now > (1.0 - TOLERANCE) * before:
            break
    return Solution(theta, r, problem.slopes(theta, r, bounds_at(theta)[1]))


def jackknife(found: Solution, blocks: Sequence[Array]) -> Array:
    """Return the covariance of the free parameters; errors within a block may be correlated as they like.

    It is the scatter of what is found when each block is left out, to first order (Quenouille, Biometrika,
    1956). `blocks` numbers by part the block of each of the equally long pieces of its residuals.
    """
    sums = []
    for J, r, block in zip(found.J, found.r, blocks, strict=True):
        rows = np.repeat(block, r.size // block.size)
        sums += [_sums([J[rows == one]], [r[rows == one]]) for one in np.unique(block)]
    curvature = np.sum([A for A, _ in sums], axis=0)
    changes = np.array([np.linalg.lstsq(curvature - A, g, rcond=1e-12)[0] for A, g in sums])
    centred = changes - changes.mean(axis=0)
    return np.asarray((len(sums) - 1) / len(sums) * centred.T @ centred)


def _sums(J: Sequence[Array], r: Sequence[Array]) -> tuple[Array, Array]:
    pairs = [*zip(J, r, strict=True)]
    return np.sum([A.T @ A for A, _ in pairs], axis=0), np.sum([A.T @ b for A, b in pairs], axis=0)
