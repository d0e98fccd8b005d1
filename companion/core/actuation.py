"""From the law's wrench to the axes: what a tilt leaves of it, moments that level, the thrusters' curve."""

import math
from typing import NamedTuple

from companion.core import attitude, levelling, pace, tilt
from companion.core.allocation import (
    HALVINGS,
    ByAxis,
    Thrusters,
    allocate,
    delivered,
    overloaded,
    without,
)
from companion.core.attitude import Deviation, Held
from companion.core.bounds import limited
from companion.core.levelling import Levelling, LevellingState
from companion.core.permission import Permission, Wanted
from companion.core.positioning import by_dof
from companion.core.tilt import TiltLimit, TiltState
from companion.records import PSI, ZERO, Axes, Flags, Vector, X, Y, Z

FULL: Vector = (1.0, 1.0, 1.0, 1.0)
NONE: Flags = (False, False, False, False)
NO_AXES: Axes = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
FREE: ByAxis = (False, False, False, False, False, False)
CUT_OFF = 0.01
"""An axis that differs from what was wanted by more than this did not get it."""


class Actuation(NamedTuple):
    """What turns a wrench into axes."""

    thrusters: Thrusters
    levels: bool
    """Whether roll and pitch are ours."""
    roll: Levelling
    pitch: Levelling
    tilt_limit: TiltLimit
    max_force: tuple[float, float]
    """Of surge and sway, N."""
    righting_nm: tuple[float, float]
    """Of roll and pitch; 0 where it is not known."""
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
    """What the tilt leaves of surge, sway, heave and yaw."""
    active_wrench: Vector
    """What the law last asked while active: this is let go, evenly, whatever it would say by then."""
    wanted: Axes
    short: ByAxis
    """Axis by axis, whether more was asked than the thrusters can give."""
    command: Axes
    """What the vehicle made of the last command."""
    beside: Axes
    """Of it what is the pilot's."""
    delivered: Vector
    """Body wrench that the last command, with the pilot's share, should have given, N and N·m."""
    saturated: Flags
    """By degree of freedom, whether the law did not get what it asked for."""
    dead_motor: int
    """Number of the motor around which is allocated; 0 for none."""


class Limits(NamedTuple):
    """What thrust and tilt leave of the reference."""

    pace: Vector
    """The share of its largest rates."""
    off_track: Flags
    """Where it starts again at the vehicle, which cannot follow."""


NO_LIMITS = Limits(FULL, NONE)


class Tilting(NamedTuple):
    """How the vehicle leans, and how what levels it answers: rad, rad/s, V, s."""

    roll: float
    pitch: float
    p: float
    q: float
    turn_radps: float
    """Rate of the heading."""
    voltage_v: float
    delay_s: float
    gain: float
    lag_s: float
    adapts: bool
    """Whether what is found of the vehicle is used."""


def start(actuation: Actuation) -> ActuationMemory:
    """Return the memory of one that has sent nothing."""
    return ActuationMemory(
        tilt.start(actuation.tilt_limit),
        attitude.HELD_LEVEL,
        levelling.START,
        levelling.START,
        FULL,
        FULL,
        ZERO,
        NO_AXES,
        FREE,
        NO_AXES,
        NO_AXES,
        ZERO,
        NONE,
        0,
    )


