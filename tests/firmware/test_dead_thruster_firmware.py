"""A thruster dies, and the firmware's own mixer drives the seven others."""

import math

import pytest

from companion.config import load_config
from companion.engine import Engine
from companion.records import Request, Setpoint, State, Z
from lab.loop.firmware import Firmware
from lab.loop.lockstep import LinkDelay, Lockstep
from lab.studies.motors import DEAD, HEAVY, MotorFailure, dive
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import load_config as load_plant
from sim_bridge.fault_kinds import Fault


@pytest.mark.parametrize("motor", [1, 5, 8])
def test_depth_and_heading_are_held_without_it(ardusub, motor):
    row = dive(MotorFailure(HEAVY, motor, DEAD, 3), ardusub)
    assert row["ended"] == "held"
    assert row["found"] == (motor if motor > 4 else 0), "horizontal ones have nothing to do"
    assert row["rms_mm"] < 30.0
    assert row["peak_mm"] < 100.0
    assert row["heading_deg"] < 5.0
    assert row["tilt_deg"] < 30.0


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
