"""The grid of vehicles: its cells, what counts as a limit cycle, and what is told of it."""

import math
from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from companion.config import load_config
from lab.studies.grid import (
    AXES,
    GAINS,
    LATIN,
    PLACES,
    SUBSETS,
    TICK_S,
    Cell,
    Grid,
    cycles_s,
    dive,
    latin,
    plant,
)
from lab.study import parser_of
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import load_config as load_plant
from sim_bridge.physics.body import Physics

BASE = load_plant(DEFAULT_CONFIG)
NOMINAL = Cell("all", 1.0, 0.15, 0, 0, "waves")
TIMES_S = TICK_S * np.arange(1000)[:, None]
LARGEST = np.array([100.0])


def test_the_full_grid_is_every_combination_once() -> None:
    cells = SUBSETS["full"]()
    assert len(cells) == len(set(cells)) == 5 * 7 * 4 * 3 * 2 * 2
    assert set(SUBSETS["lines"]()) | set(SUBSETS["corners"]()) <= set(cells)


def test_a_latin_hypercube_reaches_every_part_of_each_range() -> None:
    cells = latin()
    assert len(cells) == LATIN
    for axis in AXES:
        assert sum(cell.axis == axis for cell in cells) == LATIN / len(AXES)
    logs = np.sort([math.log(cell.gain, 3.0) for cell in cells])
    assert np.allclose(logs, np.linspace(-1.0, 1.0, 2 * LATIN + 1)[1::2], atol=1.01 / LATIN)
    assert latin() == cells != latin(seed=2)


@pytest.mark.parametrize(("axis", "column"), [("surge", 0), ("sway", 1), ("heave", 2), ("yaw", 5)])
def test_the_gain_of_an_axis_is_its_own(axis: str, column: int) -> None:
    forces = []
    for cell in (NOMINAL, NOMINAL._replace(axis=axis, gain=2.0)):
        body = Physics(plant(BASE, cell, 1), 1)
        for _ in range(200):
            body.step((1700, 1600, 1400, 1550, 1700, 1650, 1560, 1700), 0.0)
        forces.append(np.array(body.tau))
    ratio = forces[1] / forces[0]
    assert ratio[column] == pytest.approx(2.0)
    assert np.delete(ratio, column) == pytest.approx(1.0)


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


def test_the_nominal_vehicle_is_held() -> None:
    outcome = dive(NOMINAL, load_config(), BASE, 1, duration_s=15.0)
    assert outcome["held"]
    assert all(outcome[f"cycle_{place}_s"] < 3.0 for place in PLACES)
    assert math.isnan(outcome["chatter_n"])  # nothing is measured before it has settled


def test_the_report_names_what_was_not_held(tmp_path) -> None:
    cycles = {f"cycle_{place}_s": 0.0 for place in PLACES}
    rms = {f"rms_{place}": error for place, error in zip(PLACES[:4], (10.0, 10.0, 3.0, 0.2), strict=True)}
    good = NOMINAL._asdict() | {"seed": 1, "gave_up": "", "held": True, "chatter_n": 2.0} | cycles | rms
    bad = good | {"axis": "yaw", "gain": GAINS[-1], "cycle_heading_s": 9.0, "held": False}
    gone = good | {"gave_up": "the vehicle is off track", "held": False}
    study = Grid(parser_of(Grid).parse_args([]))
    console = Console(width=140, file=StringIO(), record=True)
    console.print(*study.tables([good, bad, gone]))
    text = console.export_text()
    assert "yaw × 3.00" in text
    assert "heading" in text
    assert text.count("off track") == 1
    assert study.failed([good, bad, gone])
    (picture,) = study.draw([good, bad, gone], tmp_path)
    assert picture.stat().st_size > 10_000
