"""One dive without MAVLink, from its engagement to its end: vehicle and companion by turns, compiled.

A tick: the command of the tick before leaves, the vehicle goes on by four steps, the companion takes in what
its telemetry reports and makes the next command by the core's tick.
"""

import math
from typing import NamedTuple

import numpy as np

from companion.core.actuation import NO_AXES, NONE
from companion.core.bounds import clamped, wrap
from companion.core.permission import Permission, Wanted
from companion.core.tick import confirm, control, observe, start
from companion.records import LEVEL, ZERO, Array, Axes, Setpoint, X, Y, Z
from companion.supervision.guard import bounded
from lab.batch.companion import Companion, inputs, on_the_wire
from lab.batch.stand_in import (
    ENGAGED_S,
    STEPS,
    TICK_S,
    Drawn,
    Readings,
    Rows,
    Timing,
    Vehicle,
    go_on_slow,
    motors,
    read,
    remember,
    water,
)
from sim_bridge.physics import plant, thrusters
from sim_bridge.physics.body import NOT_DRIVEN, Motors, moved
from sim_bridge.physics.thrusters import NO_THRUST

OURS = (True, True, True, True, True, True)
LOST_M = 5.0
"""A dive that is further than this from where it should be is given up: its figures stop there."""


class Figures(NamedTuple):
    """What came of a dive; see `lab.batch.simulate.simulate`."""

    place_rms_mm: float
    place_chatter_n: float
    depth_rms_mm: float
    depth_peak_mm: float
    heading_rms_deg: float
    thrust_rms_n: float
    chatter_n: float
    tail_rms_mm: float
    tilt_deg: float
    hidden_s: float
    lost_s: float


def dive(
    vehicle: Vehicle,
    drawn: Drawn,
    companion: Companion,
    at: Timing,
    targets: Rows,
    since_tick: int,
    tail_tick: int,
    trace: Rows,
) -> Figures:
    """Dive as long as there are targets.

    Args:
        vehicle: and its water.
        drawn: what it meets.
        companion: its configuration.
        at: where the delays fall.
        targets: (ticks, 12): x, y, z, psi, their rates and their accelerations; NaN: where it began.
        since_tick: from when on figures count.
        tail_tick: from when on those of the tail count.
        trace: (ticks, 2) takes depth error (m) and thrust asked for in heave (N); (0, 2) for none.

    """
    ticks = len(targets)
    parameters = companion.parameters
    memory = start(parameters)
    afloat = begun(vehicle, drawn)
    first = read(vehicle, afloat.past, 0, afloat.slow, drawn.normals, 0)
    north, east = begins(afloat)
    axes, last = NO_AXES, NO_AXES
    sensor_delay_s, lead_s = parameters.observers.sensor_delay_s, companion.lead_s
    depth_sum, heading_sum, thrust_sum, change_sum, tail_sum = 0.0, 0.0, 0.0, 0.0, 0.0
    place_sum, place_change_sum = 0.0, 0.0
    count, tail_count, peak, upright, lost_s, delivered = 0, 0, 0.0, 1.0, math.nan, ZERO
    for index in range(ticks):
        afloat = went_on(vehicle, drawn, afloat, index, axes)
        state, wanted = afloat.state, targets[index]
        readings = read(vehicle, afloat.past, STEPS * (index + 1), afloat.slow, drawn.normals, index + 1)
        hidden_s = memory.observed.hidden.hidden_s
        measured = inputs(at, readings, vehicle.voltage_v, lead_s, sensor_delay_s, hidden_s, index)
        memory, known = observe(parameters, memory, measured)
        where = aim(vehicle, wanted, north, east, first)
        memory, demand = control(parameters, memory, known, permit(companion, index), where, TICK_S)
        last = bounded(demand.axes, last, companion.reach, companion.slew)
        axes = on_the_wire(last)
        memory = confirm(parameters, memory, demand, axes, OURS)

        before, delivered = delivered, memory.actuated.delivered
        depth_error = state[2] - wanted[2]
        if not abs(depth_error) < LOST_M:
            lost_s = ENGAGED_S + index * TICK_S
            break
        if index < len(trace):
            trace[index, 0], trace[index, 1] = depth_error, delivered[Z]
        if index >= since_tick:
            _, _, yaw = plant.euler(state)
            heading_error = wrap(yaw - wanted[3])
            x = state[0] - (vehicle.start[0] if math.isnan(wanted[0]) else wanted[0])
            y = state[1] - (vehicle.start[1] if math.isnan(wanted[1]) else wanted[1])
            place_sum += x * x + y * y
            depth_sum += depth_error * depth_error
            heading_sum += heading_error * heading_error
            thrust_sum += delivered[Z] * delivered[Z]
            if count > 0:
                x, y, z = delivered[X] - before[X], delivered[Y] - before[Y], delivered[Z] - before[Z]
                place_change_sum += x * x + y * y
                change_sum += z * z
            count += 1
            peak = max(peak, abs(depth_error))
            upright = min(upright, plant.down_axis(state)[2])
            if index >= tail_tick:
                tail_sum += depth_error * depth_error
                tail_count += 1
    n = max(count, 1)
    return Figures(
        1e3 * math.sqrt(place_sum / n) if vehicle.positioned else math.nan,
        math.sqrt(place_change_sum / max(n - 1, 1)),
        1e3 * math.sqrt(depth_sum / n),
        1e3 * peak,
        math.degrees(math.sqrt(heading_sum / n)),
        math.sqrt(thrust_sum / n),
        math.sqrt(change_sum / max(n - 1, 1)),
        1e3 * math.sqrt(tail_sum / max(tail_count, 1)),
        math.degrees(math.acos(clamped(upright, -1.0, 1.0))),
        memory.observed.hidden.hidden_s,
        lost_s,
    )


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


