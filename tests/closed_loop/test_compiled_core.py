"""The live engine's core and the lab's, which is compiled, give the same numbers, to the last bit."""

from typing import NamedTuple

import numpy as np
import pytest
from virtual import Dive, Somebody, hold

from companion.arrays import Array
from companion.core import tick
from companion.core.allocation import ByAxis
from companion.core.observers import Inputs
from companion.core.permission import Permission, Wanted
from companion.core.tick import Known, Memory, Parameters, begin, confirm, control, observe, start
from companion.records import PSI, Axes, X, Z
from lab.batch.companion import as_arguments
from lab.batch.compiled import cached

pytestmark = [
    pytest.mark.compiles,
    pytest.mark.filterwarnings("ignore::numba.core.errors.NumbaPendingDeprecationWarning"),
]


class Given(NamedTuple):
    """What one tick was given."""

    inputs: Inputs
    permission: Permission
    wanted: Wanted
    dt_s: float
    applied: Axes
    held: ByAxis


def dived(parameters: Parameters, ticks: list[Given], found: Array) -> None:
    memory = start(parameters)
    for i in range(len(ticks)):
        given = ticks[i]
        memory, known = observe(parameters, memory, given.inputs)
        memory = begin(parameters, memory, known, given.permission)
        memory, demand = control(parameters, memory, known, given.permission, given.wanted, given.dt_s)
        memory = confirm(parameters, memory, demand, given.applied, given.held)
        put(found[i], memory, known)


def put(row: Array, memory: Memory, known: Known) -> None:
    motion, model, wanted = known.motion, known.model, memory.actuated.wanted
    for axis in range(6):
        row[axis] = wanted[axis]
    for dof in range(4):
        row[6 + dof] = motion.eta_ahead[dof]
        row[10 + dof] = motion.eta_dot_ahead[dof]
        row[14 + dof] = motion.disturbance[dof]
        row[18 + dof] = model.dof_gain[dof]
        row[22 + dof] = memory.actuated.delivered[dof]
    row[26] = memory.observed.hidden.hidden_s
    row[27] = memory.watch.dead
    row[28] = memory.controlled.axes[Z].reference.x_d
    row[29] = memory.controlled.axes[X].reference.x_d
    row[30] = memory.controlled.axes[PSI].reference.x_d


def test_a_live_dive_is_the_compiled_one(monkeypatch):
    """With DVL, levelling, waves, a current, resets of the EKF, a motor that dies and one that comes back."""
    ticks, found, dts_s = [], [], []

    def controlled(parameters, memory, known, permission, wanted, dt_s, excitation):
        dts_s.append(dt_s)
        return control(parameters, memory, known, permission, wanted, dt_s, excitation)

    def confirmed(parameters, memory, demand, applied, held):
        applied = tuple(applied)  # a named tuple of its own in the engine
        ticks.append(Given(demand.known.inputs, demand.permission, demand.wanted, dts_s[-1], applied, held))
        memory = confirm(parameters, memory, demand, applied, held)
        found.append(np.zeros(31))
        put(found[-1], memory, demand.known)
        return memory

    monkeypatch.setattr(tick, "control", controlled)
    monkeypatch.setattr(tick, "confirm", confirmed)
    plant = ("sensors.dvl=true", "current.enabled=true", "current.speed_m_s=0.35", "waves.enabled=true")
    dive = Dive("initial.eta=[0,0,2.5,0,0,0]", *plant, setpoint=hold(z=2.5, x=0.0, y=0.0), seed=6)
    dive.tap.to_vehicle.append(Somebody().origin())
    dive.run(9.0)
    dive.fault("thruster", 11.0, thruster=6, value=0.0)
    dive.run(12.0)
    dive.fault("yaw_reset", value=40.0)
    dive.fault("position_reset", value=3.0)
    dive.run(3.0)
    assert dive.engine.target[0] > 2.0, "the resets were not seen"

    again = np.zeros((len(ticks), 31))
    cached(dived)(as_arguments(dive.engine.parameters), ticks, again)
    live = np.array(found)
    different = np.flatnonzero((live != again).any(axis=1))
    assert not len(different), (different[0], live[different[0]], again[different[0]])
    assert live[:, 27].max() == 6.0, "the dead motor was not found"
    assert abs(live[:, :6]).max(axis=0).min() > 0.01, "an axis was not used"
