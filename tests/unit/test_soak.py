"""The soaks' own sums, and that they would notice."""

import math
import os
from pathlib import Path

import msgspec
import pytest
from rich.console import Console

from companion.telemetry import schemas as telemetry
from lab.bench.soak import Soak
from lab.bench.usage import cpu_s, memory_kb, slope
from lab.faults import soak
from lab.faults.faults import FAULTS, FaultSpec
from lab.faults.soak import Hour, soak_hour


def test_the_slope_of_a_line_is_found_and_how_sure_it_is() -> None:
    exact = slope([0.0, 1.0, 2.0, 3.0], [5.0, 7.0, 9.0, 11.0])
    assert exact.slope == pytest.approx(2.0)
    assert exact.error == pytest.approx(0.0, abs=1e-9)
    assert slope([0.0, 1.0, 2.0, 3.0], [0.0, 1.0, 0.0, 1.0]).error > 0.1
    assert math.isnan(slope([0.0, 1.0], [0.0, 1.0]).slope)


def test_what_a_process_allocates_is_seen() -> None:
    before, begun_s = memory_kb(os.getpid()), cpu_s(os.getpid())
    kept = os.urandom(40_000_000)
    assert memory_kb(os.getpid()).own - before.own == pytest.approx(39_000.0, abs=8_000.0)
    assert cpu_s(os.getpid()) >= begun_s
    del kept


def test_leaving_active_is_counted_by_its_reason() -> None:
    found = Soak()
    for state, reason in (("READY", ""), ("ACTIVE", "engaged"), ("PILOT", "a stick"), ("ACTIVE", "engaged")):
        record = telemetry.Supervisor(
            t_s=1.0, boot_s=1.0, state=state, conditions=(), authority=0.0, reason=reason
        )
        found.take("holdfast/soak/supervisor", msgspec.json.encode(record))
    assert found.let_go == {"a stick": 1}


def one_fault(monkeypatch: pytest.MonkeyPatch, spec: FaultSpec) -> Hour:
    monkeypatch.setattr(soak, "FAULTS", {"it": spec})
    monkeypatch.setitem(FAULTS, "it", spec)
    monkeypatch.setattr(soak, "QUIET_S", (0.1, 0.2))
    monkeypatch.setattr(soak, "LASTS_S", (4.0, 4.1))
    return soak_hour(0, 1.0)


def test_an_hour_recovers_from_its_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    hour = one_fault(monkeypatch, FAULTS["mode changed"])
    assert hour.faults == {"it": 1}
    assert hour.let_go == {"the flight mode was changed": 1}
    assert (hour.broken, hour.stuck) == ([], [])


def test_an_hour_tells_what_raised_and_what_pushed_too_long(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise ZeroDivisionError("somewhere")

    assert (
        "ZeroDivisionError: somewhere" in one_fault(monkeypatch, FaultSpec(fails, lambda _: None)).broken[0]
    )
    nothing = FaultSpec(lambda *_: None, lambda _: 1.0)
    assert "it: still pushing" in one_fault(monkeypatch, nothing).broken[0]


def test_the_same_command_continues(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "soak.jsonl"
    rows = [Hour(0, "heavy", simulated_s=9.0), Hour(1, "heavy", simulated_s=9.0, broken=["it: broke"])]
    file.write_bytes(b"".join(msgspec.json.encode(row) + b"\n" for row in rows) + b'{"number": 2, "veh')
    monkeypatch.setattr(soak, "soak_hour", None)  # nothing is missing
    console = Console(record=True, width=120)
    assert soak.main(console, 2, 1, file) == 1
    assert "hour 1: BROKEN: it: broke" in console.export_text()
    assert soak.main(console, 1, 1, file) == 0
    assert file.read_bytes().count(b"\n") == 2
