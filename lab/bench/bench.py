"""How well it holds, and how well others do: every row of `lab.rows` over the same dives in the full loop.

A case is a scenario and a delay. Within a case all rows dive with the same vehicles, seas, loads and noise,
so that differences are taken dive by dive. The seeds are those that no search ever sees. The last row is
computed, not dived: the LQG floor of every single dive (`lab.floor`).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from pathlib import Path
from statistics import NormalDist
from typing import Any

import numpy as np

from companion.config import Config, load_config
from lab.bench.floor import floor
from lab.bench.rows import DEFAULT, Row, tuned, values_of
from lab.loop.dive import FIGURES, dive
from lab.loop.lockstep import LinkDelay
from lab.loop.scenarios import four
from lab.pool import worker_pool
from lab.rivals import alt_hold
from sim_bridge.config import SimConfig

FIRST_SEED = 1000
SEEDS = 60
SCENARIOS = ("waves", "path", "load", "calm")
LINKS = {0: LinkDelay(), 80: LinkDelay(up_s=0.041, down_s=0.041)}
"""By the delay that is added, ms: half of it each way, there from the start, and told to nobody."""

FLOOR = "floor"
HELD_FROM_S = 5.0
CONFIDENCE = 0.95


@dataclass(frozen=True)
class Run:
    """One dive of one row: its figures, NaN where the row has none. `held` unless the supervisor gave up."""

    row: str
    scenario: str
    delay_ms: int
    seed: int
    held: bool
    figures: dict[str, float]


@dataclass(frozen=True)
class Summary:
    """A row in a case: means over seeds, and the paired difference of depth RMS to the default, mm."""

    row: str
    scenario: str
    delay_ms: int
    seeds: int
    gave_up: int
    mean: dict[str, float]
    floor_ratio: float
    difference_mm: float
    low_mm: float
    high_mm: float


def measure(
    settings: Sequence[str],
    plant: SimConfig,
    rows: Sequence[Row],
    seeds: int,
    done: Callable[[], None],
    firmware: Path | None = None,
    scenarios: Sequence[str] = SCENARIOS,
) -> list[Run]:
    """Dive every case with `seeds` vehicles and every row on all cores, and compute the floors.

    `done` is called after each dive and floor; `settings` are overrides of the companion's configuration, for
    all rows. With a `firmware` the vehicles are the real ArduSub's.
    """
    cases = [
        (scenario, delay_ms, FIRST_SEED + seed)
        for scenario in scenarios
        for delay_ms in LINKS
        for seed in range(seeds)
    ]
    jobs = [(firmware, *made, *case) for case in cases for made in _made(settings, rows)]
    runs = []
    with worker_pool() as pool:
        dives, floors = pool.map(partial(_dive, plant), jobs), pool.map(partial(_floor, plant), cases)
        for result in chain(dives, floors):
            runs.append(result)
            done()
    return runs


def measure_both(
    settings: Sequence[str],
    plant: SimConfig,
    rows: Sequence[Row],
    seeds: int,
    done: Callable[[], None],
    firmware: Path,
) -> tuple[list[Run], list[Run]]:
    """Dive the same vehicles and seas with our stand-in and with the real firmware, without added delay.

    `done` is called after each of the dives.
    """
    jobs = [
        (vehicle, *made, scenario, 0, FIRST_SEED + seed)
        for vehicle in (None, firmware)
        for made in _made(settings, rows)
        for scenario in SCENARIOS
        for seed in range(seeds)
    ]
    runs = []
    with worker_pool() as pool:
        for result in pool.map(partial(_dive, plant), jobs):
            runs.append(result)
            done()
    return runs[: len(runs) // 2], runs[len(runs) // 2 :]


def _made(settings: Sequence[str], rows: Sequence[Row]) -> list[tuple[Row, Config, dict[str, float]]]:
    """Return each row with its companion's configuration and its values."""
    found = tuned()
    values = [values_of(row, found) for row in rows]
    return [
        (row, load_config(overrides=[*settings, *row.overrides(one)]), one)
        for row, one in zip(rows, values, strict=True)
    ]


def as_records(runs: Sequence[Run]) -> list[dict[str, Any]]:
    """Return flat records, one a dive."""
    return [
        {
            "row": run.row,
            "scenario": run.scenario,
            "delay_ms": run.delay_ms,
            "seed": run.seed,
            "held": run.held,
        }
        | run.figures
        for run in runs
    ]


