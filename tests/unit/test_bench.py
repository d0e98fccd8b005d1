"""The benches' arithmetic, their rows and what a search found, and a search that is run."""

import math
import tomllib
from collections.abc import Sequence
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from companion import assembly
from companion.config import Config, load_config
from holdfast import main
from lab.studies import gain_search as searching
from lab.studies import tune
from lab.studies.competitors import (
    COMPETITORS,
    DEFAULT,
    FIRST_SEED,
    TUNED_FILE,
    competitors,
    place_knobs_of,
    steered,
    tuned,
    written,
)
from lab.studies.dives import FIGURES, LINKS, SCENARIOS, Dives
from lab.studies.gain_search import Stage, scores, search, training
from lab.studies.reality import FIRST_SEED as FIRST_REAL_SEED
from lab.studies.rivals import Rivals
from lab.studies.statistics import interval, student
from lab.study import Row, Study, by, parser_of
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.sim_config import load_config as load_plant

CONFIG = load_config()
BASE = load_plant(DEFAULT_CONFIG)


def test_intervals_are_students_and_cover_the_truth_as_often_as_they_say() -> None:
    table = {1: 12.706, 2: 4.303, 3: 3.182, 4: 2.776, 9: 2.262, 59: 2.001}
    assert [student(freedom) for freedom in table] == pytest.approx([*table.values()], rel=0.006)
    rng = np.random.default_rng(0)
    found = [interval(rng.normal(1.0, 2.0, 6)) for _ in range(4000)]
    assert np.mean([abs(mean - 1.0) < half for mean, half in found]) == pytest.approx(0.95, abs=0.015)
    assert math.isnan(interval([1.0])[1])


def configured(overrides: Sequence[str]) -> Config:
    return load_config(overrides=overrides)


def study(kind: type[Study[Any]], *options: str) -> Study[Any]:
    return kind(parser_of(kind).parse_args(options))


def shown(bench: Study[Any], rows: Sequence[Row]) -> str:
    console = Console(width=140, record=True, file=StringIO())
    console.print(*bench.tables(rows))
    return console.export_text()


def dives(rows: dict[str, float], seeds: int = 4) -> list[Row]:
    """Every row off by its number from a floor of 2 mm plus the seed's own."""
    return [
        {"row": row, "scenario": scenario, "delay_ms": delay_ms, "seed": seed, "held": row != "ppi"}
        | dict.fromkeys(FIGURES, math.nan)
        | {"depth_rms_mm": 2.0 + seed + more, "chatter_n": 4.0}
        for scenario in SCENARIOS
        for delay_ms in LINKS
        for row, more in rows.items()
        for seed in range(seeds)
    ]


def test_differences_are_taken_dive_by_dive() -> None:
    made = dives({"law": 3.0, "ppi": 5.0, "network": 99.0, DEFAULT: 1.0})
    bench = study(Dives, "--seeds", "4")
    table = bench.summary(made)
    assert table["columns"][:2] == ["depth RMS, mm (as is/+80 ms)", "waves"]
    lines = {line[0]: line[1:] for line in table["rows"]}
    assert next(iter(lines)) == "Holdfast"
    assert lines["law"] == ["6.5/6.5"] * 4 + ["+2.00±0.00", "4.0"]
    assert lines["P-PI"][0] == "8.5††††/8.5††††"
    assert lines["Holdfast"][-2] == "–"
    assert {line[-2] for line in bench.summary(dives({"law": 3.0}))["rows"]} == {"–"}
    text = shown(bench, made)
    assert "+2.00±0.00" in text
    assert "…" not in text


def test_no_search_sees_a_seed_of_a_bench() -> None:
    searched = tomllib.loads(TUNED_FILE.read_text())["search"]["training_seeds"]
    assert int(searched.removeprefix("0..")) < min(FIRST_SEED, FIRST_REAL_SEED)
    assert {scenario.seed for scenario in training(5)} == set(range(5))
    cases = study(Dives, "--rows", DEFAULT, "--scenarios", "calm", "waves").cases()
    assert {case.seed for case in cases} == set(range(FIRST_SEED, FIRST_SEED + 60))
    assert [name for (name,) in by([case._asdict() for case in cases], "scenario")] == ["waves", "calm"]
    assert min(case.seed for case in study(Rivals).cases()) == FIRST_REAL_SEED


