"""The companion of one dive without MAVLink: the engine's own equations in the engine's own order.

What differs from `companion.engine` stands here and nowhere else:

- depth and heading alone are measured, and held from the start with full authority and without a supervisor;
- each tick brings one sample of all, over links whose delays stay what the companion's meter would find;
- commands leave on whole ticks, so that their history has a row a tick.

`learn`, `force` and what begins with `initial_` are slots: the loop is compiled with the compensators and the
laws of a configuration (`slots_of`).
"""

import math
from typing import Any, NamedTuple

import numpy as np

from companion import assembly
from companion.config import Config
from companion.control import levelling, oscillation, pace, reference
from companion.control.actuation import CUT_OFF
from companion.control.allocation import (
    Thrusters,
    allocate,
    delivered,
    overloaded,
    without,
)
from companion.control.bounds import clamped, limited, wrap
from companion.control.compensator import Signals
from companion.control.law import Motion, Terms
from companion.control.oscillation import mean_disturbance, scaled_disturbance
from companion.control.positioning import Jacobian, Model, coriolis_and_damping, damping
from companion.control.schedule import Gains, Left, scheduled
from companion.control.tilt import (
    YAW_LEVEL_RAD,
    YAW_STEEP_RAD,
    body_force,
    coming_tilt,
    level_force,
    share,
)
from companion.estimation import hidden_delay, observer, thruster_watch, vehicle_model
from companion.estimation.estimator import WATCH_TICKS
from companion.estimation.hidden_delay import HiddenDelayState
from companion.estimation.observer import ObserverParameters, ObserverState, ObserverTable
from companion.estimation.observers import MAX_EXTRAPOLATION_S, PREDICTION_STEP_S
from companion.estimation.parameters import hidden_delay_parameters, model_tables, thruster_watch_parameters
from companion.estimation.vehicle_model import Found, ModelState, Scheduled, Tables, Used
from companion.records import PSI, Axes, Z
from lab.batch.compiled import Slotted, slotted
from lab.batch.vehicle import OVERRIDE_SPAN_US, TICK_S, Readings, Rows, Timing
from sim_bridge.physics.plant import Three

NO_AXES: Axes = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
NO_LEVELLING = levelling.levelling_of(1.0, 0.0, 0.0, 0.0, 0.0)
STRAIGHT = Jacobian(1.0, 0.0)
"""Heave and yaw are the same in all headings."""
HEAVE, YAW = 0, 1
"""Columns of the commanded thrusts; two further are their sums."""


class Dof(NamedTuple):
    """How one degree of freedom is estimated and controlled (`companion.control.controller.Dof`)."""

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


class Observed(NamedTuple):
    """What the estimator remembers of a degree of freedom: when it was observed last counts in ticks."""

    state: ObserverState
    at: float
    mean_d: float
    model: ModelState
    found: Found
    used: Used
    scheduled: Scheduled


class Held(NamedTuple):
    """What the controller remembers of a degree of freedom (`companion.control.controller.DofState`)."""

    began: float
    """Where it was engaged."""
    reference: reference.State
    oscillation: oscillation.State
    law: Any
    learnt: Any
    mean_d: float
    pace: float
    allowed_pace: float
    """What a tilt leaves of `pace`."""
    saturated: bool
    d_share: float
    """What d̂ was scaled by in the last tick."""


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


class Estimate(NamedTuple):
    """Position and rate of a degree of freedom when a command sent now acts, and its disturbance."""

    q: float
    v: float
    d: float


def learn(parameters: Any, learnt: Any, signals: Signals, learn_s: float, adapt: bool) -> tuple[Any, float]:
    """Step the compensators of a degree of freedom; return their states and the sum of their d̂."""
    raise NotImplementedError


def force(parameters: Any, state: Any, motion: Motion, dt_s: float) -> tuple[Any, Terms]:
    """Step the law of a degree of freedom."""
    raise NotImplementedError


def step_one(
    parameters: Any, learnt: Any, signals: Signals, learn_s: float, adapt: bool
) -> tuple[Any, float, bool]:
    """Step one compensator."""
    raise NotImplementedError


def initial_one(parameters: Any) -> Any:
    """Return one compensator's first state."""
    raise NotImplementedError


def initial_learnt(parameters: Any) -> Any:
    """Return the compensators' first states."""
    raise NotImplementedError


def initial_law(parameters: Any) -> Any:
    """Return the law's first state."""
    raise NotImplementedError


# Estimation


def given(commands: Rows, column: int, tick: int, at: float) -> float:
    """Return what the commands gave until `at`, N·ticks: times count in ticks.

    The command of tick i is sent at i, and the newest is that before `tick`.
    """
    i = min(math.floor(at), tick - 1)
    if i < 0:
        return 0.0
    return float(commands[i, 2 + column] + commands[i, column] * (at - i))


