"""`python -m lab.studies.tune_courses`: the search of `holdfast tune` for `holdfast bench position`.

The same optimiser and the same width of bounds; but every candidate dives in the full loop, because the batch
knows no horizontal position. So it has fewer evaluations. What it finds for Holdfast, the same for surge and
sway, belongs into the companion's configuration.
"""

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from companion.config import ConfigError
from lab.options import positive
from lab.studies.competitors import DEFAULT, Competitor
from lab.studies.courses import COURSES, ROWS, TUNED_FILE, sail
from lab.studies.search import LOST_MM, minimised
from lab.studies.tune import Search, values_table
from lab.study import Row, Study, start
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import load_config as load_plant

TRAINED_ON = ("station", "circle")
TRAINING_S = 30.0
AXIS = {"lambda_per_s": 3.0, "kappa_per_s": 4.0, "disturbance_noise": 5.0}
"""What a search may turn of Holdfast's surge and sway, the same for both."""


def knobs(row: Competitor) -> Mapping[str, float]:
    """Return what a search may turn of a row, and where it starts; nothing of the stock autopilot."""
    return AXIS if row.name == DEFAULT else row.knobs


def score(row: Competitor, values: Mapping[str, float]) -> float:
    """Return the mean horizontal RMS error over TRAINED_ON, mm."""
    settings = [
        f"{axis}.{key}={values[key]!r}" for axis in ("surge", "sway") for key in AXIS if key in values
    ]
    plant, rms_mm = load_plant(DEFAULT_CONFIG), []
    for seed, name in enumerate(TRAINED_ON):
        course = next(course for course in COURSES if course.name == name)
        try:
            track = sail(row, course, values, plant, seed, settings=settings, lasts_s=TRAINING_S)
        except ConfigError:
            return LOST_MM
        rms_mm.append(track.figures()["place_rms_mm"] if track.held else LOST_MM)
    return float(np.mean(rms_mm))


def _scores(row: Competitor, candidates: Sequence[Mapping[str, float]]) -> list[float]:
    return [score(row, values) for values in candidates]


class TuneCourses(Study[Search]):
    """A search for each row that has knobs."""

    command = "tune-courses"
    about = f"Searches gains for the rows of `holdfast bench position`, for {TUNED_FILE.name}."
    unit = "searches"
    recipe = ("evaluations",)

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        names = [row.name for row in ROWS if knobs(row)]
        parser.add_argument("--evaluations", type=positive, default=30, metavar="N")
        parser.add_argument("--rows", nargs="+", choices=names, default=names, metavar="ROW")
        parser.set_defaults(out=Path("out/tune"))

    def __init__(self, arguments: argparse.Namespace) -> None:
        self._rows: list[str] = arguments.rows
        self.steps = arguments.evaluations

    def cases(self) -> Sequence[Search]:
        return [Search(name) for name in self._rows]

    def dive(self, cases: Sequence[Search]) -> Iterator[Row]:
        """Search, every candidate in the full loop."""
        for row in (row for row in ROWS if Search(row.name) in cases):
            found = minimised(knobs(row), partial(_scores, row), self.steps, self.advance)
            yield found._asdict()

    def tables(self, rows: Sequence[Row]) -> Iterator[str]:
        for row in rows:
            yield (
                f"# {' and '.join(TRAINED_ON)}, {TRAINING_S:g} s each, seeds 0 and 1, never of the bench\n"
                f"# mean horizontal RMS: {row['start_score']:.1f} mm before, {row['score']:.1f} mm after\n"
            ) + "\n".join(values_table(row)).replace("[", "\\[")


if __name__ == "__main__":
    sys.exit(start(TuneCourses, sys.argv[1:]))
