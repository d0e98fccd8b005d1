"""The companion of one dive without MAVLink: the engine's own equations in the engine's own order.

What differs from `companion.engine` stands here and nowhere else:

- depth and heading alone are measured, and held from the start with full authority and without a supervisor;
- each tick brings one sample of all, over links whose delays stay what the companion's meter would find;
- commands leave on whole ticks, so that their history has a row a tick.

The loop is compiled with the compensators and the laws of a configuration in its slots (`slots_of`).
"""

import math
from typing import NamedTuple

from companion import assembly
from companion.config import Config
from companion.control import levelling, pace
from companion.control.actuation import CUT_OFF
from companion.control.allocation import allocate, delivered, overloaded, without
from companion.control.bounds import limited, wrap
from companion.control.positioning import Jacobian, coriolis_and_damping, damping
from companion.control.schedule import scheduled
from companion.control.tilt import (
    YAW_LEVEL_RAD,
    YAW_STEEP_RAD,
    body_force,
    coming_tilt,
    level_force,
    share,
)
from companion.core.tick import WATCH_TICKS
from companion.estimation import hidden_delay, thruster_watch, vehicle_model
from companion.estimation.hidden_delay import HiddenDelayState
from companion.estimation.observers import PREDICTION_STEP_S
from companion.records import PSI, Axes, Z
from lab.batch.compiled import Slotted, slotted
from lab.batch.control import Held, after, chosen, control, followed, held
from lab.batch.estimation import (
    HEAVE,
    YAW,
    Estimate,
    Observed,
    first_observed,
    less_disturbed,
    observe,
    predict,
    record,
    rescheduled,
)
from lab.batch.settings import Companion
from lab.batch.vehicle import OVERRIDE_SPAN_US, TICK_S, Readings, Rows, Timing
from sim_bridge.physics.plant import Three

NO_AXES: Axes = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
STRAIGHT = Jacobian(1.0, 0.0)
"""Heave and yaw are the same in all headings."""

# Slots: heave and yaw have compensators and laws of their own.
control_heave = control_yaw = control
held_heave = held_yaw = held


class Memory(NamedTuple):
    """All that a companion remembers from tick to tick, beside its commands."""

    z: Observed
    psi: Observed
    hidden: HiddenDelayState
    heave: Held
    yaw: Held
    roll: levelling.LevellingState
    pitch: levelling.LevellingState
    watch: thruster_watch.State
    dead_motor: int
    """The motor around which is allocated; 0 for none."""
    axes: Axes
    """The last command before it was rounded for the wire."""
    pushed: Axes
    """Body wrench that the last command should have given, N and N·m."""


def start(companion: Companion, readings: Readings) -> Memory:
    """Engage where the first telemetry puts the vehicle."""
    return Memory(
        first_observed(companion.heave, readings.depth),
        first_observed(companion.yaw, readings.heading),
        hidden_delay.start(readings.depth, 0.0),
        held_heave(companion.heave, Estimate(readings.depth, 0.0, 0.0)),
        held_yaw(companion.yaw, Estimate(readings.heading, 0.0, 0.0)),
        levelling.START,
        levelling.START,
        thruster_watch.START,
        0,
        NO_AXES,
        NO_AXES,
    )


def without_dead(companion: Companion, before: Memory, voltage_v: float) -> Memory:
    """Allocate around the motor that was found dead, or no longer (`companion.core.tick`)."""
    motor = before.watch.dead
    if motor == before.dead_motor:
        return before
    applied = on_the_wire(before.axes)
    believed = delivered(without(companion.thrusters, before.dead_motor), applied, voltage_v)
    given = delivered(without(companion.thrusters, motor), applied, voltage_v)
    return Memory(
        less_disturbed(before.z, believed[2] - given[2]),
        less_disturbed(before.psi, believed[3] - given[3]),
        before.hidden,
        before.heave,
        before.yaw,
        relevelled(companion.roll, before.roll, believed[4] - given[4]),
        relevelled(companion.pitch, before.pitch, believed[5] - given[5]),
        before.watch,
        motor,
        before.axes,
        before.pushed,
    )


def relevelled(
    axis: levelling.Levelling, before: levelling.LevellingState, lost_nm: float
) -> levelling.LevellingState:
    """Add to the integral the moment that a motor was believed to give (`Actuation.go_on_without`)."""
    integral = before.integral + lost_nm / axis.inertia
    return levelling.LevellingState(integral, before.slow, before.oscillation, before.pushed_n)


