"""The soak's own sums, and that it would notice."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from builders import RECORDING
from msgspec.structs import replace
from tools import soak
from tools.soak import ChildError, Minute, SoakLog

from lab.study import start


def _minute(number: int) -> Minute:
    return Minute(60.0 * number, {"run": 50_000.0 + 40.0 * number})


@pytest.mark.parametrize(("lost", "dies", "status"), [(0, False, 0), (3, False, 1), (0, True, 1)])
def test_a_lost_record_or_a_dead_process_ends_with_1(
    lost: int, dies: bool, status: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def soaked(minutes: int, logs: Path, heard: SoakLog) -> Iterator[None]:
        assert minutes == 1
        heard.recorder, heard.lateness_ms = replace(RECORDING, lost=lost), [1.0]
        heard.minutes.append(_minute(1))
        yield
        if dies:
            raise ChildError("`holdfast sim` ended with status 1")

    monkeypatch.setattr(soak, "soaked", soaked)
    assert start(soak.Soak, ["--minutes", "1", "--out", str(tmp_path)]) == status
    written = json.loads((tmp_path / "soak.json").read_text(encoding="utf-8"))["soak"][0]
    assert written["records_lost"] == lost
    assert written["lateness_max_ms"] == 1.0
    assert ("ended" in written["error"]) == dies
