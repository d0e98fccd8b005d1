"""The paper's simulation: one degree of freedom, 60 s, from e(0) = 0 (tracking) and 0.1 m (phase portrait).

    m z̈ = τ − h (ż − v_c)|ż − v_c| − d             the plant (eq. rov); v_c is the current
    z_d = 0.5 (1 − cos 0.1πt)                       the reference (sec. 5)

The controller assumes m̂ and ĥ. Law, network and integrator are those of the vehicle: `rov_law`, `network`,
`integrator`, compiled as they stand. The thrust is held for a tick, the plant moves by RK4 at 1 ms.

| symbol | meaning                  | unit   |
|--------|--------------------------|--------|
| z, w   | depth and its rate       | m, m/s |
| e, eps | tracking, combined error | m, m/s |
| tau    | thrust                   | N      |
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import product
from math import cos, exp, inf, pi, sin, sqrt
from typing import Any

import numpy as np

from companion.arrays import Array
from companion.core import integrator, network
from companion.core.compensator import Inputs, Signals
from companion.core.law import rov_law
from lab.batch.compiled import cached

MASS_KG = 50.0
DAMPING = 250.0  # N s²/m²
LAM = KAPPA = 3.5
UNITS = 5
INPUTS = 3
ETA, ETA_V = 200.0, 2.0
INTEGRAL_GAIN = ETA * UNITS / 4.0  # what η‖σ‖² is at rest, where each logistic unit gives 1/2

TICK_MS, TICK_S, STEP_S = 10, 0.01, 0.001
DURATION_S = 60
PERIOD_S = 20  # of the reference, and so of the orbit
SWING = 0.1 * pi  # rad/s, the reference's
STARTS_M = (0.0, 0.1)

DISTURBANCES = ("none", "constant", "sine", "tether", "current")
LAWS = ("derived", "printed")
COMPENSATORS = (("none", 0.0), ("integrator", 0.0), ("network", 0.0), ("network", 2.0))
SEEDS = range(10)


@dataclass(frozen=True, slots=True)
class PaperCase:
    """What disturbs, which law with which compensator, how wrong its model is, and the seed.

    The seed draws the network's first weights and the tether's pull; the network learns from `wait_s` on.
    `mass_ratio` is m̂/m, `damping_ratio` ĥ/h.
    """

    disturbance: str = "none"
    law: str = "derived"
    compensator: str = "none"
    wait_s: float = 0.0
    seed: int = 0
    mass_ratio: float = 1.1
    damping_ratio: float = 0.9


@dataclass(frozen=True, slots=True)
class Trace:
    """One dive: arrays of shape (ticks,), s, m, m/s and N."""

    t_s: Array
    z_d: Array
    e: Array
    e_dot: Array
    tau: Array


@dataclass(frozen=True, slots=True)
class PaperFigures:
    """What came of a case.

    From e(0) = 0 over the whole dive: RMS and largest |e|, RMS of the thrust. From e(0) = 0.1 m: half the
    width of the orbit in e over the last period, and the largest −ė, the overshoot of the paper's fig. 2.
    """

    rms_mm: float
    peak_mm: float
    orbit_mm: float
    peak_rate_mm_s: float
    thrust_rms_n: float


def table() -> list[PaperCase]:
    """Return every case of the table; 10 seeds each, which without network or tether only repeat."""
    rows = product(DISTURBANCES, LAWS, COMPENSATORS, SEEDS)
    return [
        PaperCase(water, law, compensator, wait_s, seed) for water, law, (compensator, wait_s), seed in rows
    ]


def dive(case: PaperCase) -> tuple[Trace, Trace]:
    """Simulate a case from each of STARTS_M."""
    m_hat = case.mass_ratio * MASS_KG
    estimate, parameters, memory = _compensator(case.compensator, case.seed)
    loop = cached(_dive)
    traces = []
    t_s: Array = TICK_S * np.arange(DURATION_S * 1000 // TICK_MS, dtype=np.float64)
    z_d = 0.5 * (1.0 - np.cos(SWING * t_s))
    for start_m in STARTS_M:
        found = np.zeros((3, len(t_s)))
        # −κε is −m̂ κ' ε with κ' = κ/m̂.
        kappa = KAPPA / m_hat if case.law == "printed" else KAPPA
        model = (m_hat, case.damping_ratio * DAMPING, kappa, case.wait_s)
        loop(
            estimate, parameters, memory.copy(), *model, start_m, *_water(case.disturbance, case.seed), found
        )
        traces.append(Trace(t_s, z_d, *found))
    return traces[0], traces[1]


def figures(traces: tuple[Trace, Trace]) -> PaperFigures:
    """Work out what came of a case."""
    tracking, portrait = traces
    last = portrait.e[-PERIOD_S * 1000 // TICK_MS :]
    return PaperFigures(
        rms_mm=1000.0 * sqrt(np.mean(tracking.e**2)),
        peak_mm=1000.0 * float(np.abs(tracking.e).max()),
        orbit_mm=500.0 * float(np.ptp(last)),
        peak_rate_mm_s=1000.0 * float((-portrait.e_dot).max()),
        thrust_rms_n=sqrt(np.mean(tracking.tau**2)),
    )


@cache
def _water(disturbance: str, seed: int) -> tuple[Array, Array]:
    """Return the force d (N) and the current v_c (m/s) every half millisecond."""
    t_s = 0.5 * STEP_S * np.arange(2000 * DURATION_S + 1)
    force, current = np.zeros_like(t_s), np.zeros_like(t_s)
    if disturbance == "constant":
        force += 5.0
    elif disturbance == "sine":
        force = 5.0 * np.sin(2.0 * pi * t_s / 10.0)
    elif disturbance == "current":
        current = 0.05 + 0.1 * np.sin(2.0 * pi * t_s / 15.0)
    elif disturbance == "tether":
        # An Ornstein-Uhlenbeck process, σ = 5 N, τ = 2 s.
        kept = exp(-0.5 * STEP_S / 2.0)
        noise = 5.0 * np.random.default_rng((1, seed)).standard_normal(len(t_s))
        force[0] = noise[0]
        for i in range(1, len(t_s)):
            force[i] = kept * force[i - 1] + sqrt(1.0 - kept**2) * noise[i]
    return force, current


def _dive(
    estimated: Callable[[Any, Array, Inputs, float, bool], float],
    parameters: Any,
    memory: Array,
    m_hat: float,
    h_hat: float,
    kappa: float,
    wait_s: float,
    z: float,
    force: Array,
    current: Array,
    found: Array,
) -> None:
    """Write e, ė and τ of every tick to the rows of `found`.

    `estimated` is one of the three below; `memory` is what it learns.
    """
    w = 0.0
    for tick in range(found.shape[1]):
        t_s = tick * TICK_S
        c, s = cos(SWING * t_s), sin(SWING * t_s)
        e, e_dot, z_d_ddot = z - 0.5 * (1.0 - c), w - 0.5 * SWING * s, 0.5 * SWING**2 * c
        theta = (1.0, 10.0 * e, 3.0 * e_dot, 0.0, 0.0, 0.0)
        eps = e_dot + LAM * e
        d_hat = estimated(parameters, memory, theta, eps, t_s >= wait_s)
        tau = rov_law(h_hat * w * abs(w), d_hat, m_hat, z_d_ddot, e_dot, eps, LAM, kappa)
        found[0, tick], found[1, tick], found[2, tick] = e, e_dot, tau
        for ms in range(tick * TICK_MS, (tick + 1) * TICK_MS):
            z, w = _moved(z, w, tau, 2 * ms, force, current)


def _moved(z: float, w: float, tau: float, at: int, force: Array, current: Array) -> tuple[float, float]:
    """Return z and w after a millisecond (RK4); `at` is the row of `force` and `current` at its beginning."""
    dt = STEP_S
    a1 = _acceleration(w, tau - force[at], current[at])
    a2 = _acceleration(w + 0.5 * dt * a1, tau - force[at + 1], current[at + 1])
    a3 = _acceleration(w + 0.5 * dt * a2, tau - force[at + 1], current[at + 1])
    a4 = _acceleration(w + dt * a3, tau - force[at + 2], current[at + 2])
    return z + dt * w + dt * dt / 6.0 * (a1 + a2 + a3), w + dt / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)


def _acceleration(w: float, push: float, current: float) -> float:
    """Return z̈ of the plant; `push` is τ − d."""
    relative = w - current
    return (push - DAMPING * relative * abs(relative)) / MASS_KG


def by_nothing(parameters: Any, memory: Array, theta: Inputs, eps: float, adapt: bool) -> float:
    """Return no d̂."""
    return 0.0


def by_integrator(
    parameters: integrator.Parameters, memory: Array, theta: Inputs, eps: float, adapt: bool
) -> float:
    """Return the integrator's d̂, which is all that it remembers."""
    signals = Signals(0.0, 0.0, eps, 0.0, 0.0, 0.0)
    state, d_hat, _ = integrator.step(parameters, integrator.State(memory[0]), signals, TICK_S, adapt)
    memory[0] = state.d_hat
    return d_hat