def step(
    companion: Companion,
    at: Timing,
    voltage_v: float,
    remembered: Memory,
    readings: Readings,
    z_target: Three,
    psi_target: Three,
    commands: Rows,
    tick: int,
) -> tuple[Memory, Axes]:
    """Return what is remembered and the axes that go out (`Engine.step`); write the tick's row of commands.

    A target is a position, its rate and its acceleration.
    """
    before = without_dead(companion, remembered, voltage_v)
    thrusters = without(companion.thrusters, before.dead_motor)
    model, heave, yaw = companion.model, companion.heave, companion.yaw
    m_z, m_psi = model.m[Z], model.m[PSI]
    drag = damping(model, (0.0, 0.0, before.z.state.v, before.psi.state.v))
    delay_s = at.telemetry_s + at.command_s + before.hidden.hidden_s
    ahead_s = at.command_s + companion.lead_s

    # Observers.step
    late_s = at.telemetry_s + 0.5 * TICK_S
    z_age_s = late_s + heave.sensor_delay_s + before.hidden.hidden_s
    psi_age_s = late_s + yaw.sensor_delay_s
    z_at, psi_at = tick - z_age_s / TICK_S, tick - psi_age_s / TICK_S
    z_before, psi_before = rescheduled(heave, before.z), rescheduled(yaw, before.psi)
    z, thrust, dt_s, position, rate = observe(
        at,
        heave,
        z_before,
        commands,
        HEAVE,
        tick,
        z_at,
        m_z,
        drag[Z],
        readings.depth,
        readings.sink,
        companion.adapts,
        z_before.found,
    )
    hidden, g_z = before.hidden, math.exp(z_before.used.log_gain)
    if companion.finds_hidden and dt_s > 0.0:
        hidden = hidden_delay.step(
            companion.hidden, hidden, thrust, m_z / g_z, drag[Z] / g_z, dt_s, position, rate
        )
    psi, _, _, _, _ = observe(
        at,
        yaw,
        psi_before,
        commands,
        YAW,
        tick,
        psi_at,
        m_psi,
        drag[PSI],
        readings.heading,
        readings.heading_rate,
        companion.adapts,
        z.found,
    )
    oldest_s = max(z_age_s, late_s + companion.longest_delay_s)
    steps = max(1, math.ceil((oldest_s + ahead_s) / PREDICTION_STEP_S))
    sent = at.command_s / TICK_S
    z_ahead = predict(
        heave,
        z,
        z_before.used,
        before.heave.d_share,
        commands,
        HEAVE,
        tick,
        z_at - sent,
        z_age_s + ahead_s,
        steps,
        m_z,
        drag[Z],
    )
    psi_ahead = predict(
        yaw,
        psi,
        psi_before.used,
        before.yaw.d_share,
        commands,
        YAW,
        tick,
        psi_at - sent,
        psi_age_s + ahead_s,
        steps,
        m_psi,
        drag[PSI],
    )

    # Controller.step
    z_d = followed(heave, before.heave, z_target, ahead_s)
    psi_d = followed(yaw, before.yaw, psi_target, ahead_s)
    learns = (tick + 1) * TICK_S >= companion.start_delay_s
    z_late_s = delay_s + vehicle_model.later_s(z.used, heave.lag_s)
    psi_late_s = delay_s + vehicle_model.later_s(psi.used, yaw.lag_s)
    lag_s = vehicle_model.longest_lag_s(z.found) if companion.adapts else heave.lag_s
    z_left = scheduled(heave.gains, z_late_s, before.heave.oscillation.gain_scale, lag_s)
    psi_left = scheduled(yaw.gains, psi_late_s, before.yaw.oscillation.gain_scale, lag_s)
    w = z_ahead.v - (1.0 - z_left.d_share) * (z_ahead.v - z_d.x_d_dot)
    r = psi_ahead.v - (1.0 - psi_left.d_share) * (psi_ahead.v - psi_d.x_d_dot)
    k_plus_h = coriolis_and_damping(model, STRAIGHT, (0.0, 0.0, w, r))
    e_z, e_psi = z_ahead.q - z_d.x_d, wrap(psi_ahead.q - psi_d.x_d)
    heave_law, down = control_heave(
        heave, before.heave, z_d, z_ahead, e_z, m_z, k_plus_h[Z], z_late_s, z_left, learns, z.used
    )
    yaw_law, turn = control_yaw(
        yaw, before.yaw, psi_d, psi_ahead, e_psi, m_psi, k_plus_h[PSI], psi_late_s, psi_left, learns, psi.used
    )

    # Actuation.step
    tilt = coming_tilt(readings.roll, readings.pitch, readings.p, readings.q)
    yaw_share = share(tilt, YAW_LEVEL_RAD, YAW_STEEP_RAD)
    X, Y, along_z = body_force(readings.roll, readings.pitch, tilt, (0.0, 0.0, down))
    roll, pitch, K, M = before.roll, before.pitch, 0.0, 0.0
    if companion.levels:
        pushed, most = before.pushed, companion.max_force
        tilt_gain = math.exp(z.used.log_gain)
        tilt_delay_s = z_late_s
        roll, K = levelling.step(
            companion.roll,
            roll,
            readings.roll,
            readings.p,
            limited(pushed[1], most[1]),
            tilt_delay_s,
            TICK_S,
            True,
            tilt_gain,
            z.used.lag_s,
        )
        pitch, M = levelling.step(
            companion.pitch,
            pitch,
            readings.pitch,
            readings.q,
            limited(pushed[0], most[0]),
            tilt_delay_s,
            TICK_S,
            True,
            tilt_gain,
            z.used.lag_s,
        )
    wanted, saturated = allocate(
        thrusters, (X, Y, along_z, yaw_share * turn, K, M), voltage_v, companion.reach
    )

    # guard, Autopilot.applied, Actuation.sent
    axes = guarded(before.axes, wanted, companion.reach, companion.slew)
    applied = on_the_wire(axes)
    pushed = delivered(thrusters, applied, voltage_v)
    overloads = overloaded(thrusters, applied)
    level = level_force(readings.roll, readings.pitch, (pushed[0], pushed[1], pushed[2]))
    z_short = saturated[Z] or overloads[Z] or abs(applied[Z] - wanted[Z]) > CUT_OFF
    psi_short = saturated[PSI] or overloads[PSI] or abs(applied[PSI] - wanted[PSI]) > CUT_OFF
    record(commands, tick, level[2], pushed[3])

    watch = before.watch
    if companion.levels and (tick + 1) % WATCH_TICKS == 0:
        watch = thruster_watch.step(
            companion.watch,
            watch,
            applied,
            voltage_v,
            (readings.roll, readings.pitch, readings.p, readings.q, readings.heading_rate),
            delay_s,
            WATCH_TICKS * TICK_S,
        )

    z_pace = pace.step(before.heave.pace, before.heave.saturated, TICK_S)
    psi_pace = pace.step(before.yaw.pace, before.yaw.saturated, TICK_S)
    return Memory(
        z,
        psi,
        hidden,
        after(heave_law, z_pace, pace.on_a_tilt(z_pace, share(tilt)), z_short),
        after(yaw_law, psi_pace, psi_pace, psi_short or yaw_share < 1.0),
        roll,
        pitch,
        watch,
        before.dead_motor,
        axes,
        pushed,
    ), applied


