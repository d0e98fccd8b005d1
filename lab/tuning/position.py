"""`python -m lab.tuning.position`: the search of `holdfast tune` for the rows of `holdfast bench position`.

The same optimiser and the same width of bounds; but every candidate dives in the full loop, because the batch
knows no horizontal position. So it has fewer evaluations. What it finds for Holdfast, the same for surge and
sway, belongs into the companion's configuration.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from companion.config import ConfigError
from lab.pool import worker_pool
from lab.studies.competitors import DEFAULT, Competitor
from lab.studies.courses import COURSES, ROWS, sail
from lab.tuning.search import LOST_MM, minimised
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import load_config as load_plant

TRAINED_ON = ("station", "circle")
TRAINING_S = 30.0
EVALUATIONS = 30
AXIS = {"lambda_per_s": 3.0, "kappa_per_s": 4.0, "disturbance_noise": 5.0}
"""What a search may turn of Holdfast's surge and sway alike."""


def knobs(row: Competitor) -> Mapping[str, float]:
    """Return what a search may turn of a row, and where it starts; nothing of the stock autopilot."""
    return AXIS if row.name == DEFAULT else row.knobs


def scores(row: Competitor, candidates: Sequence[Mapping[str, float]]) -> list[float]:
    """Return the mean horizontal RMS error of each candidate, mm."""
    jobs = [(row, values, i) for values in candidates for i in range(len(TRAINED_ON))]
    with worker_pool() as pool:
        found = np.reshape([*pool.map(_score, jobs)], (len(candidates), -1))
    return [float(score) for score in found.mean(1)]


def _score(job: tuple[Competitor, Mapping[str, float], int]) -> float:
    row, values, i = job
    course = next(course for course in COURSES if course.name == TRAINED_ON[i])
    settings = [
        f"{axis}.{key}={values[key]!r}" for axis in ("surge", "sway") for key in AXIS if key in values
    ]
    try:
        track = sail(
            row, course, values, load_plant(DEFAULT_CONFIG), i, settings=settings, lasts_s=TRAINING_S
        )
    except ConfigError:
        return LOST_MM
    return track.figures()["place_rms_mm"] if track.held else LOST_MM


def main() -> None:
    """Search, and write what `lab/studies/courses.toml` holds to the standard output."""
    searched = {row.name: row for row in ROWS if knobs(row)}
    parser = argparse.ArgumentParser(prog="python -m lab.tuning.position")
    parser.add_argument("--evaluations", type=int, default=EVALUATIONS, metavar="N")
    parser.add_argument("--rows", nargs="+", choices=searched, default=[*searched], metavar="ROW")
    arguments = parser.parse_args()
    for row in (searched[name] for name in arguments.rows):
        found = minimised(knobs(row), partial(scores, row), arguments.evaluations)
        lines = (
            f"# python -m lab.tuning.position --evaluations {arguments.evaluations} --rows {row.name}",
            f"# {' and '.join(TRAINED_ON)}, {TRAINING_S:g} s each, seeds 0 and 1, never of the bench",
            f"# mean horizontal RMS: {found.start_score:.1f} mm before, {found.score:.1f} mm after",
            f"[values.{row.name}]",
            *(f'"{key}" = {value!r}' for key, value in found.values.items()),
        )
        sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
