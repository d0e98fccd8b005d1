"""How sure a mean of paired differences is."""

import math
from collections.abc import Sequence
from statistics import NormalDist

import numpy as np

from companion.arrays import Array

CONFIDENCE = 0.95


def interval(differences: Sequence[float] | Array) -> tuple[float, float]:
    """Return the mean and half the confidence interval, Student's; NaN for half of fewer than two."""
    n = len(differences)
    spread = float(np.std(differences, ddof=1)) / math.sqrt(n) if n > 1 else math.nan
    return float(np.mean(differences)), student(n - 1) * spread if n > 1 else math.nan


def student(freedom: int, confidence: float = CONFIDENCE) -> float:
    """Return Student's two-sided quantile: exact for 1 and 2 degrees of freedom, else Cornish-Fisher, 0.5 %.

    (Abramowitz and Stegun, 26.7.5.)
    """
    p = 0.5 + 0.5 * confidence
    if freedom == 1:
        return math.tan(math.pi * (p - 0.5))
    if freedom == 2:
        return (2.0 * p - 1.0) * math.sqrt(2.0 / (4.0 * p * (1.0 - p)))
    z, n = NormalDist().inv_cdf(p), float(freedom)
    terms = (
        (z**3 + z) / 4.0,
        (5.0 * z**5 + 16.0 * z**3 + 3.0 * z) / 96.0,
        (3.0 * z**7 + 19.0 * z**5 + 17.0 * z**3 - 15.0 * z) / 384.0,
        (79.0 * z**9 + 776.0 * z**7 + 1482.0 * z**5 - 1920.0 * z**3 - 945.0 * z) / 92160.0,
    )
    return z + sum(term / n**i for i, term in enumerate(terms, 1))
