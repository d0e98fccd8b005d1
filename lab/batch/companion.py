"""What stands around the core's calls in a batch: what is measured, and how the wire rounds.

What differs from the full loop stands here and nowhere else:

- it is engaged from the start with full authority, without a supervisor;
- each tick brings one sample of all, over links whose delays stay what the companion's meter would find.
"""

import math

from companion.core.observers import Inputs, Measured
from companion.records import PSI, Axes, Vector, X, Z
from lab.batch.stand_in import OVERRIDE_SPAN_US, TICK_S, Readings, Timing

NOTHING: Vector = (0.0, 0.0, 0.0, 0.0)


def inputs(
    at: Timing,
    readings: Readings,
    voltage_v: float,
    lead_s: float,
    sensor_delay_s: Vector,
    hidden_s: float,
    tick: int,
) -> Inputs:
    """Return what a tick of a batch knows before it observes."""
    now_s = tick * TICK_S
    sampled_s = now_s - at.believed_age_s
    place_s, psi_s = sampled_s - sensor_delay_s[X], sampled_s - sensor_delay_s[PSI]
    z_s = sampled_s - sensor_delay_s[Z] - hidden_s
    begins = (math.nan, math.nan, math.nan, math.nan)
    if tick == 0:
        begins = (readings.north, readings.east, readings.depth, readings.heading)
    positioned, learns = not math.isnan(readings.north), tick > 0
    return Inputs(
        now_s,
        (
            Measured(readings.north, place_s, readings.north_rate, place_s),
            Measured(readings.east, place_s, readings.east_rate, place_s),
            Measured(readings.depth, z_s, readings.sink, z_s),
            Measured(readings.heading, psi_s, readings.heading_rate, psi_s),
        ),
        begins,
        (not positioned, not positioned, False, False),
        at.telemetry_s,
        at.command_s,
        at.command_s + lead_s,
        True,
        positioned,
        (learns and positioned, learns and positioned, learns, learns),
        (readings.roll, readings.pitch, readings.p, readings.q, readings.r),
        voltage_v,
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
