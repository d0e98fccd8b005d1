"""Roll and pitch held at an angle: the reference, and what an angle changes of a law that works level.

The law pushes north, east, down, and turns about the vertical. A vehicle that is held at φ_d, θ_d gives that
along its own axes (Fossen 2011, 2.2), and levelling takes what is left as if the vehicle hung level:

    f_b = R(φ_d, θ_d)ᵀ f                                               forces
    N_b = cos φ_d cos θ_d N                                            a turn about the vertical
    K = I_x φ_d'' + k_x sin φ_d cos θ_d − (I_x / I_z) sin θ_d N        beside what levels
    M = I_y θ_d'' + k_y sin θ_d + (I_y / I_z) sin φ_d cos θ_d N
    e = (φ − φ_d, (θ − θ_d) cos φ_d)                                   about the body's x and y
    e' = (p − φ_d' + ψ' sin θ_d, q − θ_d' cos φ_d − ψ' sin φ_d cos θ_d)

| symbol       | meaning                                                       | unit          |
|--------------|---------------------------------------------------------------|---------------|
| φ_d, θ_d     | reference of roll and pitch                                   | rad           |
| f, f_b       | force, level in the frame of the heading and along the body   | N             |
| N, K, M      | moments: about the vertical (N_b: the body's z), x and y      | N·m           |
| I_x, I_y, I_z| inertia with the added mass                                   | kg m²         |
| k_x, k_y     | what rights the vehicle; 0 where it is not known: levelling's integral finds it | N·m |
"""

import math
from typing import NamedTuple

from companion.core import reference
from companion.core.tilt import Force
from companion.records import LEVEL, Angles

MAX_ANGLE_RAD = math.radians(55.0)
"""Largest roll and pitch. Beyond it too little of the thrust is left for depth, place and heading."""

MAX_MOMENT_SHARE = 0.5
"""Share of the largest levelling moment that righting may take at the angle; the rest is for waves."""

STRAIGHT_RAD = math.radians(10.0)
"""Tilt beyond which what was learnt of the level vehicle does not hold."""

LIMITS = reference.Parameters(max_rate=math.radians(20.0), max_acceleration=math.radians(20.0), angular=False)


class Held(NamedTuple):
    """The references of roll and pitch, rad."""

    roll: reference.ReferenceState
    pitch: reference.ReferenceState


class Deviation(NamedTuple):
    """Deviation from the held angles about the body's axes, rad, and its rate, rad/s."""

    roll: float
    pitch: float
    p: float
    q: float


MIN_COS_PITCH = 0.1
"""Keeps θ off the singularity."""

HELD_LEVEL = Held(reference.start(LIMITS, 0.0, 0.0), reference.start(LIMITS, 0.0, 0.0))


def angle_rates(roll: float, pitch: float, p: float, q: float, r: float) -> tuple[float, float, float]:
    """Return φ', θ', ψ' (rad/s) from the rates about the body's axes (Fossen 2011, eq. 2.28)."""
    s, c = math.sin(roll), math.cos(roll)
    turn = (q * s + r * c) / max(math.cos(pitch), MIN_COS_PITCH)
    return p + math.sin(pitch) * turn, q * c - r * s, turn


def approach(held: Held, wanted: Angles, dt_s: float) -> Held:
    """Move the references toward what is wanted."""
    if wanted == LEVEL and held == HELD_LEVEL:
        return held
    return Held(
        reference.advance(LIMITS, held.roll, wanted.roll, 0.0, 0.0, 1.0, dt_s),
        reference.advance(LIMITS, held.pitch, wanted.pitch, 0.0, 0.0, 1.0, dt_s),
    )


def angles(held: Held) -> Angles:
    """Return φ_d and θ_d."""
    return Angles(held.roll.x_d, held.pitch.x_d)


def is_straight(held: Held) -> bool:
    """Tell whether the held angles are small."""
    return abs(held.roll.x_d) < STRAIGHT_RAD and abs(held.pitch.x_d) < STRAIGHT_RAD


def deviation(held: Held, roll: float, pitch: float, p: float, q: float, turn_radps: float) -> Deviation:
    """Return e and e' for the measured attitude and body rates, and ψ'."""
    roll_d, pitch_d = held.roll.x_d, held.pitch.x_d
    sin_roll, cos_roll = math.sin(roll_d), math.cos(roll_d)
    return Deviation(
        roll - roll_d,
        (pitch - pitch_d) * cos_roll,
        p - held.roll.x_d_dot + turn_radps * math.sin(pitch_d),
        q - held.pitch.x_d_dot * cos_roll - turn_radps * sin_roll * math.cos(pitch_d),
    )


def body_force(held: Held, force: Force) -> Force:
    """Return f_b: forward, right, down of the vehicle that is held so."""
    X, Y, Z = force
    sin_roll, cos_roll = math.sin(held.roll.x_d), math.cos(held.roll.x_d)
    sin_pitch, cos_pitch = math.sin(held.pitch.x_d), math.cos(held.pitch.x_d)
    upright = sin_pitch * X + cos_pitch * Z
    return cos_pitch * X - sin_pitch * Z, cos_roll * Y + sin_roll * upright, cos_roll * upright - sin_roll * Y


def upright_share(held: Held) -> float:
    """Return N_b / N."""
    return math.cos(held.roll.x_d) * math.cos(held.pitch.x_d)


def roll_moment(held: Held, inertia: float, righting_nm: float, turn_nm: float) -> float:
    """Return K, N·m; `turn_nm` is N I_x / I_z."""
    roll_d, pitch_d = held.roll.x_d, held.pitch.x_d
    rights = righting_nm * math.sin(roll_d) * math.cos(pitch_d)
    return inertia * held.roll.x_d_ddot + rights - math.sin(pitch_d) * turn_nm


def pitch_moment(held: Held, inertia: float, righting_nm: float, turn_nm: float) -> float:
    """Return M, N·m; `turn_nm` is N I_y / I_z."""
    roll_d, pitch_d = held.roll.x_d, held.pitch.x_d
    turns = math.sin(roll_d) * math.cos(pitch_d) * turn_nm
    return inertia * held.pitch.x_d_ddot + righting_nm * math.sin(pitch_d) + turns


def most_rad(righting_nm: float, max_moment_nm: float) -> float:
    """Return the largest angle that may be held against what rights the vehicle."""
    if MAX_MOMENT_SHARE * max_moment_nm >= righting_nm * math.sin(MAX_ANGLE_RAD):
        return MAX_ANGLE_RAD
    return math.asin(MAX_MOMENT_SHARE * max_moment_nm / righting_nm)
