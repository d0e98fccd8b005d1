"""The proof of docs/theory.md, run: random plants, disturbances and references inside its assumptions.

Each example is a batch of random dives through the law and the compensators that steer the vehicle, compiled.
The names are those of the page: d* is what d_hat should be, W* weights that would give it up to delta.
"""

# Arrays stand where the equations have numbers.
# mypy: disable-error-code="arg-type"

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from learner import hidden

from companion.core import network
from companion.core.compensator import Signals, inputs
from companion.core.law import rov_law
from companion.core.network import Parameters as NetworkParameters
from companion.core.network import State as NetworkState
from companion.core.network import step as step_network
from lab.batch.compiled import compiled

pytestmark = pytest.mark.compiles

Columns = np.ndarray[tuple[int, int], np.dtype[np.float64]]
Column = np.ndarray[tuple[int], np.dtype[np.float64]]
Flags = np.ndarray[tuple[int], np.dtype[np.bool_]]

DIVES, UNITS = 144, 6
DT, STEPS = 1e-3, 6000
seeds = st.integers(0, 2**32 - 1)
# A dive costs as much as a thousand small examples, and a smaller seed is no simpler: no shrinking.
FEW = settings(
    max_examples=max(1, settings().max_examples // 30), phases=(Phase.explicit, Phase.reuse, Phase.generate)
)


@dataclass
class Setting:
    """Random parameters, each of shape (DIVES,)."""

    m: np.ndarray
    h: np.ndarray
    m_hat: np.ndarray
    h_hat: np.ndarray
    lam: np.ndarray
    kappa: np.ndarray
    eta: np.ndarray
    leak: np.ndarray
    dead_zone: np.ndarray
    swing: np.ndarray  # of the reference, m
    omega: np.ndarray  # rad/s
    start: np.ndarray  # (2, DIVES): e(0), e_dot(0)


def draw(rng):
    def within(low, high, size=DIVES):
        return rng.uniform(low, high, size)

    m, h = within(10.0, 80.0), within(0.0, 300.0)
    return Setting(
        m=m,
        h=h,
        m_hat=m * within(0.7, 1.4),
        h_hat=h * within(0.5, 1.5),
        lam=within(1.0, 4.0),
        kappa=within(1.5, 6.0),
        eta=within(20.0, 300.0),
        leak=within(0.02, 0.5),
        dead_zone=rng.choice([0.0, 0.001, 0.02], DIVES),
        swing=within(0.0, 0.5),
        omega=within(0.2, 1.5),
        start=within(-1.0, 1.0, (2, DIVES)),
    )


def networks_step(
    parameters: Columns,
    V_start: Columns,
    W: Columns,
    V: np.ndarray[tuple[int, int, int], np.dtype[np.float64]],
    signals: Columns,
    adapt: Flags,
    d_hat: Column,
    learning: Flags,
) -> None:
    """Step a network a dive, whose weights W (dives, units) and V (dives, units, inputs) are changed."""
    columns = [(v[0], v[1], v[2], v[3], v[4], v[5]) for v in V_start]
    for i in range(len(W)):
        eta, eta_v, leak, dead_zone, d_max = parameters[i]
        gains = NetworkParameters(eta, eta_v, leak, dead_zone, d_max, columns)
        now = [(v[0], v[1], v[2], v[3], v[4], v[5]) for v in V[i]]
        state = NetworkState(list(W[i]), now)
        x = signals[i]
        seen = Signals(x[0], x[1], x[2], x[3], x[4], x[5])
        state, d_hat[i], learning[i] = step_network(gains, state, seen, DT, adapt[i])
        for j in range(len(now)):
            W[i, j] = state.W[j]
            V[i, j] = state.V[j]


class Networks:
    """A network for each dive, all with the same first hidden layer, alone."""

    def __init__(self, s, eta_v, d_max, seed):
        self._parameters = np.ascontiguousarray(np.stack((s.eta, eta_v, s.leak, s.dead_zone, d_max)).T)
        values = dict.fromkeys(NetworkParameters._fields, 0.0) | {"hidden": hidden(UNITS, seed)}
        parameters = network.parameters(values)
        self.V_start = np.array(parameters.hidden)
        self.weights, self._V = np.zeros((DIVES, UNITS)), np.tile(self.V_start, (DIVES, 1, 1))
        self._step = compiled(networks_step)

    def step(self, signals, adapt):
        d_hat, self.learning = np.zeros(DIVES), np.zeros(DIVES, bool)
        known = self.V_start, self.weights, self._V
        self._step(self._parameters, *known, signals, adapt, d_hat, self.learning)
        return d_hat


@dataclass
class Dive:
    """What happened, each of shape (STEPS, DIVES) but W, with a last axis more."""

    eps: np.ndarray
    W: np.ndarray
    d_star: np.ndarray
    needed: np.ndarray  # F: the thrust that would hold eps where it is
    d_hat: np.ndarray
    learning: np.ndarray
    saturated: np.ndarray


def dive(s, compensator, disturbance, tau_max):
    """Euler's steps of the closed loop; `disturbance(t, w, e_dot, r_ddot, signals)` is d."""
    log: dict[str, list[np.ndarray]] = {name: [] for name in Dive.__dataclass_fields__}

    def reference(t):
        turn = s.omega * t
        return (
            s.swing * (1.0 - np.cos(turn)),
            s.swing * s.omega * np.sin(turn),
            s.swing * s.omega**2 * np.cos(turn),
        )

    z, w = s.start[0].copy(), s.start[1].copy()
    free = np.ones(DIVES, bool)
    for k in range(STEPS):
        r, r_dot, r_ddot = reference(k * DT)
        e, e_dot = z - r, w - r_dot
        eps = e_dot + s.lam * e
        signals = np.ascontiguousarray(np.stack((e, e_dot, eps, w, r_dot, r_ddot)).T)

        def law(d_hat, w=w, r_ddot=r_ddot, e_dot=e_dot, eps=eps):
            return rov_law(s.h_hat * w * np.abs(w), d_hat, s.m_hat, r_ddot, e_dot, eps, s.lam, s.kappa)

        before = np.copy(compensator.weights)
        d_hat = compensator.step(signals, np.zeros(DIVES, bool))  # looks, learns nothing
        free = np.abs(law(d_hat)) <= tau_max
        d_hat = compensator.step(signals, free)
        tau = np.clip(law(d_hat), -tau_max, tau_max)

        d = disturbance(k * DT, w, e_dot, r_ddot, signals)
        needed = s.h * w * np.abs(w) + d + s.m * (r_ddot - s.lam * e_dot)
        d_star = d + (s.h - s.h_hat) * w * np.abs(w) + (s.m - s.m_hat) * (r_ddot - s.lam * e_dot)
        row = (eps, before, d_star, needed, d_hat, compensator.learning, ~free)
        for name, value in zip(log, row, strict=True):
            log[name].append(value)
        z, w = z + DT * w, w + DT * (tau - s.h * w * np.abs(w) - d) / s.m
    return Dive(**{name: np.array(values) for name, values in log.items()})


def lyapunov(s, run, W_star, delta):
    """Return V, the bound on its rate, b, and V_b outside which it must fall (theory, section 4)."""
    felt = run.eps - np.clip(run.eps, -s.dead_zone, s.dead_zone)
    gap = np.sum((run.W - W_star) ** 2, axis=-1)
    star = np.sum(W_star**2, axis=-1)
    V = 0.5 * s.m * felt**2 + gap / (2.0 * s.eta)
    stiffness = s.m_hat * s.kappa
    rho = np.maximum(0.0, delta - stiffness * s.dead_zone)
    learning = rho * np.abs(felt) - s.leak / (2.0 * s.eta) * (gap - star)
    rate = -stiffness * felt**2 + np.where(run.learning, learning, 0.0)
    b = rho**2 / (2.0 * stiffness) + s.leak * star / (2.0 * s.eta)
    return felt, V, rate, b, b * np.maximum(s.m / stiffness, 1.0 / s.leak)


def assert_theorem(s, run, W_star, delta, d_max, tau_max):
    """Sections 4 and 5 of the theory, for all dives whose thrust has the authority that they ask for."""
    felt, V, rate, b, V_b = lyapunov(s, run, W_star, delta)
    reach = np.abs(run.needed).max(axis=0) + 4.0 * d_max
    able = reach <= tau_max
    assert able.sum() >= DIVES // 6
    rate = np.where(run.saturated, -(tau_max - np.abs(run.needed)) * np.abs(felt), rate)

    # What a step of 1 ms adds to the continuous rate: its squares, and the reference's next derivative.
    d_eps, d_W = np.diff(run.eps, axis=0), np.diff(run.W, axis=0)
    squares = (0.5 * s.m * d_eps**2 + np.sum(d_W**2, axis=-1) / (2.0 * s.eta)) / DT
    jerk = DT * s.m * np.abs(felt[:-1]) * s.swing * s.omega**2 * (s.omega + s.lam)
    allowed = rate[:-1] + 1.01 * squares + jerk + 1e-9 * (1.0 + V[:-1] / DT)
    excess = (np.diff(V, axis=0) / DT - allowed)[:, able]
    assert excess.max() <= 1e-6

    # V falls outside V_b, but where eps is inside the dead zone and learning rests: there it stays.
    moving = run.learning | (felt != 0.0)
    outside = ((1.02 * V_b < V) & moving)[:-1, able]
    slack = (1.01 * squares + jerk)[:, able]
    fall = np.diff(V, axis=0)[:, able] / DT
    assert rate[:-1, able][outside].max(initial=-1.0) < 0.0
    assert (fall[outside] < slack[outside] + 1e-9).all()
    firm = outside & (-rate[:-1, able] > 2.0 * slack + 1e-6)
    assert (fall[firm] < 0.0).all()

    # So V stays below where it began or V_b, and eps with it.
    ceiling = 1.02 * np.maximum(V[0], V_b) + 1e-6
    assert (V[:, able] <= ceiling[able]).all()
    bound = s.dead_zone + np.sqrt(2.0 * ceiling / s.m)
    assert (np.abs(run.eps)[:, able] <= bound[able]).all()

    # Mean square of what is felt, from the last saturated step on.
    for i in np.flatnonzero(able):
        late = np.flatnonzero(run.saturated[:, i])
        first = late[-1] + 1 if late.size else 0
        n = STEPS - first
        if n > 1000:
            mean = np.mean(felt[first:, i] ** 2)
            most = 2.0 / (s.m_hat[i] * s.kappa[i]) * (b[i] + V[first, i] / (n * DT))
            assert mean <= 1.02 * most + 1e-9
    return able


@FEW
@given(seed=seeds)
def test_network_with_frozen_hidden_layer(seed):
    """Every convention at once: leak, dead zone, projection, freeze under saturation, a wrong model."""
    rng = np.random.default_rng(seed)
    s = draw(rng)
    W_star = rng.normal(size=(DIVES, UNITS)) * rng.uniform(0.5, 4.0, (DIVES, 1))
    delta = rng.uniform(0.0, 3.0, DIVES) * rng.integers(0, 2, DIVES)
    largest = np.maximum(np.maximum(W_star, 0.0).sum(-1), np.maximum(-W_star, 0.0).sum(-1))
    d_max = (largest + delta) * rng.uniform(1.0, 1.3, DIVES)
    tau_max = rng.uniform(40.0, 400.0, DIVES)
    wave = rng.uniform(0.5, 8.0, DIVES)
    networks = Networks(s, np.zeros(DIVES), d_max, seed)

    def disturbance(t, w, e_dot, r_ddot, signals):
        """Give d* = W*ᵀσ + a with |a| ≤ delta: assumption 2."""
        theta = np.stack((np.ones(DIVES), *inputs(Signals(*signals.T))[1:]), axis=-1)
        sigma = 1.0 / (1.0 + np.exp(np.minimum(-theta @ networks.V_start.T, 40.0)))
        d_star = np.sum(W_star * sigma, axis=-1) + delta * np.sin(wave * t)
        wrong_model = (s.h - s.h_hat) * w * np.abs(w) + (s.m - s.m_hat) * (r_ddot - s.lam * e_dot)
        return d_star - wrong_model

    run = dive(s, networks, disturbance, tau_max)
    assert_theorem(s, run, W_star, delta, d_max, tau_max)


@FEW
@given(seeds)
def test_projection_alone_bounds_the_error_whatever_the_network_does(seed):
    """Section 3: both layers learn, no weights fit, d_max is any, and still |eps| obeys (d_max + D)/(m̂κ)."""
    rng = np.random.default_rng(seed)
    s = draw(rng)
    d_max = rng.uniform(0.0, 30.0, DIVES)
    tau_max = rng.uniform(40.0, 600.0, DIVES)
    pull, wave = rng.uniform(-15.0, 15.0, (2, DIVES))
    networks = Networks(s, rng.uniform(0.0, 5.0, DIVES), d_max, seed)
    current = rng.uniform(-0.2, 0.2, DIVES)

    def disturbance(t, w, e_dot, r_ddot, signals):
        through_water = w - current * np.sin(0.7 * t)
        return pull + wave * np.sin(2.0 * t) + s.h * (through_water * np.abs(through_water) - w * np.abs(w))

    run = dive(s, networks, disturbance, tau_max)
    stiffness = s.m_hat * s.kappa
    worst = d_max + np.abs(run.d_star).max(axis=0)
    able = np.abs(run.needed).max(axis=0) < tau_max
    assert able.sum() >= DIVES // 6
    eps = np.abs(run.eps)
    assert (np.abs(run.d_hat) <= d_max).all()
    assert (eps[:, able] <= 1.001 * np.maximum(eps[0], worst / stiffness)[able] + 1e-4).all()

    unsaturated = able & ~run.saturated.any(axis=0)
    t = DT * np.arange(STEPS)[:, None]
    decay = worst / stiffness + eps[0] * np.exp(-stiffness / s.m * t)
    assert (eps[:, unsaturated] <= 1.001 * decay[:, unsaturated] + 1e-4).all()
