"""The measurement of bad subscribers: its own sums."""

import numpy as np

from lab.subscribers import CASES, NOBODY, P99_RATIO, _bounds


def test_each_cases_p99_is_set_over_that_with_nobody() -> None:
    windows = [(case, 100.0 * index, 100.0 * index + 50.0) for index, case in enumerate(CASES)]
    windows.append((CASES[-1], 1000.0, 1050.0))
    ticks = [
        (begun_s + tick / 10, 2.0 if case == CASES[-1] else 1.0)
        for case, begun_s, _ in windows
        for tick in range(500)
    ]
    ticks += [(begun_s + 60.0, 99.0) for _, begun_s, _ in windows]  # between the windows: no part of them
    bounds = {bound.name: bound for bound in _bounds(windows, np.array(ticks))}
    assert bounds[f"p99, {CASES[-1]} over {NOBODY}"].value == 2.0
    assert not bounds[f"p99, {CASES[-1]} over {NOBODY}"].held
    assert bounds[f"p99, {CASES[1]} over {NOBODY}"].value == 1.0
    assert bounds[f"p99, {CASES[1]} over {NOBODY}"].limit == P99_RATIO
    assert bounds[f"tick lateness, {CASES[-1]}: p99 of 1000"].value == 2.0
