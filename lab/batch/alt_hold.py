"""ArduSub's depth hold for many dives, without MAVLink: what the search for its gains runs on.

The equations are the simulator's, of its firmware and of its plant, compiled as they stand. Simpler here: it
begins in ALT_HOLD at START_S, where the vehicle is, asks for no moment and no horizontal force, and the link
brings the target late and nothing else. The figures of the full double (`lab.rivals.alt_hold`) decide; a test
shows that these agree with them.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from companion.records import Array, Setpoint, Z
from lab.batch.compiled import cached, slotted
from lab.batch.stand_in import (
    STEPS,
    TICK_S,
    Drawn,
    Rows,
    Timing,
    Vehicle,
    drawn,
    go_on_slow,
    motors,
    recall,
    remember,
    vehicle_of,
    water,
)
from lab.loop.scenarios import SETTLE_S
from sim_bridge.config import SimConfig
from sim_bridge.firmware import depth_hold
from sim_bridge.firmware.depth_hold import GAINS, DepthGains
from sim_bridge.firmware.params import DEFAULTS
from sim_bridge.physics import thrusters
from sim_bridge.physics.body import NOT_DRIVEN, STEP_S, moved
from sim_bridge.physics.plant import ned_velocity
from sim_bridge.physics.sensors import ACCEL_FILTER_DELAY_S
from sim_bridge.physics.thrusters import CURVE_US

START_S = 3.2
FASTEST_M_S = 0.01 * DEFAULTS["PILOT_SPEED_UP"].default
ON_BOARD = Timing(0.0, 0.0, 0.0, 0.0, 0.0)
ACCEL_STEPS = round(ACCEL_FILTER_DELAY_S / STEP_S)


class Figures(NamedTuple):
    """What came of a dive."""

    depth_rms_mm: float
    chatter_n: float


def simulate(
    plants: Sequence[SimConfig],
    targets: Sequence[Callable[[float], Setpoint]],
    duration_s: float,
    seeds: Sequence[int],
    link_s: Array,
    gains: Mapping[str, Array | float],
) -> dict[str, Array]:
    """Return depth_rms_mm and chatter_n, (dives,); `link_s` (dives,) is how late its target comes."""
    ticks = round(duration_s / TICK_S) - round(START_S / TICK_S)
    starts_s = START_S + TICK_S * np.arange(ticks + 1.0)
    since = int(np.searchsorted(starts_s, SETTLE_S - 1e-9))
    each_gain = [np.broadcast_to(gains[name], len(plants)) for name in GAINS]
    loop, figures = cached(slotted(dive)), []
    for i, (config, seed) in enumerate(zip(plants, seeds, strict=True)):
        nominal = replace(config.thrusters, gain=(1.0,), dead_band_us=float(CURVE_US[6]))
        target, late_s = targets[i], float(link_s[i])
        depths = [(target(t_s).eta_d[Z], target(t_s - late_s).eta_d[Z]) for t_s in starts_s]
        white = np.random.default_rng((seed, 4)).standard_normal((STEPS * ticks, 2))
        figures.append(
            loop(
                vehicle_of(config, ON_BOARD),
                vehicle_of(replace(config, thrusters=nominal), ON_BOARD),
                drawn(config, seed, ticks),
                DepthGains(*(float(values[i]) for values in each_gain)),
                np.array(depths),
                white,
                since,
            )
        )
    return {name: np.array(column) for name, column in zip(Figures._fields, np.array(figures).T, strict=True)}


def dive(
    vehicle: Vehicle,
    nominal: Vehicle,
    drawn: Drawn,
    gains: DepthGains,
    depths: Rows,
    white: Rows,
    since_tick: int,
) -> Figures:
    """Dive as long as there are depths.

    Args:
        vehicle: and its water.
        nominal: the same with thrusters as they should be: chatter is told in their newtons.
        drawn: what it meets.
        gains: of the depth loop.
        depths: (ticks + 1, 2): where it should be at each tick, and where it knows that it should be (m).
        white: (steps, 2): normals for the noise of depth and climb.
        since_tick: from when on figures count.

    """
    oldest = max(vehicle.depth_back, vehicle.climb_back, ACCEL_STEPS + 1)
    past = np.zeros((int(oldest) + 2, 13))
    for i in range(len(past)):
        remember(past, i, vehicle.start)
    slow = np.zeros((1, drawn.slow.shape[1]))
    state, driven, hold = vehicle.start, NOT_DRIVEN, depth_hold.AT_REST
    squares, changes, asked_before, count = 0.0, 0.0, 0.0, 0
    for tick in range(len(depths) - 1):
        go_on_slow(drawn, slow, tick)
        force, flow = water(vehicle, drawn.sea, slow, START_S + tick * TICK_S, state)
        for now in range(STEPS * tick, STEPS * (tick + 1)):
            depth = recall(past, now - vehicle.depth_back)[2] + slow[0, 0] + slow[0, 2]
            climb = slow[0, 1] - ned_velocity(recall(past, now - vehicle.climb_back))[2]
            felt, earlier = recall(past, now - ACCEL_STEPS), recall(past, now - ACCEL_STEPS - 1)
            rise = (ned_velocity(earlier)[2] - ned_velocity(felt)[2]) / STEP_S
            depth += vehicle.white[0] * white[now, 0]
            climb += vehicle.white[1] * white[now, 1]
            hold = depth_hold.step(
                gains, hold, depth - depths[tick, 1], depth_hold.STILL, FASTEST_M_S, climb, rise, STEP_S
            )
            axes = (0.0, 0.0, -hold.throttle, 0.0, 0.0, 0.0)
            driven, state, _ = moved(vehicle.hull, driven, state, motors(vehicle, axes), force, flow, 1.0)
            remember(past, now + 1, state)
        if tick >= since_tick:
            asked = thrusters.wrench(nominal.hull.thrusters, motors(nominal, axes))[2]
            squares += (state[2] - depths[tick + 1, 0]) ** 2
            changes += (asked - asked_before) ** 2 if count > 0 else 0.0
            asked_before = asked
            count += 1
    return Figures(1e3 * math.sqrt(squares / count), math.sqrt(changes / (count - 1)))
