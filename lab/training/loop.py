"""One dive of `lab.batch` that stops in each tick for an action: a generator, compiled.

In each tick the core's tick is taken twice: first to see what the law sees, then with the action.
"""

import math
from collections.abc import Iterator

from companion.control.axis import AxisMemory
from companion.control.bounds import wrap
from companion.control.controller import ControlMemory
from companion.core.tick import Memory, start, tick
from companion.records import PSI, X, Y, Z
from companion.supervision.guard import bounded
from lab.batch.companion import NO_AXES, inputs, outside
from lab.batch.loop import begins, begun, built, scripted, went_on
from lab.batch.settings import Companion
from lab.batch.stand_in import STEPS, TICK_S, Drawn, Rows, Timing, Vehicle, read
from lab.rivals import policy
from lab.rivals.policy import Observation
from lab.training import handed
from sim_bridge.physics import plant


def ticks(
    vehicle: Vehicle,
    drawn: Drawn,
    companion: Companion,
    at: Timing,
    targets: Rows,
    actions: Rows,
    seen: Rows,
    told: Rows,
) -> Iterator[int]:
    """Dive as long as there are targets; each tick yields its index before it acts.

    Args:
        vehicle: and its water.
        drawn: what it meets.
        companion: its configuration; its laws are `handed`.
        at: where the delays fall.
        targets: (ticks, 12): as `lab.batch.loop.dive`'s.
        actions: (1, 4), read after each tick's yield: by degree of freedom the action; NaN: the law's own.
        seen: (4, OBSERVED), written before each yield: the observations.
        told: (2, 4), written likewise: the true error, m and rad, and the force asked for in the tick before.

    """
    memory = start(built(companion.parameters))
    afloat = begun(vehicle, drawn)
    first = read(vehicle, afloat.past, 0, afloat.slow, drawn.normals, 0)
    north, east = begins(afloat)
    axes, last = NO_AXES, NO_AXES
    for index in range(len(targets)):
        afloat = went_on(vehicle, drawn, afloat, index, axes)
        state, wanted = afloat.state, targets[index]
        readings = read(vehicle, afloat.past, STEPS * (index + 1), afloat.slow, drawn.normals, index + 1)
        script = scripted(vehicle, companion, wanted, north, east, first, index, last)
        hidden_s = memory.observed.hidden.hidden_s
        sensor_delay_s = built(companion.parameters).observers.sensor_delay_s
        known = inputs(at, readings, vehicle.voltage_v, companion.lead_s, sensor_delay_s, hidden_s, index)
        for acts in range(2):
            parameters = built(companion.parameters)  # what lives over a yield takes long to compile
            if acts == 1:
                memory = with_actions(memory, actions)
            after, _ = tick(parameters, memory, known, outside(script), TICK_S)
            if acts == 0:
                x, y, z, psi = after.controlled.axes
                _show(seen, told, X, x.law.seen, memory.controlled.axes[X].law.remembered)
                _show(seen, told, Y, y.law.seen, memory.controlled.axes[Y].law.remembered)
                _show(seen, told, Z, z.law.seen, memory.controlled.axes[Z].law.remembered)
                _show(seen, told, PSI, psi.law.seen, memory.controlled.axes[PSI].law.remembered)
                _, _, yaw = plant.euler(state)
                told[0, X] = state[0] - (vehicle.start[0] if math.isnan(wanted[0]) else wanted[0])
                told[0, Y] = state[1] - (vehicle.start[1] if math.isnan(wanted[1]) else wanted[1])
                told[0, Z], told[0, PSI] = state[2] - wanted[2], wrap(yaw - wanted[3])
                yield index
            else:
                memory = after
                last = bounded(memory.actuated.wanted, last, companion.reach, companion.slew)
                axes = memory.actuated.command


def _show(seen: Rows, told: Rows, dof: int, observation: Observation, remembered: policy.State) -> None:
    for i, value in enumerate(observation):
        seen[dof, i] = value
    told[1, dof] = remembered.asked


def with_actions(memory: Memory, actions: Rows) -> Memory:
    """Return the memory with the actions for the next tick."""
    x, y, z, psi = memory.controlled.axes
    controlled = ControlMemory(
        (
            _with_action(x, actions[0, X]),
            _with_action(y, actions[0, Y]),
            _with_action(z, actions[0, Z]),
            _with_action(psi, actions[0, PSI]),
        ),
        memory.controlled.engaged_s,
    )
    return Memory(
        memory.observed, controlled, memory.actuated, memory.limits, memory.watch, memory.watch_ticks
    )


def _with_action(axis: AxisMemory, action: float) -> AxisMemory:
    law = handed.State(action, axis.law.seen, axis.law.remembered)
    return AxisMemory(
        axis.reference,
        axis.oscillation,
        law,
        axis.learnt,
        axis.mean_d,
        axis.d_hat,
        axis.d_share,
        axis.asked,
        axis.bias,
        axis.seeds,
    )
