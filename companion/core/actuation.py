"""From the law's wrench to the axes: what a tilt leaves of it, moments that level, the thrusters' curve."""

import math
from typing import NamedTuple

from companion.core import attitude, levelling, tilt
from companion.core.allocation import (
    HALVINGS,
    ByAxis,
    Thrusters,
    allocate,
    as_found,
    delivered,
    overloaded,
)
from companion.core.attitude import Deviation, Held
from companion.core.bounds import limited
from companion.core.four import each, each_of_two
from companion.core.levelling import Levelling, LevellingState, Response, Turn
from companion.core.permission import Permission, Wanted
from companion.core.positioning import by_dof
from companion.core.tilt import Force, TiltLimit, TiltState
from companion.records import PSI, ZERO, Axes, Flags, Vector, X, Y, Z

FULL: Vector = (1.0, 1.0, 1.0, 1.0)
NONE: Flags = (False, False, False, False)
NO_AXES: Axes = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
CUT_OFF = 0.01
"""An axis that differs from what was wanted by more than this did not get it."""


class Actuation(NamedTuple):
    """What turns a wrench into axes."""

    thrusters: Thrusters
    levels: bool
    """Whether Holdfast controls roll and pitch."""
    roll: Levelling
    pitch: Levelling
    tilt_limit: TiltLimit
    max_force: tuple[float, float]
    """Surge and sway, N."""
    righting_nm: tuple[float, float]
    """Righting moments of roll and pitch; 0: not known."""
    yaw_inertia: float
    """kg m²."""


class ActuationMemory(NamedTuple):
    """What is remembered."""

    tilt: TiltState
    held: Held
    """The angles at which roll and pitch are held."""
    roll: LevellingState
    pitch: LevellingState
    pace: Vector
    """Share of the reference's rate that saturation leaves."""
    share: Vector
    """Shares of surge, sway, heave and yaw that the tilt leaves."""
    active_wrench: Vector
    """The last force while active. On release it falls to zero from this value, whatever the law asks."""
    wanted: Axes
    shortfall: ByAxis
    """Axis by axis, whether more was asked than the thrusters can give."""
    command: Axes
    """The last command, as the vehicle applies it."""
    pilots: Axes
    """The pilot's part of it."""
    delivered: Vector
    """Body wrench that the last command, with the pilot's share, should have given, N and N·m."""
    saturated: Flags
    """Whether the law did not get the force that it asked for, by degree of freedom."""
    dead_motor: int
    """Number of the motor around which is allocated; 0 for none."""
    reversed_motor: int
    """Number of the motor that is used the other way round; 0 for none."""


class Limits(NamedTuple):
    """What thrust and tilt leave of the reference."""

    pace: Vector
    """The share of its largest rates."""
    off_track: Flags
    """Whether the reference starts again at the vehicle, which cannot follow."""


NO_LIMITS = Limits(FULL, NONE)


class Tilt(NamedTuple):
    """How the vehicle is tilted, and how what levels it answers: rad, rad/s, V."""

    roll: float
    pitch: float
    p: float
    q: float
    turn_radps: float
    """Rate of the heading."""
    voltage_v: float
    response: Response


def start(actuation: Actuation) -> ActuationMemory:
    """Return the memory of one that has sent nothing."""
    return ActuationMemory(
        tilt=tilt.start(actuation.tilt_limit),
        held=attitude.HELD_LEVEL,
        roll=levelling.START,
        pitch=levelling.START,
        pace=FULL,
        share=FULL,
        active_wrench=ZERO,
        wanted=NO_AXES,
        shortfall=(False, False, False, False, False, False),
        command=NO_AXES,
        pilots=NO_AXES,
        delivered=ZERO,
        saturated=NONE,
        dead_motor=0,
        reversed_motor=0,
    )