def by_network(
    parameters: network.Parameters, memory: Array, theta: Inputs, eps: float, adapt: bool
) -> float:
    """Return the network's d̂, which remembers of each unit its weight and its column of V."""
    W = [memory[at] for at in range(0, len(memory), 7)]
    V = [
        (memory[at], memory[at + 1], memory[at + 2], memory[at + 3], memory[at + 4], memory[at + 5])
        for at in range(1, len(memory), 7)
    ]
    state, d_hat, _ = network.learnt(parameters, network.State(W, V), theta, eps, TICK_S, adapt)
    for j in range(len(state.W)):
        memory[7 * j] = state.W[j]
        for k in range(6):
            memory[7 * j + 1 + k] = state.V[j][k]
    return d_hat


def _compensator(kind: str, seed: int) -> tuple[Callable[..., float], Any, Array]:
    """Return what estimates d̂, its parameters, and what it remembers at the start: W = 0 and V ~ N(0, 1).

    Without leak a network's V(0) is where it starts and nothing else, so that its parameters need no seed.
    """
    if kind == "integrator":
        return by_integrator, integrator.Parameters(INTEGRAL_GAIN, 0.0, 0.0, inf), np.zeros(1)
    if kind == "network":
        units = np.zeros((UNITS, 7))
        units[:, 1 : 1 + INPUTS] = np.random.default_rng(seed).standard_normal((INPUTS, UNITS)).T
        parameters = network.Parameters(ETA, ETA_V, 0.0, 0.0, inf, ((0.0,) * 6,) * UNITS)
        return by_network, parameters, units.reshape(-1)
    return by_nothing, 0.0, np.zeros(1)