def observe(
    at: Timing,
    dof: Dof,
    before: Observed,
    commands: Rows,
    column: int,
    tick: int,
    until: float,
    m: float,
    c: float,
    position: float,
    rate: float,
    adapts: bool,
    of_lag: Found,
) -> tuple[Observed, float, float, float, float]:
    """Bring an observer on to `until` and correct it (`Estimator._observe`, `ModelLearner`).

    m and c are the nominal vehicle's; `of_lag` is what heave found of the lag.

    Return it, the thrust that was in force, for how long (s), and what was measured, brought to that moment.
    """
    command = at.command_s / TICK_S
    since = min(before.at, until)
    dt_s = (until - since) * TICK_S
    thrust = 0.0
    if until > since:
        thrust = given(commands, column, tick, until - command) - given(
            commands, column, tick, since - command
        )
        thrust /= until - since
    parameters, gain = before.scheduled.control, math.exp(before.used.log_gain)
    m_eff, c_eff = m / gain, c / gain
    state = observer.advance(parameters, before.state, thrust, m_eff, c_eff, dt_s)
    expected, rates = observer.expected(state), observer.rates(state, m_eff, c_eff)
    most_s = dof.max_extrapolation_s
    later_s = clamped(at.believed_age_s - at.telemetry_s - 0.5 * TICK_S, -most_s, most_s)
    position, rate = position + rates[0] * later_s, rate + rates[1] * later_s
    missed = position - expected[0]
    if dof.reference.angular:
        missed = wrap(missed)
    state = observer.correct(parameters, state, missed, rate - expected[1])
    mean_d = mean_disturbance(before.mean_d, state.d, TICK_S)
    model, found, used = before.model, before.found, before.used
    if adapts and dt_s > 0.0:
        g, here = math.exp(found.log_gain), before.scheduled.here
        slow = ObserverParameters(found.lag_s, here.slow_time_s, here.by_position, here.by_rate)
        model, evidence = vehicle_model.observe(
            slow, model, thrust, m / g, c / g, dt_s, position, rate, dof.reference.angular
        )
        if evidence.gain_gain > 0.0:
            if dof.reference.angular:
                found = vehicle_model.learn_gain(found, evidence, of_lag, TICK_S)
            else:
                found = vehicle_model.learn(found, evidence, TICK_S)
            used = vehicle_model.follow(used, found)
    now = Observed(state, until, mean_d, model, found, used, before.scheduled)
    return now, thrust, dt_s, position, rate


def rescheduled(dof: Dof, before: Observed) -> Observed:
    """Look the observers up where the model has moved (`ModelLearner.turn`)."""
    if vehicle_model.is_near(before.scheduled, before.used):
        return before
    return Observed(
        before.state,
        before.at,
        before.mean_d,
        before.model,
        before.found,
        before.used,
        vehicle_model.schedule(dof.tables, before.used),
    )


def predict(
    dof: Dof,
    now: Observed,
    used: Used,
    d_share: float,
    commands: Rows,
    column: int,
    tick: int,
    since: float,
    ahead_s: float,
    steps: int,
    m: float,
    c: float,
) -> Estimate:
    """Predict through the commands on their way, the first of which was sent at `since`, `ahead_s` on.

    `used` is the model of the tick before; m and c are the nominal vehicle's.
    """
    step_s, gain = ahead_s / steps, math.exp(used.log_gain)
    model = observer.coefficients(now.scheduled.control, m / gain, c / gain, step_s)
    d_hat = scaled_disturbance(now.mean_d, now.state.d, d_share)
    motion = (now.state.q, now.state.v, now.state.f)
    before = given(commands, column, tick, since)
    for k in range(steps):
        after = given(commands, column, tick, since + (k + 1) * (step_s / TICK_S))
        motion = observer.predict_step(model, motion, (after - before) * (TICK_S / step_s), d_hat)
        before = after
    return Estimate(motion[0], motion[1], now.state.d)


# Control


def held(dof: Dof, start: Estimate) -> Held:
    """Rest where the vehicle is (`Controller.rest`)."""
    d = limited(start.d, dof.max_disturbance) if dof.by_observer else 0.0
    return Held(
        start.q,
        reference.start(dof.reference, start.q, start.v),
        oscillation.START,
        initial_law(dof.law),
        initial_learnt(dof.compensators),
        d,
        1.0,
        1.0,
        False,
        1.0,
    )


def learn_none(
    parameters: Any, learnt: Any, signals: Signals, learn_s: float, adapt: bool
) -> tuple[Any, float]:
    """Step no compensator."""
    return learnt, 0.0


def learn_one_more(
    parameters: Any, learnt: Any, signals: Signals, learn_s: float, adapt: bool
) -> tuple[Any, float]:
    """Step a compensator, and those before it."""
    others, d_others = learn(parameters[0], learnt[0], signals, learn_s, adapt)
    state, d_hat, _ = step_one(parameters[1], learnt[1], signals, learn_s, adapt)
    return (others, state), d_others + d_hat


def initial_none(parameters: Any) -> float:
    """Return the state of no compensator."""
    return 0.0


def initial_one_more(parameters: Any) -> Any:
    """Return the first states of a compensator, and of those before it."""
    return (initial_learnt(parameters[0]), initial_one(parameters[1]))


