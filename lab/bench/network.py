"""Is the network worth it? Every degree of freedom, in the full loop, each learner beside the observer's d̂.

Each dive moves or disturbs all four degrees of freedom at once, and all four have the same kind of learner:
one dive judges four. One number is searched, alike for all learners: how fast a learner learns, as the time
mκ/K in which it would integrate a constant error away (K is its integral gain; SETTLING_S is the grid).
TRAINING vehicles, which do not judge, choose the time of each degree of freedom.

The DVL of these dives has its noise but no drift: a drift is an error that no controller sees.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from msgspec.structs import replace

from companion import assembly
from companion.config import Config, load_config
from companion.control.bounds import wrap
from companion.engine import Engine
from companion.records import PSI, Array, Request, Setpoint, State
from lab.loop.dive import TRUE_PSI
from lab.loop.lockstep import LinkDelay, Lockstep
from lab.loop.scenarios import DEPTH_M, SETTLE_S, ensemble
from lab.pool import worker_pool
from sim_bridge.config import SimConfig
from sim_bridge.vehicle import Vehicle

AXES = ("surge", "sway", "heave", "yaw")
UNITS = ("mm", "mm", "mm", "°")
OBSERVER = "observer"
LEARNERS = ("network", "regressor", "integrator")
SETTLING_S = (8.0, 4.0, 2.0, 1.0)
MAY_COST = 0.02
TRAINING, FIRST_TRAINING_SEED = 2, 5000
FIRST_SEED = 6000
MEASURED_S = 32.0
AMPLITUDES = (0.25, 0.25, 0.25, 0.25)
"""Of the path: m, m, m, rad."""

PERIODS_S = (8.0, 9.0, 6.0, 7.0)
SIX = (0, 1, 2, 5)
"""Where AXES stand in a vector of six."""

Change = Callable[[SimConfig], SimConfig]


@dataclass(frozen=True)
class Variant:
    """What learns beside the observer's d̂ on every axis, `settling_s` of each; empty: the observer alone."""

    learner: str
    settling_s: tuple[float, ...] = ()

    def config(self, settings: Sequence[str]) -> Config:
        """Return the companion's configuration."""
        if not self.settling_s:
            return load_config(overrides=[*settings, *_each("compensator", [OBSERVER] * len(AXES))])
        chosen = f"{self.learner}+observer"
        probe = load_config(
            overrides=[
                *settings,
                *_each("compensator", [chosen] * len(AXES)),
                *_each("learning_rate", [1.0] * len(AXES)),
            ]
        )
        rates = []
        for axis, settling_s in zip(probe.axes, self.settling_s, strict=True):
            ((_, integral_gain),) = assembly.compensators(probe, axis)
            rate = axis.mass * axis.kappa_per_s / (settling_s * integral_gain)
            rates.append(float(f"{rate:.3g}"))
        return load_config(
            overrides=[*settings, *_each("compensator", [chosen] * len(AXES)), *_each("learning_rate", rates)]
        )


@dataclass(frozen=True)
class Outcome:
    """One dive: RMS error (UNITS) and chatter (N; N m a tick) of AXES, and whether it was given up."""

    variant: Variant
    case: str
    seed: int
    rms: tuple[float, ...]
    chatter: tuple[float, ...]
    lost: bool


def study(
    base: SimConfig, settings: Sequence[str], seeds: int, done: Callable[[], None]
) -> tuple[dict[str, Variant], list[Outcome]]:
    """Search the learners' rates on training vehicles; return what was found, and the dives of the others."""
    trained = _dive_all(
        [
            Variant(OBSERVER),
            *(Variant(learner, (one,) * len(AXES)) for learner in LEARNERS for one in SETTLING_S),
        ],
        {name: ends for name, ends in cases().items() if name in TRAINED_BY},
        range(FIRST_TRAINING_SEED, FIRST_TRAINING_SEED + TRAINING),
        base,
        settings,
        done,
    )
    found = {learner: best(learner, trained) for learner in LEARNERS}
    variants, judges = [Variant(OBSERVER), *found.values()], range(FIRST_SEED, FIRST_SEED + seeds)
    return found, _dive_all(variants, cases(), judges, base, settings, done)


def count(seeds: int) -> int:
    """Return how often `study` calls `done`."""
    return (1 + len(LEARNERS) * len(SETTLING_S)) * len(TRAINED_BY) * TRAINING + (1 + len(LEARNERS)) * len(
        cases()
    ) * seeds


