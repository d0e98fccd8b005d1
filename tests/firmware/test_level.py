"""Roll and pitch through the firmware's own mixer: a wrong sign would turn it over within a second."""

import numpy as np

from companion.config import load_config
from companion.engine import Engine
from companion.records import Request, Setpoint, State
from lab.loop.firmware import Firmware
from lab.loop.lockstep import LinkDelay, Lockstep
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import load_config as load_plant

GOAL = (0.0, 0.0, 3.0, 0.3)
SEA = ("sensors.dvl=true", "waves.enabled=true", "current.enabled=true", "current.speed_m_s=0.4")


def test_a_place_is_held_level_in_a_current_and_waves(ardusub):
    plant = load_plant(DEFAULT_CONFIG, ("initial.eta=[0,0,3,0,0,0]", *SEA))
    config = load_config()
    with Firmware(ardusub, plant, 1) as vehicle:
        loop = Lockstep(vehicle, Engine(config, Setpoint(GOAL), arm=True), LinkDelay(), 1)
        loop.requests = [Request.ENGAGE]
        next(step for step in loop.run(6.0) if step.sample.verdict.state is State.ACTIVE)
        steps = list(loop.run(40.0))[round(9.0 * config.loop.rate_hz) :]
    assert {step.sample.verdict.state for step in steps} == {State.ACTIVE}
    eta = np.array([step.truth.eta for step in steps])
    assert np.degrees(np.abs(eta[:, 3:5]).max()) < 12.0
    assert np.hypot(*eta[:, :2].T).max() < 0.3
    assert eta[:, 2].std() < 0.010