def actuate(
    actuation: Actuation,
    memory: ActuationMemory,
    requested: Vector,
    permission: Permission,
    wanted: Wanted,
    at: Tilt,
    away_m: float,
    dt_s: float,
) -> tuple[ActuationMemory, Axes, Limits]:
    """Return the axes for the level wrench `requested`, and what thrust and tilt leave of the reference.

    Roll and pitch are to be held at the angles `wanted`; the tilt that counts is the deviation from them.
    The reference is `away_m` from the vehicle, horizontally.
    """
    rests, learns = permission.authority == 0.0, permission.authority == 1.0
    if rests:
        memory = rested(actuation, memory)
    held = attitude.HELD_LEVEL if rests else attitude.approach(memory.held, wanted.angles, dt_s)
    off = attitude.deviation(held, at.roll, at.pitch, at.p, at.q, at.turn_radps)
    angle = tilt.coming_tilt(off.roll, off.pitch, off.p, off.q)
    active_wrench = requested if permission.active else memory.active_wrench
    of_tilt, share = tilt_share(actuation, memory, active_wrench, angle, dt_s)
    pace, limits = paced(memory, angle, share, away_m, dt_s)

    surge, sway, heave, N = active_wrench if permission.releases else requested
    along_axes = attitude.body_force(held, (share[X] * surge, share[Y] * sway, heave))
    force, N = tilt.body_force(off.roll, off.pitch, angle, along_axes), share[PSI] * N
    roll, pitch, K, M = memory.roll, memory.pitch, 0.0, 0.0
    if actuation.levels:
        rolls, pitches = turns(
            actuation, held, off, pushed(memory, wanted, force), N, learns, at.response.gain
        )
        roll, K = levelling.level(actuation.roll, roll, rolls, at.response, dt_s)
        pitch, M = levelling.level(actuation.pitch, pitch, pitches, at.response, dt_s)
    a, N = permission.authority, attitude.upright_share(held) * N
    tau = (a * force[X], a * force[Y], a * force[Z], a * N, a * K, a * M)
    axes, shortfall = allocated(actuation, memory, tau, at.voltage_v, permission.reach, wanted.engaged[PSI])
    memory = memory._replace(
        tilt=of_tilt,
        held=held,
        roll=roll,
        pitch=pitch,
        pace=pace,
        share=share,
        active_wrench=active_wrench,
        wanted=axes,
        shortfall=shortfall,
    )
    return memory, axes, limits


def rested(actuation: Actuation, memory: ActuationMemory) -> ActuationMemory:
    """Return the memory of one that nobody steers: what was found of its levers stays."""
    return memory._replace(
        tilt=tilt.start(actuation.tilt_limit),
        roll=levelling.rested(memory.roll),
        pitch=levelling.rested(memory.pitch),
    )


def tilt_share(
    actuation: Actuation, memory: ActuationMemory, asked: Vector, angle: float, dt_s: float
) -> tuple[TiltState, Vector]:
    """Return what a tilt of `angle` leaves of surge, sway, heave and yaw. Heave is always ours."""
    of_tilt = tilt.find_limit(actuation.tilt_limit, memory.tilt, angle, level_n(memory.delivered), dt_s)
    most_n, asked_n = tilt.allowed_n(of_tilt, angle), level_n(asked)
    level = most_n / asked_n if asked_n > most_n else 1.0
    return of_tilt, (level, level, 1.0, tilt.share(angle, tilt.YAW_LEVEL_RAD, tilt.YAW_STEEP_RAD))


def level_n(tau: Vector) -> float:
    """Return the horizontal force of a wrench, N."""
    return math.sqrt(tau[X] * tau[X] + tau[Y] * tau[Y])


def paced(
    memory: ActuationMemory, angle: float, share: Vector, away_m: float, dt_s: float
) -> tuple[Vector, Limits]:
    """Return the pace that saturation leaves, and what the reference may do at a tilt of `angle`.

    While the horizontal force is limited the reference waits for the vehicle: the law asks for no more than
    it can get.
    """
    x, y, z, psi = pace = each_of_two(tilt.pace, memory.pace, memory.saturated, dt_s)
    left, limits = tilt.share(angle), share[X] < 1.0
    allowed = (tilt.slowed(x, left), tilt.slowed(y, left), tilt.slowed(z, left), psi)
    far = limits and away_m > tilt.FOLLOWS_M
    return pace, Limits(allowed, (far, far, False, limits and share[PSI] == 0.0))


def pushed(memory: ActuationMemory, wanted: Wanted, force: Force) -> tuple[float, float]:
    """Return the force along surge and sway, N: the pilot's on an axis that is not held."""
    surge = force[X] if wanted.engaged[X] else memory.delivered[X]
    return surge, force[Y] if wanted.engaged[Y] else memory.delivered[Y]


def turns(
    actuation: Actuation,
    held: Held,
    off: Deviation,
    push: tuple[float, float],
    N: float,
    learns: bool,
    gain: float,
) -> tuple[Turn, Turn]:
    """Return what keeps roll and pitch at their angles has to answer."""
    turn, straight = N / actuation.yaw_inertia, attitude.is_straight(held)
    I_x, I_y, (k_x, k_y) = actuation.roll.inertia, actuation.pitch.inertia, actuation.righting_nm
    surge, sway = limited(push[X], actuation.max_force[X]), limited(push[Y], actuation.max_force[Y])
    K = attitude.roll_moment(held, I_x / gain, k_x, I_x * turn)
    M = attitude.pitch_moment(held, I_y / gain, k_y, I_y * turn)
    return (
        Turn(angle=off.roll, rate=off.p, force=sway, moment=K, learns=learns, straight=straight),
        Turn(angle=off.pitch, rate=off.q, force=surge, moment=M, learns=learns, straight=straight),
    )