def best(learner: str, trained: Sequence[Outcome]) -> Variant:
    """Return the learner with, for each axis, the time of the smallest error among those that cost little.

    Errors are geometric means. Little is at most MAY_COST over the observer alone in each case; if every time
    costs more, the slowest is taken.
    """
    alone = Variant(OBSERVER)

    def over_observer(settling_s: float, i: int) -> list[float]:
        variant = Variant(learner, (settling_s,) * len(AXES))
        return [mean(trained, variant, case, i) / mean(trained, alone, case, i) for case in TRAINED_BY]

    found = []
    for i in range(len(AXES)):
        ratios = {settling_s: over_observer(settling_s, i) for settling_s in SETTLING_S}
        cheap = [one for one in SETTLING_S if max(ratios[one]) <= 1.0 + MAY_COST] or [max(SETTLING_S)]
        found.append(min(cheap, key=lambda one: math.prod(ratios[one])))
    return Variant(learner, tuple(found))


def mean(outcomes: Sequence[Outcome], variant: Variant, case: str, i: int) -> float:
    """Return the geometric mean, over the vehicles, of a variant's error on axis `i` in a case."""
    errors = [one.rms[i] for one in outcomes if one.variant == variant and one.case == case]
    return math.exp(sum(map(math.log, errors)) / len(errors))


# --- Vehicles and water -----------------------------------------------------------------------------------


def vehicle(base: SimConfig, seed: int) -> SimConfig:
    """Draw a vehicle: the bench's, and on the other axes added mass × 0.7..1.3 and damping × 0.5..1.5."""
    drawn = ensemble(base, seed)
    draw = np.random.default_rng((seed, 3)).uniform
    added, linear, quadratic = (
        list(six) for six in (drawn.hull.added_mass, drawn.hull.linear_damping, drawn.hull.quadratic_damping)
    )
    for i in (0, 1, 5):
        added[i] *= draw(0.7, 1.3)
        damping = draw(0.5, 1.5)
        linear[i] *= damping
        quadratic[i] *= damping
    hull = replace(
        drawn.hull, added_mass=tuple(added), linear_damping=tuple(linear), quadratic_damping=tuple(quadratic)
    )
    return replace(drawn, hull=hull, sensors=replace(drawn.sensors, dvl=True, dvl_drift_m=0.0))


def held(t_s: float) -> Setpoint:
    """Stay at one place and heading."""
    return Setpoint((0.0, 0.0, DEPTH_M, 0.0))


def path(t_s: float) -> Setpoint:
    """Move all four axes at once: A (1 − cos 2πt/T) each, from SETTLE_S on."""
    since_s, moving = max(t_s - SETTLE_S, 0.0), float(t_s >= SETTLE_S)
    omega = [2.0 * math.pi / period_s for period_s in PERIODS_S]
    start = (0.0, 0.0, DEPTH_M, 0.0)
    rows = [
        (
            x + a * (1.0 - math.cos(w * since_s)),
            a * w * math.sin(w * since_s),
            moving * a * w * w * math.cos(w * since_s),
        )
        for x, a, w in zip(start, AMPLITUDES, omega, strict=True)
    ]
    eta, eta_dot, eta_ddot = zip(*rows, strict=True)
    return Setpoint(eta, eta_dot, eta_ddot)


def cases() -> dict[str, tuple[Change, Callable[[float], Setpoint]]]:
    """Return how each case changes a vehicle and its water, and what it has to do."""
    return {
        "waves": (_waves, held),
        "path": (_tether, path),
        "gusts, load": (_gusts, held),
        "damping × 3, path": (lambda plant: _tether(_damped(plant, 3.0)), path),
        "damping × 3, waves": (lambda plant: _waves(_damped(plant, 3.0)), held),
        "damping / 3, path": (lambda plant: _tether(_damped(plant, 1.0 / 3.0)), path),
        "mass × 1.5, path": (lambda plant: _tether(_heavier(plant)), path),
        "thrust / 2, path": (lambda plant: _tether(_thrusting(plant, 0.5)), path),
        "thrust × 2, path": (lambda plant: _tether(_thrusting(plant, 2.0)), path),
        "weak thrusters, path": (lambda plant: _tether(_weak(plant)), path),
        "tether pulls, path": (_pulled, path),
    }


TRAINED_BY = ("waves", "path", "gusts, load")


def _waves(plant: SimConfig) -> SimConfig:
    return replace(
        plant, waves=replace(plant.waves, enabled=True, height_m=0.3, period_s=4.0, direction_deg=30.0)
    )