def begun(vehicle: Vehicle, drawn: Drawn) -> Afloat:
    """Return the vehicle at rest where it starts."""
    oldest = max(vehicle.depth_back, vehicle.climb_back, vehicle.attitude_back, vehicle.place_back)
    past = np.zeros((int(oldest) + STEPS + 2, 13))
    for i in range(len(past)):
        remember(past, i, vehicle.start)
    flying = np.zeros((vehicle.to_motor_steps // STEPS + 2, 8))
    slow = np.zeros((1, drawn.slow.shape[1]))
    go_on_slow(drawn, slow, 0)
    return Afloat(past, flying, slow, vehicle.start, NOT_DRIVEN, NO_THRUST)


def begins(afloat: Afloat) -> tuple[float, float]:
    """Return the place of a vehicle that has just begun as an estimate has it: without white noise."""
    return afloat.state[0] + afloat.slow[0, 9], afloat.state[1] + afloat.slow[0, 10]


def went_on(vehicle: Vehicle, drawn: Drawn, afloat: Afloat, index: int, axes: Axes) -> Afloat:
    """Return the vehicle after the next tick; `axes` is the command that leaves at its beginning."""
    past, flying, slow, state, driven, static = afloat
    go_on_slow(drawn, slow, index + 1)
    put(flying, index, motors(vehicle, axes))
    force, flow = water(vehicle, drawn.sea, slow, ENGAGED_S + index * TICK_S, state)
    for step in range(STEPS * index, STEPS * (index + 1)):
        since = step - vehicle.to_motor_steps
        if since >= 0 and since % STEPS == 0:
            static = taken(flying, since // STEPS)
        driven, state, _ = moved(vehicle.hull, driven, state, static, force, flow, 1.0)
        remember(past, step + 1, state)
    return Afloat(past, flying, slow, state, driven, static)


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
        excitation=ZERO,
    )


def aim(vehicle: Vehicle, wanted: Array, north: float, east: float, first: Readings) -> Wanted:
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
