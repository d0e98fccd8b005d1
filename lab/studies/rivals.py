"""`holdfast lab bench rivals`: other laws on vehicles unlike the model, in depth and in place.

The vehicles are those of `bench reality`. Every rival has our estimator, delay compensation and thruster
curve, and the model that Holdfast has. `holdfast lab tune` searches each as it does Holdfast: first its
depth, then with that its place, with equal budget and width of bounds. The dives are batches without MAVLink
bytes.
"""

import argparse
import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from companion.config import load_config
from holdfast import RefusedError
from lab.loop.scenarios import positioned
from lab.options import add_bench, seeds_of
from lab.studies.competitors import COMPETITORS, DEFAULT, RIVALS, steered, tuned
from lab.studies.reality import COUNTS_S, ENDS_S, FIRST_SEED
from lab.studies.statistics import interval
from lab.studies.trials import hold, rough
from lab.study import Row, Study, by, known

LAWS = ("holdfast", "observer", *(f"{law}{how}" for law in RIVALS for how in ("", "_predicted")))
ROWS = (DEFAULT, *LAWS)
"""What is shipped, and the laws that a search turns in depth and place."""


class RivalDive(NamedTuple):
    """One dive of one row."""

    row: str
    seed: int


class Rivals(Study[RivalDive]):
    """Every row with every vehicle."""

    command = "lab bench rivals"
    about = (
        "Holds the vehicles of `bench reality` with other laws, in depth and in place: compiled dives "
        "without MAVLink bytes, the DVL without drift. The rows were tuned on other such vehicles "
        "(holdfast lab tune ROW)."
    )

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        add_bench(parser, " ".join(ROWS))

    def __init__(self, arguments: argparse.Namespace) -> None:
        if arguments.firmware is not None:
            raise RefusedError("bench rivals dives without MAVLink bytes: leave --firmware out")
        names: Sequence[str] = arguments.rows or ROWS
        known(names, ROWS, "row")
        self._seeds = range(FIRST_SEED, FIRST_SEED + seeds_of(arguments))
        config, found = load_config(), tuned()
        self._configs = {
            name: load_config(
                overrides=[*steered(COMPETITORS[name], config, found.get(name, {})), *arguments.set]
            )
            for name in names
        }

    def cases(self) -> Sequence[RivalDive]:
        return [RivalDive(row, seed) for row in self._configs for seed in self._seeds]

    def groups(self, cases: Sequence[RivalDive]) -> Sequence[Sequence[RivalDive]]:
        rows = dict.fromkeys(case.row for case in cases)
        return [[case for case in cases if case.row == row] for row in rows]

    def dive(self, cases: Sequence[RivalDive]) -> Iterator[Row]:
        from lab.batch.simulate import simulate

        seeds = [case.seed for case in cases]
        plants = [positioned(rough(seed).plant) for seed in seeds]
        figures = simulate(self._configs[cases[0].row], plants, hold, ENDS_S, seeds, since_s=COUNTS_S)
        for i in range(len(cases)):
            yield {key: float(values[i]) for key, values in figures.items()}

    def summary(self, rows: Sequence[Row]) -> dict[str, Any]:
        columns = (
            *("", "depth, mm", "Δ depth, %", "place, mm", "Δ place, %"),
            *("tilt, °", "chatter in depth, N", "chatter in place, N", "thrust, N"),
        )
        of_row = {name: some for (name,), some in by(rows, "row").items()}
        lines = [self._line(name, some, of_row.get(DEFAULT, ())) for name, some in of_row.items()]
        return {"columns": [*columns], "rows": lines}

    def _line(self, name: str, some: Sequence[Row], shipped: Sequence[Row]) -> list[str]:
        lost = sum(not math.isnan(row["lost_s"]) for row in some)

        def mean(key: str, digits: int = 1) -> str:
            return f"{np.mean([row[key] for row in some]):.{digits}f}"

        def less(key: str) -> str:
            if name == DEFAULT or not shipped:
                return ""
            ours = np.array([row[key] for row in shipped])
            apart, half = interval(np.array([row[key] for row in some]) - ours)
            return f"{100.0 * apart / ours.mean():+.0f} ± {100.0 * half / ours.mean():.0f}"

        return [
            COMPETITORS[name].title + (f" ({lost} lost)" if lost else ""),
            *(mean("depth_rms_mm", 2), less("depth_rms_mm")),
            *(mean("place_rms_mm"), less("place_rms_mm")),
            f"{max(row['tilt_deg'] for row in some):.0f}",
            *(mean("chatter_n"), mean("place_chatter_n"), mean("thrust_rms_n")),
        ]
