"""Telemetry logs of real vehicles through engine and relay."""

import math
from collections import defaultdict
from collections.abc import Iterator

import numpy as np
import pytest
from tools.telemetry_log import TlogRecord, read
from virtual import ROOT

from companion.config import load_config
from companion.engine import Engine
from companion.mavlink.relay import Relay
from companion.predive.check import CheckRow
from companion.records import ControlSample, LoopHealth, Setpoint, Z

REAL = ROOT.parent / "shared" / "data"
START_S, RATE_HZ = 1000.0, 20
SETTINGS = (
    f"loop.rate_hz={RATE_HZ}",
    "vehicle.thrust_path=manual_control",
    "ground_station.endpoint=udp-listen:127.0.0.1:14551",
)


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
            checked = engine.check_list
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
