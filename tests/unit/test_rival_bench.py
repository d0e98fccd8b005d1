"""`holdfast lab bench rivals`: the rows, their search, and what the table says."""

import tomllib

import pytest
from rich.console import Console

from companion import assembly
from companion.config import load_config
from holdfast import RefusedError
from lab.studies import tune
from lab.studies.competitors import DEFAULT, WIDTH, tuned
from lab.studies.rivals import (
    RIVALS,
    TUNED_FILE,
    Rivals,
    competitor,
    overrides,
    step_us,
)
from lab.studies.search import Found, training_of_reality
from lab.studies.unlike import FIRST_SEED
from lab.study import Row, parser_of

CONFIG = load_config()


def study(*options, kind=Rivals):
    return kind(parser_of(Rivals).parse_args([*options, "--out", "out"]))


@pytest.mark.parametrize("name", RIVALS)
def test_all_that_a_search_may_try_can_take_off(name):
    for place in (False, True):
        row = competitor(name, CONFIG, place=place)
        for factor in (1.0 / WIDTH, 1.0, WIDTH):
            values = {key: factor * start for key, start in row.knobs.items()}
            if factor == 1.0:
                assembly.control(load_config(overrides=row.overrides(values)))


@pytest.mark.parametrize("name", RIVALS)
def test_what_was_found_lies_within_the_same_width_for_every_row(name):
    found = tuned(TUNED_FILE)[name]
    both = [competitor(name, CONFIG, place=place).knobs for place in (False, True)]
    assert set(found) == set(both[0]) | set(both[1])
    for knobs in both:
        for key, start in knobs.items():
            assert 1.0 / WIDTH <= found[key] / start <= 1.001 * WIDTH


def test_a_rival_steers_depth_and_place_and_the_default_is_what_is_shipped():
    config = load_config(overrides=overrides("indi", CONFIG, tuned(TUNED_FILE)))
    assert (config.heave.law, config.surge.law, config.sway.law) == ("indi_depth", "indi_place", "indi_place")
    assert (config.yaw.law, config.heave.compensator) == ("lyapunov", "none")
    assert overrides(DEFAULT, CONFIG, {}) == []


def test_no_search_sees_a_vehicle_of_the_bench():
    vehicles = tomllib.loads(TUNED_FILE.read_text())["search"]["training_seeds"]
    assert int(vehicles.removeprefix("0..")) < FIRST_SEED
    assert {scenario.seed for scenario, _ in training_of_reality(5)} == set(range(5))
    assert min(case.seed for case in study().cases()) == FIRST_SEED


def test_differences_are_taken_vehicle_by_vehicle_and_the_lost_are_counted():
    figures: Row = {"place_rms_mm": 20.0, "tilt_deg": 4.0, "chatter_n": 3.0, "place_chatter_n": 1.0}
    rows = [
        {"row": row, "seed": seed, "depth_rms_mm": (4.0 + seed) * factor, "thrust_rms_n": 5.0, "lost_s": lost}
        | figures
        for row, factor, lost in ((DEFAULT, 1.0, float("nan")), ("mpc", 0.9, 30.0))
        for seed in (0, 1, 2)
    ]
    bench = study("--rows", DEFAULT, "mpc", "--seeds", "3")
    console = Console(width=140, record=True)
    console.print(*bench.tables(rows))
    text = console.export_text()
    assert "MPC + observer (3 lost)" in text
    assert "-10 ± 5" in text
    assert "+0 ± 0" in text
    line = bench.summary(rows)["rows"][1]
    assert len(line) == len(bench.summary(rows)["columns"])


def test_a_step_of_mpc_costs_more_than_the_papers_law():
    config = load_config(overrides=overrides("mpc", CONFIG, tuned(TUNED_FILE)))
    assert step_us(config) > step_us(CONFIG) > 0.0


def test_a_search_turns_the_depth_of_each_row_and_then_its_place(monkeypatch):
    judged = []

    def search(stage, load, *_, **__):
        judged.append((stage.name, stage.place, load(()).laws.get("indi_depth", {}).get("omega")))
        return Found({key: 1.5 * start for key, start in stage.knobs.items()}, 3.0, 4.0, 10)

    monkeypatch.setattr(tune, "search", search)
    arguments = parser_of(tune.Tune).parse_args(["indi", "--reality"])
    arguments.command = "holdfast lab tune"
    found = tune.Tune(arguments)
    (row,) = found.dive(found.cases())
    assert judged == [("indi", False, None), ("indi", True, 9.0)]
    assert row["scores"] == [4.0, 3.0, 4.0, 3.0]
    assert set(row["values"]) == set(tuned(TUNED_FILE)["indi"])
    assert (
        tomllib.loads(tune.tuned_text({"seeds": 1}, [{"row": "indi"} | row]))["values"]["indi"]
        == row["values"]
    )


def test_an_unknown_row_and_a_firmware_are_refused():
    with pytest.raises(RefusedError, match="no such row: nonesuch"):
        study("--rows", "nonesuch")
