"""The EKF's own correction of a yaw that was wrong at boot: "in-flight yaw alignment complete", on diving."""

import numpy as np
import pytest

from companion.config import load_config
from companion.engine import Engine
from companion.records import Condition, Request, Setpoint, State
from lab.loop.firmware import Firmware
from lab.loop.lockstep import LinkDelay, Lockstep
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import load_config as load_plant
from sim_bridge.fault_kinds import Fault

DEPTH_M = 5.0
WRONG_COMPASS = (
    "initial.eta=[0,0,1,0,0,0]",
    "parameters.SIM_MAG1_OFS_Y=100",
    "parameters.COMPASS_USE2=0",
    "parameters.COMPASS_USE3=0",
)
"""A hundred milligauss turn the compass by 24°; they go before the vehicle has dived deep enough to align."""
HELD_S = 2.4
"""So long after engaging; 4.5 tells its parameters, and is engaged, two seconds later than 4.7."""


@pytest.mark.parametrize("sea", [("current.enabled=false",), ("current.enabled=true", "sensors.dvl=true")])
def test_a_yaw_that_is_aligned_while_diving_moves_nothing(ardusub, sea):
    plant, config = load_plant(DEFAULT_CONFIG, (*WRONG_COMPASS, *sea)), load_config()
    with Firmware(ardusub, plant, 1) as vehicle:
        engine = Engine(config, Setpoint((np.nan, np.nan, DEPTH_M, np.nan)), arm=True)
        loop = Lockstep(vehicle, engine, LinkDelay(), 1, config.loop.rate_hz)
        loop.requests = [Request.ENGAGE]
        next(step for step in loop.run(6.0) if step.sample.verdict.state is State.ACTIVE)
        vehicle.inject(Fault(kind="parameter", parameter="SIM_MAG1_OFS_Y", at_s=vehicle.time_s + HELD_S))
        held = list(loop.run(18.0))[round(HELD_S * config.loop.rate_hz) :]
    assert {step.sample.verdict.state for step in held} == {State.ACTIVE}
    texts = [text.text for step in held for text in step.sample.texts]
    assert any("in-flight yaw alignment complete" in text for text in texts)
    turned_deg = [np.degrees(s.sample.state.frame_shift.turn_rad) for s in held if s.sample.state.frame_shift]
    assert abs(sum(turned_deg)) > 15.0
    assert any(Condition.YAW_RESET in step.sample.verdict.warnings for step in held)
    assert np.degrees([abs(step.truth.eta[5]) for step in held]).max() < 2.0
    assert max(abs(step.sample.requested[3]) for step in held) < 0.3
    if len(sea) > 1:
        places = np.array([step.truth.eta[:2] for step in held])
        assert np.abs(places - places[0]).max() < 0.03
    assert held[-1].truth.eta[2] == pytest.approx(DEPTH_M, abs=0.05)
