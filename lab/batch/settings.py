"""What the equations need to know of a dive's companion: numbers alone, made from its configuration."""

import math
from typing import Any, NamedTuple

import numpy as np

from companion import assembly
from companion.config import Config
from companion.control import levelling, oscillation, reference
from companion.control.allocation import Thrusters
from companion.control.positioning import Model
from companion.control.schedule import Gains
from companion.control.several import joined
from companion.estimation import thruster_watch
from companion.estimation.observer import ObserverParameters, ObserverTable
from companion.estimation.observers import MAX_EXTRAPOLATION_S
from companion.estimation.parameters import hidden_delay_parameters, model_tables, thruster_watch_parameters
from companion.estimation.vehicle_model import Tables
from companion.records import PSI, Axes, Z
from lab.batch.vehicle import TICK_S


class Dof(NamedTuple):
    """How one degree of freedom is estimated and controlled (`companion.control.axis.Axis`)."""

    gains: Gains
    reference: reference.Parameters
    oscillation: oscillation.Parameters
    law: Any
    compensators: Any
    by_observer: bool
    max_disturbance: float
    tables: Tables
    lag_s: float
    """Of the nominal thrusters."""
    sensor_delay_s: float
    max_extrapolation_s: float


class Companion(NamedTuple):
    """What the equations need to know of a dive's companion."""

    model: Model
    heave: Dof
    yaw: Dof
    hidden: ObserverParameters
    finds_hidden: bool
    adapts: bool
    levels: bool
    roll: levelling.Levelling
    pitch: levelling.Levelling
    thrusters: Thrusters
    watch: thruster_watch.Parameters
    max_force: tuple[float, float]
    """Of surge and sway, N."""
    reach: Axes
    slew: float
    """Change of a demand in a tick, at most."""
    start_delay_s: float
    lead_s: float
    longest_delay_s: float
    """Largest sensor delay of all four degrees of freedom."""


def companion_of(config: Config, finds_hidden: bool = True, damps: bool = True) -> Companion:
    """Make the parameters of a configured companion.

    Without `finds_hidden` no hidden delay is looked for; without `damps` no oscillation draws gains back.
    Raises ValueError for what only the full loop can do.
    """
    if config.vehicle.thrust_path != "rc_override":
        raise ValueError("a batch steers by rc_override: set vehicle.thrust_path")
    if abs(1.0 / config.loop.rate_hz - TICK_S) > 1e-9:
        raise ValueError(f"a batch ticks as the autopilot's input loop does, in {TICK_S} s")
    model = assembly.model(config)
    dofs = [_dof(config, dof, damps) for dof in (Z, PSI)]
    limits = config.thrusters
    tilts = config.levelling.max_axis if config.levels else 0.0
    roll, pitch = assembly.levelling(config)
    whole = assembly.thrusters(config)
    return Companion(
        model=model,
        heave=dofs[0],
        yaw=dofs[1],
        hidden=hidden_delay_parameters(config, model),
        finds_hidden=finds_hidden,
        adapts=config.vehicle.adapts,
        levels=config.levels,
        roll=roll,
        pitch=pitch,
        thrusters=whole,
        watch=thruster_watch_parameters(config, whole),
        max_force=(config.surge.max_force, config.sway.max_force),
        reach=(limits.max_axis,) * 4 + (tilts,) * 2,
        slew=limits.max_slew_per_s * TICK_S,
        start_delay_s=config.network.start_delay_s,
        lead_s=limits.lead_s,
        longest_delay_s=max(axis.sensor_delay_s for axis in config.axes),
    )


def _dof(config: Config, dof: int, damps: bool) -> Dof:
    model, axis = assembly.model(config), config.axes[dof]
    one = assembly.axis_control(config, dof)
    learners: Any = 0.0
    for chosen in joined(one.compensator):
        learners = (learners, chosen.parameters)
    return Dof(
        gains=one.gains,
        reference=one.reference,
        oscillation=one.oscillation if damps else oscillation.Parameters(axis.max_force, math.inf),
        law=one.law.parameters,
        compensators=learners,
        by_observer=one.by_observer,
        max_disturbance=one.max_disturbance,
        tables=Tables(*map(_arrayed, model_tables(config, model)[dof])),
        lag_s=config.thrusters.lag_s,
        sensor_delay_s=axis.sensor_delay_s,
        max_extrapolation_s=MAX_EXTRAPOLATION_S[dof],
    )


def _arrayed(table: ObserverTable) -> ObserverTable:
    """Return a table whose rows numba takes as one array."""
    return ObserverTable(table.log_gains, table.lags_s, table.slow_time_s, np.array(table.rows))  # type: ignore[arg-type]  # rows as an array for numba
