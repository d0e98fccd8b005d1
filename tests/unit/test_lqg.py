"""The LQG floor against closed forms, against a simulation written otherwise, and against the paper's."""

import math

import numpy as np
import pytest

from lab.loop.lockstep import LinkDelay
from lab.loop.scenarios import four
from lab.studies.floor import CHATTER_N, floor, loop_delay_s, sea_speed
from lab.studies.lqg import LQG, Plant, discrete, expm, riccati, stationary
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import load_config
from sim_bridge.physics.waves import Sea

BASE = load_config(DEFAULT_CONFIG)
TICK_S = 0.02
DELAY_TICKS = 3


def heave(q: float = 4.0) -> Plant:
    """z, w, f and a wandering force on 30 kg; depth and rate measured."""
    A = np.zeros((4, 4))
    A[0, 1] = 1.0
    A[1] = (0.0, -20.0 / 30.0, 1.0 / 30.0, 1.0 / 30.0)
    A[2, 2], A[3, 3] = -1.0 / 0.15, -1.0 / 5.0
    return Plant(A, np.array([0, 0, 1 / 0.15, 0]), np.diag([0, 0, 0, q]), np.eye(2, 4), np.diag([1e-5, 2e-5]))


def test_exponential_of_a_rotation_and_of_a_shear() -> None:
    turn = expm(np.array([[0.0, -2.0], [2.0, 0.0]]))
    np.testing.assert_allclose(turn, [[math.cos(2), -math.sin(2)], [math.sin(2), math.cos(2)]], atol=1e-12)
    np.testing.assert_allclose(expm(np.array([[0.0, 3.0], [0.0, 0.0]])), [[1.0, 3.0], [0.0, 1.0]], atol=1e-12)


def test_discrete_noise_of_an_ornstein_uhlenbeck_process() -> None:
    plant = Plant(np.array([[-0.5]]), np.ones(1), np.array([[3.0]]), np.eye(1), np.eye(1))
    A, B, Q = discrete(plant, 0.4)
    assert A[0, 0] == pytest.approx(math.exp(-0.2))
    assert B[0] == pytest.approx(2.0 * (1.0 - math.exp(-0.2)))
    assert Q[0, 0] == pytest.approx(3.0 * (1.0 - math.exp(-0.4)))


def test_riccati_and_lyapunov_equations_are_solved() -> None:
    rng = np.random.default_rng(0)
    A = 0.6 * rng.standard_normal((5, 5))
    B, H = rng.standard_normal((5, 2)), np.eye(5)
    G = B @ B.T
    X = riccati(A, G, H)
    np.testing.assert_allclose(X, A.T @ X @ np.linalg.inv(np.eye(5) + G @ X) @ A + H, rtol=1e-9, atol=1e-9)
    F = A / (1.1 * np.abs(np.linalg.eigvals(A)).max())
    S = stationary(F, H)
    np.testing.assert_allclose(S, F @ S @ F.T + H, rtol=1e-9)


def test_what_is_reached_is_what_a_simulation_reaches() -> None:
    """A Kalman filter in the past, its estimate run forward tick by tick through the commands sent."""
    plant = heave()
    lqg = LQG(plant, DELAY_TICKS * TICK_S, TICK_S)
    K = lqg.tuned(plant, CHATTER_N)
    rms, chatter = lqg.reached(plant, K)

    A, B, Q = discrete(plant, TICK_S)
    rng = np.random.default_rng(1)
    runs, ticks = 200, 1500
    root = np.linalg.cholesky(Q + 1e-18 * np.eye(4))
    x, x_hat = np.zeros((runs, 4)), np.zeros((runs, 4))
    u, sent = np.zeros(runs), [np.zeros(runs)] * (DELAY_TICKS + 1)
    seen = [np.zeros((runs, 4))] * (DELAY_TICKS + 1)
    errors, changes = [], []
    for tick in range(ticks):
        seen = [*seen[1:], x]
        y = seen[0] @ plant.C.T + rng.standard_normal((runs, 2)) * np.sqrt(np.diag(plant.R))
        x_hat = x_hat @ A.T + np.outer(sent[0], B)
        x_hat = x_hat + (y - x_hat @ plant.C.T) @ lqg.L.T
        ahead = x_hat
        for earlier in sent[1:]:
            ahead = ahead @ A.T + np.outer(earlier, B)
        change = -np.column_stack([ahead, u]) @ K
        u = u + change
        sent = [*sent[1:], u]
        if tick > 300:
            errors.append(x[:, 0])
            changes.append(change)
        x = x @ A.T + np.outer(u, B) + rng.standard_normal((runs, 4)) @ root.T
    assert np.std(errors) == pytest.approx(rms, rel=0.03)
    assert np.std(changes) == pytest.approx(chatter, rel=0.03)


