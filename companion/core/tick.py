"""One tick: observe, permit, guide, law, thrust, send, remember.

Parameters, memory, inputs and outputs are values. What is not an equation comes in by three functions of
`Outside`: who may steer, where to go, and what leaves for the vehicle.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from companion.core import actuation, controller, levelling, observers, thruster_watch
from companion.core.actuation import Actuation, ActuationMemory, Limits, Tilting
from companion.core.allocation import ByAxis
from companion.core.controller import Ahead, Control, ControlMemory, Samples
from companion.core.observers import Inputs, Motion, Observers, ObserversMemory
from companion.core.positioning import Jacobian, jacobian, to_body, to_inertial
from companion.core.reference import Reference
from companion.records import PSI, Angles, Axes, Flags, Setpoint, Vector, VehicleModel, X, Y, Z, without

WATCH_TICKS = 4
"""The thrusters are watched every so many ticks: it takes 70 µs, and what they turn is slow."""


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
    watch: thruster_watch.State
    watch_ticks: int


class Permission(NamedTuple):
    """What the supervisor allows in this tick."""

    authority: float
    """0..1: the share of the wrench that is sent."""
    freeze: bool
    """Nothing is learnt."""
    active: bool
    releases: bool
    """What was asked while it was active is let go evenly, whatever the law says by then."""
    rests: bool
    """Nothing is held: law and reference stay where the vehicle is."""
    regained: Flags
    """What is held again: its reference starts where the vehicle is."""
    trusts_thrusters: bool
    """All motors are taken for sound again."""
    reach: Axes
    """Largest demand on each axis."""
    excitation: Vector
    """A body force beside the law's, N and N·m, to identify the vehicle."""


class Wanted(NamedTuple):
    """Where to go, which degrees of freedom the law holds, and at which angles roll and pitch."""

    target: Setpoint
    engaged: Flags
    angles: Angles


class Sent(NamedTuple):
    """What the vehicle makes of the command that went out, and which of its axes are ours."""

    applied: Axes
    held: ByAxis


class Outside(NamedTuple):
    """What is not an equation. Each function takes `state` first: the engine, or a scripted dive."""

    permit: Callable[[Any, Inputs, "Known"], Permission]
    guide: Callable[[Any, Inputs, "Known", Reference], Wanted]
    send: Callable[[Any, Inputs, Axes], Sent]
    state: Any


class Known(NamedTuple):
    """What is known of the vehicle in this tick: its motion, and what it was found to be."""

    motion: Motion
    ahead: Ahead
    lean: Tilting
    model: VehicleModel
    dead_motor: int


class Outputs(NamedTuple):
    """What telemetry has of the tick beside `Known`."""

    known: Known
    samples: Samples
    target: Setpoint
    engaged: Flags
    saturated: Flags
    """By degree of freedom, whether the last command gave less than the law asked."""
    requested: Vector
    """The law's body wrench, N and N·m."""
    finite: bool


def start(parameters: Parameters) -> Memory:
    """Return the memory of one that knows nothing and has sent nothing."""
    zero = (0.0, 0.0, 0.0, 0.0)
    return Memory(
        observers.start(parameters.observers),
        controller.at_rest(parameters.control, zero, zero, zero),
        actuation.start(parameters.actuation),
        actuation.NO_LIMITS,
        thruster_watch.START,
        0,
    )


def tick(
    parameters: Parameters, memory: Memory, inputs: Inputs, outside: Outside, dt_s: float
) -> tuple[Memory, Outputs]:
    """Advance by `dt_s`."""
    observed, controlled, actuated, limits, watch, ticks = memory
    delay_s = inputs.telemetry_s + inputs.command_s + observed.hidden.hidden_s
    observed, motion = observers.step(parameters.observers, observed, inputs, shares(controlled))
    known = known_of(inputs, motion, observed.learner.model, delay_s, watch.dead, parameters.observers.adapts)
    if known.dead_motor != actuated.dead_motor:
        actuated, lost = actuation.gone_on_without(
            parameters.actuation, actuated, known.dead_motor, known.lean
        )
        lost_ned = to_inertial(jacobian(known.ahead.eta[PSI]), lost)
        observed, controlled = (
            observers.without(observed, lost_ned),
            controller.without(controlled, lost_ned),
        )

    permission = outside.permit(outside.state, inputs, known)
    controlled = begun(parameters.control, controlled, permission, known.ahead)
    target, engaged, angles = outside.guide(outside.state, inputs, known, referred(controlled, limits))

    J = jacobian(known.ahead.eta[PSI])
    full, saturated = permission.authority >= 1.0, actuated.saturated
    controlled, samples = controller.step(
        parameters.control,
        controlled,
        known.ahead,
        J,
        target,
        limits.pace,
        engaged,
        without(engaged, saturated),
        without(inputs.stale, engaged),
        full and not permission.freeze,
        full,
        dt_s,
    )
    requested = wrench(J, samples, permission.excitation)
    finite = math.isfinite(requested[0] + requested[1] + requested[2] + requested[3])
    actuated, wanted, limits = actuation.step(
        parameters.actuation,
        actuated,
        requested,
        actuation.Permission(
            permission.authority, permission.active, permission.releases, engaged, permission.reach
        ),
        known.lean,
        angles,
        distance_m(known.ahead.eta, controlled),
        dt_s,
    )
    controlled = controller.caught_up(
        parameters.control, controlled, limits.off_track, known.ahead.eta, known.ahead.eta_dot
    )

    applied, held = outside.send(outside.state, inputs, wanted)
    actuated, given = actuation.sent(parameters.actuation, actuated, applied, known.lean, held)
    observed = observers.sent(observed, inputs.now_s, to_inertial(J, given))
    if parameters.actuation.levels:
        watch, ticks = watched(
            parameters.watch,
            watch,
            ticks,
            inputs,
            permission,
            applied,
            levers(parameters.actuation, actuated, known.lean.adapts),
            parameters.observers.tick_s,
        )
    outputs = Outputs(known, samples, target, engaged, saturated, requested, finite)
    return Memory(observed, controlled, actuated, limits, watch, ticks), outputs