@pytest.mark.parametrize("name", [name for name, row in COMPETITORS.items() if row.autopilot is None])
def test_every_row_can_take_off_as_it_was_found_and_where_a_search_begins(name: str) -> None:
    row, found = COMPETITORS[name], tuned().get(name, {})
    for place in (False, True):
        start = [*row.settings(place=place), *written(row.knobs(CONFIG, place=place))]
        for overrides in (row.overrides(CONFIG, found, place=place), start):
            assembly.control(configured(overrides))


def test_what_is_not_shipped_has_rows_that_start_where_the_configuration_stands() -> None:
    config = load_config(
        overrides=[
            "compensators.mine.module=companion.core.integrator",
            "laws.other={module='lab.rivals.ppi', k_p=3.0, k_v=7.0, k_i=0.0}",
        ]
    )
    more = {name: row for name, row in competitors(config).items() if name not in COMPETITORS}
    assert [*more] == ["mine", "mine+observer", "other"]
    assert more["mine"].knobs(config, place=False)["heave.learning_rate"] == config.heave.learning_rate
    assert more["other"].depth == {"laws.other.k_p": 3.0, "laws.other.k_v": 7.0}
    assert "heave.compensator='mine+observer'" in more["mine+observer"].settings(place=False)


def test_a_rival_steers_depth_and_place_and_the_default_is_what_is_shipped() -> None:
    for row, compensator in (("indi", "none"), ("indi_predicted", "predictor")):
        config = configured(steered(COMPETITORS[row], CONFIG, tuned()["indi"]))
        assert (config.heave.law, config.surge.law, config.sway.law) == ("indi_depth", *["indi_place"] * 2)
        assert (config.yaw.law, config.heave.compensator) == ("lyapunov", compensator)
    assert steered(COMPETITORS[DEFAULT], CONFIG, {}) == []


def test_rivals_are_compared_vehicle_by_vehicle_and_the_lost_are_counted() -> None:
    figures: Row = {"place_rms_mm": 20.0, "tilt_deg": 4.0, "chatter_n": 3.0, "place_chatter_n": 1.0}
    rows = [
        {"row": row, "seed": seed, "depth_rms_mm": (4.0 + seed) * factor, "thrust_rms_n": 5.0, "lost_s": lost}
        | figures
        for row, factor, lost in ((DEFAULT, 1.0, math.nan), ("mpc", 0.9, 30.0))
        for seed in (0, 1, 2)
    ]
    bench = study(Rivals, "--rows", DEFAULT, "mpc", "--seeds", "3")
    text = shown(bench, rows)
    for said in ("MPC + observer (3 lost)", "-10 ± 5", "+0 ± 0"):
        assert said in text


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(searching, "COUNTS_S", 12.0)
    monkeypatch.setattr(searching, "TRAINING_S", 3.0)


@pytest.mark.compiles
@pytest.mark.usefixtures("short")
def test_a_search_gets_better_and_prices_chatter_and_loss() -> None:
    soft = {"heave.lambda_per_s": 1.0, "heave.kappa_per_s": 2.0}
    dives, stage = training(1), Stage(soft, (), place=False, chatter_n=2.2)
    found = search(stage, configured, BASE, dives, evaluations=11)
    assert found.score < 0.9 * found.start_score
    assert set(found.values) == set(soft)
    wild = soft | {"heave.disturbance_noise": 60.0, "heave.kappa_per_s": 12.0}
    refused = {"heave.kappa_per_s": 1e6}
    bad, lost = scores(stage, [wild, refused], configured, BASE, dives)
    assert bad > found.score + searching.EQUAL_PRICE
    assert lost == searching.LOST_MM


@pytest.mark.compiles
@pytest.mark.usefixtures("short")
def test_a_search_for_the_place_judges_surge_and_sway() -> None:
    shipped = place_knobs_of(CONFIG)
    soft = {key: 0.16 * value for key, value in shipped.items()}
    stage = Stage(shipped, (), place=True, chatter_n=10.0)
    good, worse = scores(stage, [shipped, soft], configured, BASE, training(1))
    assert worse > 2.0 * good


def test_the_search_ends_with_the_command_that_dives_its_result():
    assert "holdfast lab bench dives --rows ppi law" in tune.next_step(["ppi", "law"])


def test_a_search_writes_over_no_file_that_is_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (there := tmp_path / "mine.toml").write_text("mine", encoding="utf-8")
    assert main(["lab", "tune", "law", "--out", str(there)]) == 2
    assert f"{there} is there already" in capsys.readouterr().err
    assert there.read_text(encoding="utf-8") == "mine"
