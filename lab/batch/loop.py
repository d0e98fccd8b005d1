"""One dive without MAVLink, from its engagement to its end: vehicle and companion by turns, compiled.

A tick: the command of the tick before leaves, the vehicle goes on by four steps, the companion takes in what
its telemetry reports and makes the next command by the core's tick. `built` is a slot (`settings`).
"""

import math
from typing import Any, NamedTuple

import numpy as np

from companion.control.bounds import clamped, wrap
from companion.control.controller import Target
from companion.core.tick import Parameters, start, tick
from companion.records import Z
from companion.supervision.guard import bounded
from lab.batch.companion import NO_AXES, Script, inputs, outside
from lab.batch.settings import Companion
from lab.batch.stand_in import (
    ENGAGED_S,
    STEPS,
    TICK_S,
    Drawn,
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
from sim_bridge.physics.body import NOT_DRIVEN, moved
from sim_bridge.physics.thrusters import NO_THRUST

LOST_M = 5.0
"""A dive that is further than this from where it should be is given up: its figures stop there."""


class Figures(NamedTuple):
    """What came of a dive; see `lab.batch.simulate.simulate`."""

    depth_rms_mm: float
    depth_peak_mm: float
    heading_rms_deg: float
    thrust_rms_n: float
    chatter_n: float
    tail_rms_mm: float
    tilt_deg: float
    hidden_s: float
    lost_s: float


def built(numbers: Any) -> Parameters:
    """Make a companion's parameters of its numbers."""
    raise NotImplementedError


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
        targets: (ticks, 6): depth and heading with their rates and accelerations; NaN: where it began.
        since_tick: from when on figures count.
        tail_tick: from when on those of the tail count.
        trace: (ticks, 2) takes depth error (m) and thrust asked for in heave (N); (0, 2) for none.

    """
    ticks = len(targets)
    parameters = built(companion.parameters)
    memory = start(parameters)
    oldest = max(vehicle.depth_back, vehicle.climb_back, vehicle.attitude_back)
    past = np.zeros((int(oldest) + STEPS + 2, 13))
    for i in range(len(past)):
        remember(past, i, vehicle.start)
    flying = np.zeros((vehicle.to_motor_steps // STEPS + 2, 8))
    slow = np.zeros((1, drawn.slow.shape[1]))
    go_on_slow(drawn, slow, 0)

    state, driven, static, axes, last = vehicle.start, NOT_DRIVEN, NO_THRUST, NO_AXES, NO_AXES
    first = read(vehicle, past, 0, slow, drawn.normals, 0)
    sensor_delay_s, lead_s = parameters.observers.sensor_delay_s, companion.lead_s
    depth_sum, heading_sum, thrust_sum, change_sum, tail_sum = 0.0, 0.0, 0.0, 0.0, 0.0
    count, tail_count, peak, upright, last_thrust, lost_s = 0, 0, 0.0, 1.0, math.nan, math.nan
    for index in range(ticks):
        t_s = ENGAGED_S + index * TICK_S
        go_on_slow(drawn, slow, index + 1)
        put(flying, index, motors(vehicle, axes))
        force, flow = water(vehicle, drawn.sea, slow, t_s, state)
        for step in range(STEPS * index, STEPS * (index + 1)):
            since = step - vehicle.to_motor_steps
            if since >= 0 and since % STEPS == 0:
                static = taken(flying, since // STEPS)
            driven, state, _ = moved(vehicle.hull, driven, state, static, force, flow, 1.0)
            remember(past, step + 1, state)

        readings = read(vehicle, past, STEPS * (index + 1), slow, drawn.normals, index + 1)
        row = targets[index]
        depth = first.depth if math.isnan(row[0]) else row[0]
        heading = first.heading if math.isnan(row[3]) else row[3]
        script = Script(
            Target((0.0, 0.0, depth, heading), (0.0, 0.0, row[1], row[4]), (0.0, 0.0, row[2], row[5])),
            (False, False, True, True),
            index == 0,
            companion.reach,
            companion.slew,
            last,
        )
        hidden_s = memory.observed.hidden.hidden_s
        known = inputs(at, readings, vehicle.voltage_v, lead_s, sensor_delay_s, hidden_s, index)
        memory, _ = tick(parameters, memory, known, outside(script), TICK_S)
        last = bounded(memory.actuated.wanted, last, companion.reach, companion.slew)
        axes = memory.actuated.command

        depth_error, pushed = state[2] - row[0], memory.actuated.delivered[Z]
        if not abs(depth_error) < LOST_M:
            lost_s = t_s
            break
        if index < len(trace):
            trace[index, 0], trace[index, 1] = depth_error, pushed
        if index >= since_tick:
            _, _, yaw = plant.euler(state)
            heading_error = wrap(yaw - row[3])
            depth_sum += depth_error * depth_error
            heading_sum += heading_error * heading_error
            thrust_sum += pushed * pushed
            if count > 0:
                change_sum += (pushed - last_thrust) * (pushed - last_thrust)
            last_thrust = pushed
            count += 1
            peak = max(peak, abs(depth_error))
            upright = min(upright, plant.down_axis(state)[2])
            if index >= tail_tick:
                tail_sum += depth_error * depth_error
                tail_count += 1
    n = max(count, 1)
    return Figures(
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


def put(ring: Rows, tick: int, static: thrusters.Eight) -> None:
    """Write the steady thrust for a command into the ring of those on their way."""
    for i, newtons in enumerate(static):
        ring[tick % len(ring), i] = newtons


def taken(ring: Rows, tick: int) -> thrusters.Eight:
    """Return the steady thrust for the command of a tick."""
    row = ring[tick % len(ring)]
    return row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7]
