"""One search for every row of the bench: CMA-ES over the logarithms of its knobs, on training seeds.

Every candidate dives the four scenarios, shortened to TRAINING_S, with TRAINING_SEEDS vehicles that no bench
ever sees, which meet the four CASES in turn: half of them 40 ms more delay each way, which is measured as in
the full loop, half of them 15 % more thrust and 40 ms more in the autopilot's filter, which no stamp shows.
What counts is the mean RMS of the depth, or of the place (mm), and CHATTER_PRICE for each newton that the
command moves by more than CHATTER_N a tick (RMS). All candidates of a generation dive at once
(`lab.batch`); those of ALT_HOLD in the full loop, which takes ten times as long.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from companion.assembly import refuse_fast_gains
from companion.config import Config, ConfigError
from companion.records import Array, Setpoint
from lab.batch.stand_in import Links
from lab.loop.lockstep import LinkDelay
from lab.loop.scenarios import SETTLE_S, Scenario, four, positioned, trajectory
from lab.rivals import alt_hold
from lab.studies.competitors import WIDTH, Competitor
from lab.studies.reality import rough
from lab.studies.unlike import COUNTS_S, hold
from sim_bridge.config import SimConfig

TRAINING_SEEDS = 8
TRAINING_S = 24.0
EVALUATIONS = 150
GENERATION = 10
CHATTER_N = 3.5
CHATTER_PRICE = 2.0
LOST_MM = 1000.0
FAST_AFTER_S = 12.0
"""The shortened trajectory starts this long before the paper's path gives way to the fast one."""


class TrainingCase(NamedTuple):
    """What a dive meets: more delay each way, delay that is hidden, and its thrust against nominal."""

    longer_s: float
    hidden_s: float
    thrust: float

    def __str__(self) -> str:
        """Say it as `tuned.toml` does."""
        longer_ms, hidden_ms = 1000.0 * self.longer_s, 1000.0 * self.hidden_s
        return f"+{longer_ms:g} ms each way, {hidden_ms:g} ms hidden, thrust x {self.thrust:g}"


CASES = (
    TrainingCase(0.0, 0.0, 1.0),
    TrainingCase(0.0, 0.04, 1.15),
    TrainingCase(0.04, 0.0, 1.0),
    TrainingCase(0.04, 0.04, 1.15),
)


class Found(NamedTuple):
    """What a search found, its score and that of where it started (mm)."""

    values: dict[str, float]
    score: float
    start_score: float
    evaluations: int


def search(
    row: Competitor,
    load: Callable[[Sequence[str]], Config],
    base: SimConfig,
    dives: Sequence[tuple[Scenario, TrainingCase]],
    *,
    evaluations: int = EVALUATIONS,
    done: Callable[[int], object] = lambda count: None,
) -> Found:
    """Search the knobs of `row`, each by up to the factor WIDTH; `load` makes a configuration of overrides.

    Deterministic for the same arguments. `done` is told after each generation how many were evaluated.
    """
    import cma  # the help of `holdfast lab tune` needs neither this nor numba

    keys, start = list(row.knobs), np.log(list(row.knobs.values()))

    def of(candidates: Sequence[Array]) -> list[float]:
        values = [dict(zip(keys, np.exp(start + x).tolist(), strict=True)) for x in candidates]
        return scores(row, values, load, base, dives)

    width = math.log(WIDTH)
    options = {"bounds": [-width, width], "seed": 1, "verbose": -9, "popsize": GENERATION}
    strategy = cma.CMAEvolutionStrategy(np.zeros(len(keys)), width / 4.0, options)
    best, best_x = of([np.zeros(len(keys))])[0], np.zeros(len(keys))
    start_score, spent = best, 1
    while spent < evaluations:
        candidates = strategy.ask()
        judged = of(candidates)
        strategy.tell(candidates, judged)
        if min(judged) < best:
            best, best_x = min(judged), candidates[int(np.argmin(judged))]
        spent += len(candidates)
        done(len(candidates))
    values = dict(zip(keys, (float(f"{value:.4g}") for value in np.exp(start + best_x)), strict=True))
    return Found(values, best, start_score, spent)


def scores(
    row: Competitor,
    values: Sequence[Mapping[str, float]],
    load: Callable[[Sequence[str]], Config],
    base: SimConfig,
    dives: Sequence[tuple[Scenario, TrainingCase]],
) -> list[float]:
    """Return the score of each set of values, mm; one that the companion would refuse counts as lost."""
    configs = [_configured(load, row.overrides(value)) for value in values]
    taken = [i for i, config in enumerate(configs) if config is not None]
    found = np.full(len(values), LOST_MM)
    if taken:
        sound = [config for config in configs if config is not None]
        found[taken] = _scores(row, [values[i] for i in taken], sound, base, dives)
    return [float(score) for score in found]


