"""`holdfast lab bench dives`: how well every competitor holds, over the same dives in the full loop.

A case is a scenario and a delay. Within a case all competitors dive with the same vehicles, seas, loads and
noise, so that differences are taken dive by dive. No search ever sees the seeds.
"""

import argparse
import math
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np

from companion.config import load_config
from lab.loop.dive import dive
from lab.loop.lockstep import LinkDelay
from lab.loop.scenarios import four
from lab.options import add_bench, seeds_of
from lab.rivals import alt_hold
from lab.studies.competitors import DEFAULT, FIRST_SEED, competitors, selected, tuned, values_of
from lab.studies.picture import dots
from lab.study import Row, Study, by, known
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import load_config as load_plant

SCENARIOS = ("waves", "path", "load", "calm")
LINKS = {0: LinkDelay(), 80: LinkDelay(up_s=0.041, down_s=0.041)}
"""By the delay that is added, ms: half of it each way, from the start, and not configured anywhere."""

HELD_FROM_S = 5.0
CONFIDENCE = 0.95
FIGURES = (
    "place_rms_mm",
    "depth_rms_mm",
    "depth_mean_mm",
    "depth_sd_mm",
    "depth_peak_mm",
    "heading_rms_deg",
    "heading_sd_deg",
    "thrust_rms_n",
    "chatter_n",
    "recovery_s",
)
"""Of `Dive.figures`."""


class BenchDive(NamedTuple):
    """One dive of one competitor."""

    row: str
    scenario: str
    delay_ms: int
    seed: int


class Dives(Study[BenchDive]):
    """Every scenario and delay with every competitor and vehicle."""

    command = "lab bench dives"
    about = (
        "Simulates four scenarios, without and with 80 ms more delay, with random vehicles, in virtual time "
        "and with real MAVLink bytes: the shipped default, other laws and compensators, and ArduSub's depth "
        "hold. One dive takes 3 s on one core; all rows with 60 vehicles take 5 core-hours, with --seeds 10 "
        "one hour."
    )
    delays: tuple[int, ...] = tuple(LINKS)
    default_rows: tuple[str, ...] = ()
    """What dives when no row is named; empty for all."""

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        add_bench(parser, "default law ppi", ", ".join(SCENARIOS))

    def __init__(self, arguments: argparse.Namespace) -> None:
        config = load_config(overrides=arguments.set)
        every = self.default_rows or [row.name for row in competitors(config)]
        self._rows = {row.name: row for row in selected(arguments.rows or every, config)}
        known(arguments.scenarios or (), SCENARIOS, "scenario")
        self._scenarios = [name for name in SCENARIOS if name in (arguments.scenarios or SCENARIOS)]
        self._seeds = range(FIRST_SEED, FIRST_SEED + seeds_of(arguments))
        found = tuned()
        self._values = {name: values_of(row, found) for name, row in self._rows.items()}
        self._configs = {
            name: load_config(overrides=[*arguments.set, *row.overrides(self._values[name])])
            for name, row in self._rows.items()
        }
        self._firmware: Path | None = arguments.firmware
        self._plant = load_plant(DEFAULT_CONFIG)
        self.titles = {row.name: row.title for row in competitors(config)}

    def cases(self) -> Sequence[BenchDive]:
        same = product(self._scenarios, self.delays, self._seeds)
        return [BenchDive(row, *case) for case in same for row in self._rows]

    def dive(self, cases: Sequence[BenchDive]) -> Iterator[Row]:
        return (self.dived(case, self._firmware) for case in cases)

    def dived(self, case: BenchDive, firmware: Path | None) -> Row:
        """Return the figures of a dive; `held` unless the supervisor gave up."""
        scenario, link = four(case.seed)[SCENARIOS.index(case.scenario)], LINKS[case.delay_ms]
        if self._rows[case.row].steers == "autopilot":
            found = alt_hold.dive(scenario, self._plant, link, self._values[case.row], firmware)
        else:
            found = dive(scenario, self._configs[case.row], self._plant, link, firmware)
        figures = found.figures()
        held = bool(found.active[found.t_s > HELD_FROM_S].all())
        return {"held": held} | {key: figures[key] for key in FIGURES}

    def summary(self, rows: Sequence[Row]) -> dict[str, Any]:
        """Return the table for docs/results.md: depth RMS at each delay, and less that of the default."""
        ours, lines = by_vehicle(rows, DEFAULT), []
        for (name,), mine in sorted(by(rows, "row").items(), key=lambda row: row[0] != (DEFAULT,)):
            cells = [
                "/".join(map(_depth, by(of_it, "delay_ms").values()))
                for of_it in by(mine, "scenario").values()
            ]
            difference = "–"
            if name != DEFAULT and len(ours):
                apart = by_vehicle(rows, name) - ours
                difference = f"{apart.mean():+.2f}"
                if len(apart) > 1:
                    difference += f"±{interval(apart)[1] - apart.mean():.2f}"
            lines.append([self.titles[name], *cells, difference, _mean(mine, "chatter_n")])
        delays = "/".join(_delay(delay_ms) for (delay_ms,) in by(rows, "delay_ms"))
        scenarios = [name for (name,) in by(rows, "scenario")]
        return {
            "columns": [f"depth RMS, mm ({delays})", *scenarios, "less Holdfast's, mm", "chatter, N"],
            "rows": lines,
        }

    def draw(self, rows: Sequence[Row], folder: Path) -> Sequence[Path]:
        """Draw every scenario: depth error and chatter of each competitor."""
        columns = {"depth_rms_mm": "depth error, RMS (mm)", "chatter_n": "command's change, RMS (N a tick)"}
        return [
            dots(
                folder / f"{scenario}.png",
                {
                    f"{self.titles[name]}, {_delay(delay_ms)}": some
                    for (name, delay_ms), some in by(of_it, "row", "delay_ms").items()
                },
                columns,
                lost=lambda row: not row["held"],
            )
            for (scenario,), of_it in by(rows, "scenario").items()
        ]


def by_vehicle(rows: Sequence[Row], name: str) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return a row's mean depth RMS with each vehicle."""
    mine = by([row for row in rows if row["row"] == name], "seed")
    return np.array([np.mean([dive["depth_rms_mm"] for dive in dives]) for dives in mine.values()])


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


def _mean(rows: Sequence[Row], key: str) -> str:
    return f"{np.mean([row[key] for row in rows]):.1f}"


def _depth(rows: Sequence[Row]) -> str:
    return _mean(rows, "depth_rms_mm") + "†" * sum(not row["held"] for row in rows)


def _delay(delay_ms: int) -> str:
    return f"+{delay_ms} ms" if delay_ms else "as is"
