"""A compass that is mounted wrongly: the place is released, before the vehicle is far away."""

import numpy as np
import pytest

from companion.config import load_config
from companion.engine import Engine
from companion.records import Condition, Request, Setpoint, State, Z
from lab.loop.firmware import Firmware
from lab.loop.lockstep import LinkDelay, Lockstep
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import load_config as load_plant

DEPTH_M = 3.0


@pytest.mark.parametrize(("orientation", "releases"), [(0, False), (4, True)])
def test_a_place_is_released_where_the_compass_points_backwards(ardusub, orientation, releases):
    plant = load_plant(
        DEFAULT_CONFIG,
        (
            "initial.eta=[0,0,3,0,0,0]",
            "current.enabled=false",
            "sensors.dvl=true",
            "parameters.COMPASS_USE2=0",
            "parameters.COMPASS_USE3=0",
            f"parameters.SIM_MAG1_ORIENT={orientation}",
        ),
    )
    config = load_config()
    with Firmware(ardusub, plant, 1) as vehicle:
        engine = Engine(config, Setpoint((0.0, 0.0, DEPTH_M, np.nan)), arm=True)
        loop = Lockstep(vehicle, engine, LinkDelay(), 1, config.loop.rate_hz)
        loop.requests = [Request.ENGAGE]
        steps = list(loop.run(30.0))
    reported = [bool(step.sample.verdict.warnings & Condition.HEADING_WRONG) for step in steps]
    assert any(reported) is releases
    assert any(any(step.sample.requested[:2]) for step in steps[-250:]) is not releases
    assert steps[-1].sample.verdict.state is State.ACTIVE
    assert steps[-1].truth.eta[Z] == pytest.approx(DEPTH_M, abs=0.05)
    assert np.abs([step.truth.eta[:2] for step in steps]).max() < (6.0 if releases else 0.1)
