"""A ground station's telemetry log: cut into its records, and through engine and relay."""

import math
import struct
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from tools.telemetry_log import MAX_GAP_S, TlogError, TlogRecord, read
from virtual import ROOT, Somebody

from companion.config import load_config
from companion.engine import Engine
from companion.mavlink.relay import Relay
from companion.predive.check import CheckRow
from companion.records import ControlSample, LoopHealth, Setpoint, Z
from sim_bridge.config import load_config as load_plant
from sim_bridge.vehicle import Vehicle

REAL = ROOT.parent / "shared" / "data"
UTC_US = 1_700_000_000_000_000
START_S, RATE_HZ = 1000.0, 20
SETTINGS = (
    f"loop.rate_hz={RATE_HZ}",
    "vehicle.thrust_path=manual_control",
    "ground_station.endpoint=udp-listen:127.0.0.1:14551",
)


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


def test_junk_between_records_and_a_cut_end_cost_only_themselves(log: Path, tmp_path: Path) -> None:
    whole = log.read_bytes()
    records = list(read(log))
    cut = sum(len(record.data) + 8 for record in records[:2000])
    spoiled = tmp_path / "spoiled.tlog"
    spoiled.write_bytes(whole[:cut] + b"\xfd\xfe\x00 junk \xfd" + whole[cut:-5])
    again = list(read(spoiled))
    assert len(again) >= len(records) - 1


def test_a_jump_of_utc_is_shortened_and_a_step_back_is_none(tmp_path: Path) -> None:
    frame = Somebody(1, 1).frame(mavlink.MAVLink_heartbeat_message(12, 3, 81, 19, 3, 3))
    path = tmp_path / "jump.tlog"
    path.write_bytes(b"".join(stamped(t_s, frame) for t_s in (0.0, 1.0, 9e8, 9e8 + 1.0, 5.0, 6.0)))
    assert [record.t_s for record in read(path)] == pytest.approx(
        [0.0, 1.0, 1.0 + MAX_GAP_S, 2.0 + MAX_GAP_S, 2.0 + MAX_GAP_S, 3.0 + MAX_GAP_S]
    )


@pytest.mark.parametrize("content", [b"", b"no log at all", bytes(4096), b"\xfd" * 4096])
def test_what_is_no_log_is_refused(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "no.tlog"
    path.write_bytes(content)
    with pytest.raises(TlogError):
        list(read(path))


def heard(records: Iterator[TlogRecord]) -> tuple[list[ControlSample], list[CheckRow]]:
    """Step engine and relay through a log; return every tick's sample, and the last pre-dive list."""
    config = load_config(overrides=SETTINGS)
    engine, relay = Engine(config, Setpoint((np.nan,) * 4)), Relay(config)
    ticks = defaultdict(list)
    for record in records:
        ticks[math.ceil(RATE_HZ * record.t_s)].append(record)
    samples, checked = [], []
    for tick in range(max(ticks) + 1):
        frames = []
        for record in ticks[tick]:
            t_ns = round((START_S + record.t_s) * 1e9)
            if record.system == config.link.system:
                assert b"".join(relay.to_vehicle(t_ns, record.data)) == record.data
            else:
                assert b"".join(relay.to_ground(t_ns, record.data)) == record.data
                frames.append((t_ns, record.data))
        health = LoopHealth(tick + 1, RATE_HZ, 0.0, 0.0, 0, 0)
        _, sample = engine.step(START_S + tick / RATE_HZ, frames, health, (), relay.take())
        samples.append(sample)
        if tick % RATE_HZ == 0 and sample.state.ages.link_s < 1.0:
            checked = engine.checked(sample.state)
    return samples, checked


@pytest.mark.skipif(not REAL.is_dir(), reason="the telemetry of real vehicles is not in this repository")
@pytest.mark.parametrize(
    ("name", "frame", "rows"),
    [
        ("bluerov2-4.1.0-bench", "GOOD", {"pilot failsafe": "GOOD", "firmware": "WARNING"}),
        ("bluerov2-4.1.1-pool", "REFUSED", {"steering id": "REFUSED", "EKF origin": "GOOD"}),
    ],
)
def test_a_real_vehicle_goes_through_engine_and_relay(name: str, frame: str, rows: dict[str, str]) -> None:
    samples, checked = heard(read(REAL / f"{name}.tlog"))
    grades = {row.name: row.grade.name for row in checked}
    assert grades["frame"] == frame
    assert rows.items() <= grades.items()
    assert len(samples) > 200 * RATE_HZ
    assert max(abs(sample.state.eta[Z]) for sample in samples if sample.state.ages.depth_s < 1.0) < 2.0
    conditions = [{one.name for one in sample.verdict.conditions} for sample in samples]
    assert not any("NON_FINITE" in held for held in conditions)
    assert sum("DISARMED" in held for held in conditions) > 200 * RATE_HZ
    assert not {"ACTIVE", "FAULT"} & {sample.verdict.state.name for sample in samples}
