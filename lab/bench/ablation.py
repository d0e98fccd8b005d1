"""What earns its place: the shipped controller less each of its parts; the network where models are wrong.

Batches of dives without MAVLink bytes (`lab.batch`), on vehicles that no search ever sees. Two questions:

- take one part away: what does it cost, as the vehicle is, with 80 ms that are measured, and with 40 ms that
  the autopilot's filter hides?
- is the network worth more than an observer alone where the nominal model is far off: damping three times as
  large, a dead thruster, a tether that pulls with depth, a path flown again and again?
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from companion.config import Config, load_config
from companion.records import Array, Setpoint
from lab.batch.dives import simulate
from lab.batch.vehicle import Links
from lab.bench.rows import Row, rows, tuned, values_of
from lab.loop.dive import dive
from lab.loop.lockstep import LinkDelay
from lab.loop.scenarios import DEPTH_M, SETTLE_S, Scenario, ensemble, four, hold
from lab.pool import worker_pool
from sim_bridge.config import SimConfig

FIRST_SEED = 1000
HELD_FROM_S = 5.0
BENCH_LINKS = {"as is": LinkDelay(), "+80 ms measured": LinkDelay(up_s=0.041, down_s=0.041)}
DELAYS: Mapping[str, Links] = {
    "as is": Links(),
    "+80 ms measured": Links(up_s=0.041, down_s=0.041),
    "40 ms hidden": Links(up_s=0.041, untold_up_s=0.04),
}
PERIOD_S, PATH_M = 6.0, 0.25
DEAD = 4
"""Index of the thruster that is dead: one of the four vertical ones."""


@dataclass(frozen=True)
class Part:
    """A variant of the shipped controller: what its configuration overrides, and what is switched off."""

    name: str
    overrides: tuple[str, ...] = ()
    finds_hidden: bool = True
    damps: bool = True


WHOLE = Part("shipped default")
PARTS = (
    WHOLE,
    Part("no network", ("heave.compensator='observer'",)),
    Part("observer's d not fed back", ("heave.compensator='network'",)),
    Part("no compensator", ("heave.compensator='none'",)),
    Part("integrator for both", ("heave.compensator='integrator'",)),
    Part("thrusters' lag not undone", ("thrusters.lead_s=0.0",)),
    Part("gains not drawn back", ("delays.gains_bear_s=1.0",)),
    Part("hidden delay not looked for", finds_hidden=False),
    Part("oscillation not damped", damps=False),
    Part("neither of the two", ("delays.gains_bear_s=1.0",), finds_hidden=False),
)
HEADLINES = tuple(part for part in PARTS if part.finds_hidden and part.damps)
"""What `--firmware` dives."""


@dataclass(frozen=True)
class AblationResult:
    """One variant in one case: mean depth RMS (mm), chatter (N a tick), and each dive's RMS.

    `each_mm` has a row for each scenario and a column for each seed.
    """

    variant: str
    case: str
    rms_mm: float
    chatter_n: float
    lost: int
    each_mm: Array


def parts(
    base: SimConfig, settings: Sequence[str], seeds: int, done: Callable[[], None]
) -> list[AblationResult]:
    """Return every variant of PARTS under every delay, over the bench's four scenarios together."""
    results = []
    for part in PARTS:
        config = load_config(overrides=[*settings, *part.overrides])
        for case, links in DELAYS.items():
            figures = [_dive(config, four_of(seeds, i), base, links, part) for i in range(4)]
            results.append(_result(part.name, case, figures))
            done()
    return results


def parts_on_firmware(
    base: SimConfig, settings: Sequence[str], seeds: int, firmware: Path, done: Callable[[], None]
) -> list[AblationResult]:
    """Return the variants that are configuration alone, over the bench's four scenarios, in the full loop.

    Those are HEADLINES, under BENCH_LINKS; the engine that dives before the real firmware is whole.
    """
    results = []
    with worker_pool() as pool:
        for part in HEADLINES:
            config = load_config(overrides=[*settings, *part.overrides])
            for case, link in BENCH_LINKS.items():
                jobs = [(config, which, FIRST_SEED + seed) for which in range(4) for seed in range(seeds)]
                dived = list(pool.map(partial(_dive_firmware, base, link, firmware), jobs))
                figures = [
                    {
                        key: np.array([one[key] for one in dived[i * seeds : (i + 1) * seeds]])
                        for key in dived[0]
                    }
                    for i in range(4)
                ]
                results.append(_result(part.name, case, figures))
                done()
    return results


def wrong_models(
    base: SimConfig, settings: Sequence[str], seeds: int, done: Callable[[], None]
) -> list[AblationResult]:
    """Return every row of `compensating`, with the gains that the search found, in every case of `wrong`."""
    results, found, configured = [], tuned(), load_config(overrides=settings)
    for case, scenarios in wrong(seeds).items():
        for row in compensating(configured):
            config = load_config(overrides=[*settings, *row.overrides(values_of(row, found))])
            results.append(_result(row.name, case, [_dive(config, scenarios, base, Links())]))
            done()
    return results


