"""The law of all four degrees of freedom, in the order in which its parts act."""

import math
from typing import NamedTuple

from companion.core import axis
from companion.core.axis import Axis, AxisMemory, Orders, Place, Sample
from companion.core.bounds import clamped
from companion.core.four import each_of_two
from companion.core.observers import Estimates
from companion.core.positioning import Jacobian, Model, coriolis_and_damping, inertia, to_body
from companion.records import PSI, Flags, Setpoint, Vector, X, Y, Z, without

Axes4 = tuple[Axis, Axis, Axis, Axis]
Memories = tuple[AxisMemory, AxisMemory, AxisMemory, AxisMemory]
Samples = tuple[Sample, Sample, Sample, Sample]

LEAST_GAIN = (0.5, 0.5, 0.0, 0.0)
"""The law takes no vehicle for weaker. A current that turns with the vehicle looks like weak surge and sway,
and the law that made up for it oscillated (docs/decisions/0026)."""

LEARNS_AFTER_S = 2.0
"""From engaging; what learns before learns the transient."""

STILL = Orders(
    engaged=(False,) * 4,
    saturated=(False,) * 4,
    idle=(False,) * 4,
    learns=False,
    watched=False,
    pace=(1.0,) * 4,
)
"""No degree of freedom is held, learnt or watched."""


class Control(NamedTuple):
    """The model, and how each degree of freedom is controlled."""

    model: Model
    axes: Axes4


class ControlMemory(NamedTuple):
    """What is remembered."""

    axes: Memories
    engaged_s: float


def at_rest(control: Control, eta: Vector, eta_dot: Vector, disturbance: Vector) -> ControlMemory:
    """Stay where the vehicle is, with nothing learnt: engaging from here is no step."""
    x, y, z, psi = control.axes
    axes = (
        axis.at_rest(x, eta[X], eta_dot[X], disturbance[X]),
        axis.at_rest(y, eta[Y], eta_dot[Y], disturbance[Y]),
        axis.at_rest(z, eta[Z], eta_dot[Z], disturbance[Z]),
        axis.at_rest(psi, eta[PSI], eta_dot[PSI], disturbance[PSI]),
    )
    return ControlMemory(axes, 0.0)


def demand(
    control: Control,
    memory: ControlMemory,
    motion: Estimates,
    J: Jacobian,
    target: Setpoint,
    orders: Orders,
    dt_s: float,
) -> tuple[ControlMemory, Samples]:
    """Return the law's inside, NED; learn only where the law got what it asked, and not soon after engaging.

    J is the Jacobian at the heading where the command acts.
    """
    x, y, z, psi = control.axes
    of_x, of_y, of_z, of_psi = memory.axes
    engaged_s = memory.engaged_s + dt_s
    if orders.learns and not engaged_s >= LEARNS_AFTER_S:
        orders = orders._replace(learns=False)

    aims = (
        axis.aim(X, x, of_x, motion, target, orders, dt_s),
        axis.aim(Y, y, of_y, motion, target, orders, dt_s),
        axis.aim(Z, z, of_z, motion, target, orders, dt_s),
        axis.aim(PSI, psi, of_psi, motion, target, orders, dt_s),
    )
    nu = to_body(J, each_of_two(drag_rate, (X, Y, Z, PSI), aims, motion.eta_dot_ahead, orders.idle))
    at = Place(
        motion=motion,
        gain=each_of_two(clamped, motion.gain, LEAST_GAIN, math.inf),
        m=inertia(control.model, J),
        k_plus_h=coriolis_and_damping(control.model, J, nu),
        orders=orders,
        free=without(orders.engaged, orders.saturated),
    )
    of_x, sample_x = axis.step(X, x, of_x, aims[X], at, dt_s)
    of_y, sample_y = axis.step(Y, y, of_y, aims[Y], at, dt_s)
    of_z, sample_z = axis.step(Z, z, of_z, aims[Z], at, dt_s)
    of_psi, sample_psi = axis.step(PSI, psi, of_psi, aims[PSI], at, dt_s)
    return ControlMemory((of_x, of_y, of_z, of_psi), engaged_s), (sample_x, sample_y, sample_z, sample_psi)


def drag_rate(i: int, aim: axis.Aimed, eta_dot: Vector, idle: Flags) -> float:
    """Return the rate at which the drag is compensated: that of the reference as far as d̂ is reduced."""
    desired, left = aim
    return eta_dot[i] if idle[i] else eta_dot[i] - (1.0 - left.d_share) * (eta_dot[i] - desired.x_d_dot)


def caught_up(
    control: Control, memory: ControlMemory, where: Flags, eta: Vector, eta_dot: Vector
) -> ControlMemory:
    """Start the references of the DOFs in `where` again, at the vehicle and with its rate."""
    if not (where[X] or where[Y] or where[Z] or where[PSI]):
        return memory
    x, y, z, psi = control.axes
    of_x, of_y, of_z, of_psi = memory.axes
    axes = (
        axis.caught_up(x, of_x, eta[X], eta_dot[X]) if where[X] else of_x,
        axis.caught_up(y, of_y, eta[Y], eta_dot[Y]) if where[Y] else of_y,
        axis.caught_up(z, of_z, eta[Z], eta_dot[Z]) if where[Z] else of_z,
        axis.caught_up(psi, of_psi, eta[PSI], eta_dot[PSI]) if where[PSI] else of_psi,
    )
    return ControlMemory(axes, memory.engaged_s)


def without_thrust(memory: ControlMemory, tau_ned: Vector) -> ControlMemory:
    """Take from d̂ what a motor that gives no thrust was believed to give, N and N·m.

    The demand becomes less by it in one tick: that is no oscillation.
    """
    return ControlMemory(each_of_two(axis.without_thrust, memory.axes, tau_ned), memory.engaged_s)


def taken_over(
    old: Control, control: Control, memory: ControlMemory, motion: Estimates, J: Jacobian, target: Setpoint
) -> ControlMemory:
    """Go on with other laws or gains, without a step in thrust.

    The new law is asked at the place and time of the last tick (`motion`, J, `target`) how much more or less
    it wants than the old one did.
    """
    x, y, z, psi = map(axis.taken_over, old.axes, control.axes, memory.axes)
    known = ControlMemory((x, y, z, psi), memory.engaged_s)
    asked, _ = demand(control, known, motion, J, target, STILL, 0.0)
    return ControlMemory(each_of_two(axis.bumpless, asked.axes, memory.axes), memory.engaged_s)
