"""One tick in four calls, on values alone: `observe`, `begin` where the vehicle is, `control`, `confirm`.

After the first others say who may steer, after the second where to go; before the last the guard bounds what
is sent. The order is in the types: a `Demand` is made of a `Known`, and a `Demand` is confirmed.
"""

import math
from typing import NamedTuple

from companion.core import actuation, controller, levelling, observers, thruster_watch
from companion.core.actuation import Actuation, ActuationMemory, Limits, Tilt
from companion.core.allocation import ByAxis
from companion.core.axis import Orders
from companion.core.controller import Control, ControlMemory, Samples
from companion.core.levelling import Response
from companion.core.observers import Estimates, Feedback, Inputs, Observers, ObserversMemory
from companion.core.permission import Permission, Wanted
from companion.core.positioning import Jacobian, jacobian, to_body, to_inertial
from companion.core.reference import Reference
from companion.records import PSI, ZERO, Axes, Vector, VehicleModel, X, Y, Z, without

WATCH_TICKS = 4
"""Ticks between two looks at the thrusters: one takes 70 µs, and the vehicle turns slowly."""


class Parameters(NamedTuple):
    """What is known beforehand."""

    observers: Observers
    control: Control
    actuation: Actuation
    watch: thruster_watch.Parameters


class Memory(NamedTuple):
    """All that is remembered from tick to tick."""

    observed: ObserversMemory
    controlled: ControlMemory
    actuated: ActuationMemory
    limits: Limits
    watch: thruster_watch.WatchState
    watch_ticks: int


class Known(NamedTuple):
    """What is known of the vehicle in this tick: its motion, and what it was found to be."""

    inputs: Inputs
    motion: Estimates
    J: Jacobian
    """At the heading where a command acts that is sent now."""
    tilt: Tilt
    model: VehicleModel
    dead_motor: int
    reversed_motor: int


class Demand(NamedTuple):
    """What the thrusters are asked for in this tick, and why."""

    known: Known
    permission: Permission
    wanted: Wanted
    samples: Samples
    requested: Vector
    """The law's body wrench, N and N·m."""
    axes: Axes
    finite: bool


def start(parameters: Parameters) -> Memory:
    """Return the memory of one that knows nothing and has sent nothing."""
    zero = (0.0, 0.0, 0.0, 0.0)
    return Memory(
        observed=observers.start(parameters.observers),
        controlled=controller.at_rest(parameters.control, zero, zero, zero),
        actuated=actuation.start(parameters.actuation),
        limits=actuation.NO_LIMITS,
        watch=thruster_watch.START,
        watch_ticks=0,
    )


def observe(parameters: Parameters, memory: Memory, inputs: Inputs) -> tuple[Memory, Known]:
    """Advance the observers to the newest measurements; use the motors as they were found."""
    observed, controlled, actuated, limits, watch, ticks = memory
    observed, motion = observers.step(parameters.observers, observed, inputs, feedback(controlled, actuated))
    known = known_of(inputs, motion, observed.learner.model, watch, parameters.observers.adapts)
    if (watch.dead, watch.reversed) != (actuated.dead_motor, actuated.reversed_motor):
        turned = watch.reversed + actuated.reversed_motor > 0
        actuated, lost = actuation.gone_on_with(
            parameters.actuation, actuated, watch.dead, watch.reversed, known.tilt
        )
        lost_ned = to_inertial(known.J, lost)
        observed = observers.without_thrust(observed, lost_ned)
        controlled = controller.without_thrust(controlled, lost_ned)
        if turned:  # the vehicle was driven away, quicker than means and swings tell: begin where it is
            observed, still = observers.undisturbed(observed), (0.0, 0.0, 0.0, 0.0)
            controlled = controller.at_rest(parameters.control, motion.eta_ahead, motion.eta_dot_ahead, still)
    return Memory(observed, controlled, actuated, limits, watch, ticks), known


