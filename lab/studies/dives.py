"""`holdfast lab bench dives`: how well every competitor holds, over the same dives in the full loop.

A case is a scenario and a delay. Within a case all competitors dive with the same vehicles, seas, loads and
noise, so that differences are taken dive by dive. No search ever sees the seeds.
"""

import argparse
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from companion.arrays import Array
from companion.config import load_config
from lab.loop.dive import dive
from lab.loop.lockstep import LinkDelay
from lab.loop.scenarios import four
from lab.options import add_bench, seeds_of
from lab.rivals import alt_hold
from lab.studies.competitors import DEFAULT, FIRST_SEED, competitors, selected, tuned
from lab.studies.dots import dots
from lab.studies.statistics import interval
from lab.study import Row, Study, by, known
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.sim_config import load_config as load_plant

SCENARIOS = ("waves", "path", "load", "calm")
LINKS = {0: LinkDelay(), 80: LinkDelay(up_s=0.041, down_s=0.041)}
"""Links by the delay that is added, ms: half of it each way, from the start; no configuration says so."""

HELD_FROM_S = 5.0
SIMULATOR, FIRMWARE = "simulator", "firmware"
FIGURES = (
    *("place_rms_mm", "depth_rms_mm", "depth_mean_mm", "depth_sd_mm", "depth_peak_mm"),
    *("heading_rms_deg", "heading_sd_deg", "thrust_rms_n", "chatter_n", "recovery_s"),
)
"""Of `Dive.figures`."""


class BenchDive(NamedTuple):
    """One dive of one competitor."""

    vehicle: str
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
        config, found = load_config(overrides=arguments.set), tuned()
        every = self.default_rows or [*competitors(config)]
        self.rows = selected(arguments.rows or every, config)
        known(arguments.scenarios or (), SCENARIOS, "scenario")
        self.scenarios = [name for name in SCENARIOS if name in (arguments.scenarios or SCENARIOS)]
        self._seeds = range(FIRST_SEED, FIRST_SEED + seeds_of(arguments))
        self._configs = {
            name: load_config(
                overrides=[*arguments.set, *row.overrides(config, found.get(name, {}), place=False)]
            )
            for name, row in self.rows.items()
        }
        self._firmware: Path | None = arguments.firmware
        self.vehicles: tuple[str, ...] = (FIRMWARE if self._firmware else SIMULATOR,)
        self._plant = load_plant(DEFAULT_CONFIG)
        self._titles = {name: row.title for name, row in competitors(config).items()}

    def cases(self) -> Sequence[BenchDive]:
        same = product(self.scenarios, self.delays, self._seeds)
        return [BenchDive(on, row, *case) for case in same for row in self.rows for on in self.vehicles]

    def dive(self, cases: Sequence[BenchDive]) -> Iterator[Row]:
        for case in cases:
            firmware = self._firmware if case.vehicle == FIRMWARE else None
            scenario, link = four(case.seed)[SCENARIOS.index(case.scenario)], LINKS[case.delay_ms]
            parameters = self.rows[case.row].autopilot
            if parameters is not None:
                found = alt_hold.dive(scenario, self._plant, link, dict(parameters), firmware)
            else:
                found = dive(scenario, self._configs[case.row], self._plant, link, firmware)
            figures, held = found.figures(), bool(found.active[found.t_s > HELD_FROM_S].all())
            yield {"held": held} | {key: figures[key] for key in FIGURES}

    def by_title(self, rows: Sequence[Row]) -> Iterator[tuple[str, str, Sequence[Row]]]:
        """Give name, title and dives of each competitor, Holdfast first."""
        for (name,), mine in sorted(by(rows, "row").items(), key=lambda row: row[0] != (DEFAULT,)):
            yield name, self._titles[name], mine

    def summary(self, rows: Sequence[Row]) -> dict[str, Any]:
        ours, lines = by_vehicle(rows, DEFAULT), []
        for name, title, mine in self.by_title(rows):
            cells = [
                "/".join(
                    _mean(dives, "depth_rms_mm") + lost(dives) for dives in by(some, "delay_ms").values()
                )
                for some in by(mine, "scenario").values()
            ]
            difference = "–"
            if name != DEFAULT and len(ours):
                apart, half = interval(by_vehicle(rows, name) - ours)
                difference = f"{apart:+.2f}" + (f"±{half:.2f}" if np.isfinite(half) else "")
            lines.append([title, *cells, difference, _mean(mine, "chatter_n")])
        delays = "/".join(_delay(delay_ms) for (delay_ms,) in by(rows, "delay_ms"))
        scenarios = [name for (name,) in by(rows, "scenario")]
        columns = [f"depth RMS, mm ({delays})", *scenarios, "minus Holdfast's, mm", "chatter, N"]
        return {"columns": columns, "rows": lines}

    def draw(self, rows: Sequence[Row], folder: Path) -> Sequence[Path]:
        columns = {"depth_rms_mm": "depth error, RMS (mm)", "chatter_n": "command's change, RMS (N a tick)"}
        files = []
        for (scenario,), of_it in by(rows, "scenario").items():
            groups = {
                f"{self._titles[name]}, {_delay(delay_ms)}": some
                for (name, delay_ms), some in by(of_it, "row", "delay_ms").items()
            }
            file = folder / f"{scenario}.png"
            files.append(dots(file, groups, columns, lost=lambda row: not row["held"]))
        return files


def by_vehicle(rows: Sequence[Row], name: str) -> Array:
    """Return a row's mean depth RMS with each vehicle."""
    mine = by([row for row in rows if row["row"] == name], "seed")
    return np.array([np.mean([dive["depth_rms_mm"] for dive in dives]) for dives in mine.values()])


def _mean(rows: Sequence[Row], key: str) -> str:
    return f"{np.mean([row[key] for row in rows]):.1f}"


def lost(rows: Sequence[Row]) -> str:
    """Return a † for each dive that was given up."""
    return "†" * sum(not row["held"] for row in rows)


def _delay(delay_ms: int) -> str:
    return f"+{delay_ms} ms" if delay_ms else "as is"
