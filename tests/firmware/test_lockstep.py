"""The loop itself: the real ArduSub and the engine in one virtual time."""

from pathlib import Path

import numpy as np

from companion.config import load_config
from companion.engine import Engine
from companion.records import Request, Setpoint, State
from lab.loop.firmware import Firmware
from lab.loop.lockstep import LinkDelay, Lockstep
from lab.studies.faults import dive_group
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import load_config as load_plant

DEPTH_M = 2.5


def dived(ardusub, seconds, *overrides):
    """Engage at once; return every step."""
    plant = load_plant(
        DEFAULT_CONFIG, ("current.enabled=false", f"initial.eta=[0,0,{DEPTH_M},0,0,0]", *overrides)
    )
    config = load_config()
    with Firmware(ardusub, plant, 1) as vehicle:
        pid = vehicle.pid
        setpoint = Setpoint((np.nan, np.nan, DEPTH_M, 0.0))
        loop = Lockstep(vehicle, Engine(config, setpoint, arm=True), LinkDelay(), 1, config.loop.rate_hz)
        loop.requests = [Request.ENGAGE]
        steps = list(loop.run(seconds))
    assert not Path(f"/proc/{pid}").exists()
    return steps


def test_it_engages_and_holds_its_depth(ardusub):
    steps = dived(ardusub, 30.0)
    assert steps[-1].sample.verdict.state is State.ACTIVE
    assert steps[-1].truth.armed
    error_m = np.array([step.truth.eta[2] - DEPTH_M for step in steps if step.t_s > 12.0])
    assert error_m.std() < 0.010
    assert abs(error_m.mean()) < 0.030, "the EKF takes its own zero on arming"


def test_the_same_seed_repeats_the_dive_bit_by_bit(ardusub):
    once, again = (dived(ardusub, 8.0, "waves.enabled=true") for _ in range(2))
    assert [step.truth.eta.tolist() for step in once] == [step.truth.eta.tolist() for step in again]


def test_a_reboot_in_mid_dive_is_survived(ardusub):
    steps = dived(ardusub, 14.0, 'faults=[{kind="reboot", at_s=5}]')
    assert steps[249].sample.verdict.state is State.ACTIVE
    after = [step for step in steps if step.t_s > 6.5]  # 4.5 is silent, which is ridden out for a second
    assert State.ACTIVE not in {step.sample.verdict.state for step in after}
    assert not after[-1].truth.armed
    depths = np.array([step.truth.eta[2] for step in steps])
    assert np.abs(np.diff(depths)).max() < 0.02, "the body stays where it was"


def test_a_dvl_gives_it_a_place_which_it_holds_in_a_current(ardusub):
    steps = dived(ardusub, 30.0, "sensors.dvl=true", "current.enabled=true", "current.speed_m_s=0.2")
    assert steps[-1].sample.verdict.state is State.ACTIVE
    place = np.array([step.truth.eta[:2] for step in steps if step.t_s > 12.0])
    assert place.std(axis=0).max() < 0.02


def test_a_dozen_dives_in_which_something_breaks_keep_every_promise(ardusub):
    rows = dive_group(range(12), ardusub)
    assert [row["broken"] for row in rows if row["broken"]] == []