def begin(parameters: Parameters, memory: Memory, known: Known, permission: Permission) -> Memory:
    """Stay where the vehicle is while nothing is held; start there what is held again."""
    control, controlled, motion = parameters.control, memory.controlled, known.motion
    eta, eta_dot = motion.eta_ahead, motion.eta_dot_ahead
    if permission.rests:
        controlled = controller.at_rest(control, eta, eta_dot, motion.disturbance)
    else:
        controlled = controller.caught_up(control, controlled, permission.regained, eta, eta_dot)
    return memory if controlled is memory.controlled else memory._replace(controlled=controlled)


def control(
    parameters: Parameters,
    memory: Memory,
    known: Known,
    permission: Permission,
    wanted: Wanted,
    dt_s: float,
    excitation: Vector = ZERO,
) -> tuple[Memory, Demand]:
    """Return what the law and the thrusters' allocation make of it, as far as it is permitted.

    `excitation` is a body force beside the law's, N and N·m, to identify the vehicle.
    """
    motion, full = known.motion, permission.authority >= 1.0
    orders = Orders(
        engaged=wanted.engaged,
        saturated=memory.actuated.saturated,
        idle=without(known.inputs.stale, wanted.engaged),
        learns=full and not permission.freeze,
        watched=full,
        pace=memory.limits.pace,
    )
    controlled, samples = controller.demand(
        parameters.control, memory.controlled, motion, known.J, wanted.target, orders, dt_s
    )
    requested = wrench(known.J, samples, excitation)
    away_m = distance_m(motion.eta_ahead, controlled)
    actuated, axes, limits = actuation.actuate(
        parameters.actuation, memory.actuated, requested, permission, wanted, known.tilt, away_m, dt_s
    )
    controlled = controller.caught_up(
        parameters.control, controlled, limits.off_track, motion.eta_ahead, motion.eta_dot_ahead
    )
    finite = math.isfinite(requested[0] + requested[1] + requested[2] + requested[3])
    demand = Demand(known, permission, wanted, samples, requested, axes, finite)
    return Memory(memory.observed, controlled, actuated, limits, memory.watch, memory.watch_ticks), demand


def confirm(parameters: Parameters, memory: Memory, demand: Demand, applied: Axes, held: ByAxis) -> Memory:
    """Remember what the vehicle makes of the command that left; axes that are not `held` are the pilot's."""
    tilt, inputs = demand.known.tilt, demand.known.inputs
    actuated, given = actuation.sent(parameters.actuation, memory.actuated, applied, tilt, held)
    given_ned = to_inertial(demand.known.J, given)
    watch, ticks = memory.watch, memory.watch_ticks
    if parameters.actuation.levels:
        watch, ticks = watched(parameters, watch, ticks, actuated, demand, applied)
    return Memory(
        observed=observers.sent(memory.observed, inputs.now_s, given_ned, d_hats(demand.samples)),
        controlled=memory.controlled,
        actuated=actuated,
        limits=memory.limits,
        watch=watch,
        watch_ticks=ticks,
    )


def d_hats(samples: Samples) -> Vector:
    """Return what of the thrust answers a disturbance, N and N·m."""
    x, y, z, psi = samples
    return (x.d_hat, y.d_hat, z.d_hat, psi.d_hat)


def feedback(memory: ControlMemory, actuated: ActuationMemory) -> Feedback:
    """Return what the observers predict with."""
    x, y, z, psi = memory.axes
    return Feedback(
        d_share=(x.d_share, y.d_share, z.d_share, psi.d_share),
        rates=(
            x.reference.x_d_dot,
            y.reference.x_d_dot,
            z.reference.x_d_dot,
            psi.reference.x_d_dot,
        ),
        accelerations=(
            x.reference.x_d_ddot,
            y.reference.x_d_ddot,
            z.reference.x_d_ddot,
            psi.reference.x_d_ddot,
        ),
        saturated=actuated.saturated,
    )


