"""The real ArduSub with a DVL whose BlueOS extension is behind Holdfast's relay."""

import numpy as np
from extension import DvlExtension
from virtual import Dive, Somebody, hold

from companion.records import State
from lab.loop.firmware import Firmware

BY_MAVLINK = (
    "parameters.VISO_TYPE=1",
    "parameters.EK3_SRC1_POSXY=6",
    "parameters.EK3_SRC1_VELXY=6",
    "initial.eta=[0,0,2,0,0,0.5]",
    "current.enabled=true",
    "current.speed_m_s=0.1",
)


def test_its_messages_give_the_firmware_a_position_which_is_held(ardusub):
    setpoint = hold(z=2.0, psi=0.5)
    dive, extension = Dive(*BY_MAVLINK, setpoint=setpoint, pilot=True, firmware=ardusub), DvlExtension()
    assert isinstance(dive.vehicle, Firmware)
    with dive.vehicle:
        dive.tap.to_vehicle.append(Somebody().origin())
        dive.until(State.ACTIVE, 12.0)
        dive.engine.aim(hold(x=0.0, y=0.0, z=2.0, psi=0.5))
        steps = []
        for _ in range(round(22.0 / 0.02)):
            dive.cockpit.extra += extension.says(dive.vehicle.truth(), dive.vehicle.time_s)
            steps += dive.run(0.02)
    assert all(frame in dive.cockpit.passed for frame in extension.sent)
    held = steps[-250:]
    assert held[-1].sample.dofs.engaged[:2] == (True, True)
    believed, true = (
        np.array([one(step) for step in held])
        for one in (lambda step: step.sample.state.eta[:2], lambda step: step.truth.eta[:2])
    )
    assert np.abs(believed).max() < 0.15
    assert np.ptp(true - believed, axis=0).max() < 0.05, "the position moves as the vehicle does"
