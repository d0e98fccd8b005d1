"""The measurement of bad subscribers: its own sums."""

import numpy as np
import pytest

from lab.operations.subscribers import CASES, NOBODY, P99_RATIO, NoReaderError, bounds_of, check_case


def test_each_cases_p99_is_set_over_that_with_nobody() -> None:
    windows = [(case, 100.0 * index, 100.0 * index + 50.0) for index, case in enumerate(CASES)]
    windows.append((CASES[-1], 1000.0, 1050.0))
    ticks = [
        (begun_s + tick / 10, 2.0 if case == CASES[-1] else 1.0)
        for case, begun_s, _ in windows
        for tick in range(500)
    ]
    ticks += [(begun_s + 60.0, 99.0) for _, begun_s, _ in windows]  # between the windows: no part of them
    bounds = {bound.name: bound for bound in bounds_of(windows, np.array(ticks))}
    assert bounds[f"p99, {CASES[-1]} over {NOBODY}"].value == 2.0
    assert not bounds[f"p99, {CASES[-1]} over {NOBODY}"].held
    assert bounds[f"p99, {CASES[1]} over {NOBODY}"].value == 1.0
    assert bounds[f"p99, {CASES[1]} over {NOBODY}"].limit == P99_RATIO
    assert bounds[f"tick lateness, {CASES[-1]}: p99 of 1000"].value == 2.0


@pytest.mark.parametrize(
    ("case", "taken", "alive"),
    [("reading", 4000, True), ("50 ms a sample", 200, True), ("stopped", 0, True), ("killed", 0, False)],
)
def test_a_reader_that_is_not_what_its_case_says_gives_no_figures(case: str, taken: int, alive: bool) -> None:
    check_case(case, taken, 10.0, alive=alive)
    with pytest.raises(NoReaderError, match=case):
        check_case(case, taken, 10.0, alive=not alive)
    with pytest.raises(NoReaderError, match=f"took {1000 - taken % 1000} samples"):
        check_case(case, 1000 - taken % 1000, 10.0, alive=alive)
