"""Home and origin that are set in mid-dive: relative_alt of 4.5 is the barometer before, the EKF after."""

from typing import cast

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from virtual import Somebody, Tap, hold

from companion.config import load_config
from companion.engine import Engine
from companion.records import Request, State
from lab.loop.firmware import Firmware
from lab.loop.lockstep import LinkDelay, Lockstep, Step
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import load_config as load_plant

DEPTH_M = 3.0
PLACE_DEG_E7 = (338103130, -1183938670)


def home(altitude_m):
    place = (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_CMD_DO_SET_HOME, *[0] * 6, *PLACE_DEG_E7, altitude_m)
    return Somebody().frame(mavlink.MAVLink_command_int_message(1, 1, *place))


def origin():
    return Somebody().frame(mavlink.MAVLink_set_gps_global_origin_message(1, *PLACE_DEG_E7, 0))


@pytest.mark.parametrize(("after_s", "noise_m"), [(4.0, 0.02), (10.0, 0.02), (4.0, 0.2)])
def test_an_origin_and_homes_that_are_set_in_mid_dive_move_nothing(ardusub, after_s, noise_m):
    """`noise_m` is the barometer's; 4.5's simulator has the larger one."""
    sea = (
        "current.enabled=false",
        f"initial.eta=[0,0,{DEPTH_M},0,0,0]",
        f"parameters.SIM_BARO_RND={noise_m}",
    )
    config = load_config()
    steps, offsets_m = list[Step](), list[float]()
    with Firmware(ardusub, load_plant(DEFAULT_CONFIG, sea), 1, surveyed=False) as vehicle:
        tap = Tap(Engine(config, hold(z=DEPTH_M), arm=True), config)
        loop = Lockstep(vehicle, cast(Engine, tap), LinkDelay(), 1, config.loop.rate_hz)
        loop.requests = [Request.ENGAGE]
        before = list(loop.run(2.0 + after_s))
        for said in (origin(), home(0), home(-0.4), home(8), home(7.8)):
            tap.to_vehicle.append(said)
            steps += loop.run(6.0)
            offsets_m.append(steps[-1].sample.state.depth_offset_m)
    assert before[-1].sample.verdict.state is State.ACTIVE
    assert {step.sample.verdict.state for step in steps} == {State.ACTIVE}
    depths = np.array([step.truth.eta[2] for step in steps])
    assert np.abs(depths - before[-1].truth.eta[2]).max() < 0.04 + noise_m
    assert np.abs(np.diff(offsets_m)[1:]) == pytest.approx([0.4, 8.4, 0.2], abs=0.05 + 0.2 * noise_m), (
        "4.7-dev counts the height of home the other way"
    )
