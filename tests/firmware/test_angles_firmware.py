"""The real ArduSub in MANUAL: roll and pitch at an angle, in waves and a current."""

import numpy as np
import pytest

from companion.config import load_config
from companion.engine import Engine
from companion.records import Request, Setpoint, State
from companion.telemetry.commands import Goto
from lab.loop.firmware import Firmware
from lab.loop.lockstep import LinkDelay, Lockstep
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import load_config as load_plant

DEPTH_M = 2.5
ROUGH = ("sensors.dvl=true", "current.enabled=true", "current.speed_m_s=0.2", "waves.enabled=true")
LEVEL_S, TURNED_S, HELD_S = 30.0, 36.0, 66.0


@pytest.mark.parametrize("asked", [(0.0, 30.0), (-30.0, 0.0), (0.0, -55.0)], ids=str)
def test_depth_and_place_are_held_at_an_angle(ardusub, asked):
    plant = load_plant(DEFAULT_CONFIG, (f"initial.eta=[0,0,{DEPTH_M},0,0,0]", *ROUGH))
    config = load_config()
    roll, pitch = asked
    with Firmware(ardusub, plant, 1) as vehicle:
        setpoint = Setpoint((np.nan, np.nan, DEPTH_M, 0.0))
        engine = Engine(config, setpoint, arm=True)
        loop = Lockstep(vehicle, engine, LinkDelay(), 1, config.loop.rate_hz)
        loop.requests = [Request.ENGAGE]
        steps = list(loop.run(LEVEL_S))
        engine.guide(Goto(roll_deg=roll, pitch_deg=pitch))
        steps += loop.run(HELD_S)
    assert steps[-1].sample.verdict.state is State.ACTIVE
    eta = np.array([step.truth.eta for step in steps])
    t_s = np.array([step.t_s for step in steps])
    level, held = (t_s > 15.0) & (t_s < LEVEL_S), t_s > TURNED_S
    np.testing.assert_allclose(np.degrees(eta[held, 3:5]).mean(axis=0), asked, atol=1.5)
    before_mm, after_mm = (1e3 * eta[during, 2].std() for during in (level, held))
    assert after_mm < 1.6 * before_mm + 2.0
    assert np.hypot(*(eta[held, :2] - eta[level, :2].mean(axis=0)).T).max() < 0.25