def step(
    actuation: Actuation,
    memory: ActuationMemory,
    requested: Vector,
    permission: Permission,
    wanted: Wanted,
    lean: Tilting,
    away_m: float,
    dt_s: float,
) -> tuple[ActuationMemory, Axes, Limits]:
    """Return the axes for the level wrench `requested`, and what thrust and tilt leave of the reference.

    Roll and pitch are to be held at the angles `wanted`; the tilt that counts is the deviation from them.

    The reference is `away_m` from the vehicle, horizontally: while the horizontal force is limited it stays
    near, and what is let go is not pulled at. Heave is always ours.
    """
    active_wrench = requested if permission.active else memory.active_wrench
    rests = permission.authority == 0.0
    of_tilt = tilt.start(actuation.tilt_limit) if rests else memory.tilt
    roll = levelling.rested(memory.roll) if rests else memory.roll
    pitch = levelling.rested(memory.pitch) if rests else memory.pitch

    held = attitude.HELD_LEVEL if rests else attitude.step(memory.held, wanted.angles, dt_s)
    off = attitude.deviation(held, lean.roll, lean.pitch, lean.p, lean.q, lean.turn_radps)
    angle = tilt.coming_tilt(off.roll, off.pitch, off.p, off.q)
    pushed_n, asked_n = _level(memory.delivered), _level(active_wrench)
    of_tilt = tilt.step(actuation.tilt_limit, of_tilt, angle, pushed_n, dt_s)
    most_n = tilt.allowed_n(of_tilt, angle)
    level = most_n / asked_n if asked_n > most_n else 1.0
    upright = tilt.share(angle, tilt.YAW_LEVEL_RAD, tilt.YAW_STEEP_RAD)
    own_pace, limits = _limits(memory, angle, level < 1.0, upright == 0.0, away_m, dt_s)

    surge, sway, heave, N = active_wrench if permission.releases else requested
    along_axes = attitude.body_force(held, (level * surge, level * sway, heave))
    force = tilt.body_force(off.roll, off.pitch, angle, along_axes)
    K, M = 0.0, 0.0
    if actuation.levels:
        engaged, full = wanted.engaged, permission.authority == 1.0
        turn = upright * N / actuation.yaw_inertia
        inertia, (k_roll, k_pitch) = actuation.roll.inertia, actuation.righting_nm
        beside = attitude.roll_moment(held, inertia / lean.gain, k_roll, inertia * turn)
        roll, K = _levelled(actuation, memory, held, roll, Y, force, engaged, full, lean, off, beside, dt_s)
        inertia = actuation.pitch.inertia
        beside = attitude.pitch_moment(held, inertia / lean.gain, k_pitch, inertia * turn)
        pitch, M = _levelled(actuation, memory, held, pitch, X, force, engaged, full, lean, off, beside, dt_s)
    N = attitude.upright_share(held) * (upright * N)
    share = permission.authority
    asked = (share * force[X], share * force[Y], share * force[Z], share * N, share * K, share * M)
    thrusters = without(actuation.thrusters, memory.dead_motor)
    axes, short = allocate(thrusters, asked, lean.voltage_v, permission.reach)
    yaw = axes[PSI]
    if memory.dead_motor > 0 and any_of(memory.beside) and math.isfinite(asked[PSI]):
        yaw = _yaw_beside(thrusters, memory.beside, asked[PSI], lean.voltage_v, permission.reach[PSI])
    if not wanted.engaged[PSI]:  # unequal curves ask for a little, of a heading not ours
        yaw = 0.0
    axes = (axes[0], axes[1], axes[2], yaw, axes[4], axes[5])
    return (
        ActuationMemory(
            of_tilt,
            held,
            roll,
            pitch,
            own_pace,
            (level, level, 1.0, upright),
            active_wrench,
            axes,
            short,
            memory.command,
            memory.beside,
            memory.delivered,
            memory.saturated,
            memory.dead_motor,
        ),
        axes,
        limits,
    )


def sent(
    actuation: Actuation, memory: ActuationMemory, command: Axes, lean: Tilting, held: ByAxis
) -> tuple[ActuationMemory, Vector]:
    """Take what the vehicle makes of the command that went out; axes that are not `held` are the pilot's.

    Return the wrench that it gives in the level frame of the heading, N and N·m.
    """
    thrusters = without(actuation.thrusters, memory.dead_motor)
    surge, sway, heave, N, _, _ = delivered(thrusters, command, lean.voltage_v)
    over, wanted, short, share = overloaded(thrusters, command), memory.wanted, memory.short, memory.share
    less = (
        over[0] or short[0] or abs(command[0] - wanted[0]) > CUT_OFF or share[0] < 1.0,
        over[1] or short[1] or abs(command[1] - wanted[1]) > CUT_OFF or share[1] < 1.0,
        over[2] or short[2] or abs(command[2] - wanted[2]) > CUT_OFF or share[2] < 1.0,
        over[3] or short[3] or abs(command[3] - wanted[3]) > CUT_OFF or share[3] < 1.0,
    )
    if not attitude.is_straight(memory.held):
        any_force = less[0] or less[1] or less[2]
        less = (any_force, any_force, any_force, less[3])
    N = N / attitude.upright_share(memory.held)
    beside = (
        0.0 if held[0] else command[0],
        0.0 if held[1] else command[1],
        0.0 if held[2] else command[2],
        0.0 if held[3] else command[3],
        0.0 if held[4] else command[4],
        0.0 if held[5] else command[5],
    )
    x, y, z = tilt.level_force(lean.roll, lean.pitch, (surge, sway, heave))
    return (
        ActuationMemory(
            memory.tilt,
            memory.held,
            memory.roll,
            memory.pitch,
            memory.pace,
            share,
            memory.active_wrench,
            wanted,
            short,
            command,
            beside,
            (surge, sway, heave, N),
            by_dof(less),
            memory.dead_motor,
        ),
        (x, y, z, N),
    )


