"""`holdfast lab bench reality`: vehicles that are unlike the model, in the full loop.

| scenario        | vehicle                                                                              |
|-----------------|--------------------------------------------------------------------------------------|
| rough           | drawn between the published models and the tank's; four degrees of freedom at once   |
| axes            | a gain of its own on each axis, 1/3 to 3, other lags, and delays that no stamp shows |
| light-waves     | 0.4 of the inertia and thrusters without lag; its depth alone, in waves              |
| light-path      | the same vehicle on a path                                                           |
| tank-*, tank-*-late | a real Heavy as measured in a tank, calm, in waves, on a path, in its place      |
| osl-*           | one like another real Heavy: inertia × 3, drag × 1.6, motors 0.15 s late             |
| delay-*         | the nominal vehicle behind 50 ms each way                                            |

Errors are true - reference, of the simulator's truth, from COUNTS_S on.
"""

import argparse
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from companion.config import load_config
from lab.loop.dive import engaging, recorded
from lab.loop.lockstep import Step
from lab.options import add_bench
from lab.studies.dots import dots
from lab.studies.trials import Trial, axes, delayed, light, rough, slow, tank
from lab.study import Row, Study, by, known

COUNTS_S, ENDS_S = 25.0, 85.0
FIRST_SEED = 9001
TURNED_OVER_DEG = 90.0
HELD, GIVEN_UP, TURNED_OVER = "held", "given up", "turned over"
PARTS = (50.0, 90.0, 100.0)
"""Percentiles of the table."""
FIGURES = {
    "depth_sd_mm": "depth SD, mm",
    "place_rms_mm": "place RMS, mm",
    "believed_rms_mm": "place without the DVL's drift, mm",
    "heading_rms_deg": "heading RMS, °",
    "tilt_deg": "tilt, largest, °",
}
NO = math.nan
SCENARIOS: Mapping[str, Callable[[int], Trial]] = {
    "rough": rough,
    "axes": axes,
    "light-waves": partial(light, moves=False),
    "light-path": partial(light, moves=True),
    **{
        f"tank-{sea}{'-late' * late}": partial(tank, sea=sea, late=late)
        for sea in ("calm", "waves", "path", "place")
        for late in (False, True)
    },
    **{f"osl-{sea}": partial(slow, sea=sea) for sea in ("calm", "waves", "path", "place")},
    **{f"delay-{sea}": partial(delayed, sea=sea) for sea in ("calm", "waves", "path", "place")},
}


class RealDive(NamedTuple):
    """One dive: the companion's preset, and the scenario."""

    preset: str
    water: str
    seed: int


class Reality(Study[RealDive]):
    """Every scenario with every preset and seed."""

    command = "lab bench reality"
    about = (
        "Holds vehicles between the published models and a real one, in four degrees of freedom at once; "
        "with --scenarios also those with a gain of its own on each axis, light ones, or a Heavy as it was "
        "measured in a tank. A row is a preset of the companion."
    )

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        add_bench(parser, "heavy tank-heavy", ", ".join(SCENARIOS))
        parser.set_defaults(seeds=60, rows=["heavy"], scenarios=["rough"])

    def __init__(self, arguments: argparse.Namespace) -> None:
        known(arguments.scenarios, SCENARIOS, "scenario")
        self._scenarios: Sequence[str] = arguments.scenarios
        self._seeds = range(FIRST_SEED, FIRST_SEED + arguments.seeds)
        self._firmware: Path | None = arguments.firmware
        self._configs = {
            row: load_config(overrides=[f"vehicle.preset={row!r}", *arguments.set]) for row in arguments.rows
        }

    def cases(self) -> Sequence[RealDive]:
        return [RealDive(*each) for each in product(self._configs, self._scenarios, self._seeds)]

    def ticks(self, case: RealDive, lasts_s: float = ENDS_S) -> list[Step]:
        """Dive a case."""
        there, config = SCENARIOS[case.water](case.seed), self._configs[case.preset]
        start = there.target(0.0)
        with engaging(
            config, there.plant, start, case.seed, there.link, self._firmware, surveyed=True
        ) as loop:
            return list(loop.run(lasts_s, there.target))

    def dive(self, cases: Sequence[RealDive]) -> Iterator[Row]:
        for case in cases:
            yield self.judged(case, self.ticks(case))

    def judged(self, case: RealDive, steps: Sequence[Step]) -> Row:
        """Return the figures of a dive."""
        dived = recorded(steps)
        counted = dived.within(COUNTS_S, math.inf)
        figures = counted.figures()
        if not SCENARIOS[case.water](case.seed).plant.sensors.dvl:
            figures["place_rms_mm"] = figures["believed_rms_mm"] = NO
        turned_over = math.degrees(float(dived.tilt.max())) > TURNED_OVER_DEG
        outcome = TURNED_OVER if turned_over else HELD if counted.held else GIVEN_UP
        return {key: figures[key] for key in FIGURES} | {"outcome": outcome}

    def summary(self, rows: Sequence[Row]) -> dict[str, Any]:
        keys, lines = _measured(rows, FIGURES), []
        for (preset, water), some in by(rows, "preset", "water").items():
            over = sum(row["outcome"] == TURNED_OVER for row in some)
            turned_over = f", {over} turned over" if over else ""
            line = [f"{preset}, {water}", f"{_held(some)} of {len(some)}{turned_over}"]
            line += [_or_dash(np.percentile([row[key] for row in some], PARTS)) for key in keys]
            lines.append(line)
        return {"columns": ["median/90 %/most", "held", *(FIGURES[key] for key in keys)], "rows": lines}

    def failed(self, rows: Sequence[Row]) -> bool:
        return _held(rows) < len(rows)

    def draw(self, rows: Sequence[Row], folder: Path) -> Sequence[Path]:
        columns = {key: FIGURES[key] for key in _measured(rows, ("depth_sd_mm", "place_rms_mm", "tilt_deg"))}
        groups = {", ".join(key): some for key, some in by(rows, "preset", "water").items()}
        return [dots(folder / "reality.png", groups, columns, lost=lambda row: bool(row["outcome"] != HELD))]


def _held(rows: Sequence[Row]) -> int:
    return sum(row["outcome"] == HELD for row in rows)


def _measured(rows: Sequence[Row], keys: Iterable[str]) -> list[str]:
    """Return the keys of which any dive has a value."""
    return [key for key in keys if np.isfinite([row[key] for row in rows]).any()]


def _or_dash(values: Iterable[float]) -> str:
    return "/".join(f"{value:.1f}" if math.isfinite(value) else "–" for value in values)
