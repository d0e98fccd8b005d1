"""One search for every row of the benches: CMA-ES over the logarithms of its knobs, on training seeds.

What counts is the mean RMS of the depth, or of the place (mm), of vehicles unlike the model, at equal
chatter: a row pays EQUAL_PRICE for each newton that the mean of these dives has more than with the shipped
default. All candidates of a generation dive at once (`lab.batch`).
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from companion.arrays import Array
from companion.assembly import refuse_fast_gains
from companion.config import Config, ConfigError
from lab.batch.stand_in import Links
from lab.loop.lockstep import LinkDelay
from lab.loop.scenarios import Scenario, positioned
from lab.studies.competitors import WIDTH, written
from lab.studies.reality import COUNTS_S
from lab.studies.trials import hold, rough
from sim_bridge.sim_config import SimConfig

TRAINING_SEEDS = 8
TRAINING_S = 24.0
EVALUATIONS = 150
GENERATION = 10
EQUAL_PRICE = 20.0
LOST_MM = 1000.0

Training = Sequence[Scenario]
"""The dives of a score."""


class Stage(NamedTuple):
    """What a search turns: knobs and their starts; `place`: it judges the place, not the depth.

    `chatter_n`: the mean of all dives that costs nothing.
    """

    knobs: Mapping[str, float]
    settings: Sequence[str]
    place: bool
    chatter_n: float

    def overrides(self, values: Mapping[str, float]) -> list[str]:
        """Return what sets a configuration so."""
        return [*self.settings, *written(values)]


class SearchResult(NamedTuple):
    """What a search found, its score and that of where it started (mm)."""

    values: dict[str, float]
    score: float
    start_score: float
    evaluations: int


def search(
    stage: Stage,
    load: Callable[[Sequence[str]], Config],
    base: SimConfig,
    dives: Training,
    *,
    evaluations: int = EVALUATIONS,
    done: Callable[[int], object] = lambda count: None,
) -> SearchResult:
    """Search the knobs, each by up to the factor WIDTH; `load` makes a configuration of overrides.

    Deterministic for the same arguments. `done` is told after each generation how many were evaluated.
    """
    import cma  # the help of `holdfast lab tune` needs neither this nor numba

    keys, start = list(stage.knobs), np.log(list(stage.knobs.values()))

    def of(candidates: Sequence[Array]) -> list[float]:
        values = [dict(zip(keys, np.exp(start + x).tolist(), strict=True)) for x in candidates]
        return scores(stage, values, load, base, dives)

    width = math.log(WIDTH)
    options = {"bounds": [-width, width], "seed": 1, "verbose": -9, "popsize": GENERATION}
    strategy = cma.CMAEvolutionStrategy(np.zeros(len(keys)), width / 4.0, options)
    best_x = np.zeros(len(keys))
    best = start_score = of([best_x])[0]
    spent = 1
    while spent < evaluations:
        candidates = strategy.ask()
        judged = of(candidates)
        strategy.tell(candidates, judged)
        if min(judged) < best:
            best, best_x = min(judged), candidates[int(np.argmin(judged))]
        spent += len(candidates)
        done(len(candidates))
    values = dict(zip(keys, (float(f"{value:.4g}") for value in np.exp(start + best_x)), strict=True))
    return SearchResult(values, best, start_score, spent)


def scores(
    stage: Stage,
    values: Sequence[Mapping[str, float]],
    load: Callable[[Sequence[str]], Config],
    base: SimConfig,
    dives: Training,
) -> list[float]:
    """Return the score of each set of values, mm; one that the companion would refuse counts as lost."""
    configs = [_configured(load, stage.overrides(value)) for value in values]
    sound = [config for config in configs if config is not None]
    found = np.full(len(values), LOST_MM)
    if not sound:
        return found.tolist()
    error_mm, chatter_n = _dived(sound, base, dives, stage.place)
    price = EQUAL_PRICE * np.maximum(chatter_n.mean(1) - stage.chatter_n, 0.0)
    found[[config is not None for config in configs]] = error_mm.mean(1) + price
    return found.tolist()


def mean_chatter_n(config: Config, base: SimConfig, dives: Training, *, place: bool) -> float:
    """Return a configuration's chatter in the mean of all dives."""
    return float(_dived([config], base, dives, place)[1].mean())


def _dived(configs: Sequence[Config], base: SimConfig, dives: Training, place: bool) -> tuple[Array, Array]:
    """Return error (mm; LOST_MM where lost) and chatter (N) of each configuration in each dive."""
    from lab.batch.simulate import simulate

    plants = [one.plant(base, one.seed) for one in dives]
    duration_s, link = dives[0].duration_s, LinkDelay()
    figures = simulate(
        [config for config in configs for _ in dives],
        [positioned(plant) if place else plant for plant in plants] * len(configs),
        [one.target for one in dives] * len(configs),
        duration_s,
        [one.seed for one in dives] * len(configs),
        Links(link.up_s, link.down_s),
        since_s=duration_s - TRAINING_S,
    )
    rms, chatter_n = ("place_rms_mm", "place_chatter_n") if place else ("depth_rms_mm", "chatter_n")
    held = np.isnan(figures["lost_s"]) & ~np.isnan(figures[rms])
    error_mm, of_held_n = np.where(held, figures[rms], LOST_MM), np.where(held, figures[chatter_n], 0.0)
    return error_mm.reshape(len(configs), -1), of_held_n.reshape(len(configs), -1)


def _configured(load: Callable[[Sequence[str]], Config], overrides: Sequence[str]) -> Config | None:
    try:
        config = load(overrides)
        refuse_fast_gains(config)
    except ConfigError:
        return None
    return config


def training(seeds: int) -> Training:
    """Return the dives of a score: vehicles of `bench reality`, which no bench dives."""
    return [
        Scenario("rough", lambda base, seed: rough(seed).plant, hold, COUNTS_S + TRAINING_S, seed)
        for seed in range(seeds)
    ]
