"""The corners of the campaign: their vehicles, what counts as a limit cycle, and what is told of it."""

import math

import numpy as np
import pytest

from lab.studies.corners import PLACES, TICK_S, Cell, Corners, cycles_s
from lab.study import parser_of

NOMINAL = Cell(1.0, 0.15, 0, 0, "waves")
TIMES_S = TICK_S * np.arange(1000)[:, None]
LARGEST = np.array([100.0])


@pytest.mark.parametrize(
    ("hz", "amplitude", "seconds", "found_s"),
    [(1.0, 40.0, 8.0, 8.0), (1.0, 10.0, 8.0, 0.0), (0.2, 40.0, 8.0, 0.0), (3.0, 40.0, 2.0, 2.0)],
)
def test_a_limit_cycle_is_fast_large_and_as_long_as_it_lasts(
    hz: float, amplitude: float, seconds: float, found_s: float
) -> None:
    demand = amplitude * np.sin(2 * math.pi * hz * TIMES_S) * (abs(TIMES_S - 10.0) < 0.5 * seconds)
    assert cycles_s(demand, LARGEST, 0.0 * demand)[0] == pytest.approx(found_s, abs=1.2)


def test_what_the_sea_asks_is_no_limit_cycle() -> None:
    demand = 40.0 * np.sin(2 * math.pi * 0.6 * TIMES_S)
    assert cycles_s(demand, LARGEST, 0.0 * demand)[0] > 15.0
    assert cycles_s(demand, LARGEST, demand)[0] == 0.0


def test_the_report_names_what_was_not_held() -> None:
    cycles = {f"cycle_{place}_s": 0.0 for place in PLACES}
    good = NOMINAL._asdict() | {"gave_up": "", "held": True, "depth_rms_mm": 2.0} | cycles
    bad = good | {"gain": 3.0, "cycle_heading_s": 9.0, "held": False}
    gone = good | {"gave_up": "the vehicle is off track", "held": False}
    study = Corners(parser_of(Corners).parse_args([]))
    table = study.summary([good, bad, gone])
    assert table["columns"][0] == "2 of 3 not held: gain"
    assert [(line[0], line[4], line[5]) for line in table["rows"]] == [
        ("3.00", "heading", ""),
        ("1.00", "roll", "the vehicle is off track"),
    ]
    assert study.failed([good, bad, gone])
