"""Reference, error, compensators and law of all four degrees of freedom, in the order in which they act."""

from typing import NamedTuple

from companion.core import axis
from companion.core.axis import Aim, Axis, AxisMemory, AxisSample, Point
from companion.core.positioning import (
    Jacobian,
    Model,
    coriolis_and_damping,
    inertia,
    to_body,
)
from companion.core.schedule import NO_GAINS
from companion.records import PSI, Flags, Setpoint, Vector, X, Y, Z

Axes4 = tuple[Axis, Axis, Axis, Axis]
Memories = tuple[AxisMemory, AxisMemory, AxisMemory, AxisMemory]
Samples = tuple[AxisSample, AxisSample, AxisSample, AxisSample]

LEAST_GAIN = (0.5, 0.5, 0.0, 0.0)
"""The law takes no vehicle for weaker. A current that turns with the vehicle looks like weak surge and sway,
and the law that made up for it oscillated (docs/decisions/0026)."""


class Control(NamedTuple):
    """The model, how each degree of freedom is controlled, and how long after engaging nothing is learnt."""

    model: Model
    axes: Axes4
    start_delay_s: float


class ControlMemory(NamedTuple):
    """What is remembered."""

    axes: Memories
    engaged_s: float


class Ahead(NamedTuple):
    """Where a command that is sent now finds the vehicle, NED, and what is known of it."""

    eta: Vector
    eta_dot: Vector
    ahead_s: float
    disturbance: Vector
    delay_s: float
    """Of the whole loop."""
    gain: Vector
    later_s: Vector
    """Delay that the thrusters' lag counts for."""
    longest_lag_s: float


class Everywhere(NamedTuple):
    """What `axis.Point` has of one degree of freedom, for all of them."""

    ahead: Ahead
    m: Vector
    k_plus_h: Vector
    engaged: Flags
    free: Flags
    idle: Flags
    learns: bool
    watched: bool


def at_rest(control: Control, eta: Vector, eta_dot: Vector, disturbance: Vector) -> ControlMemory:
    """Stay where the vehicle is, with nothing learnt: engaging from here is no step."""
    x, y, z, psi = control.axes
    return ControlMemory(
        (
            axis.at_rest(x, eta[X], eta_dot[X], disturbance[X]),
            axis.at_rest(y, eta[Y], eta_dot[Y], disturbance[Y]),
            axis.at_rest(z, eta[Z], eta_dot[Z], disturbance[Z]),
            axis.at_rest(psi, eta[PSI], eta_dot[PSI], disturbance[PSI]),
        ),
        0.0,
    )


def step(
    control: Control,
    memory: ControlMemory,
    ahead: Ahead,
    J: Jacobian,
    target: Setpoint,
    pace: Vector,
    engaged: Flags,
    free: Flags,
    idle: Flags,
    learns: bool,
    watched: bool,
    dt_s: float,
) -> tuple[ControlMemory, Samples]:
    """Return the law's inside, NED; learn only where `free`, and not soon after engaging.

    J is the Jacobian at the heading where the command acts. What is `idle` is not held, and nothing is known
    of its motion.
    """
    x, y, z, psi = control.axes
    of_x, of_y, of_z, of_psi = memory.axes
    engaged_s = memory.engaged_s + dt_s
    learns = learns and engaged_s >= control.start_delay_s

    aim_x = _aim(x, of_x, X, ahead, target, pace, idle, dt_s)
    aim_y = _aim(y, of_y, Y, ahead, target, pace, idle, dt_s)
    aim_z = _aim(z, of_z, Z, ahead, target, pace, idle, dt_s)
    aim_psi = _aim(psi, of_psi, PSI, ahead, target, pace, idle, dt_s)
    nu = to_body(
        J,
        (
            _drag_rate(ahead.eta_dot[X], aim_x),
            _drag_rate(ahead.eta_dot[Y], aim_y),
            _drag_rate(ahead.eta_dot[Z], aim_z),
            _drag_rate(ahead.eta_dot[PSI], aim_psi),
        ),
    )
    m, k_plus_h = inertia(control.model, J), coriolis_and_damping(control.model, J, nu)

    at = Everywhere(ahead, m, k_plus_h, engaged, free, idle, learns, watched)
    of_x, sample_x = _stepped(x, of_x, aim_x, X, at, dt_s)
    of_y, sample_y = _stepped(y, of_y, aim_y, Y, at, dt_s)
    of_z, sample_z = _stepped(z, of_z, aim_z, Z, at, dt_s)
    of_psi, sample_psi = _stepped(psi, of_psi, aim_psi, PSI, at, dt_s)
    remembered = ControlMemory((of_x, of_y, of_z, of_psi), engaged_s)
    return remembered, (sample_x, sample_y, sample_z, sample_psi)


