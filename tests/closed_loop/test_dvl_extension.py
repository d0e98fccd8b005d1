"""A DVL whose BlueOS extension is behind Holdfast's relay: VISION_POSITION_DELTA is the position source."""

import numpy as np
from extension import DvlExtension
from virtual import Dive, Somebody, hold

from companion.records import State

BY_MAVLINK = (
    "sensors.dvl_by_mavlink=true",
    "initial.eta=[0,0,2,0,0,0.5]",
    "current.enabled=true",
    "current.speed_m_s=0.1",
)


def sailing(dive, extension, seconds, speaks=True):
    steps = []
    for _ in range(round(seconds / 0.02)):
        if speaks:
            dive.cockpit.extra += extension.says(dive.vehicle.truth(), dive.vehicle.time_s)
        steps += dive.run(0.02)
    return steps


def test_its_messages_reach_the_vehicle_unchanged_and_give_the_ekf_a_position():
    dive, extension = Dive(*BY_MAVLINK, setpoint=hold(z=2.0, psi=0.5), pilot=True), DvlExtension()
    dive.tap.to_vehicle.append(Somebody().origin())
    dive.until(State.ACTIVE)
    blind = sailing(dive, extension, 1.0, speaks=False)
    assert not blind[-1].sample.state.ages.position_s < 10.0
    dive.engine.aim(hold(x=0.0, y=0.0, z=2.0, psi=0.5))
    sailing(dive, extension, 6.0)
    assert dive.step.sample.dofs.engaged[:2] == (True, True)
    steps = sailing(dive, extension, 2.0)
    assert all(frame in dive.cockpit.passed for frame in extension.sent), "every byte, while it steers"
    believed = np.array([step.sample.state.eta[:2] for step in steps])
    assert np.abs(believed).max() < 0.1
    offset = np.array([step.truth.eta[:2] for step in steps]) - believed
    assert np.ptp(offset, axis=0).max() < 0.03, "the position moves as the vehicle does"


def test_an_ekf_that_is_not_set_up_for_them_ignores_them():
    dive = Dive(*BY_MAVLINK, "parameters.VISO_TYPE=0", setpoint=hold(z=2.0, psi=0.5), pilot=True)
    dive.until(State.ACTIVE)
    steps = sailing(dive, DvlExtension(), 2.0)
    assert not steps[-1].sample.state.ages.position_s < 10.0
