"""One dive without MAVLink, from its engagement to its end: vehicle and companion by turns, compiled.

A tick: the command of the tick before leaves, the vehicle goes on by four steps, the companion takes in what
its telemetry reports and makes the next command by the core's tick.
"""

import math
from typing import NamedTuple

import numpy as np

from companion.arrays import Array
from companion.core.actuation import NO_AXES, NONE
from companion.core.permission import Permission, Wanted
from companion.core.tick import begin, confirm, control, observe, start
from companion.records import LEVEL, Axes, Setpoint
from companion.supervision.guard import bounded
from lab.batch.companion import Companion, inputs, on_the_wire
from lab.batch.stand_in import (
    ENGAGED_S,
    STEPS,
    TICK_S,
    BatchVehicle,
    Drawn,
    Readings,
    Rows,
    Timing,
    go_on_slow,
    motors,
    read,
    recall,
    remember,
    water,
)
from sim_bridge.physics import plant, thrusters
from sim_bridge.physics.body import NOT_DRIVEN, STEP_S, Motors, moved
from sim_bridge.physics.ekf_height import NO_HEIGHT_ERROR, HeightError, drawn_off
from sim_bridge.physics.thrusters import NO_THRUST

OURS = (True, True, True, True, True, True)
LOST_M = 5.0
"""A dive that is further than this from where it should be is given up: its figures stop there."""


def dive(
    vehicle: BatchVehicle, drawn: Drawn, companion: Companion, at: Timing, targets: Rows, found: Rows
) -> tuple[int, float]:
    """Dive as long as there are targets; return the number of ticks until it was lost, and its hidden delay.

    Args:
        vehicle: and its water.
        drawn: what it meets.
        companion: its configuration.
        at: where the delays fall.
        targets: (ticks, 12): x, y, z, psi, their rates and their accelerations; NaN: where it began.
        found: (ticks, 7) takes the true place (m), cos(tilt), and the force asked for (N), surge to heave.

    """
    memory = start(companion.parameters)
    afloat = begun(vehicle, drawn)
    first = read(vehicle, afloat.past, afloat.height, afloat.slow, drawn.normals, 0)
    north, east = begins(afloat)
    axes, last, parameters = NO_AXES, NO_AXES, companion.parameters
    ticks = len(targets)
    for index in range(ticks):
        afloat = went_on(vehicle, drawn, afloat, index, axes)
        readings = read(vehicle, afloat.past, afloat.height, afloat.slow, drawn.normals, index + 1)
        measured = inputs(at, readings, vehicle.voltage_v, companion, memory.observed.hidden.hidden_s, index)
        memory, known = observe(parameters, memory, measured)
        wanted = aim(vehicle, targets[index], north, east, first)
        permission = permit(companion, index)
        memory = begin(parameters, memory, known, permission)
        memory, demand = control(parameters, memory, known, permission, wanted, TICK_S)
        last = bounded(demand.axes, last, companion.reach, companion.slew)
        axes = on_the_wire(last)
        memory = confirm(parameters, memory, demand, axes, OURS)
        for i in range(3):
            found[index, i], found[index, 4 + i] = afloat.state[i], memory.actuated.delivered[i]
        found[index, 3] = plant.down_axis(afloat.state)[2]
        if not abs(afloat.state[2] - targets[index, 2]) < LOST_M:
            return index, memory.observed.hidden.hidden_s
    return ticks, memory.observed.hidden.hidden_s


class Afloat(NamedTuple):
    """The vehicle of a dive, and what is remembered of it."""

    past: Rows
    """A ring of its states, a row each step."""
    flying: Rows
    """A ring of the steady thrust of the commands on their way, a row each tick."""
    slow: Rows
    state: plant.State
    driven: Motors
    static: thrusters.Eight
    height: HeightError


def begun(vehicle: BatchVehicle, drawn: Drawn) -> Afloat:
    """Return the vehicle at rest where it starts."""
    oldest = max(
        *(vehicle.depth_back, vehicle.climb_back, vehicle.barometer_back),
        *(vehicle.attitude_back, vehicle.place_back),
    )
    past = np.zeros((int(oldest) + STEPS + 2, 13))
    for i in range(len(past)):
        remember(past, i, vehicle.start)
    flying = np.zeros((vehicle.to_motor_steps // STEPS + 2, 8))
    slow = np.zeros((1, drawn.slow.shape[1]))
    go_on_slow(drawn, slow, 0)
    return Afloat(past, flying, slow, vehicle.start, NOT_DRIVEN, NO_THRUST, NO_HEIGHT_ERROR)


def begins(afloat: Afloat) -> tuple[float, float]:
    """Return the place of a vehicle that has just begun as an estimate has it: without white noise."""
    return afloat.state[0] + afloat.slow[0, 9], afloat.state[1] + afloat.slow[0, 10]


def went_on(vehicle: BatchVehicle, drawn: Drawn, afloat: Afloat, index: int, axes: Axes) -> Afloat:
    """Return the vehicle after the next tick; `axes` is the command that leaves at its beginning."""
    past, flying, slow, state, driven, static, height = afloat
    go_on_slow(drawn, slow, index + 1)
    put(flying, index, motors(vehicle, axes))
    force, flow = water(vehicle, drawn.sea, slow, ENGAGED_S + index * TICK_S, state)
    for step in range(STEPS * index, STEPS * (index + 1)):
        since = step - vehicle.to_motor_steps
        if since >= 0 and since % STEPS == 0:
            static = taken(flying, since // STEPS)
        driven, state, _ = moved(vehicle.hull, driven, state, static, force, flow, 1.0)
        remember(past, step + 1, state)
        deeper_m = recall(past, step + 1 - vehicle.barometer_back)[2] - state[2]
        height = drawn_off(height, deeper_m, STEP_S)
    return Afloat(past, flying, slow, state, driven, static, height)


def permit(companion: Companion, index: int) -> Permission:
    """Return full authority; what is held begins where the vehicle is."""
    return Permission(
        authority=1.0,
        freeze=False,
        active=True,
        releases=False,
        rests=index == 0,
        regained=NONE,
        trusts_thrusters=False,
        reach=companion.reach,
    )


def aim(vehicle: BatchVehicle, wanted: Array, north: float, east: float, first: Readings) -> Wanted:
    """Return where to go, from a row of targets; NaN: `north`, `east` and what was read at `first`."""
    target = Setpoint(
        (
            north if math.isnan(wanted[0]) else wanted[0],
            east if math.isnan(wanted[1]) else wanted[1],
            first.depth if math.isnan(wanted[2]) else wanted[2],
            first.heading if math.isnan(wanted[3]) else wanted[3],
        ),
        (wanted[4], wanted[5], wanted[6], wanted[7]),
        (wanted[8], wanted[9], wanted[10], wanted[11]),
    )
    return Wanted(target, (vehicle.positioned, vehicle.positioned, True, True), LEVEL)


def put(ring: Rows, tick: int, static: thrusters.Eight) -> None:
    """Write the steady thrust for a command into the ring of those on their way."""
    for i, newtons in enumerate(static):
        ring[tick % len(ring), i] = newtons


def taken(ring: Rows, tick: int) -> thrusters.Eight:
    """Return the steady thrust for the command of a tick."""
    row = ring[tick % len(ring)]
    return row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7]