def control(
    dof: Dof,
    before: Held,
    x_d: reference.State,
    x: Estimate,
    e: float,
    m: float,
    k_plus_h: float,
    late_s: float,
    left: Left,
    learns: bool,
    used: Used,
) -> tuple[Held, float]:
    """Return what is remembered, and the force (N) or moment (N·m) that is asked for (`Controller.step`)."""
    gain, free = math.exp(used.log_gain), not before.saturated
    e_dot = x.v - x_d.x_d_dot
    lam, kappa, learning_scale, share, d_share = left
    signals = Signals(e, e_dot, e_dot + lam * e, x.v, x_d.x_d_dot, x_d.x_d_ddot)
    d = limited(x.d, dof.max_disturbance) if dof.by_observer else 0.0
    learnt, found = learn(
        dof.compensators, before.learnt, signals, learning_scale / gain * TICK_S, learns and free
    )
    mean_d = mean_disturbance(before.mean_d, d + found, TICK_S)
    d_hat = scaled_disturbance(mean_d, d + found, d_share)
    motion = Motion(e, e_dot, x.v, x_d.x_d_ddot, m / gain, k_plus_h / gain, d_hat, lam, kappa, share, free)
    law, terms = force(dof.law, before.law, motion, TICK_S)
    tau = terms.feedforward + terms.feedback + terms.d_hat
    believed_s = late_s + oscillation.LOG_GAIN_COUNTS_S * used.log_gain
    watched = oscillation.step(dof.oscillation, before.oscillation, tau, TICK_S, believed_s)
    return Held(
        before.began,
        x_d,
        watched,
        law,
        learnt,
        mean_d,
        before.pace,
        before.allowed_pace,
        before.saturated,
        d_share,
    ), tau


# Slots: heave and yaw have compensators and laws of their own.
control_heave = control_yaw = control
held_heave = held_yaw = held


# A tick


def first_observed(dof: Dof, position: float) -> Observed:
    """Observe the nominal vehicle from a known place."""
    nominal = Used(0.0, dof.lag_s)
    return Observed(
        observer.at_rest(position),
        math.inf,
        0.0,
        vehicle_model.start(position),
        vehicle_model.nothing_found(dof.lag_s),
        nominal,
        vehicle_model.schedule(dof.tables, nominal),
    )


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
    """Allocate around the motor that was found dead, or no longer (`Engine._follow_thrusters`)."""
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


def less_disturbed(observed: Observed, lost: float) -> Observed:
    """Take from d what a motor was believed to give (`Estimator.lose`)."""
    q, v, f, d, s, p = observed.state
    return Observed(
        ObserverState(q, v, f, d - lost, s, p),
        observed.at,
        observed.mean_d - lost,
        observed.model,
        observed.found,
        observed.used,
        observed.scheduled,
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

    # Estimator._estimates
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


def followed(dof: Dof, before: Held, target: Three, ahead_s: float) -> reference.State:
    """Let the reference go on toward where the target will be `ahead_s` later; NaN: stay where it began."""
    position = before.began if math.isnan(target[0]) else target[0]
    x, x_dot, x_ddot = reference.ahead(position, target[1], target[2], ahead_s)
    return reference.step(dof.reference, before.reference, x, x_dot, x_ddot, before.allowed_pace, TICK_S)


def after(law: Held, own_pace: float, allowed_pace: float, saturated: bool) -> Held:
    """Return what is remembered of a degree of freedom once its command is out."""
    return Held(
        law.began,
        law.reference,
        law.oscillation,
        law.law,
        law.learnt,
        law.mean_d,
        own_pace,
        allowed_pace,
        saturated,
        law.d_share,
    )


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


def record(commands: Rows, tick: int, down: float, turn: float) -> None:
    """Write down what a command gives, and what all before it gave until then."""
    commands[tick, HEAVE], commands[tick, YAW] = down, turn
    if tick > 0:
        commands[tick, 2 + HEAVE] = commands[tick - 1, 2 + HEAVE] + commands[tick - 1, HEAVE]
        commands[tick, 2 + YAW] = commands[tick - 1, 2 + YAW] + commands[tick - 1, YAW]


# From a configuration


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
    roll, pitch = assembly.levelling(config) or (NO_LEVELLING, NO_LEVELLING)
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
    one = assembly.dof(config, dof)
    learners: Any = 0.0
    for chosen in one.compensators:
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


def slots_of(config: Config) -> dict[str, Slotted]:
    """Return `step` and `start` with the compensators and the laws of a configuration in their slots."""
    names = ("heave", "yaw")
    of_step, of_start = {}, {}
    for name, dof in zip(names, (Z, PSI), strict=True):
        one = assembly.dof(config, dof)
        learning, beginning = slotted(learn_none), slotted(initial_none)
        for chosen in one.compensators:
            kind = chosen.functions
            learning = slotted(learn_one_more, learn=learning, step_one=kind.step)
            beginning = slotted(initial_one_more, initial_learnt=beginning, initial_one=kind.initial)
        law = one.law.functions
        of_step[f"control_{name}"] = slotted(control, learn=learning, force=law.step)
        of_start[f"held_{name}"] = slotted(held, initial_learnt=beginning, initial_law=law.initial)
    return {"step_companion": slotted(step, **of_step), "start_companion": slotted(start, **of_start)}
