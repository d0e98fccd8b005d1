"""The soak's own sums, and that it would notice."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from companion.telemetry import schemas as telemetry
from lab import commands
from lab.operations import soak
from lab.operations.soak import ChildError, Minute, SoakLog, figures


def _minute(number: int) -> Minute:
    return Minute(60.0 * number, {"run": 50_000.0 + 40.0 * number}, [0.1] * 99 + [float(number)])


def _recorder(lost: int) -> telemetry.Recorder:
    return telemetry.Recorder(
        t_s=1.0,
        boot_s=1.0,
        recording=True,
        file="",
        size_bytes=0,
        messages=9,
        dropped=0,
        free_bytes=0,
        said="",
        lost=lost,
    )


def test_memory_and_lateness_are_told_of_the_whole_soak() -> None:
    found = figures(SoakLog(recorder=_recorder(0)), [_minute(number) for number in range(1, 31)])
    assert found["run_memory_mb"] == 50.0
    assert found["run_slope_kb_h"] == pytest.approx(2_400.0)
    assert (found["lateness_p50_ms"], found["lateness_max_ms"]) == (0.1, 30.0)
    assert (found["records"], found["records_lost"]) == (9, 0)


@pytest.mark.parametrize(("lost", "dies", "status"), [(0, False, 0), (3, False, 1), (0, True, 1)])
def test_a_lost_record_or_a_dead_process_ends_with_1(
    lost: int, dies: bool, status: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def minutes(seconds: float, logs: Path, heard: SoakLog) -> Iterator[Minute]:
        assert seconds == 60.0
        heard.recorder = _recorder(lost)
        yield _minute(1)
        if dies:
            raise ChildError("`holdfast sim` ended with status 1")

    monkeypatch.setattr(soak, "_minutes", minutes)
    command = ["soak", "--minutes", "1", "--out", str(tmp_path)]
    assert commands.bench(command) == status
    written = json.loads((tmp_path / "soak.json").read_text(encoding="utf-8"))["soak"][0]
    assert written["records_lost"] == lost
    assert written["lateness_max_ms"] == 1.0
    assert ("ended" in written["error"]) == dies
