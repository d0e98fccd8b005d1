"""The doubt of `holdfast identify` is as large as its errors, also where innovations are alike for long."""

import math

import numpy as np
import pytest

from companion.identify import fit
from companion.records import Z

H_S, N = 0.02, 1600
T_S = np.linspace(0.0, H_S * (N - 1), N)
RECORD = fit.Record(Z, T_S, T_S, T_S, np.zeros((N, 8)), np.zeros(8), np.zeros(8), T_S)
DRAWS = 150


def swell(rng, period_s=4.0, lasts_s=2.0):
    """Narrow-band noise of variance 1: it keeps its phase for `lasts_s`."""
    w = 2.0 * math.pi / period_s
    keep = complex(math.exp(-H_S / lasts_s)) * complex(math.cos(w * H_S), math.sin(w * H_S))
    steps = math.sqrt(1.0 - abs(keep) ** 2) * (rng.normal(size=N) + 1j * rng.normal(size=N))
    z, out = complex(rng.normal(), rng.normal()), np.empty(N)
    for i, step in enumerate(steps.tolist()):
        z = keep * z + step
        out[i] = z.real
    return out


def error_over_doubt(rng, share):
    """Fit one number to innovations of which `share` is a swell, as is what shows the number."""
    whitened = rng.normal(size=(N, 2))
    whitened[:, 0] = math.sqrt(1.0 - share) * whitened[:, 0] + math.sqrt(share) * swell(rng)
    shown = np.zeros((N, 2))
    shown[:, 0] = swell(rng)
    counting = fit.after_burn_in(RECORD)
    error = (shown[counting] * whitened[counting]).sum() / (shown[counting] ** 2).sum()
    J = np.concatenate((np.where(counting[:, None], shown, 0.0).ravel(), np.zeros(3)))[:, None]
    return error / math.sqrt(fit.parameter_covariance(RECORD, J, whitened)[0, 0])


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_the_doubt_is_as_large_as_the_errors(share):
    rng = np.random.default_rng(1)
    ratios = np.array([error_over_doubt(rng, share) for _ in range(DRAWS)])
    assert 0.7 < np.sqrt(np.mean(ratios**2)) < 1.4
    assert np.mean(np.abs(ratios) < 2.0) > 0.85
