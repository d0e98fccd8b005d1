"""The doubt of a fit is as large as its errors, also where errors are alike for long."""

import numpy as np
import pytest

from companion.identify.least_squares import jackknife, least_squares

WINDOWS, BLOCK, DRAWS = 600, 20, 150


def error_over_doubt(rng: np.random.Generator, share: float) -> float:
    """Fit one number to errors of which `share` is the same throughout a block, as is the slope."""
    block = np.repeat(np.arange(WINDOWS // BLOCK), BLOCK)
    shown = rng.normal(size=WINDOWS // BLOCK)[block]
    errors = np.sqrt(share) * rng.normal(size=WINDOWS // BLOCK)[block]
    errors += np.sqrt(1.0 - share) * rng.normal(size=WINDOWS)
    bounds = np.array((-10.0,)), np.array((10.0,))
    found = least_squares(
        [lambda theta: shown * theta[0] - errors], np.zeros(1), ([0], []), np.array((1e-3,)), lambda _: bounds
    )
    return float(found.theta[0, 0] / np.sqrt(jackknife(found, [block.astype(float)])[0, 0]))


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_the_doubt_is_as_large_as_the_errors(share: float) -> None:
    rng = np.random.default_rng(1)
    ratios = np.array([error_over_doubt(rng, share) for _ in range(DRAWS)])
    assert 0.7 < np.sqrt(np.mean(ratios**2)) < 1.4
    assert np.mean(np.abs(ratios) < 2.0) > 0.85
