"""`python -m lab.tuning.position`: the search of `holdfast tune` for the rivals of `holdfast bench position`.

The same optimiser and the same width of bounds; but every candidate dives in the full loop, because the batch
knows no horizontal position. So it has fewer evaluations.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from companion.config import load_config
from lab.bench.position import COURSES, ROWS, sail
from lab.bench.rows import Row
from lab.pool import worker_pool
from lab.tuning.search import LOST_MM, minimised
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import load_config as load_plant

TRAINED_ON = ("station", "circle")
TRAINING_S = 30.0
EVALUATIONS = 30


def scores(row: Row, candidates: Sequence[Mapping[str, float]]) -> list[float]:
    """Return the mean horizontal RMS error of each candidate, mm."""
    jobs = [(row, values, i) for values in candidates for i in range(len(TRAINED_ON))]
    with worker_pool() as pool:
        found = np.reshape([*pool.map(_score, jobs)], (len(candidates), -1))
    return [float(score) for score in found.mean(1)]


def _score(job: tuple[Row, Mapping[str, float], int]) -> float:
    row, values, i = job
    course = next(course for course in COURSES if course.name == TRAINED_ON[i])
    config = load_config(overrides=row.overrides(values))
    track = sail(course, config, load_plant(DEFAULT_CONFIG), i, TRAINING_S)
    return track.figures()["place_rms_mm"] if track.held else LOST_MM


def main() -> None:
    """Search, and write what `lab/bench/position.toml` holds to the standard output."""
    parser = argparse.ArgumentParser(prog="python -m lab.tuning.position")
    parser.add_argument("--evaluations", type=int, default=EVALUATIONS, metavar="N")
    evaluations = parser.parse_args().evaluations
    for row in ROWS:
        if row.knobs:
            found = minimised(row.knobs, partial(scores, row), evaluations)
            lines = (
                f"# python -m lab.tuning.position --evaluations {evaluations}",
                f"# {' and '.join(TRAINED_ON)}, {TRAINING_S:g} s each, seeds 0 and 1, never of the bench",
                f"# mean horizontal RMS: {found.start_score:.1f} mm before, {found.score:.1f} mm after",
                f"[values.{row.name}]",
                *(f'"{key}" = {value!r}' for key, value in found.values.items()),
            )
            sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