def gone_on_without(
    actuation: Actuation, memory: ActuationMemory, motor: int, lean: Tilting
) -> tuple[ActuationMemory, Vector]:
    """Allocate around a motor that gives no thrust, or none for 0, without a step in what is given.

    Return what the last command gave less than was believed, as `sent` does. Where the others cannot do the
    motor's work (`allocation.can_lose`), everything stays as it is.
    """
    command = memory.command
    believed = delivered(without(actuation.thrusters, memory.dead_motor), command, lean.voltage_v)
    given = delivered(without(actuation.thrusters, motor), command, lean.voltage_v)
    surge, sway, heave = believed[0] - given[0], believed[1] - given[1], believed[2] - given[2]
    N, K, M = believed[3] - given[3], believed[4] - given[4], believed[5] - given[5]
    roll, pitch = memory.roll, memory.pitch
    if actuation.levels:
        roll = levelling.trimmed(roll, K / actuation.roll.inertia)
        pitch = levelling.trimmed(pitch, M / actuation.pitch.inertia)
    N = N / attitude.upright_share(memory.held)
    x, y, z = tilt.level_force(lean.roll, lean.pitch, (surge, sway, heave))
    return (
        ActuationMemory(
            memory.tilt,
            memory.held,
            roll,
            pitch,
            memory.pace,
            memory.share,
            memory.active_wrench,
            memory.wanted,
            memory.short,
            command,
            memory.beside,
            memory.delivered,
            memory.saturated,
            motor,
        ),
        (x, y, z, N),
    )


def any_of(axes: Axes) -> bool:
    """Tell whether any axis differs from zero."""
    return bool(axes[0] or axes[1] or axes[2] or axes[3] or axes[4] or axes[5])


def _level(tau: Vector) -> float:
    """Return the horizontal force of a wrench, N."""
    return math.sqrt(tau[0] * tau[0] + tau[1] * tau[1])


def _limits(
    memory: ActuationMemory, angle: float, limited_: bool, overturned: bool, away_m: float, dt_s: float
) -> tuple[Vector, Limits]:
    """Return the pace that saturation leaves, and what the reference may do at a tilt of `angle`."""
    own, cut = memory.pace, memory.saturated
    x, y = pace.step(own[X], cut[X], dt_s), pace.step(own[Y], cut[Y], dt_s)
    z, psi = pace.step(own[Z], cut[Z], dt_s), pace.step(own[PSI], cut[PSI], dt_s)
    left = tilt.share(angle)
    allowed = (pace.on_a_tilt(x, left), pace.on_a_tilt(y, left), pace.on_a_tilt(z, left), psi)
    far = limited_ and away_m > tilt.FOLLOWS_M
    return (x, y, z, psi), Limits(allowed, (far, far, False, limited_ and overturned))


def _levelled(
    actuation: Actuation,
    memory: ActuationMemory,
    held: Held,
    state: LevellingState,
    along: int,
    force: tilt.Force,
    engaged: Flags,
    full: bool,
    lean: Tilting,
    off: Deviation,
    beside: float,
    dt_s: float,
) -> tuple[LevellingState, float]:
    """Return the moment that keeps roll or pitch at its angle beside the force `along` sway or surge.

    `beside` is what the angle takes of it; the lever is found while the vehicle is level. On an axis that is
    not held the pilot's force counts. The thrusters that level are those of heave: a vehicle that answers
    more strongly or weakly there is taken to do so in roll and pitch.
    """
    push = force[along] if engaged[along] else memory.delivered[along]
    angle, rate = (off.roll, off.p) if along == Y else (off.pitch, off.q)
    return levelling.step(
        actuation.roll if along == Y else actuation.pitch,
        state,
        angle,
        rate,
        limited(push, actuation.max_force[along]),
        lean.delay_s,
        dt_s,
        full,
        lean.gain,
        lean.lag_s,
        lean.adapts,
        beside,
        attitude.is_straight(held),
    )


def _yaw_beside(thrusters: Thrusters, beside: Axes, N: float, voltage_v: float, reach: float) -> float:
    """Return the yaw axis for a moment beside the pilot's axes, which turn a vehicle without a motor."""
    low, high = -reach, reach
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        axes = (beside[0], beside[1], beside[2], middle, beside[4], beside[5])
        if delivered(thrusters, axes, voltage_v)[3] < N:
            low = middle
        else:
            high = middle
    return low
