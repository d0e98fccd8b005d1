"""The soaks' own sums, and that they would notice."""

import math
import os
from pathlib import Path

import msgspec
import pytest

from companion.records import Condition
from companion.telemetry import schemas as telemetry
from lab import commands
from lab.operations.soak import Soak
from lab.studies import fault_hours
from lab.studies.breaking import FAULTS, FaultSpec
from lab.studies.fault_hours import Hour, soak_hour
from lab.usage import cpu_s, memory_kb, slope


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
    monkeypatch.setattr(fault_hours, "FAULTS", {"it": spec})
    monkeypatch.setitem(FAULTS, "it", spec)
    monkeypatch.setattr(fault_hours, "QUIET_S", (0.1, 0.2))
    monkeypatch.setattr(fault_hours, "LASTS_S", (4.0, 4.1))
    return soak_hour(0, 1.0)


def test_an_hour_recovers_from_its_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    hour = one_fault(monkeypatch, FAULTS["mode changed"])
    assert hour.faults == {"it": 1}
    assert hour.let_go == {Condition.WRONG_MODE.text: 1}
    assert (hour.broken, hour.stuck) == ([], [])


def test_an_hour_tells_what_raised_and_what_pushed_too_long(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise ZeroDivisionError("somewhere")

    assert (
        "ZeroDivisionError: somewhere" in one_fault(monkeypatch, FaultSpec(fails, lambda _: None)).broken[0]
    )
    nothing = FaultSpec(lambda *_: None, lambda _: 1.0)
    assert "it: still pushing" in one_fault(monkeypatch, nothing).broken[0]


def test_the_same_command_continues(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def dived(number: int) -> Hour:
        return Hour(number, "heavy", simulated_s=9.0, broken=["it: broke"] * number)

    monkeypatch.setattr(fault_hours, "soak_hour", dived)
    command = ["--out", str(tmp_path / "soak.jsonl"), "--workers", "1", "--hours"]
    assert commands.faults([*command, "2"]) == 1
    monkeypatch.setattr(fault_hours, "soak_hour", None)  # nothing is missing
    assert commands.faults([*command, "2"]) == 1
    assert "hour 1: BROKEN: it: broke" in capsys.readouterr().out
    assert commands.faults([*command, "1"]) == 0
