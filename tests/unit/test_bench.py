"""The bench's arithmetic, its rows and what a search found, and a search that is run."""

import math
import tomllib
from collections.abc import Sequence
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from companion import assembly
from companion.config import DEFAULT_FILE, Config, load_config, vehicle_of
from holdfast import RefusedError, main
from lab import commands
from lab.loop.scenarios import ensemble, four
from lab.studies import search as tune
from lab.studies.competitors import (
    COMPETITORS,
    DEFAULT,
    FIRST_SEED,
    TUNED_FILE,
    WIDTH,
    Competitor,
    competitors,
    place_knobs_of,
    selected,
    tuned,
    values_of,
)
from lab.studies.dives import FIGURES, LINKS, SCENARIOS, Dives, interval, student
from lab.studies.fidelity import Fidelity
from lab.studies.own_vehicle import around, nominal, write_config
from lab.studies.tune import next_step
from lab.study import Row, by, parser_of
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import load_config as load_plant
from sim_bridge.firmware.params import DEFAULTS

BASE = load_plant(DEFAULT_CONFIG)
SIX_THRUSTERS = load_plant(DEFAULT_CONFIG.parent / "sim-bluerov2.toml")


@pytest.mark.parametrize(
    ("freedom", "quantile"), [(1, 12.706), (2, 4.303), (3, 3.182), (4, 2.776), (9, 2.262), (59, 2.001)]
)
def test_students_quantile_is_that_of_the_table(freedom: int, quantile: float) -> None:
    assert student(freedom) == pytest.approx(quantile, rel=0.006)


def test_interval_covers_the_truth_as_often_as_it_says() -> None:
    rng = np.random.default_rng(0)
    covered = [low < 1.0 < high for low, high in (interval(rng.normal(1.0, 2.0, 6)) for _ in range(4000))]
    assert np.mean(covered) == pytest.approx(0.95, abs=0.015)
    assert all(math.isnan(end) for end in interval([1.0]))


def configured(overrides: Sequence[str]) -> Config:
    return load_config(overrides=overrides)


def study(kind: type[Dives], *options: str) -> Dives:
    return kind(parser_of(kind).parse_args(options))


def dives(rows: dict[str, float], seeds: int = 4) -> list[Row]:
    """Every row off by its number from a floor of 2 mm plus the seed's own."""
    return [
        {"row": row, "scenario": scenario, "delay_ms": delay_ms, "seed": seed, "held": row != "ppi"}
        | figures(2.0 + seed + more)
        for scenario in SCENARIOS
        for delay_ms in LINKS
        for row, more in rows.items()
        for seed in range(seeds)
    ]


def figures(rms_mm: float) -> dict[str, float]:
    return dict.fromkeys(FIGURES, math.nan) | {
        "depth_rms_mm": rms_mm,
        "depth_peak_mm": 3 * rms_mm,
        "thrust_rms_n": 5.0,
        "chatter_n": 4.0,
        "heading_rms_deg": 0.2,
    }


def test_differences_are_taken_dive_by_dive() -> None:
    made = dives({"law": 3.0, "ppi": 5.0, "network+observer": 99.0, DEFAULT: 1.0})
    shown = study(Dives, "--seeds", "4").summary(made)
    assert shown["columns"][:2] == ["depth RMS, mm (as is/+80 ms)", "waves"]
    lines = {line[0]: line[1:] for line in shown["rows"]}
    assert next(iter(lines)) == "Holdfast"
    assert lines["law"] == ["6.5/6.5"] * 4 + ["+2.00±0.00", "4.0"]
    assert lines["P-PI"][0] == "8.5††††/8.5††††"
    assert lines["Holdfast"][-2] == "–"
    without = study(Dives, "--seeds", "4").summary(dives({"law": 3.0}))
    assert {line[-2] for line in without["rows"]} == {"–"}

    console = Console(width=80, record=True, file=StringIO())
    console.print(*study(Dives, "--seeds", "4").tables(made))
    text = console.export_text()
    assert "+2.00±0.00" in text
    assert "…" not in text


def test_a_picture_for_every_scenario(tmp_path: Path) -> None:
    paths = study(Dives).draw(dives({"law": 3.0, DEFAULT: 1.0}), tmp_path)
    assert [path.name for path in paths] == [f"{scenario}.png" for scenario in SCENARIOS]
    assert all(path.stat().st_size > 10_000 for path in paths)


def test_bench_seeds_are_none_that_a_search_sees() -> None:
    assert FIRST_SEED > 100 * tune.TRAINING_SEEDS
    cases = study(Dives, "--rows", DEFAULT, "--scenarios", "calm", "waves").cases()
    assert {case.seed for case in cases} == set(range(FIRST_SEED, FIRST_SEED + 60))
    assert [name for (name,) in by([case._asdict() for case in cases], "scenario")] == ["waves", "calm"]