def compensating(config: Config) -> list[Row]:
    """Return the bench's rows that have the paper's law in heave, with any compensator or none."""
    return [row for row in rows(config) if row.compensates]


def count(settings: Sequence[str]) -> int:
    """Return how often `parts` and `wrong_models` call `done`."""
    return len(PARTS) * len(DELAYS) + len(compensating(load_config(overrides=settings))) * len(wrong(1))


def four_of(seeds: int, which: int) -> list[Scenario]:
    """Return one of the bench's four scenarios for each seed."""
    return [four(FIRST_SEED + seed)[which] for seed in range(seeds)]


def wrong(seeds: int) -> dict[str, list[Scenario]]:
    """Return the cases in which the nominal model is far from the vehicle, or the task repeats."""

    def case(change: Callable[[SimConfig], SimConfig], target: Callable[[float], Setpoint]) -> list[Scenario]:
        def plant(base: SimConfig, seed: int) -> SimConfig:
            return change(ensemble(base, seed))

        return [Scenario("", plant, target, SETTLE_S + 72.0, FIRST_SEED + seed) for seed in range(seeds)]

    return {
        "damping × 3, path": case(_draggy, repeated),
        "damping × 3, waves": case(lambda plant: _wavy(_draggy(plant)), hold()),
        "dead thruster, waves": case(lambda plant: _wavy(_dead(plant)), hold()),
        "tether pulls 8 N a metre, path": case(_tethered, repeated),
        "repeated path": case(lambda plant: plant, repeated),
    }


def repeated(t_s: float) -> Setpoint:
    """Follow 0.25 (1 − cos 2πt/6) below DEPTH_M, again and again."""
    omega = 2.0 * math.pi / PERIOD_S
    phase = omega * max(t_s - SETTLE_S, 0.0)
    moving = float(t_s >= SETTLE_S)
    return Setpoint(
        (math.nan, math.nan, DEPTH_M + PATH_M * (1.0 - math.cos(phase)), 0.0),
        (0.0, 0.0, PATH_M * omega * math.sin(phase), 0.0),
        (0.0, 0.0, moving * PATH_M * omega**2 * math.cos(phase), 0.0),
    )


def _draggy(plant: SimConfig) -> SimConfig:
    hull = plant.hull
    linear, quadratic = list(hull.linear_damping), list(hull.quadratic_damping)
    linear[2], quadratic[2] = 3.0 * linear[2], 3.0 * quadratic[2]
    changed = replace(hull, linear_damping=tuple(linear), quadratic_damping=tuple(quadratic))
    return replace(plant, hull=changed)


def _dead(plant: SimConfig) -> SimConfig:
    gain = [plant.thrusters.gain[0]] * 8
    gain[DEAD] = 0.0
    return replace(plant, thrusters=replace(plant.thrusters, gain=tuple(gain)))


def _tethered(plant: SimConfig) -> SimConfig:
    return replace(
        plant, tether=replace(plant.tether, enabled=True, heave_n_per_m=-8.0, sigma_n=(0.0, 0.0, 0.0))
    )


def _wavy(plant: SimConfig) -> SimConfig:
    return replace(plant, waves=replace(plant.waves, enabled=True, height_m=0.3, period_s=4.0))


def _dive(
    config: Config, scenarios: Sequence[Scenario], base: SimConfig, links: Links, part: Part = WHOLE
) -> dict[str, Array]:
    plants = [scenario.plant(base, scenario.seed) for scenario in scenarios]
    first, seeds = scenarios[0], [scenario.seed for scenario in scenarios]
    return simulate(
        config,
        plants,
        first.target,
        first.duration_s,
        seeds,
        links,
        finds_hidden=part.finds_hidden,
        damps=part.damps,
    )


def _dive_firmware(
    base: SimConfig, link: LinkDelay, firmware: Path, job: tuple[Config, int, int]
) -> dict[str, float]:
    """Return RMS, chatter, and when the supervisor gave up (s), NaN if it did not."""
    config, which, seed = job
    dived = dive(four(seed)[which], config, base, link, firmware)
    figures = dived.figures()
    given_up = ~dived.active & (dived.t_s > HELD_FROM_S)
    lost_s = float(dived.t_s[np.argmax(given_up)]) if given_up.any() else math.nan
    return {key: figures[key] for key in ("depth_rms_mm", "chatter_n")} | {"lost_s": lost_s}


def _result(variant: str, case: str, figures: Sequence[dict[str, Array]]) -> AblationResult:
    rms = np.stack([one["depth_rms_mm"] for one in figures])
    chatter = np.stack([one["chatter_n"] for one in figures])
    lost = int(sum((~np.isnan(one["lost_s"])).sum() for one in figures))
    return AblationResult(variant, case, float(rms.mean()), float(np.nanmean(chatter)), lost, rms)
