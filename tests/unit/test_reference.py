"""Whatever the operator asks for, the path is one that a vehicle can follow and the law can differentiate."""

import numpy as np
import pytest
from alone import Law
from builders import RESTING

from companion.core import controller
from companion.core.reference import Parameters, advance, start
from companion.records import Setpoint, vector

TICK_S = 0.02
RATE = np.array([0.4, 0.4, 0.45, 0.8])
ACCELERATION = np.array([0.3, 0.3, 0.4, 0.8])
YAW = (False, False, False, True)
STILL = np.zeros(4)
LIMITS = [Parameters(*each) for each in zip(RATE, ACCELERATION, YAW, strict=True)]


class Reference:
    """The references of four degrees of freedom."""

    def __init__(self, x, x_dot):
        self.pace = (1.0,) * 4
        self.reset(x, x_dot)

    def reset(self, x, x_dot):
        self.states = [start(*each) for each in zip(LIMITS, vector(x), vector(x_dot), strict=True)]

    @property
    def x_d(self):
        return tuple(state.x_d for state in self.states)


def model(x=STILL, x_dot=STILL):
    return Reference(x, x_dot)


def motion(reference):
    """x_d, x_d_dot, x_d_ddot, and the target's motion."""
    return tuple(zip(*reference.states, strict=True))


def step(reference, target, target_dot=STILL, target_ddot=STILL):
    rows = zip(LIMITS, reference.states, target, target_dot, target_ddot, reference.pace, strict=True)
    reference.states = [
        advance(limits, state, x, x_dot, x_ddot, pace, TICK_S)
        for limits, state, x, x_dot, x_ddot, pace in rows
    ]


def walk(reference, target, seconds, target_dot=STILL):
    """Step toward a fixed target; return x, x_dot, x_ddot over time, each (ticks, 4)."""
    seen = []
    for _ in range(round(seconds / TICK_S)):
        step(reference, target, target_dot)
        seen.append(motion(reference)[:3])
    return (np.array(column) for column in zip(*seen, strict=True))


def test_rates_are_the_derivatives_of_what_they_belong_to():
    x, x_dot, x_ddot = walk(model(), [1.0, -2.0, 3.0, 2.0], 15.0)
    np.testing.assert_allclose(np.diff(x, axis=0) / TICK_S, x_dot[1:], atol=1e-9)
    np.testing.assert_allclose(np.diff(x_dot, axis=0) / TICK_S, x_ddot[1:], atol=0.02)


@pytest.mark.parametrize("before_mps", [0.22, 0.0])
def test_a_target_that_stops_or_starts_in_one_tick_steps_no_position(before_mps):
    """The position used to step by half a tick of the rate: 2 mm at 0.22 m/s."""
    reference, target = model(), STILL
    for rate_mps in [before_mps] * 200 + [0.22 - before_mps] * 100:
        x, before = motion(reference)[:2]
        target = target + TICK_S * rate_mps
        step(reference, target, np.full(4, rate_mps))
        moved, now = (np.array(column) for column in motion(reference)[:2])
        np.testing.assert_allclose(moved - x, 0.5 * TICK_S * (now + before), atol=2e-4)


@pytest.mark.parametrize(
    ("start", "target", "change"),
    [
        (3.0, -3.0, 2 * np.pi - 6.0),
        (-3.0, 3.0, 6.0 - 2 * np.pi),
        (0.5, 0.5 + 3.0, 3.0),
        (0.1, 7.0, 6.9 - 2 * np.pi),
    ],
)
def test_the_heading_takes_the_short_way(start, target, change):
    x, _, _ = walk(model([0.0, 0.0, 0.0, start]), [0.0, 0.0, 0.0, target], 20.0)
    gone = x[:, 3] - start
    assert gone[-1] == pytest.approx(change, abs=2e-3)
    assert np.abs(gone).max() <= abs(change) + 0.02


def paths(t):
    """The paper's z_d = 0.5 (1 - cos 0.1 pi t), and a faster one, with their derivatives."""
    w = np.array([0.1 * np.pi, 1.0, 0.1 * np.pi, 0.5])
    size = np.array([0.3, 0.1, 0.5, 0.6])
    return size * (1 - np.cos(w * t)), size * w * np.sin(w * t), size * w**2 * np.cos(w * t)


def test_a_path_from_rest_is_followed_exactly():
    """Started on the path: x_d is the path (to the trapezoid's error), x_d' and x_d'' are its own."""
    reference = model()
    worst = np.zeros(3)
    for k in range(1, 2000):
        eta, eta_dot, eta_ddot = paths(k * TICK_S)
        step(reference, eta, eta_dot, eta_ddot)
        if k * TICK_S > 4.0:
            found = motion(reference)[:3]
            errors = [
                np.abs(a - b).max()
                for a, b in zip(map(np.array, found), (eta, eta_dot, eta_ddot), strict=True)
            ]
            worst = np.maximum(worst, errors)
    assert (worst < [1e-4, 1e-3, 5e-3]).all()


def test_a_slower_pace_is_never_passed_by_much():
    reference = model()
    reference.pace = (1.0, 1.0, 0.5, 1.0)
    _, x_dot, _ = walk(reference, [0.0, 0.0, 10.0, 0.0], 10.0)
    assert x_dot[:, 2].max() == pytest.approx(0.225, rel=0.01)


def test_where_asked_it_starts_anew_and_elsewhere_it_goes_on():
    law, twin = Law(), Law()
    for one in (law, twin):
        one.tick(RESTING, Setpoint((9.0, 9.0, 9.0, 1.0)))
    where, eta, eta_dot = (True, False, True, False), (0.5, 0.6, 0.7, 0.8), (0.1, 0.1, 9.0, 0.1)
    memory = controller.caught_up(law.parameters, law.memory, where, eta, eta_dot)
    x, y, z, psi = (axis.reference for axis in memory.axes)
    _, same_y, _, same_psi = (axis.reference for axis in twin.memory.axes)
    assert (x.x_d, y, z.x_d, psi) == (0.5, same_y, 0.7, same_psi)
    assert (x.x_d_dot, z.x_d_dot) == (0.1, law.parameters.axes[2].reference.max_rate)