def test_every_row_was_searched_within_the_same_width() -> None:
    found = tuned()
    about = tomllib.loads(TUNED_FILE.read_text())["search"]
    assert about["bounds_factor"] == WIDTH
    for row in COMPETITORS:
        assert set(found.get(row.name, {})) == set(row.knobs)
        for key, value in values_of(row, found).items():
            assert 1.0 / WIDTH <= value / row.knobs[key] <= WIDTH * 1.001


def test_every_row_can_take_off() -> None:
    found = tuned()
    for row in COMPETITORS:
        values = values_of(row, found)
        config = load_config(overrides=row.overrides(values))
        assembly.control(config)
        if row.steers == "autopilot":
            assert set(values) <= set(DEFAULTS)
    with pytest.raises(RefusedError, match="no such row: nonesuch; there are alt_hold_stock"):
        selected(["law", "nonesuch"], load_config())


def test_what_is_not_shipped_has_rows_that_start_where_the_configuration_stands() -> None:
    config = load_config(
        overrides=[
            "compensators.mine.module=companion.core.integrator",
            "laws.other={module='lab.rivals.ppi', k_p=3.0, k_v=7.0, k_i=0.0}",
        ]
    )
    mine, beside, other = (row for row in competitors(config) if row not in COMPETITORS)
    assert [mine.name, beside.name, other.name] == ["mine", "mine+observer", "other"]
    assert mine.knobs["heave.learning_rate"] == config.heave.learning_rate
    assert {key: value for key, value in other.knobs.items() if key.startswith("laws.")} == {
        "laws.other.k_p": 3.0,
        "laws.other.k_v": 7.0,
    }
    assert "heave.compensator='mine+observer'" in beside.overrides({})
    assert competitors(load_config()) == COMPETITORS


@pytest.mark.compiles
def test_a_search_gets_better_and_prices_chatter_and_loss(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tune, "TRAINING_S", 12.0)
    row = selected(["alt_hold"], load_config())[0]
    found = tune.search(row, configured, BASE, tune.training(1, ensemble), evaluations=12)
    assert found.score < 0.8 * found.start_score
    assert set(found.values) == set(row.knobs)
    wild = {"PSC_POSZ_P": 18.0, "PSC_VELZ_P": 48.0, "PSC_ACCZ_P": 3.0, "PSC_ACCZ_I": 0.6}
    dives = tune.training(1, around)
    assert tune.scores(row, [wild], configured, BASE, dives)[0] > 3.0 * tune.CHATTER_N + found.score


@pytest.mark.compiles
def test_candidates_do_not_disturb_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tune, "TRAINING_S", 3.0)
    row = selected(["network"], load_config())[0]
    values = [dict(row.knobs), {key: 1.3 * value for key, value in row.knobs.items()}]
    dives = [dive for dive in tune.training(2, around) if dive[0].name == "waves"]
    together = tune.scores(row, values, configured, BASE, dives)
    alone = [tune.scores(row, [one], configured, BASE, dives)[0] for one in values]
    assert together == pytest.approx(alone, rel=0.02)
    assert together[0] != pytest.approx(together[1], rel=1e-3)


@pytest.mark.compiles
def test_a_search_for_the_place_judges_surge_and_sway(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tune, "TRAINING_S", 3.0)
    shipped = place_knobs_of(load_config())
    soft = {key: 0.25 * value for key, value in shipped.items()}
    row = Competitor("place", "place", "companion", shipped, place=True)
    dives = [dive for dive in tune.training(1, around) if dive[0].name == "calm"]
    good, worse = tune.scores(row, [shipped, soft], configured, BASE, dives)
    assert worse > 2.0 * good


def test_own_vehicles_config_is_written_with_its_comments(tmp_path: Path) -> None:
    settings = [f"{key}={value}" for key, value in nominal(SIX_THRUSTERS).items()]
    vehicle = vehicle_of(load_config(overrides=settings))
    identified = tmp_path / "vehicle.toml"
    identified.write_text("of `holdfast identify`")
    write_config(DEFAULT_FILE, vehicle, {"heave.kappa_per_s": 7.25}, tmp_path / "mine.toml")
    assert identified.read_text() == "of `holdfast identify`"
    mine, text = load_config(tmp_path / "mine.toml"), (tmp_path / "mine.toml").read_text()
    assert mine == load_config(overrides=[*settings, "heave.kappa_per_s=7.25"])
    hull = SIX_THRUSTERS.hull
    assert mine.vehicle.frame == "vectored"
    assert mine.heave.mass == pytest.approx(hull.mass_kg + hull.added_mass[2])
    assert mine.yaw.mass == pytest.approx(hull.inertia_kg_m2[2] + hull.added_mass[5])
    assert [line.find("#") for line in text.splitlines()][:-3] == [
        line.find("#") for line in DEFAULT_FILE.read_text().splitlines()
    ]


