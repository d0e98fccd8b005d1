"""The observer against plants that are simulated more finely than it thinks, and by other means."""

import numpy as np
import pytest

from companion.estimation.observer import Noise, Observer

M = np.array([17.5, 18.0, 28.5, 0.5])
C = np.array([18.0, 19.0, 30.0, 0.2])
LAG_S = 0.15
TICK_S = 0.02
NOISE = Noise(
    position=np.array([0.005, 0.005, 0.0006, 0.002]),
    rate=np.array([0.005, 0.005, 0.0008, 0.003]),
    position_slow=np.array([0.01, 0.01, 0.003, 0.005]),
    rate_slow=np.array([0.005, 0.005, 0.004, 0.002]),
    disturbance=np.array([5.0, 5.0, 10.0, 0.5]),
    slow_time_s=0.8,
)
D = np.array([4.0, -3.0, 12.0, -0.4])


def observer():
    return Observer(M, C, LAG_S, NOISE, TICK_S)


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


def run(q, v, u=thrust, noise=None, o=None):
    """Feed samples of q and v tick by tick; return the observer and its states over time."""
    o = o or observer()
    seen = []
    for k in range(1, len(q)):
        o.advance(u((k - 1) * TICK_S), M, C, TICK_S)
        measured = np.stack((q[k], v[k]), axis=-1)
        if noise is not None:
            measured = measured + noise[k]
        o.correct(measured - o.expected)
        seen.append(o.x.copy())
    return o, np.array(seen)


def ahead(o, commands, dt_s=TICK_S):
    """q, v and f along the way, (steps + 1, 4, 3)."""
    return np.moveaxis(np.array(o.predict(commands, M, C, dt_s)), 1, -1)


def test_everything_is_found_without_bias_and_d_in_the_papers_sign():
    """m x'' = tau - k - h - d: a positive d pushes up and back, and has to be met by a positive thrust."""
    q, v, f = plant(25.0)
    _, seen = run(q, v)
    np.testing.assert_allclose(seen[-1, :, 3], D, rtol=0.02)
    np.testing.assert_allclose(seen[-1, :, 0], q[-1], atol=0.003)
    np.testing.assert_allclose(seen[-1, :, 1], v[-1], atol=0.003)
    assert (np.abs(seen[-1, :, 2] - f[-1]) <= 0.05 * np.abs(D)).all()


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_d_has_the_sign_of_the_thrust_that_holds_against_it(sign):
    hold = sign * np.array([5.0, 5.0, 5.0, 0.5])
    q = v = np.zeros((1500, 4))
    _, seen = run(q, v, u=lambda t: hold)
    np.testing.assert_allclose(seen[-1, :, 3], hold, rtol=0.02)


def test_a_step_of_disturbance_is_followed_within_a_second():
    still = np.zeros(4)
    q1, v1, _ = plant(10.0, d=still, u=lambda t: still)
    o, seen = run(q1, v1, u=lambda t: still)
    np.testing.assert_allclose(seen[-1, :, 3], 0.0, atol=1e-6)
    q2, v2, _ = plant(6.0, d=D, u=lambda t: still)
    _, seen = run(q2, v2, u=lambda t: still, o=o)
    heave = seen[:, 2, 3]
    assert heave[50] > 0.5 * D[2]
    np.testing.assert_allclose(seen[-1, 2:, 3], D[2:], rtol=0.05)


def test_noise_is_reduced():
    """White noise of the stated size on rest: position and rate come out quieter than they came in."""
    rng = np.random.default_rng(1)
    white = rng.normal(size=(3000, 4, 2)) * np.stack((NOISE.position, NOISE.rate), axis=-1)
    rest = np.zeros((3000, 4))
    _, seen = run(rest, rest, u=lambda t: np.zeros(4), noise=white)
    settled = seen[500:]
    assert (settled[:, :, 0].std(0) < 0.7 * NOISE.position).all()
    assert (settled[:, :, 1].std(0) < NOISE.rate).all()
    assert (np.abs(settled[:, :, 3].mean(0)) < 0.5 * NOISE.disturbance).all()


def test_prediction_is_what_then_happens():
    """From an exact state through known commands: within half a millimetre and a mm/s over 0.3 s."""
    q, v, f = plant(4.0)
    o = observer()
    start, steps = 150, 15
    o.x[..., 0], o.x[..., 1], o.x[..., 2], o.x[..., 3] = q[start], v[start], f[start], D
    commands = np.array([thrust((start + k) * TICK_S) for k in range(steps)])
    way = ahead(o, commands)
    for k in range(steps + 1):
        np.testing.assert_allclose(way[k, :, 0], q[start + k], atol=5e-4)
        np.testing.assert_allclose(way[k, :, 1], v[start + k], atol=3e-3)


def test_prediction_changes_nothing_and_starts_where_the_observer_is():
    q, v, _ = plant(2.0)
    o, _ = run(q, v)
    before = o.x.copy()
    way = ahead(o, np.zeros((3, 4)), 0.03)
    np.testing.assert_array_equal(o.x, before)
    np.testing.assert_array_equal(way[0, :, :2], before[:, :2])


def test_thrust_ahead_moves_it_forward_and_disturbance_backward():
    o = observer()
    np.testing.assert_array_less(0.0, ahead(o, np.ones((5, 4)))[-1, :, 0])
    o.x[..., 3] = 1.0
    np.testing.assert_array_less(ahead(o, np.zeros((5, 4)))[-1, :, 0], 0.0)


def test_advance_is_one_step_of_predict():
    q, v, _ = plant(2.0)
    a, _ = run(q, v)
    b, _ = run(q, v)
    way = ahead(b, np.array([thrust(2.0)]))
    a.advance(thrust(2.0), M, C, TICK_S)
    np.testing.assert_allclose(a.x[:, 0:2], way[-1, :, 0:2], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(a.x[:, 4:6], b.x[:, 4:6] * np.exp(-TICK_S / 0.8), rtol=1e-12)
    np.testing.assert_array_equal(a.x[:, 3], b.x[:, 3])


def test_start_knows_the_place_and_nothing_else_and_leaves_the_others():
    q, v, _ = plant(2.0)
    o, _ = run(q, v)
    before = o.x.copy()
    o.start(2, 7.5)
    np.testing.assert_array_equal(o.x[2], [7.5, 0, 0, 0, 0, 0])
    np.testing.assert_array_equal(np.delete(o.x, 2, axis=0), np.delete(before, 2, axis=0))


def test_rates_are_those_of_the_model():
    o = observer()
    o.x[...] = np.random.default_rng(2).normal(size=(4, 6))
    rates = o.rates(M, C)
    np.testing.assert_array_equal(rates[:, 0], o.x[:, 1])
    np.testing.assert_allclose(rates[:, 1], (o.x[:, 2] - C * o.x[:, 1] - o.x[:, 3]) / M, rtol=1e-12)


def test_an_innovation_of_zero_changes_nothing():
    o = observer()
    o.x[...] = np.random.default_rng(3).normal(size=(4, 6))
    before = o.x.copy()
    o.correct(np.zeros((4, 2)))
    np.testing.assert_array_equal(o.x, before)


def test_what_it_returns_is_a_copy():
    o = observer()
    d = o.disturbance
    o.x[..., 3] = 5.0
    np.testing.assert_array_equal(d, 0.0)