def guarded(before: Axes, wanted: Axes, most: Axes, slew: float) -> Axes:
    """Return the axes within reach, and a tick's slew of those before; neutral if one is not finite."""
    if not math.isfinite(wanted[0] + wanted[1] + wanted[2] + wanted[3] + wanted[4] + wanted[5]):
        return NO_AXES
    return (
        before[0] + limited(limited(wanted[0], most[0]) - before[0], slew),
        before[1] + limited(limited(wanted[1], most[1]) - before[1], slew),
        before[2] + limited(limited(wanted[2], most[2]) - before[2], slew),
        before[3] + limited(limited(wanted[3], most[3]) - before[3], slew),
        before[4] + limited(limited(wanted[4], most[4]) - before[4], slew),
        before[5] + limited(limited(wanted[5], most[5]) - before[5], slew),
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


def slots_of(config: Config) -> dict[str, Slotted]:
    """Return `step` and `start` with the compensators and the laws of a configuration in their slots."""
    of_step, of_start = {}, {}
    for name, dof in (("heave", Z), ("yaw", PSI)):
        of_step[f"control_{name}"], of_start[f"held_{name}"] = chosen(assembly.axis_control(config, dof))
    return {"step_companion": slotted(step, **of_step), "start_companion": slotted(start, **of_start)}