def allocated(
    actuation: Actuation, memory: ActuationMemory, tau: Axes, voltage_v: float, reach: Axes, turns: bool
) -> tuple[Axes, ByAxis]:
    """Return the axes for a body wrench; yaw is ours where it `turns`, and beside the pilot's axes."""
    thrusters = as_found(actuation.thrusters, memory.dead_motor, memory.reversed_motor)
    axes, shortfall = allocate(thrusters, tau, voltage_v, reach)
    yaw = axes[PSI]
    if memory.dead_motor + memory.reversed_motor > 0 and memory.pilots != NO_AXES and math.isfinite(tau[PSI]):
        yaw = yaw_beside(thrusters, memory.pilots, tau[PSI], voltage_v, reach[PSI])
    if not turns:  # the autopilot holds the heading; unequal thrust curves leave a small demand of yaw
        yaw = 0.0
    return with_yaw(axes, yaw), shortfall


def with_yaw(axes: Axes, yaw: float) -> Axes:
    """Return the axes with another demand on yaw."""
    return (axes[0], axes[1], axes[2], yaw, axes[4], axes[5])


def yaw_beside(thrusters: Thrusters, pilots: Axes, N: float, voltage_v: float, reach: float) -> float:
    """Return the yaw axis for a moment beside the pilot's axes, which turn a vehicle without a motor."""
    low, high = -reach, reach
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if delivered(thrusters, with_yaw(pilots, middle), voltage_v)[PSI] < N:
            low = middle
        else:
            high = middle
    return low


def sent(
    actuation: Actuation, memory: ActuationMemory, command: Axes, at: Tilt, held: ByAxis
) -> tuple[ActuationMemory, Vector]:
    """Take what the vehicle makes of the command that went out; axes that are not `held` are the pilot's.

    Return the wrench that it gives in the level frame of the heading, N and N·m.
    """
    thrusters = as_found(actuation.thrusters, memory.dead_motor, memory.reversed_motor)
    less = each(fell_short, (0, 1, 2, 3), memory, command, overloaded(thrusters, command))
    if not attitude.is_straight(memory.held):
        any_force = less[0] or less[1] or less[2]
        less = (any_force, any_force, any_force, less[3])
    pilots = (
        0.0 if held[0] else command[0],
        0.0 if held[1] else command[1],
        0.0 if held[2] else command[2],
        0.0 if held[3] else command[3],
        0.0 if held[4] else command[4],
        0.0 if held[5] else command[5],
    )
    surge, sway, heave, N, _, _ = delivered(thrusters, command, at.voltage_v)
    N = N / attitude.upright_share(memory.held)
    given, saturated = (surge, sway, heave, N), by_dof(less)
    memory = memory._replace(command=command, pilots=pilots, delivered=given, saturated=saturated)
    return memory, level_wrench(at, given)


def fell_short(axis: int, memory: ActuationMemory, command: Axes, over: ByAxis) -> bool:
    """Tell whether an axis did not get what the law asked for."""
    cut = over[axis] or memory.shortfall[axis]
    return cut or abs(command[axis] - memory.wanted[axis]) > CUT_OFF or memory.share[axis] < 1.0


def level_wrench(at: Tilt, tau: Vector) -> Vector:
    """Return what a wrench along the body's axes is in the level frame of the heading, N and N·m."""
    surge, sway, heave, N = tau
    x, y, z = tilt.level_force(at.roll, at.pitch, (surge, sway, heave))
    return (x, y, z, N)


def gone_on_with(
    actuation: Actuation, memory: ActuationMemory, dead: int, reversed_motor: int, at: Tilt
) -> tuple[ActuationMemory, Vector]:
    """Allocate as the motors were found, without a step in what is given (`allocation.as_found`).

    Return what the last command gave less than was believed, as `sent` does.
    """
    whole, command = actuation.thrusters, memory.command
    before = as_found(whole, memory.dead_motor, memory.reversed_motor)
    believed = delivered(before, command, at.voltage_v)
    given = delivered(as_found(whole, dead, reversed_motor), command, at.voltage_v)
    surge, sway, heave = believed[0] - given[0], believed[1] - given[1], believed[2] - given[2]
    N, K, M = believed[3] - given[3], believed[4] - given[4], believed[5] - given[5]
    roll, pitch = memory.roll, memory.pitch
    if reversed_motor + memory.reversed_motor > 0:
        roll, pitch = levelling.rested(roll), levelling.rested(pitch)
    elif actuation.levels:
        roll = levelling.trimmed(actuation.roll, roll, K)
        pitch = levelling.trimmed(actuation.pitch, pitch, M)
    N = N / attitude.upright_share(memory.held)
    memory = memory._replace(roll=roll, pitch=pitch, dead_motor=dead, reversed_motor=reversed_motor)
    return memory, level_wrench(at, (surge, sway, heave, N))
