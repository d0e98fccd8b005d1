"""What stands around the core's calls in a batch: what is measured, and how the wire rounds.

What differs from the full loop stands here and nowhere else:

- it is engaged from the start with full authority, without a supervisor;
- each tick brings one sample of all, over links whose delays stay what the companion's meter would find.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from companion import assembly
from companion.config import Config
from companion.core.observers import Inputs
from companion.core.tick import Parameters
from companion.records import PSI, Axes, Vector, X, Z, vector
from lab.batch.stand_in import OVERRIDE_SPAN_US, TICK_S, Readings, Timing

ROWS = 8
"""A tuple of so many tuples is a table: it becomes an array, for numba takes each number for a parameter."""


class Companion(NamedTuple):
    """A dive's companion."""

    parameters: Parameters
    reach: Axes
    slew: float
    """Change of a demand in a tick, at most."""
    lead_s: float
    rate_delay_s: Vector


def companion_of(config: Config) -> Companion:
    """Return a configured companion.

    Raises ValueError for what only the full loop can do.
    """
    if config.vehicle.thrust_path != "rc_override":
        raise ValueError("a batch steers by rc_override: set vehicle.thrust_path")
    if abs(1.0 / config.loop.rate_hz - TICK_S) > 1e-9:
        raise ValueError(f"a batch ticks as the autopilot's input loop does, in {TICK_S} s")
    limits = config.thrusters
    tilts = config.levelling.max_axis if config.levels else 0.0
    return Companion(
        parameters=as_arguments(assembly.parameters(config)),
        reach=(*(limits.max_axis,) * 4, *(tilts,) * 2),
        slew=limits.max_slew_per_s * TICK_S,
        lead_s=limits.lead_s,
        rate_delay_s=vector([axis.rate_delay_s for axis in config.axes]),
    )


def as_arguments(value: Any) -> Any:
    """Return a tree of (named) tuples and numbers with arrays for its tables."""
    if not isinstance(value, (tuple, list)):
        return value
    if len(value) >= ROWS and not hasattr(value, "_fields"):
        return np.array(value, dtype=float)
    parts = [as_arguments(part) for part in value]
    return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)


def inputs(
    at: Timing, readings: Readings, voltage_v: float, companion: Companion, hidden_s: float, tick: int
) -> Inputs:
    """Return what a tick of a batch knows before it observes."""
    now_s, sensor_delay_s = tick * TICK_S, companion.parameters.observers.sensor_delay_s
    sampled_s, rate_delay_s = now_s - at.age_s, companion.rate_delay_s
    place_s, psi_s = sampled_s - sensor_delay_s[X], sampled_s - sensor_delay_s[PSI]
    z_s = sampled_s - sensor_delay_s[Z] - hidden_s
    velocity_s, turn_s = sampled_s - rate_delay_s[X], sampled_s - rate_delay_s[PSI]
    begins = (math.nan, math.nan, math.nan, math.nan)
    if tick == 0:
        begins = (readings.north, readings.east, readings.depth, readings.heading)
    positioned, learns = not math.isnan(readings.north), tick > 0
    return Inputs(
        now_s=now_s,
        positions=(
            (readings.north, place_s),
            (readings.east, place_s),
            (readings.depth, z_s),
            (readings.heading, psi_s),
        ),
        rates=(
            (readings.north_rate, velocity_s),
            (readings.east_rate, velocity_s),
            (readings.sink, sampled_s - rate_delay_s[Z] - hidden_s),
            (readings.heading_rate, turn_s),
        ),
        begins=begins,
        stale=(not positioned, not positioned, False, False),
        telemetry_s=at.telemetry_s,
        command_s=at.command_s,
        ahead_s=at.command_s + companion.lead_s,
        positioned=positioned,
        learns=(learns and positioned, learns and positioned, learns, learns),
        attitude=(readings.roll, readings.pitch, readings.p, readings.q, readings.r),
        voltage_v=voltage_v,
    )


def on_the_wire(axes: Axes) -> Axes:
    """Return the axes in whole µs, as RC_CHANNELS_OVERRIDE carries them."""
    span = OVERRIDE_SPAN_US
    return (
        round(span * axes[0]) / span,
        round(span * axes[1]) / span,
        round(span * axes[2]) / span,
        round(span * axes[3]) / span,
        round(span * axes[4]) / span,
        round(span * axes[5]) / span,
    )
