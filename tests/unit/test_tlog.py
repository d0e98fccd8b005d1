"""A ground station's telemetry log through engine and relay: no exception, whatever it holds."""

import struct
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from virtual import ROOT, Somebody

import holdfast
from lab.logs.telemetry_log import MAX_GAP_S, TlogError, read
from lab.rerun.command import main
from lab.rerun.ground_log import lines, think
from sim_bridge.config import load_config as load_plant
from sim_bridge.vehicle import Vehicle

REAL = ROOT.parent / "shared" / "data"
UTC_US = 1_700_000_000_000_000
QUICK = ("loop.rate_hz=20",)


def stamped(t_s: float, data: bytes) -> bytes:
    return struct.pack(">Q", UTC_US + round(t_s * 1e6)) + data


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve seconds of the simulator at the surface; its ground station has asked for all parameters."""
    vehicle = Vehicle(load_plant(ROOT / "config" / "sim.toml", []), 1)
    vehicle.open_link(1)
    station = Somebody()
    rows = []
    for step in range(round(12.0 / vehicle.step_s)):
        asked = []
        if step % 200 == 0:
            asked.append(station.frame(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)))
        if step == 0:
            asked.append(station.frame(mavlink.MAVLink_param_request_list_message(1, 1)))
        rows += [stamped(vehicle.time_s, data) for data in asked]
        rows += [stamped(vehicle.time_s, data) for _, data in vehicle.step([(1, data) for data in asked])]
    path = tmp_path_factory.mktemp("logs") / "pool.tlog"
    path.write_bytes(b"".join(rows))
    return path


def test_a_log_is_cut_into_its_records_and_no_byte_is_lost(log: Path) -> None:
    records = list(read(log))
    assert sum(len(record.data) + 8 for record in records) == log.stat().st_size
    assert {record.system for record in records} == {1, 255}
    assert records[-1].t_s == pytest.approx(12.0, abs=0.1)


def test_it_tells_what_holdfast_would_have_waited_for(log: Path) -> None:
    thoughts = think(read(log))
    assert "DISARMED" in thoughts.held_s
    assert not any("ACTIVE" in span.state for span in thoughts.spans)
    assert np.isfinite(thoughts.depth_m[-50:]).all()
    assert {row.name: row.grade.name for row in thoughts.checked}["frame"] == "GOOD"
    assert any("IDLE: waiting for: arming" in line for line in lines(thoughts))


def test_the_relay_passes_every_byte_of_the_log(log: Path) -> None:
    up = sum(len(record.data) for record in read(log) if record.system != 255)
    down = sum(len(record.data) for record in read(log) if record.system == 255)
    assert think(read(log), QUICK).relayed == (up, down)


def test_junk_between_records_and_a_cut_end_cost_only_themselves(log: Path, tmp_path: Path) -> None:
    whole = log.read_bytes()
    records = list(read(log))
    cut = sum(len(record.data) + 8 for record in records[:2000])
    spoiled = tmp_path / "spoiled.tlog"
    spoiled.write_bytes(whole[:cut] + b"\xfd\xfe\x00 junk \xfd" + whole[cut:-5])
    again = list(read(spoiled))
    assert len(again) >= len(records) - 1
    assert "DISARMED" in think(iter(again), QUICK).held_s


def test_a_jump_of_utc_is_shortened_and_a_step_back_is_none(tmp_path: Path) -> None:
    frame = Somebody(1, 1).frame(mavlink.MAVLink_heartbeat_message(12, 3, 81, 19, 3, 3))
    path = tmp_path / "jump.tlog"
    path.write_bytes(b"".join(stamped(t_s, frame) for t_s in (0.0, 1.0, 9e8, 9e8 + 1.0, 5.0, 6.0)))
    assert [record.t_s for record in read(path)] == pytest.approx(
        [0.0, 1.0, 1.0 + MAX_GAP_S, 2.0 + MAX_GAP_S, 2.0 + MAX_GAP_S, 3.0 + MAX_GAP_S]
    )


@pytest.mark.parametrize("content", [b"", b"no log at all", bytes(4096), b"\xfd" * 4096])
def test_what_is_no_log_is_refused_in_one_line(
    content: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "no.tlog"
    path.write_bytes(content)
    with pytest.raises(TlogError):
        list(read(path))
    assert holdfast.main(["rerun", str(path), "--out", str(tmp_path / "no.png")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "telemetry log" in said


def test_the_command_draws_its_picture(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(log), "--out", str(tmp_path / "seen" / "log.png"), "--set", QUICK[0]]) == 0
    assert (tmp_path / "seen" / "log.png").stat().st_size > 10_000
    assert "pool.tlog" in capsys.readouterr().out


@pytest.mark.skipif(not REAL.is_dir(), reason="the telemetry of real vehicles is not in this repository")
@pytest.mark.parametrize(
    ("name", "frame", "rows"),
    [
        ("bluerov2-4.1.0-bench", "GOOD", {"pilot failsafe": "GOOD", "firmware": "WARNING"}),
        ("bluerov2-4.1.1-pool", "REFUSED", {"steering id": "REFUSED", "EKF origin": "GOOD"}),
    ],
)
def test_a_real_vehicle_goes_through_engine_and_relay(name: str, frame: str, rows: dict[str, str]) -> None:
    thoughts = think(read(REAL / f"{name}.tlog"), QUICK)
    grades = {row.name: row.grade.name for row in thoughts.checked}
    assert grades["frame"] == frame
    assert rows.items() <= grades.items()
    assert thoughts.t_s[-1] > 200.0
    assert np.nanmax(np.abs(thoughts.depth_m)) < 2.0
    assert thoughts.held_s["DISARMED"] > 200.0
    assert thoughts.held_s.get("NON_FINITE", 0.0) == 0.0
    assert not any(span.state in ("ACTIVE", "FAULT") for span in thoughts.spans)
