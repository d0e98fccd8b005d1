"""The observer against plants that are simulated more finely than it thinks, and by other means."""

import numpy as np

from companion.core.observer import (
    Push,
    advance,
    at_rest,
    correct,
    expected,
)
from companion.estimation.observer_design import Noise, observer_parameters

M = np.array([17.5, 18.0, 28.5, 0.5])
C = np.array([18.0, 19.0, 30.0, 0.2])
LAG_S = 0.15
TICK_S = 0.02
SLOW_S = 0.8
NOISES = (
    Noise(0.005, 0.005, 0.01, 0.005, 5.0, SLOW_S),
    Noise(0.005, 0.005, 0.01, 0.005, 5.0, SLOW_S),
    Noise(0.0006, 0.0008, 0.003, 0.004, 10.0, SLOW_S),
    Noise(0.002, 0.003, 0.005, 0.002, 0.5, SLOW_S),
)
PARAMETERS = [
    observer_parameters(m, c, LAG_S, noise, TICK_S) for m, c, noise in zip(M, C, NOISES, strict=True)
]
POSITION_NOISE, RATE_NOISE, _, _, DISTURBANCE_NOISE, _ = np.array(NOISES).T
D = np.array([4.0, -3.0, 12.0, -0.4])


def push(dof, u, dt_s=TICK_S):
    return Push(u, M[dof], C[dof], dt_s, u)


def thrust(t):
    """Commanded thrust that keeps changing."""
    return np.array([8.0, 6.0, 20.0, 0.6]) * np.sin(np.array([1.1, 0.7, 0.9, 1.3]) * t + 0.3)


def plant(seconds, d=D, fine=20, u=thrust):
    """m v' = f - c v - d, f' = (u - f)/T, u held for a tick: return q, v, f at each tick, (ticks + 1, 4)."""
    q = v = f = np.zeros(4)
    seen, dt = [(q, v, f)], TICK_S / fine
    for k in range(round(seconds / TICK_S)):
        held = u(k * TICK_S)
        for _ in range(fine):
            f_middle = held + (f - held) * np.exp(-0.5 * dt / LAG_S)
            v_middle = v + 0.5 * dt * (f - C * v - d) / M
            q, v = q + dt * v_middle, v + dt * (f_middle - C * v_middle - d) / M
            f = held + (f - held) * np.exp(-dt / LAG_S)
        seen.append((q, v, f))
    return (np.array(column) for column in zip(*seen, strict=True))


def run(q, v, u=thrust, noise=None, states=None):
    """Feed samples of q and v tick by tick; return the four last states, and all over time (ticks, 4, 6)."""
    states = [at_rest(0.0) for _ in PARAMETERS] if states is None else list(states)
    seen = []
    for k in range(1, len(q)):
        thrusts, measured = u((k - 1) * TICK_S), np.stack((q[k], v[k]), axis=-1)
        if noise is not None:
            measured = measured + noise[k]
        for dof, parameters in enumerate(PARAMETERS):
            moved = advance(parameters, states[dof], push(dof, thrusts[dof]), 1.0)
            states[dof] = correct(parameters, moved, *(measured[dof] - expected(moved)))
        seen.append(list(states))
    return states, np.array(seen)


def test_everything_is_found_without_bias_and_d_in_the_papers_sign():
    """m x'' = tau - k - h - d: a positive d pushes up and back, and has to be met by a positive thrust."""
    q, v, f = plant(25.0)
    _, seen = run(q, v)
    np.testing.assert_allclose(seen[-1, :, 3], D, rtol=0.02)
    np.testing.assert_allclose(seen[-1, :, 0], q[-1], atol=0.003)
    np.testing.assert_allclose(seen[-1, :, 1], v[-1], atol=0.003)
    assert (np.abs(seen[-1, :, 2] - f[-1]) <= 0.05 * np.abs(D)).all()


def test_noise_is_reduced():
    """White noise of the stated size on rest: position and rate come out quieter than they came in."""
    rng = np.random.default_rng(1)
    white = rng.normal(size=(3000, 4, 2)) * np.stack((POSITION_NOISE, RATE_NOISE), axis=-1)
    rest = np.zeros((3000, 4))
    _, seen = run(rest, rest, u=lambda t: np.zeros(4), noise=white)
    settled = seen[500:]
    assert (settled[:, :, 0].std(0) < 0.7 * POSITION_NOISE).all()
    assert (settled[:, :, 1].std(0) < RATE_NOISE).all()
    assert (np.abs(settled[:, :, 3].mean(0)) < 0.5 * DISTURBANCE_NOISE).all()
