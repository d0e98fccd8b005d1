"""The current: right where the answer is known, else unknown."""

import math

import pytest

from companion.core import predictor
from companion.core.observers import Estimates
from companion.core.positioning import Model, jacobian, to_inertial
from companion.estimation.water import KEPT_S, MEAN_S, Water

MODEL = Model((20.0, 20.0, 32.0, 0.6), (13.7, 0.0, 33.0, 0.1), (141.0, 217.0, 190.0, 1.5))
DT_S = 0.02
PLAIN = (1.0, 1.0, 1.0, 1.0)


def flowing(water, psi=0.0, current=(0.3, -0.2), v=(0.0, 0.0), seconds=30.0, seen=True, gain=PLAIN):
    """Let the observer find the disturbance that this current makes; return the current that is found."""
    J = jacobian(psi)
    found = None
    c, s = J.c, J.s

    def drag(north, east):
        u, w = c * north + s * east, c * east - s * north
        X, Y = (MODEL.d1[i] * x + MODEL.d2[i] * abs(x) * x for i, x in enumerate((u, w)))
        return to_inertial(J, (X, Y, 0.0, 0.0))

    through = [a - b for a, b in zip(drag(v[0] - current[0], v[1] - current[1]), drag(*v), strict=True)]
    d = tuple(force / g for force, g in zip(through, gain, strict=True))
    eta, eta_dot = (0.0, 0.0, 0.0, psi), (*v, 0.0, 0.0)
    motion = Estimates(eta, eta_dot, 0.0, eta, eta_dot, d, predictor.NONE, PLAIN, 0.0, PLAIN)
    for _ in range(round(seconds / DT_S)):
        found = water.step(MODEL, motion, gain, DT_S, seen)
    return found


@pytest.mark.parametrize("psi", [0.0, 1.0, -2.5])
@pytest.mark.parametrize("v", [(0.0, 0.0), (0.2, 0.1)])
def test_the_current_is_what_explains_the_drag(psi, v):
    found = flowing(Water(), psi, v=v)
    assert (found.north_mps, found.east_mps) == pytest.approx((0.3, -0.2), abs=0.005)
    assert 0.03 < found.doubt_mps < 0.25


def test_it_is_unknown_until_there_is_a_mean_and_after_a_while_without_one():
    water = Water()
    assert math.isnan(flowing(water, seconds=MEAN_S - 0.5).north_mps)
    assert math.isfinite(flowing(water, seconds=1.0).north_mps)
    assert math.isfinite(flowing(water, seconds=KEPT_S - 1.0, seen=False).north_mps)
    assert math.isnan(flowing(water, seconds=2.0, seen=False).north_mps)
