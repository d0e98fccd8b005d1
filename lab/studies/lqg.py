"""Linear-quadratic-Gaussian control with a late sensor, in closed form: what it reaches, without a dive.

A plant ẋ = A x + B u + white noise of intensity Q is measured every tick, y = C x + noise of covariance R,
and what was measured `delay_s` ago is all that is known when u is chosen. The best u is linear: a Kalman
filter at the time of the measurement, its estimate carried forward by the delay, and a state feedback of it.
The cost is x_0² + ρ Δu² a tick, so that ρ weighs error against chatter.

| symbol | meaning                                               | source                        |
|--------|-------------------------------------------------------|-------------------------------|
| L, K   | Kalman gain, feedback gain of Δu                      | Riccati equations             |
| ξ      | estimate carried forward to when u acts               | ξ⁺ = A ξ + B u + Φ L ν        |
| e      | true state less estimate when measured                | e⁺ = (I − L C)(A e + w) − L v |
| ν      | innovation                                            | ν = C (A e + w) + v           |
| Φ      | e^{A delay}: carries e to where u acts                |                               |

(ξ, u, e) is one linear system driven by w and v, so its covariance follows from one Lyapunov equation, for
the noise it was designed for as for any other; and so does its answer to a step.
"""

import math
from dataclasses import dataclass

import numpy as np

from companion.records import Array

ITERATIONS = 60


@dataclass(frozen=True)
class Plant:
    """ẋ = A x + B u + w with E[w wᵀ] = Q δ; y = C x + v, E[v vᵀ] = R; x_0 is what has to stay small.

    A (n, n), B (n,), Q (n, n), C (m, n), R (m, m).
    """

    A: Array
    B: Array
    Q: Array
    C: Array
    R: Array


class LQG:
    """The best controller for `plant` that learns of it `delay_s` late and acts every `tick_s`."""

    def __init__(self, plant: Plant, delay_s: float, tick_s: float) -> None:
        self._n = len(plant.A)
        self._A, self._B, Q = discrete(plant, tick_s)
        self._later, self._delay_s, self._tick_s = expm(delay_s * plant.A), delay_s, tick_s
        self._C, self._R = plant.C, plant.R
        X = riccati(self._A.T, self._C.T @ np.linalg.solve(self._R, self._C), Q)
        self.L = X @ self._C.T @ np.linalg.inv(self._C @ X @ self._C.T + self._R)
        """The observer's gain, (n, m)."""

    def tuned(self, plant: Plant, chatter: float) -> Array:
        """Return K, the gain with which Δu has this RMS in `plant`'s noise, or less if nothing needs more."""
        low, high = -16.0, 0.0
        for _ in range(24):
            middle = 0.5 * (low + high)
            _, moved = self.reached(plant, self.feedback(10.0**middle))
            low, high = (middle, high) if moved > chatter else (low, middle)
        return self.feedback(10.0**high)

    def feedback(self, rho: float) -> Array:
        """Return K (n + 1,) of Δu = −K (ξ, u) for this price of chatter."""
        n = self._n
        A = np.eye(n + 1)
        A[:n, :n], A[:n, n] = self._A, self._B
        B = np.append(self._B, 1.0)
        cost = np.zeros((n + 1, n + 1))
        cost[0, 0] = 1.0
        X = riccati(A, np.outer(B, B) / rho, cost)
        K: Array = B @ X @ A / (rho + B @ X @ B)
        return K

    def reached(self, plant: Plant, K: Array) -> tuple[float, float]:
        """Return the RMS of x_0 and of Δu in the noise of `plant`, which may be another than designed for."""
        n = self._n
        F, by_w, by_v = self._loop(K)
        _, _, Q = discrete(plant, self._tick_s)
        S = stationary(F, by_w @ Q @ by_w.T + by_v @ self._R @ by_v.T)
        _, _, unseen = discrete(plant, self._delay_s)
        seen = self._outcome()
        return math.sqrt(seen @ S @ seen + unseen[0, 0]), math.sqrt(K @ S[: n + 1, : n + 1] @ K)

    def step_response(self, K: Array, state: int, height: float, duration_s: float) -> Array:
        """Return x_0 at each tick after state number `state` of the plant jumped by `height` at 0 s."""
        F, _, _ = self._loop(K)
        x = np.zeros(len(F))
        x[self._n + 1 + state] = height
        seen, answer = self._outcome(), []
        for _ in range(round(duration_s / self._tick_s)):
            x = F @ x
            answer.append(seen @ x)
        return np.array(answer)

    def _loop(self, K: Array) -> tuple[Array, Array, Array]:
        """Return the matrices of (ξ, u, e): F, and how w and v enter."""
        n = self._n
        carried = self._later @ self.L
        F = np.zeros((2 * n + 1, 2 * n + 1))
        u = np.append(-K, np.zeros(n))
        u[n] += 1.0
        F[:n, :n] = self._A
        F[:n] += np.outer(self._B, u)
        F[:n, n + 1 :] = carried @ self._C @ self._A
        F[n] = u
        rest = np.eye(n) - self.L @ self._C
        F[n + 1 :, n + 1 :] = rest @ self._A
        by_w = np.vstack([carried @ self._C, np.zeros((1, n)), rest])
        by_v = np.vstack([carried, np.zeros((1, len(self._C))), -self.L])
        return F, by_w, by_v

    def _outcome(self) -> Array:
        """Return the row that makes x_0, when u acts, of (ξ, u, e)."""
        return np.concatenate([np.eye(self._n)[0], [0.0], self._later[0]])


def discrete(plant: Plant, tick_s: float) -> tuple[Array, Array, Array]:
    """Return A, B and Q of one tick with u held (Van Loan 1978)."""
    n = len(plant.A)
    held = np.zeros((n + 1, n + 1))
    held[:n, :n], held[:n, n] = plant.A, plant.B
    held = expm(tick_s * held)
    block = np.block([[-plant.A, plant.Q], [np.zeros((n, n)), plant.A.T]])
    block = expm(tick_s * block)
    A = held[:n, :n]
    return A, held[:n, n], A @ block[:n, n:]


def riccati(A: Array, G: Array, H: Array) -> Array:
    """Return the X ≥ 0 with X = Aᵀ X (I + G X)⁻¹ A + H, by doubling (Chu, Fan, Lin 2005)."""
    for _ in range(ITERATIONS):
        W = np.linalg.inv(np.eye(len(A)) + G @ H)
        AW = A @ W
        grown = A.T @ H @ W @ A
        A, G, H = AW @ A, G + AW @ G @ A.T, H + 0.5 * (grown + grown.T)
        if np.abs(grown).max() <= 1e-12 * np.abs(H).max():
            break
    return H


def stationary(F: Array, W: Array) -> Array:
    """Return S = F S Fᵀ + W for a stable F, by doubling."""
    S = W
    for _ in range(ITERATIONS):
        grown = F @ S @ F.T
        S, F = S + grown, F @ F
        if np.abs(grown).max() <= 1e-12 * np.abs(S).max():
            break
    return S


def expm(A: Array) -> Array:
    """Return e^A by a Taylor series of A/2^s, squared s times."""
    squarings = max(0, math.ceil(math.log2(max(float(np.abs(A).sum(1).max()), 1e-300))) + 3)
    A = A / 2.0**squarings
    result = term = np.eye(len(A))
    for i in range(1, 13):
        term = term @ A / i
        result = result + term
    for _ in range(squarings):
        result = result @ result
    return result