def known_of(
    inputs: Inputs,
    motion: Estimates,
    model: VehicleModel,
    watch: thruster_watch.WatchState,
    adapts: bool,
) -> Known:
    """Return what is known of the vehicle, and where a command finds it that is sent now."""
    roll, pitch, p, q, _ = inputs.attitude
    turns = not inputs.stale[PSI]
    response = Response(
        delay_s=motion.delay_s,
        gain=model.gain[Z] if adapts else 1.0,
        adapts=adapts,
    )
    tilt = Tilt(
        roll=roll,
        pitch=pitch,
        p=p if turns else 0.0,
        q=q if turns else 0.0,
        turn_radps=motion.eta_dot_ahead[PSI],
        voltage_v=inputs.voltage_v,
        response=response,
    )
    return Known(inputs, motion, jacobian(motion.eta_ahead[PSI]), tilt, model, watch.dead, watch.reversed)


def referred(memory: ControlMemory, limits: Limits) -> Reference:
    """Return the references, and the pace that is left."""
    x, y, z, psi = memory.axes
    return Reference((x.reference, y.reference, z.reference, psi.reference), limits.pace)


def wrench(J: Jacobian, samples: Samples, excitation: Vector) -> Vector:
    """Return the body wrench that the law asks for, N and N·m."""
    x, y, z, psi = samples
    tau = to_body(J, (x.tau, y.tau, z.tau, psi.tau))
    return (
        tau[0] + excitation[0],
        tau[1] + excitation[1],
        tau[2] + excitation[2],
        tau[3] + excitation[3],
    )


def distance_m(eta: Vector, memory: ControlMemory) -> float:
    """Return how far the reference is from the vehicle, horizontally."""
    x, y, _, _ = memory.axes
    north, east = eta[X] - x.reference.x_d, eta[Y] - y.reference.x_d
    return math.sqrt(north * north + east * east)


def levers(vehicle: Actuation, memory: ActuationMemory, adapts: bool) -> thruster_watch.Levers:
    """Return how far below the centre of gravity the horizontal motors push, as levelling found it."""
    return thruster_watch.Levers(
        levelling.lever_in_use_m(vehicle.roll, memory.roll, adapts),
        levelling.lever_doubt_m(memory.roll.lever),
        -levelling.lever_in_use_m(vehicle.pitch, memory.pitch, adapts),
        levelling.lever_doubt_m(memory.pitch.lever),
    )


def watched(
    parameters: Parameters,
    watch: thruster_watch.WatchState,
    ticks: int,
    actuated: ActuationMemory,
    demand: Demand,
    applied: Axes,
) -> tuple[thruster_watch.WatchState, int]:
    """Look for a motor that gives no thrust, or pushes the other way, while the vehicle follows us."""
    permission, inputs = demand.permission, demand.known.inputs
    if permission.trusts_thrusters:
        watch = thruster_watch.START
    if not (permission.active and permission.authority > 0.0) or inputs.stale[PSI]:
        return thruster_watch.rest(watch), ticks
    ticks += 1
    if ticks % WATCH_TICKS == 0:
        watch = thruster_watch.watch(
            parameters.watch,
            watch,
            applied,
            inputs.voltage_v,
            inputs.attitude,
            levers(parameters.actuation, actuated, demand.known.tilt.response.adapts),
            inputs.telemetry_s + inputs.command_s,
            WATCH_TICKS * parameters.observers.tick_s,
        )
    return watch, ticks


def retuned(old: Parameters, parameters: Parameters, memory: Memory, last: Demand | None) -> Memory:
    """Go on with other parameters, without a step in thrust; `last` is what the last tick asked."""
    observed = observers.retuned(parameters.observers, memory.observed)
    if last is None:
        return start(parameters)._replace(observed=observed)
    motion, target = last.known.motion, last.wanted.target
    controlled = controller.taken_over(
        old.control, parameters.control, memory.controlled, motion, last.known.J, target
    )
    return memory._replace(observed=observed, controlled=controlled)
