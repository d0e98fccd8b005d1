"""Studies of vehicles that are unlike the model, in the full loop: the dive, how it is judged, the table.

Errors are true - reference, of the simulator's truth, from COUNTS_S on.
"""

import argparse
import math
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np

from companion.config import load_config
from companion.records import Setpoint
from lab.loop.dive import EXACT, engaging, recorded
from lab.loop.lockstep import LinkDelay, Step
from lab.loop.scenarios import SETTLE_S, up_and_down
from lab.options import add_bench
from lab.studies.picture import dots
from lab.study import Row, Study, by, known
from sim_bridge.config import SimConfig

DEPTH_M = 2.0
COUNTS_S, ENDS_S = 25.0, 85.0
FIRST_SEED = 9001
TURNED_OVER_DEG = 90.0
HELD, GIVEN_UP, TURNED_OVER = "held", "given up", "turned over"
NONE = math.nan
FIGURES = {
    "depth_sd_mm": "depth SD, mm",
    "place_rms_mm": "place RMS, mm",
    "believed_rms_mm": "place without the DVL's drift, mm",
    "heading_rms_deg": "heading RMS, °",
    "tilt_deg": "tilt, largest, °",
}


class RealDive(NamedTuple):
    """One dive: the companion's preset, the water, and how late the tank vehicle's motors start."""

    preset: str
    water: str
    start_s: float
    seed: int


def group_of(preset: str, water: str, start_s: float) -> str:
    """Say what dives of all seeds have in common."""
    return f"{preset}, {water}" + (f", start {start_s:g} s" if start_s else "")


def hold(t_s: float) -> Setpoint:
    """Stay where it began."""
    return Setpoint((0.0, 0.0, DEPTH_M, 0.0))


def path(t_s: float) -> Setpoint:
    """Follow 0.25 (1 − cos 2πt/6) m below DEPTH_M; place and heading stay."""
    return up_and_down(t_s - SETTLE_S, 0.25, math.pi / 3.0, DEPTH_M, (0.0, 0.0))


@dataclass(frozen=True)
class Situation:
    """What is dived: the vehicle in its water, the setpoint over time, and the link."""

    plant: SimConfig
    target: Callable[[float], Setpoint] = hold
    link: LinkDelay = EXACT


class Unlike(Study[RealDive]):
    """What `tank` and `reality` share."""

    seeds: ClassVar[int]
    waters: ClassVar[tuple[str, ...]]
    default_waters: ClassVar[tuple[str, ...]] = ()
    """What dives when no scenario is named; empty for all."""
    presets: ClassVar[tuple[str, ...]] = ("heavy",)
    starts_s: ClassVar[tuple[float, ...]] = (0.0,)
    parts: ClassVar[tuple[float, ...]] = (50.0, 90.0, 100.0)
    """Percentiles of the table."""
    goals: ClassVar[Mapping[tuple[str, str], Mapping[str, tuple[float, ...]]]]
    """By preset and water, of each figure the goal at each of `parts`; NaN where there is none."""

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        add_bench(parser, " ".join(cls.presets), ", ".join(cls.waters))
        parser.set_defaults(seeds=cls.seeds)

    def __init__(self, arguments: argparse.Namespace) -> None:
        known(arguments.rows or (), self.presets, "row")
        known(arguments.scenarios or (), self.waters, "scenario")
        self._presets = arguments.rows or self.presets
        self._waters = arguments.scenarios or self.default_waters or self.waters
        self._seeds = range(FIRST_SEED, FIRST_SEED + arguments.seeds)
        self._firmware: Path | None = arguments.firmware
        self._configs = {
            preset: load_config(overrides=[*self.overrides(preset), *arguments.set])
            for preset in self._presets
        }

    @abstractmethod
    def situation(self, case: RealDive) -> Situation:
        """Draw what a case dives."""

    def overrides(self, preset: str) -> list[str]:
        """Return what sets the companion apart in this row."""
        return [f'vehicle.preset="{preset}"']

    def cases(self) -> Sequence[RealDive]:
        return [RealDive(*each) for each in product(self._presets, self._waters, self.starts_s, self._seeds)]

    def ticks(self, case: RealDive, lasts_s: float = ENDS_S) -> list[Step]:
        """Dive a case."""
        plant, target, link = (there := self.situation(case)).plant, there.target, there.link
        config, start = self._configs[case.preset], target(0.0)
        with engaging(config, plant, start, case.seed, link, self._firmware, surveyed=True) as loop:
            return list(loop.run(lasts_s, target))

    def dive(self, cases: Sequence[RealDive]) -> Iterator[Row]:
        for case in cases:
            dived = recorded(self.ticks(case))
            counted = dived.within(COUNTS_S, math.inf)
            figures = counted.figures()
            if not self.situation(case).plant.sensors.dvl:
                figures["place_rms_mm"] = figures["believed_rms_mm"] = math.nan
            turned_over = math.degrees(float(dived.tilt.max())) > TURNED_OVER_DEG
            outcome = TURNED_OVER if turned_over else HELD if counted.held else GIVEN_UP
            yield {key: figures[key] for key in FIGURES} | {"outcome": outcome}

    def _groups(self, rows: Sequence[Row]) -> dict[str, list[Row]]:
        groups = by(rows, "preset", "water", "start_s")
        return {group_of(*key): some for key, some in groups.items()}

    def _goal(self, rows: Sequence[Row], key: str) -> tuple[float, ...]:
        return self.goals.get((rows[0]["preset"], rows[0]["water"]), {}).get(key, ())

    @property
    def _part_names(self) -> list[str]:
        return ["most" if part == 100.0 else f"{part:g} %" for part in self.parts]

    def summary(self, rows: Sequence[Row]) -> dict[str, Any]:
        """Return a row for each preset, water and start: true errors from COUNTS_S on."""
        keys = _measured(rows, FIGURES)
        lines = []
        for group, some in self._groups(rows).items():
            over = sum(row["outcome"] == TURNED_OVER for row in some)
            turned_over = f", {over} turned over" if over else ""
            line = [group, f"{_held(some)} of {len(some)}{turned_over}"]
            for key in keys:
                values, goals = np.percentile([row[key] for row in some], self.parts), self._goal(some, key)
                goal = f" (goal {'/'.join(_or_dash(goal, 'g') for goal in goals)})" if goals else ""
                line.append("/".join(_or_dash(value, ".1f") for value in values) + goal)
            lines.append(line)
        parts = "/".join(self._part_names).replace("50 %", "median")
        return {"columns": [parts, "held", *(FIGURES[key] for key in keys)], "rows": lines}

    def failed(self, rows: Sequence[Row]) -> bool:
        """Return whether a vehicle was given up or turned over."""
        return _held(rows) < len(rows)

    def draw(self, rows: Sequence[Row], folder: Path) -> Sequence[Path]:
        """Draw each figure's distribution, a line for each preset, water and start."""
        keys = _measured(rows, ("depth_sd_mm", "place_rms_mm", "tilt_deg"))
        file = folder / f"{self.command.split()[-1]}.png"
        columns = {key: FIGURES[key] for key in keys}
        return [dots(file, self._groups(rows), columns, lost=lambda row: bool(row["outcome"] != HELD))]


def _held(rows: Sequence[Row]) -> int:
    return sum(row["outcome"] == HELD for row in rows)


def _measured(rows: Sequence[Row], keys: Iterable[str]) -> list[str]:
    """Return the keys of which any dive has a value."""
    return [key for key in keys if np.isfinite([row[key] for row in rows]).any()]


def _or_dash(value: float, how: str) -> str:
    return format(value, how) if math.isfinite(value) else "–"