def test_own_vehicles_config_stays_one_file_where_it_was_one(tmp_path: Path, complete_config: Path) -> None:
    vehicle = vehicle_of(load_config(overrides=["heave.mass=31"]))
    write_config(complete_config, vehicle, {"heave.kappa_per_s": 7.25}, tmp_path / "mine.toml")
    assert load_config(tmp_path / "mine.toml") == load_config(
        overrides=["heave.mass=31", "heave.kappa_per_s=7.25"]
    )
    assert not [*tmp_path.glob("*-vehicle.toml")]


@pytest.mark.parametrize("text", ["[heave]\nlambda_per_s = 3.0\n", "\ufeff[vehicle]\npreset = 'heavy'\n"])
def test_own_vehicles_config_may_be_short_or_saved_by_windows(tmp_path: Path, text: str) -> None:
    (source := tmp_path / "short.toml").write_text(text, encoding="utf-8")
    write_config(source, vehicle_of(load_config()), {"heave.kappa_per_s": 7.25}, tmp_path / "mine.toml")
    assert load_config(tmp_path / "mine.toml").heave.kappa_per_s == 7.25


def test_vehicles_are_drawn_around_ones_own() -> None:
    drawn = [around(SIX_THRUSTERS, seed) for seed in range(20)]
    masses = [one.hull.mass_kg + one.hull.added_mass[2] for one in drawn]
    own = SIX_THRUSTERS.hull.mass_kg + SIX_THRUSTERS.hull.added_mass[2]
    assert 0.9 * own <= min(masses) < max(masses) <= 1.1 * own
    assert len(set(masses)) == 20
    assert around(SIX_THRUSTERS, 3) == around(SIX_THRUSTERS, 3)


def test_the_simulator_beside_the_firmware_is_marked_where_they_differ() -> None:
    def dive(vehicle: str, scenario: str, seed: int) -> Row:
        worse = vehicle == "firmware" and scenario == "load"
        sd_mm = 3.0 if vehicle == "simulator" else 5.0 if worse else 3.3
        case = {"vehicle": vehicle, "row": DEFAULT, "scenario": scenario, "seed": seed, "held": not worse}
        return case | dict.fromkeys(FIGURES, 1.0) | {"depth_sd_mm": sd_mm, "depth_mean_mm": -5.0}

    rows = [
        dive(vehicle, scenario, seed)
        for vehicle in ("simulator", "firmware")
        for scenario in SCENARIOS
        for seed in (1, 2)
    ]
    (line,) = study(Fidelity).summary(rows)["rows"]
    assert line == ["Holdfast", "3.3 (3.0)", "3.3 (3.0)", "5.0†† (3.0)*", "3.3 (3.0)"]


def test_without_a_firmware_the_command_says_what_to_set(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("HOLDFAST_ARDUSUB", raising=False)
    assert commands.bench(["firmware"]) == 2
    assert commands.bench(["dives", "--firmware"]) == 2
    assert "set HOLDFAST_ARDUSUB" in capsys.readouterr().err


@pytest.mark.parametrize("row", [row for row in COMPETITORS if row.knobs], ids=lambda row: row.name)
def test_what_a_search_may_try_is_within_the_ranges(row: Competitor) -> None:
    for factor in (1.0 / WIDTH, WIDTH):
        configured(row.overrides({key: factor * start for key, start in row.knobs.items()}))


def test_published_vehicles_are_within_the_ranges() -> None:
    for path in DEFAULT_CONFIG.parent.glob("sim*.toml"):
        configured([f"{key}={value}" for key, value in nominal(load_plant(path)).items()])


def test_a_candidate_that_the_companion_refuses_is_lost() -> None:
    row = selected(["law"], load_config())[0]
    refused = dict(row.knobs) | {"heave.kappa_per_s": 1e6}
    assert tune.scores(row, [refused], configured, BASE, tune.training(1, around)) == [tune.LOST_MM]


def test_the_search_ends_with_the_command_that_dives_its_result(tmp_path):
    file = tmp_path / "companion.toml"
    write_config(DEFAULT_FILE, vehicle_of(load_config()), {"heave.kappa_per_s": 9.0}, file)
    command = next_step(file, ["default"], "").splitlines()[-1].split()
    assert command[:2] == ["holdfast", "run"]
    assert load_config(Path(command[command.index("--config") + 1])).heave.kappa_per_s == 9.0
    assert "holdfast lab bench dives --rows ppi law" in next_step(file, ["ppi", "law"], "dives")


def test_scenarios_have_the_names_of_the_documents():
    text = (Path(__file__).parents[2] / "docs" / "results.md").read_text(encoding="utf-8")
    assert [name for name in SCENARIOS if f"\n|{name}|" in text] == [one.name for one in four(1)]


@pytest.mark.parametrize("there", ["mine.toml", "mine-vehicle.toml"])
def test_a_search_writes_over_no_file_that_is_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], there: str
) -> None:
    (tmp_path / there).write_text("mine", encoding="utf-8")
    assert main(["lab", "tune", "--out", str(tmp_path / "mine.toml")]) == 2
    assert f"{tmp_path / there} is there already" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == [there]
