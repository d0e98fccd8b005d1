"""The paper's simulations: one degree of freedom, all dives of the table in one array.

    m z̈ = τ − h (ż − v_c)|ż − v_c| − d             the plant (eq. rov); v_c is the current
    z_d = 0.5 (1 − cos 0.1πt)                       the reference (sec. 5)

The controller knows m and h up to ±10 %; it is the one of the vehicle: `rov_law`, `network`, `integrator`,
compiled as they stand and called case by case.
Each case dives twice: from e(0) = 0 (tracking) and from e(0) = 0.1 m (phase portrait).

| symbol | meaning                  | unit   |
|--------|--------------------------|--------|
| z, w   | depth and its rate       | m, m/s |
| e, eps | tracking, combined error | m, m/s |
| tau    | thrust                   | N      |
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, product
from math import cos, exp, inf, pi, sin, sqrt
from typing import Any

import numpy as np

from companion.control import integrator, network
from companion.control.compensator import Inputs, Signals
from companion.control.law import rov_law
from companion.records import Array
from lab.batch.compiled import cached, slotted

MASS_KG = 50.0
DAMPING = 250.0  # N s²/m²
LAM = KAPPA = 3.5
UNITS = 5
INPUTS = 3
ETA, ETA_V = 200.0, 2.0
INTEGRAL_GAIN = ETA * UNITS / 4.0  # what η‖σ‖² is at rest, where each logistic unit gives 1/2

TICK_MS, TICK_S = 10, 0.01
DURATION_S = 60
PERIOD_S = 20  # of the reference, and so of the orbit
SWING = 0.1 * pi  # rad/s, the reference's
STARTS_M = (0.0, 0.1)

DISTURBANCES = ("none", "constant", "sine", "tether", "current")
LAWS = ("derived", "printed")
COMPENSATORS = (("none", 0.0), ("integrator", 0.0), ("network", 0.0), ("network", 2.0))
CORNERS = tuple(product((0.9, 1.1), (0.9, 1.1)))
CANONICAL = (1.1, 0.9)
SEEDS = range(10)


@dataclass(frozen=True, slots=True)
class PaperCase:
    """One row: what disturbs, which law with which compensator, how wrong its model is, and the seed.

    The seed draws the network's first weights and the tether's pull. `mass_ratio` is m̂/m, `damping_ratio`
    ĥ/h; the network learns from `wait_s` on.
    `delay_ms` lets every command arrive late; the paper has none.
    """

    disturbance: str
    law: str
    compensator: str
    mass_ratio: float
    damping_ratio: float
    seed: int
    wait_s: float
    delay_ms: int = 0


@dataclass(frozen=True, slots=True)
class Figures:
    """What came of a case.

    From e(0) = 0 over the whole dive: RMS and largest |e|, RMS of the thrust. From e(0) = 0.1 m: half the
    width of the orbit in e over the last period, and the largest −ė, the overshoot of the paper's fig. 2.
    """

    rms_mm: float
    peak_mm: float
    orbit_mm: float
    peak_rate_mm_s: float
    thrust_rms_n: float


@dataclass(frozen=True, slots=True)
class Trace:
    """One dive as drawn: arrays of shape (ticks,), s, m, m/s and N."""

    t_s: Array
    z_d: Array
    e: Array
    e_dot: Array
    tau: Array


@dataclass(frozen=True, slots=True)
class PaperResult:
    """Figures of every case, in order, and traces of the watched ones: one from each of STARTS_M."""

    figures: list[Figures]
    traces: dict[PaperCase, tuple[Trace, Trace]]


def table() -> list[PaperCase]:
    """Return every row of the table; 10 seeds each, which without network or tether only repeat."""
    return [
        PaperCase(disturbance, law, compensator, *corner, seed, wait_s)
        for (compensator, wait_s), law, corner, disturbance, seed in product(
            COMPENSATORS, LAWS, CORNERS, DISTURBANCES, SEEDS
        )
    ]


def dive(
    cases: Sequence[PaperCase],
    watched: Sequence[PaperCase] = (),
    second_passed: Callable[[], None] = lambda: None,
) -> PaperResult:
    """Dive all `cases` at once; `second_passed` is called after each simulated second."""
    order = sorted(range(len(cases)), key=lambda i: (cases[i].compensator, cases[i].seed))
    fleet = _Fleet([cases[i] for i in order], {case: order.index(cases.index(case)) for case in watched})
    for second in range(DURATION_S):
        for tick in range(second * 1000, second * 1000 + 1000, TICK_MS):
            fleet.command(tick)
            fleet.move(tick)
        second_passed()
    figures = fleet.figures()
    return PaperResult([figures[order.index(i)] for i in range(len(cases))], fleet.traces())


def reference(t_s: float) -> tuple[float, float, float]:
    """Return z_d, ż_d, z̈_d (m, m/s, m/s²)."""
    c, s = cos(SWING * t_s), sin(SWING * t_s)
    return 0.5 * (1.0 - c), 0.5 * SWING * s, 0.5 * SWING**2 * c


class _Sea:
    """Forces d (N) and currents v_c (m/s) that each case feels."""

    def __init__(self, cases: Sequence[PaperCase]) -> None:
        self._seeds = sorted({case.seed for case in cases})
        self._row = np.array(
            [
                DISTURBANCES.index(case.disturbance) * len(self._seeds) + self._seeds.index(case.seed)
                for case in cases
            ]
        )
        # The tether's pull: an Ornstein-Uhlenbeck process, σ = 5 N, τ = 2 s, new every millisecond.
        draws = [np.random.default_rng((1, seed)) for seed in self._seeds]
        noise = 5.0 * np.array([draw.standard_normal(DURATION_S * 1000 + 1) for draw in draws]).T
        self._tether, self._gusts = noise[0], noise[1:]
        self._kept = exp(-0.001 / 2.0)
        self._force = np.zeros((len(DISTURBANCES), len(self._seeds)))
        self._flow = np.zeros_like(self._force)

    def blow(self, ms: int) -> None:
        """Let a millisecond pass for the tether."""
        self._tether = self._kept * self._tether + sqrt(1.0 - self._kept**2) * self._gusts[ms]

    def force_and_current(self, t_s: float) -> tuple[Array, Array]:
        """Return d and v_c, each of shape (cases,)."""
        self._force[DISTURBANCES.index("constant")] = 5.0
        self._force[DISTURBANCES.index("sine")] = 5.0 * sin(2.0 * pi * t_s / 10.0)
        self._force[DISTURBANCES.index("tether")] = self._tether
        self._flow[DISTURBANCES.index("current")] = 0.05 + 0.1 * sin(2.0 * pi * t_s / 15.0)
        return self._force.take(self._row), self._flow.take(self._row)


class _Fleet:
    """Plants, laws and compensators of all cases: arrays of shape (starts, cases)."""

    def __init__(self, cases: Sequence[PaperCase], watched: dict[PaperCase, int]) -> None:
        shape = (len(STARTS_M), len(cases))
        self._sea = _Sea(cases)
        self._z = np.array(STARTS_M)[:, None] + np.zeros(shape)
        self._w = np.zeros(shape)
        self._m_hat = MASS_KG * np.array([case.mass_ratio for case in cases])
        self._h_hat = DAMPING * np.array([case.damping_ratio for case in cases])
        printed = np.array([case.law == "printed" for case in cases])
        self._kappa = np.where(printed, KAPPA / self._m_hat, KAPPA)  # −κε is −m κ' ε with κ' = κ/m
        self._wait_ms = np.array([1000.0 * case.wait_s for case in cases])
        self._compensators = list(_compensators(cases))

        self._delay_ms = np.array([case.delay_ms for case in cases])
        self._delayed = bool(self._delay_ms.any())
        self._sent = np.zeros((int(self._delay_ms.max()) // TICK_MS + 2, *shape))

        self._square, self._thrust_square = np.zeros(shape), np.zeros(shape)
        self._peak, self._peak_rate = np.zeros(shape), np.zeros(shape)
        self._low, self._high = np.full(shape, np.inf), np.full(shape, -np.inf)
        self._watched = watched
        self._seen: list[tuple[float, float, Array, Array, Array]] = []

    def command(self, ms: int) -> None:
        """Look, learn, and set the thrust that is held for the next tick."""
        t_s = ms / 1000.0
        z_d, z_d_dot, z_d_ddot = reference(t_s)
        e, e_dot = self._z - z_d, self._w - z_d_dot
        adapt = ms >= self._wait_ms
        tau = np.zeros_like(e)
        for columns, asked, parameters, memory in self._compensators:
            asked(
                *(parameters, memory, self._m_hat[columns], self._h_hat[columns], self._kappa[columns]),
                *(adapt[columns], z_d_ddot, self._w[:, columns], e[:, columns], e_dot[:, columns]),
                tau[:, columns],
            )
        self._sent[ms // TICK_MS % len(self._sent)] = tau
        self._note(t_s, z_d, e, e_dot, tau)

    def move(self, start_ms: int) -> None:
        """Move the plants through one tick: RK4 at 1 ms, the thrust held."""
        dt = 0.001
        tau = self._sent[start_ms // TICK_MS % len(self._sent)]
        for ms in range(start_ms, start_ms + TICK_MS):
            if self._delayed:
                slot = (ms - self._delay_ms) // TICK_MS % len(self._sent)
                tau = np.take_along_axis(self._sent, slot[None, None], axis=0)[0]
            w, drive_now, flow_now = self._w, *self._drive(tau, ms)
            drive_mid, flow_mid = self._drive(tau, ms + 0.5)
            drive_end, flow_end = self._drive(tau, ms + 1.0)
            a1 = _acceleration(w - flow_now, drive_now)
            a2 = _acceleration(w + (0.5 * dt) * a1 - flow_mid, drive_mid)
            a3 = _acceleration(w + (0.5 * dt) * a2 - flow_mid, drive_mid)
            a4 = _acceleration(w + dt * a3 - flow_end, drive_end)
            middle = a2 + a3
            self._z = self._z + dt * w + (dt * dt / 6.0) * (a1 + middle)
            self._w = w + (dt / 6.0) * (a1 + 2.0 * middle + a4)
            self._sea.blow(ms)

    def figures(self) -> list[Figures]:
        """Return what came of each case."""
        ticks = DURATION_S * 1000 / TICK_MS
        columns = (
            1000.0 * np.sqrt(self._square[0] / ticks),
            1000.0 * self._peak[0],
            500.0 * (self._high[1] - self._low[1]),
            1000.0 * self._peak_rate[1],
            np.sqrt(self._thrust_square[0] / ticks),
        )
        return [Figures(*map(float, row)) for row in zip(*columns, strict=True)]

    def traces(self) -> dict[PaperCase, tuple[Trace, Trace]]:
        """Return the watched dives, from e(0) = 0 and from e(0) = 0.1 m."""
        if not self._watched:
            return {}
        t_s, z_d, e, e_dot, tau = (np.array(column) for column in zip(*self._seen, strict=True))
        return {
            case: (
                Trace(t_s, z_d, e[:, 0, i], e_dot[:, 0, i], tau[:, 0, i]),
                Trace(t_s, z_d, e[:, 1, i], e_dot[:, 1, i], tau[:, 1, i]),
            )
            for i, case in enumerate(self._watched)
        }

    def _drive(self, tau: Array, ms: float) -> tuple[Array, Array]:
        force, flow = self._sea.force_and_current(ms / 1000.0)
        return (tau - force) / MASS_KG, flow

    def _note(self, t_s: float, z_d: float, e: Array, e_dot: Array, tau: Array) -> None:
        self._square += e * e
        self._thrust_square += tau * tau
        np.maximum(self._peak, np.abs(e), out=self._peak)
        np.maximum(self._peak_rate, -e_dot, out=self._peak_rate)
        if t_s >= DURATION_S - PERIOD_S:
            np.maximum(self._high, e, out=self._high)
            np.minimum(self._low, e, out=self._low)
        if self._watched:
            columns = list(self._watched.values())
            self._seen.append((t_s, z_d, e[:, columns], e_dot[:, columns], tau[:, columns]))


def _acceleration(relative: Array, drive: Array) -> Array:
    """Return z̈ of the plant for the speed through the water and (τ − d)/m."""
    return drive - (DAMPING / MASS_KG) * relative * np.abs(relative)


def asked(
    parameters: Any,
    memory: Array,
    m_hat: Array,
    h_hat: Array,
    kappa: Array,
    adapt: Array,
    z_d_ddot: float,
    w: Array,
    e: Array,
    e_dot: Array,
    tau: Array,
) -> None:
    """Write the thrust of all starts and cases to `tau`; `memory` (starts, cases, n) is what is learnt."""
    for start in range(tau.shape[0]):
        for i in range(tau.shape[1]):
            now, rate, speed = e[start, i], e_dot[start, i], w[start, i]
            theta = (1.0, 10.0 * now, 3.0 * rate, 0.0, 0.0, 0.0)
            d_hat = estimated(parameters, memory[start, i], theta, rate + LAM * now, adapt[i])
            drag = h_hat[i] * speed * abs(speed)
            terms = rov_law(drag, d_hat, m_hat[i], z_d_ddot, now, rate, LAM, kappa[i])
            tau[start, i] = terms.feedforward + terms.feedback + d_hat


def estimated(parameters: Any, memory: Array, theta: Inputs, eps: float, adapt: bool) -> float:
    """Return d̂ of one case, having learnt for a tick: a slot."""
    raise NotImplementedError


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


ESTIMATES = {"none": by_nothing, "integrator": by_integrator, "network": by_network}


def _compensators(cases: Sequence[PaperCase]) -> Iterator[tuple[slice, Callable[..., None], Any, Array]]:
    """Give what compensates which columns, its parameters and what it remembers of each start and case.

    Without leak a network's V(0) is where it starts and nothing else, so that one serves all seeds.
    """
    gains = integrator.Parameters(INTEGRAL_GAIN, 0.0, 0.0, inf)
    learning = network.Parameters(ETA, ETA_V, 0.0, 0.0, inf, ((0.0,) * 6,) * UNITS, (0.0,) * UNITS)
    parameters = {"none": 0.0, "integrator": gains, "network": learning}
    start = 0
    for kind, group in groupby(cases, key=lambda case: case.compensator):
        first = [_first_weights(case.seed) if kind == "network" else np.zeros(1) for case in group]
        stop = start + len(first)
        loop = cached(slotted(asked, estimated=ESTIMATES[kind]))
        yield slice(start, stop), loop, parameters[kind], np.array([first] * len(STARTS_M))
        start = stop


def _first_weights(seed: int) -> Array:
    """Return W = 0 and V(0) as `by_network` remembers them."""
    units = np.zeros((UNITS, 7))
    units[:, 1 : 1 + INPUTS] = np.random.default_rng(seed).standard_normal((INPUTS, UNITS)).T
    return units.reshape(-1)
