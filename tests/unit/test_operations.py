"""The measurements of the process as a study: exit status, files, and what the plain `bench` adds."""

import json
from pathlib import Path

import pytest
from rich.console import Console

import holdfast
from lab import commands
from lab.demo.crew import ChildError
from lab.operations import operations
from lab.operations.bounds import Bound
from lab.operations.soak import Minute, Soak, summary
from lab.usage import Memory


def measured(monkeypatch: pytest.MonkeyPatch, *bounds: Bound) -> None:
    monkeypatch.setattr(operations, "virtual", lambda *_: [Bound("speed", 30.0, "x", at_least=20.0)])
    monkeypatch.setattr(operations, "process", lambda: list(bounds))
    monkeypatch.setattr(operations, "latency", list)


def test_a_bound_that_is_not_held_is_reported_and_ends_with_1(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["process", "--out", str(tmp_path), "--json", str(tmp_path / "figures.json")]
    measured(monkeypatch, Bound("memory", 70.0, "MB", 80.0))
    assert commands.bench(command) == 0
    measured(monkeypatch, Bound("memory", 90.0, "MB", 80.0))
    assert commands.bench(command) == 1
    assert "NO" in capsys.readouterr().out
    found = json.loads((tmp_path / "figures.json").read_text(encoding="utf-8"))
    assert found["provenance"]["command"].startswith("holdfast bench process")
    assert [(one["name"], one["held"]) for one in found["bounds"]] == [("speed", True), ("memory", False)]
    assert found["measurements"][1]["memory"] == 90.0


def test_after_dives_the_figures_stand_beside_theirs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    measured(monkeypatch, Bound("memory", 70.0, "MB", 80.0))
    path = tmp_path / "figures.json"
    path.write_text('{"dives": [1], "provenance": {"command": "holdfast bench"}}', encoding="utf-8")
    options = ["--seeds", "4", "--rows", "default", "ppi", "--out", str(tmp_path), "--json", str(path)]
    assert operations.after_dives(options) == 0
    found = json.loads(path.read_text(encoding="utf-8"))
    assert (found["dives"], len(found["bounds"])) == ([1], 2)


def test_what_cannot_be_measured_is_said(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def dies(vehicles: int) -> list[Bound]:
        raise ChildError(f"router of {vehicles} died")

    monkeypatch.setattr(operations, "measure", dies)
    assert commands.bench(["fleet", "--vehicles", "3", "--out", str(tmp_path)]) == 1
    assert "no figures: router of 3 died" in capsys.readouterr().out
    assert holdfast.main(["bench", "fleet", "--scheduler", "tcp://127.0.0.1:1"]) == 2


def test_the_soak_names_each_process_in_80_columns() -> None:
    names = ("run", "sim", "dashboard", "record")
    minute = Minute(60.0, dict.fromkeys(names, Memory(4e4, 4e4)), (0.1, 0.2, 0.3), 0.1, 1.0)
    console = Console(record=True, width=80)
    console.print(summary(Soak(minutes=[minute._replace(at_s=60.0 * n) for n in range(1, 5)]), 4))
    text = console.export_text()
    assert all(f" {name} " in text for name in names)