def _configured(load: Callable[[Sequence[str]], Config], overrides: Sequence[str]) -> Config | None:
    try:
        config = load(overrides)
        refuse_fast_gains(config)
    except ConfigError:
        return None
    return config


def _scores(
    row: Competitor,
    values: Sequence[Mapping[str, float]],
    configs: Sequence[Config],
    base: SimConfig,
    dives: Sequence[tuple[Scenario, TrainingCase]],
) -> Array:
    figures = _dive(row, values, configs, base, dives)
    of = ("place_rms_mm", "place_chatter_n") if row.place else ("depth_rms_mm", "chatter_n")
    rms, chatter_n = figures[of[0]], figures[of[1]]
    rms = np.where(np.isnan(rms), LOST_MM, rms)
    price = CHATTER_PRICE * np.maximum(chatter_n - CHATTER_N, 0.0)
    lost = ~np.isnan(figures.get("lost_s", np.full(len(rms), np.nan)))
    mean: Array = np.where(lost, LOST_MM, rms + price).reshape(len(values), -1).mean(1)
    return mean


def _dive(
    row: Competitor,
    values: Sequence[Mapping[str, float]],
    configs: Sequence[Config],
    base: SimConfig,
    dives: Sequence[tuple[Scenario, TrainingCase]],
) -> dict[str, Array]:
    """Dive all with each of `values`: figures of shape (values · dives,)."""
    if row.steers == "autopilot":
        each = [_by_autopilot(gains, *dived, base) for gains in values for dived in dives]
        return {key: np.array([figures[key] for figures in each]) for key in ("depth_rms_mm", "chatter_n")}
    from lab.batch.simulate import simulate

    of_one = [_stronger(scenario.plant(base, scenario.seed), case.thrust) for scenario, case in dives]
    plants = [positioned(plant) if row.place else plant for plant in of_one] * len(values)
    seeds = [scenario.seed for scenario, _ in dives] * len(values)
    longer_s, hidden_s, _ = np.array([case for _, case in dives] * len(values)).T
    targets = [scenario.target for scenario, _ in dives] * len(values)
    duration_s, link = dives[0][0].duration_s, LinkDelay()
    candidates = [config for config in configs for _ in dives]
    up_s = link.up_s + longer_s + hidden_s
    links = Links(up_s, link.down_s + longer_s, untold_up_s=hidden_s)
    return simulate(candidates, plants, targets, duration_s, seeds, links, since_s=duration_s - TRAINING_S)


def _by_autopilot(
    gains: Mapping[str, float], scenario: Scenario, case: TrainingCase, base: SimConfig
) -> dict[str, float]:
    """Dive once in the full loop with these parameters of the autopilot; return its figures."""
    plant = _stronger(scenario.plant(base, scenario.seed), case.thrust)
    met = Scenario(scenario.name, lambda *_: plant, scenario.target, scenario.duration_s, scenario.seed)
    link = LinkDelay(down_s=LinkDelay().down_s + case.longer_s)
    return alt_hold.dive(met, base, link, dict(gains)).figures()


def training(seeds: int, vary: Callable[[SimConfig, int], SimConfig]) -> list[tuple[Scenario, TrainingCase]]:
    """Return the dives of a score, shortened, and what each meets."""
    dives = []
    for seed in range(seeds):
        for whole in four(seed, vary):
            target = _fast_trajectory if whole.name == "path" else whole.target
            short = Scenario(whole.name, whole.plant, target, SETTLE_S + TRAINING_S, seed)
            dives.append((short, CASES[seed % len(CASES)]))
    return dives


def training_of_reality(seeds: int) -> list[tuple[Scenario, TrainingCase]]:
    """Return the dives of a score on vehicles of `bench reality`, which no bench dives."""
    return [
        (Scenario("rough", lambda base, seed: rough(seed), hold, COUNTS_S + TRAINING_S, seed), CASES[0])
        for seed in range(seeds)
    ]


def _fast_trajectory(t_s: float) -> Setpoint:
    return trajectory(t_s + 60.0 - FAST_AFTER_S)


def _stronger(plant: SimConfig, thrust: float) -> SimConfig:
    gain = tuple(thrust * motor for motor in plant.thrusters.gain)
    return replace(plant, thrusters=replace(plant.thrusters, gain=gain))
