"""How well it holds: the four scenarios over many vehicles, through the full loop, in virtual time."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np

from companion.config import Config
from lab.dive import dive
from lab.lockstep import Link
from lab.scenarios import four
from sim_bridge.config import SimConfig

FIRST_SEED = 1000
SCENARIOS = ("waves", "trajectory", "load", "calm")

PAPER_RMS_MM = {"waves": 4.0, "trajectory": 4.2, "load": 3.6, "calm": 3.1}
"""`paper.md`, telemetry as the firmware gives it: law + network without observer, 3.1 N chatter."""


@dataclass(frozen=True)
class Row:
    """One scenario: the mean and the standard deviation over seeds of every figure of `Dive.figures`."""

    scenario: str
    mean: dict[str, float]
    deviation: dict[str, float]


def measure(config: Config, plant: SimConfig, link: Link, seeds: int, done: Callable[[], None]) -> list[Row]:
    """Dive every scenario with `seeds` vehicles on all cores; `done` is called after each dive."""
    jobs = [(scenario, FIRST_SEED + seed) for scenario in range(len(SCENARIOS)) for seed in range(seeds)]
    figures = []
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for result in pool.map(partial(_dive, config, plant, link), jobs):
            figures.append(result)
            done()
    rows = []
    for i, name in enumerate(SCENARIOS):
        of_one = figures[i * seeds : (i + 1) * seeds]
        rows.append(Row(name, _over(of_one, np.mean), _over(of_one, np.std)))
    return rows


def _dive(config: Config, plant: SimConfig, link: Link, job: tuple[int, int]) -> dict[str, float]:
    scenario, seed = job
    recorded = dive(four(seed)[scenario], config, plant, link)
    if not recorded.active[recorded.t_s > 5.0].all():
        raise RuntimeError(f"{SCENARIOS[scenario]}, seed {seed}: the supervisor gave up during the dive")
    return recorded.figures()


def _over(
    figures: Sequence[dict[str, float]], statistic: Callable[[list[float]], np.floating]
) -> dict[str, float]:
    return {key: float(statistic([figure[key] for figure in figures])) for key in figures[0]}
