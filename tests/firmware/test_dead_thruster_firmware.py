"""A thruster dies, and the firmware's own mixer drives the seven others."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from companion.config import load_config
from companion.engine import Engine
from companion.records import Request, Setpoint, State, Z
from lab.loop.dive import engaging, recorded
from lab.loop.firmware import Firmware
from lab.loop.lockstep import LinkDelay, Lockstep
from lab.loop.scenarios import DEPTH_M, ensemble, water
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import load_config as load_plant
from sim_bridge.fault_kinds import Fault

DIES_S = 20.0


@pytest.mark.parametrize("motor", [1, 5, 8])
def test_depth_and_heading_are_held_without_it(ardusub, motor):
    draw = np.random.default_rng((3, 8)).uniform
    dies = Fault(kind="thruster", at_s=DIES_S, thruster=motor, value=0.0)
    plant = water(
        replace(ensemble(load_plant(DEFAULT_CONFIG), 3), faults=(dies,)),
        depth_m=DEPTH_M,
        waves_m=draw(0.2, 0.4),
        period_s=draw(3.5, 5.0),
        current_m_s=draw(0.1, 0.5),
        current_deg=draw(0.0, 360.0),
    )
    here = Setpoint((math.nan, math.nan, DEPTH_M, 0.0))
    with engaging(load_config(), plant, here, 3, firmware=ardusub) as loop:
        steps = list(loop.run(80.0))
    found = next((step.sample.state.dead_motor for step in steps if step.sample.state.dead_motor), 0)
    since = recorded(steps).within(DIES_S, math.inf)
    assert since.active[-1]
    assert found == (motor if motor > 4 else 0), "horizontal ones have nothing to do"
    assert since.figures(DIES_S + 10.0)["depth_rms_mm"] < 30.0
    assert since.figures()["depth_peak_mm"] < 100.0
    assert np.degrees(np.abs(np.unwrap(since.truth[:, 3]))).max() < 5.0
    assert since.figures()["tilt_deg"] < 30.0


def test_a_vehicle_that_stays_tilted_is_kept_while_its_depth_is_held(ardusub):
    """Handed over, it sank by 3 m in 35 s in ALT_HOLD."""
    load = ("load.enabled=true", "load.on_s=5", "load.off_s=1e4", "load.weight_n=8")
    config = load_config(overrides=("supervisor.max_tilt_deg=25",))
    with Firmware(ardusub, load_plant(DEFAULT_CONFIG, ("initial.eta=[0,0,5,0,0,0]", *load)), 1) as vehicle:
        for motor in (5, 7):
            vehicle.inject(Fault(kind="thruster", at_s=8.0, thruster=motor, value=0.0))
        engine = Engine(config, Setpoint((math.nan, math.nan, 5.0, math.nan)), arm=True)
        loop = Lockstep(vehicle, engine, LinkDelay(), 1)
        loop.requests = [Request.ENGAGE]
        steps = [step for step in loop.run(40.0) if step.t_s > 8.0]
    assert {step.sample.verdict.state for step in steps} == {State.ACTIVE}
    assert max(math.degrees(abs(step.truth.eta[3])) for step in steps) > 25.0
    assert max(abs(step.truth.eta[Z] - 5.0) for step in steps) < 0.1