def shares(memory: ControlMemory) -> Vector:
    """Return what d̂ is scaled by in each degree of freedom: the prediction scales d by the same."""
    x, y, z, psi = memory.axes
    return (x.d_share, y.d_share, z.d_share, psi.d_share)


def known_of(
    inputs: Inputs, motion: Motion, model: VehicleModel, delay_s: float, dead_motor: int, adapts: bool
) -> Known:
    """Return what is known of the vehicle, and where a command finds it that is sent now."""
    ahead = Ahead(
        motion.eta_ahead,
        motion.eta_dot_ahead,
        inputs.ahead_s,
        motion.disturbance,
        delay_s,
        model.dof_gain,
        model.dof_later_s,
        model.longest_lag_s,
    )
    roll, pitch, p, q, _ = inputs.attitude
    turns = not inputs.stale[PSI]
    lean = Tilting(
        roll,
        pitch,
        p if turns else 0.0,
        q if turns else 0.0,
        motion.eta_dot_ahead[PSI],
        inputs.voltage_v,
        delay_s + model.dof_later_s[Z],
        levelling_gain(model) if adapts else 1.0,
        model.lag_s[Z],
        adapts,
    )
    return Known(motion, ahead, lean, model, dead_motor)


def levelling_gain(model: VehicleModel) -> float:
    """Return the gain for which roll and pitch are levelled, from that of heave, whose thrusters they share.

    Of a weak vehicle it is one standard deviation above what was found, sooner than the law follows: the gain
    margin of levelling is 2.3, and a vehicle that is levelled too softly tips over.
    """
    most = model.found_gain[Z] * math.exp(model.log_gain_doubt[Z])
    return most if most < model.gain[Z] else model.gain[Z]


def begun(control: Control, memory: ControlMemory, permission: Permission, ahead: Ahead) -> ControlMemory:
    """Stay where the vehicle is while nothing is held; start there what is held again."""
    if permission.rests:
        return controller.at_rest(control, ahead.eta, ahead.eta_dot, ahead.disturbance)
    return controller.caught_up(control, memory, permission.regained, ahead.eta, ahead.eta_dot)


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
    """Return how far below the centre of gravity the horizontal motors push, as levelling has it."""
    return thruster_watch.Levers(
        levelling.lever_in_use_m(vehicle.roll, memory.roll, adapts),
        levelling.lever_doubt_m(memory.roll.lever),
        -levelling.lever_in_use_m(vehicle.pitch, memory.pitch, adapts),
        levelling.lever_doubt_m(memory.pitch.lever),
    )


def watched(
    parameters: thruster_watch.Parameters,
    watch: thruster_watch.State,
    ticks: int,
    inputs: Inputs,
    permission: Permission,
    applied: Axes,
    levers: thruster_watch.Levers,
    tick_s: float,
) -> tuple[thruster_watch.State, int]:
    """Look for a motor that gives no thrust, while the vehicle follows us."""
    if permission.trusts_thrusters:
        watch = thruster_watch.START
    if permission.authority != 1.0 or inputs.stale[PSI]:
        return thruster_watch.rest(watch), ticks
    ticks += 1
    if ticks % WATCH_TICKS == 0:
        watch = thruster_watch.step(
            parameters,
            watch,
            applied,
            inputs.voltage_v,
            inputs.attitude,
            levers,
            inputs.telemetry_s + inputs.command_s,
            WATCH_TICKS * tick_s,
        )
    return watch, ticks


def retuned(old: Parameters, parameters: Parameters, memory: Memory, last: Outputs | None) -> Memory:
    """Go on with other parameters, without a step in thrust; `last` is what the last tick gave."""
    observed = observers.retuned(parameters.observers, memory.observed)
    if last is None:
        return start(parameters)._replace(observed=observed)
    ahead = last.known.ahead
    controlled = controller.taken_over(
        old.control, parameters.control, memory.controlled, ahead, jacobian(ahead.eta[PSI]), last.target
    )
    return memory._replace(observed=observed, controlled=controlled)