def count(rows: Sequence[Row], seeds: int, scenarios: Sequence[str] = SCENARIOS) -> int:
    """Return how often `measure` calls `done`."""
    return (len(rows) + 1) * len(scenarios) * len(LINKS) * seeds


def dived(of: Sequence[Run] | Sequence[Summary]) -> list[str]:
    """Return the scenarios that were dived, in the order of SCENARIOS."""
    return [name for name in SCENARIOS if any(one.scenario == name for one in of)]


def summaries(runs: Sequence[Run]) -> list[Summary]:
    """Summarise each row in each case, in the order in which the rows first ran; the floor is last."""
    names = [*dict.fromkeys(run.row for run in runs if run.row != FLOOR), FLOOR]
    result = []
    for scenario in dived(runs):
        for delay_ms in LINKS:
            case = [run for run in runs if (run.scenario, run.delay_ms) == (scenario, delay_ms)]
            by_row = {name: sorted((r for r in case if r.row == name), key=_seed) for name in names}
            rms = {name: np.array([run.figures["depth_rms_mm"] for run in by_row[name]]) for name in names}
            for name in names:
                difference = rms[name] - rms.get(DEFAULT, np.full(len(rms[name]), np.nan))
                figures = [run.figures for run in by_row[name]]
                result.append(
                    Summary(
                        name,
                        scenario,
                        delay_ms,
                        len(figures),
                        sum(not run.held for run in by_row[name]),
                        {key: float(np.mean([one[key] for one in figures])) for key in figures[0]},
                        float(rms[name].mean() / rms[FLOOR].mean()),
                        float(difference.mean()),
                        *interval(difference),
                    )
                )
    return result


def interval(
    differences: Sequence[float] | np.ndarray[tuple[int], np.dtype[np.float64]],
) -> tuple[float, float]:
    """Return the confidence interval of the mean of paired differences, Student's; NaN for fewer than two."""
    n = len(differences)
    if n < 2:
        return math.nan, math.nan
    half = student(n - 1) * float(np.std(differences, ddof=1)) / math.sqrt(n)
    return float(np.mean(differences)) - half, float(np.mean(differences)) + half


def student(freedom: int, confidence: float = CONFIDENCE) -> float:
    """Return Student's two-sided quantile: exact for 1 and 2 degrees of freedom, else Cornish-Fisher, 0.5 %.

    (Abramowitz and Stegun, 26.7.5.)
    """
    p = 0.5 + 0.5 * confidence
    if freedom == 1:
        return math.tan(math.pi * (p - 0.5))
    if freedom == 2:
        return (2.0 * p - 1.0) * math.sqrt(2.0 / (4.0 * p * (1.0 - p)))
    z, n = NormalDist().inv_cdf(p), float(freedom)
    terms = (
        (z**3 + z) / 4.0,
        (5.0 * z**5 + 16.0 * z**3 + 3.0 * z) / 96.0,
        (3.0 * z**7 + 19.0 * z**5 + 17.0 * z**3 - 15.0 * z) / 384.0,
        (79.0 * z**9 + 776.0 * z**7 + 1482.0 * z**5 - 1920.0 * z**3 - 945.0 * z) / 92160.0,
    )
    return z + sum(term / n**i for i, term in enumerate(terms, 1))


def _dive(plant: SimConfig, job: tuple[Path | None, Row, Config, dict[str, float], str, int, int]) -> Run:
    firmware, row, config, values, name, delay_ms, seed = job
    scenario, link = four(seed)[SCENARIOS.index(name)], LINKS[delay_ms]
    if row.steers == "autopilot":
        dived = alt_hold.dive(scenario, plant, link, values, firmware)
    else:
        dived = dive(scenario, config, plant, link, firmware)
    held = bool(dived.active[dived.t_s > HELD_FROM_S].all())
    return Run(row.name, name, delay_ms, seed, held, dived.figures())


def _floor(plant: SimConfig, case: tuple[str, int, int]) -> Run:
    name, delay_ms, seed = case
    reached = floor(four(seed)[SCENARIOS.index(name)], plant, LINKS[delay_ms])
    none = dict.fromkeys(FIGURES, math.nan)
    figures = {"depth_rms_mm": reached.depth_rms_mm, "chatter_n": reached.chatter_n}
    return Run(FLOOR, name, delay_ms, seed, True, none | figures)


def _seed(run: Run) -> int:
    return run.seed