def _tether(plant: SimConfig) -> SimConfig:
    return replace(plant, tether=replace(plant.tether, enabled=True, sigma_n=(2.0, 2.0, 2.0), tau_s=2.0))


def _gusts(plant: SimConfig) -> SimConfig:
    """Let the current vary, and hang a load on."""
    return replace(
        _tether(plant),
        current=replace(plant.current, enabled=True, speed_m_s=0.2, sigma_m_s=0.08, tau_s=8.0),
        load=replace(plant.load, enabled=True, weight_n=12.0, on_s=20.0, off_s=40.0),
    )


def _damped(plant: SimConfig, factor: float) -> SimConfig:
    hull = plant.hull
    linear, quadratic = list(hull.linear_damping), list(hull.quadratic_damping)
    for i in SIX:
        linear[i] *= factor
        quadratic[i] *= factor
    return replace(
        plant, hull=replace(hull, linear_damping=tuple(linear), quadratic_damping=tuple(quadratic))
    )


def _heavier(plant: SimConfig) -> SimConfig:
    """Let water that is carried along add half of the mass, and of the inertia about the vertical."""
    hull = plant.hull
    added = list(hull.added_mass)
    for i in SIX:
        added[i] += 0.5 * (added[i] + (hull.inertia_kg_m2[2] if i == TRUE_PSI else hull.mass_kg))
    return replace(plant, hull=replace(hull, added_mass=tuple(added)))


def _thrusting(plant: SimConfig, factor: float) -> SimConfig:
    gain = tuple(factor * one for one in plant.thrusters.gain)
    return replace(plant, thrusters=replace(plant.thrusters, gain=gain))


def _weak(plant: SimConfig) -> SimConfig:
    """Halve the thrust of one horizontal and of one vertical thruster."""
    gain = [plant.thrusters.gain[0]] * 8
    gain[0] *= 0.5
    gain[4] *= 0.5
    return replace(plant, thrusters=replace(plant.thrusters, gain=tuple(gain)))


def _pulled(plant: SimConfig) -> SimConfig:
    tether = replace(_tether(plant).tether, heave_n_per_m=-8.0, pull_n=(4.0, 4.0, 0.0))
    return replace(plant, tether=tether)


# --- Dives ------------------------------------------------------------------------------------------------


def _dive_all(
    variants: Sequence[Variant],
    which: Mapping[str, tuple[Change, Callable[[float], Setpoint]]],
    seeds: Sequence[int],
    base: SimConfig,
    settings: Sequence[str],
    done: Callable[[], None],
) -> list[Outcome]:
    jobs = [(variant, case, seed) for seed in seeds for case in which for variant in variants]
    outcomes = []
    with worker_pool() as pool:
        for outcome in pool.map(partial(_dive, base, settings), jobs):
            outcomes.append(outcome)
            done()
    return outcomes


def _dive(base: SimConfig, settings: Sequence[str], job: tuple[Variant, str, int]) -> Outcome:
    variant, case, seed = job
    change, target = cases()[case]
    config = variant.config(settings)
    loop = Lockstep(
        Vehicle(change(vehicle(base, seed)), seed),
        Engine(config, target(0.0), arm=True),
        LinkDelay(),
        seed,
        config.loop.rate_hz,
    )
    loop.requests = [Request.ENGAGE]
    errors, taus, active = [], [], True
    for step in loop.run(SETTLE_S + MEASURED_S, target):
        if step.t_s < SETTLE_S:
            continue
        wanted, eta = target(step.t_s).eta_d, step.truth.eta
        active &= step.sample.verdict.state is State.ACTIVE
        errors.append([eta[i] - w for i, w in zip(SIX, wanted, strict=True)])
        errors[-1][PSI] = math.degrees(wrap(errors[-1][PSI]))
        taus.append(step.sample.delivered.tau)
    scale = (1e3, 1e3, 1e3, 1.0)
    rms = tuple(s * r for s, r in zip(scale, _rms(np.array(errors)), strict=True))
    return Outcome(variant, case, seed, rms, tuple(_rms(np.diff(np.array(taus), axis=0))), not active)


def _each(key: str, values: Sequence[object]) -> list[str]:
    return [f"{axis}.{key}={value!r}" for axis, value in zip(AXES, values, strict=True)]


def _rms(rows: Array) -> Iterator[float]:
    """Return the RMS of each column."""
    return iter(np.sqrt(np.mean(rows * rows, axis=0)).tolist())