def test_no_other_gain_does_better_at_the_same_price() -> None:
    plant, rho = heave(), 1e-7
    lqg = LQG(plant, 0.05, TICK_S)
    K = lqg.feedback(rho)

    def cost(gain: np.ndarray) -> float:
        error, change = lqg.reached(plant, gain)
        return error**2 + rho * change**2

    for i in range(len(K)):
        for factor in (0.9, 1.1):
            other = K.copy()
            other[i] *= factor
            assert cost(other) >= cost(K)


def test_chatter_is_limited_and_delay_costs() -> None:
    plant = heave()
    reached = []
    for delay_s in (0.03, 0.11):
        lqg = LQG(plant, delay_s, TICK_S)
        rms, chatter = lqg.reached(plant, lqg.tuned(plant, 0.8))
        assert chatter == pytest.approx(0.8, rel=0.01)
        reached.append(rms)
    assert reached[0] < reached[1]


def test_a_step_is_found_and_undone() -> None:
    plant = heave()
    lqg = LQG(plant, 0.05, TICK_S)
    answer = lqg.step_response(lqg.tuned(plant, CHATTER_N), 3, 15.0, 20.0)
    assert 1e-3 < answer.max() < 0.05
    assert abs(answer[-1]) < 1e-4


def test_delay_of_the_loop_follows_the_input_loops_phase() -> None:
    delays_ms = {round(1e3 * loop_delay_s(seed, LinkDelay())) for seed in range(1000, 1020)}
    assert delays_ms == {15, 35}
    longer = LinkDelay(up_s=0.041, down_s=0.041)
    assert all(
        loop_delay_s(seed, longer) == pytest.approx(loop_delay_s(seed, LinkDelay()) + 0.08)
        for seed in range(9)
    )


def test_slices_carry_the_seas_energy() -> None:
    config = four(1000)[0].plant(BASE, 1000)
    _, amplitude = sea_speed(config.waves, 2.5)
    sea = Sea(config.waves, np.random.default_rng(3))
    speeds = [sea.flow(0.5 * i, 0.0, 0.0, 2.5)[2] for i in range(4000)]
    assert math.sqrt(0.5 * float(amplitude @ amplitude)) == pytest.approx(np.std(speeds), rel=0.2)


@pytest.mark.parametrize(
    ("link", "low_mm", "high_mm"),
    [(LinkDelay(), 2.7, 3.4), (LinkDelay(0.041, 0.041), 3.0, 3.7)],
)
def test_floor_is_that_of_the_paper(link: LinkDelay, low_mm: float, high_mm: float) -> None:
    """docs/decisions/0020: 2.9 / 2.9 / 2.9 / 2.8, at +80 ms 3.2 / 3.2 / 3.1 / 3.0."""
    for scenario in range(4):
        reached = [floor(four(seed)[scenario], BASE, link) for seed in range(1000, 1004)]
        assert low_mm < np.mean([one.depth_rms_mm for one in reached]) < high_mm
        assert max(one.chatter_n for one in reached) <= CHATTER_N + 0.01