def _aim(
    axis_: Axis,
    memory: AxisMemory,
    i: int,
    ahead: Ahead,
    target: Setpoint,
    pace: Vector,
    idle: Flags,
    dt_s: float,
) -> Aim:
    if idle[i]:
        return Aim(memory.reference, 0.0, 0.0, NO_GAINS)
    return axis.aim(
        axis_,
        memory,
        (target.eta_d[i], target.eta_d_dot[i], target.eta_d_ddot[i]),
        pace[i],
        ahead.ahead_s,
        ahead.eta[i],
        ahead.eta_dot[i],
        ahead.delay_s + ahead.later_s[i],
        ahead.longest_lag_s,
        dt_s,
    )


def _drag_rate(x_dot: float, aim: Aim) -> float:
    """Return the rate at which the drag is compensated: that of the reference as far as d̂ is drawn back."""
    return x_dot - (1.0 - aim.gains.d_share) * aim.e_dot


def _stepped(
    axis_: Axis, memory: AxisMemory, aim: Aim, i: int, at: Everywhere, dt_s: float
) -> tuple[AxisMemory, AxisSample]:
    if at.idle[i]:
        return axis.idle(axis_, memory, dt_s)
    ahead, least = at.ahead, LEAST_GAIN[i]
    point = Point(
        ahead.eta[i],
        ahead.eta_dot[i],
        ahead.disturbance[i],
        at.m[i],
        at.k_plus_h[i],
        least if ahead.gain[i] < least else ahead.gain[i],
        ahead.delay_s + ahead.later_s[i],
        at.engaged[i],
        at.free[i],
        at.learns,
        at.watched,
    )
    return axis.step(axis_, memory, aim, point, dt_s)


def caught_up(
    control: Control, memory: ControlMemory, where: Flags, eta: Vector, eta_dot: Vector
) -> ControlMemory:
    """Start the references of the DOFs in `where` again, at the vehicle and with its rate."""
    if not (where[X] or where[Y] or where[Z] or where[PSI]):
        return memory
    x, y, z, psi = control.axes
    of_x, of_y, of_z, of_psi = memory.axes
    return ControlMemory(
        (
            axis.caught_up(x, of_x, eta[X], eta_dot[X]) if where[X] else of_x,
            axis.caught_up(y, of_y, eta[Y], eta_dot[Y]) if where[Y] else of_y,
            axis.caught_up(z, of_z, eta[Z], eta_dot[Z]) if where[Z] else of_z,
            axis.caught_up(psi, of_psi, eta[PSI], eta_dot[PSI]) if where[PSI] else of_psi,
        ),
        memory.engaged_s,
    )


def without(memory: ControlMemory, tau_ned: Vector) -> ControlMemory:
    """Take from d̂ what a motor that gives no thrust was believed to give, N and N·m.

    The demand becomes less by it in one tick: that is no oscillation.
    """
    x, y, z, psi = memory.axes
    return ControlMemory(
        (
            axis.without(x, tau_ned[X]),
            axis.without(y, tau_ned[Y]),
            axis.without(z, tau_ned[Z]),
            axis.without(psi, tau_ned[PSI]),
        ),
        memory.engaged_s,
    )


def taken_over(
    old: Control, control: Control, memory: ControlMemory, ahead: Ahead, J: Jacobian, target: Setpoint
) -> ControlMemory:
    """Go on with other laws or gains, without a step in thrust.

    The new law is asked at the place and time of the last tick (`ahead`, J, `target`) how much more or less
    it wants than the old one did.
    """
    x, y, z, psi = map(axis.taken_over, old.axes, control.axes, memory.axes)
    known = ControlMemory((x, y, z, psi), memory.engaged_s)
    still, nobody = (1.0, 1.0, 1.0, 1.0), (False, False, False, False)
    asked, _ = step(control, known, ahead, J, target, still, nobody, nobody, nobody, False, False, 0.0)
    x, y, z, psi = map(axis.bumpless, asked.axes, memory.axes)
    return ControlMemory((x, y, z, psi), memory.engaged_s)
