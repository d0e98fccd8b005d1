"""What a tilt leaves of thrust that the law means level: functions of the measured tilt.

The horizontal thrusters push below the centre of gravity, and a vehicle that moves through the water at u
is turned by the Munk moment (Za − Xa) u w (Fossen 2011, 6.3). Both grow with speed; the moment that rights an
ROV is 1 to 2 N·m/rad. A BlueROV2 with six thrusters, which nobody keeps from pitching, is unstable head-on
above 0.46 m/s, and at 0.22 m/s waves with w = 0.2 m/s pitch it by 15°. So horizontal force and speed shrink
with the tilt: what is left is a vehicle that drifts level and keeps its depth and heading. Where roll and
pitch are levelled this is hardly ever felt.
"""

import math
from typing import NamedTuple

from companion.core.bounds import clamped

Force = tuple[float, float, float]
"""Along three axes, N."""

LEVEL_RAD, STEEP_RAD = math.radians(12.0), math.radians(25.0)
"""Horizontal force and the reference's speed are whole up to here, nothing from there on. With 8° and 20° a
place that swings in a current was lost to a tilt that the vehicle bears (tests/closed_loop/test_place.py)."""

YAW_LEVEL_RAD, YAW_STEEP_RAD = math.radians(40.0), math.radians(60.0)
"""Yaw is whole up to here, nothing from there on: its thrust stays level for longer."""

ALARM_RAD, UNLEVELLED_ALARM_RAD, CALM = math.radians(20.0), math.radians(12.0), 0.6
"""A tilt above it says that the force is too large for the vehicle; below CALM times it that this is over.
At 7° one that nobody levels let its place go in most seas; at 15° waves and a current tilted it by 40°."""

CUT, MEMORY_S, LEAST_N = 0.6, 2.0, 1.0
FAST_N_PER_S, SLOW_N_PER_S = 1.0, 0.05
LEVELLED_N_PER_S = 5.0
"""A current of 0.5 m/s takes 60 N: what a tilt took of it has to be back before the vehicle is far away."""

UNLEVELLED_N = 2.0
"""What is tried first where nobody keeps the vehicle from pitching."""

FOLLOWS_M = 0.5
"""Largest distance of the reference while the horizontal force is limited; beyond it, it follows."""

AHEAD_S = 0.3
"""A tilt is predicted by this time: twice the thrusters' lag and the way to them."""

LEAST_PACE = 0.2
"""The reference never stops: a vehicle that stays tilted still comes up."""

SLOW_DOWN_S, RECOVER_S = 0.5, 4.0
"""How fast the pace of a degree of freedom falls while it saturates, and comes back."""

PART_FROM_RAD, PART_WHOLE_RAD = math.radians(4.0), math.radians(10.0)
MIN_COS = 0.5


def cos_tilt(roll: float, pitch: float) -> float:
    """Return the cosine of the angle between the body's z axis and the vertical; angles in rad."""
    return math.cos(roll) * math.cos(pitch)


def coming_tilt(roll: float, pitch: float, p: float, q: float) -> float:
    """Return the larger of the tilt now and AHEAD_S later, rad; angles in rad, body rates in rad/s."""
    now, later = cos_tilt(roll, pitch), cos_tilt(roll + AHEAD_S * p, pitch + AHEAD_S * q)
    return math.acos(clamped(now if now < later else later, -1.0, 1.0))


def share(tilt: float, level: float = LEVEL_RAD, steep: float = STEEP_RAD) -> float:
    """Return 1 up to `level`, 0 from `steep` on, smooth between (rad); 0 for a tilt that is not known."""
    if not tilt < steep:
        return 0.0
    if tilt <= level:
        return 1.0
    s = (tilt - level) / (steep - level)
    return 1.0 - s * s * (3.0 - 2.0 * s)


def body_force(roll: float, pitch: float, tilt: float, force: Force) -> Force:
    """Return what to push along the body's axes for a level `force`: forward, right, down (N).

    Along a tilted body's z axis heave also pushes sideways, and a load then drags it the same way: it glides,
    and gliding it is tilted further (Munk). So the horizontal thrusters take their part of heave, except at a
    small tilt, where they would only chatter in their dead band, and at a large one. The rest goes along z:
    divided by the cosine, up to twofold; on its side nothing, overturned the other way round.
    """
    X, Y, Z = force
    sin_roll, sin_pitch = math.sin(roll), math.sin(pitch)
    part = (1.0 - share(tilt, PART_FROM_RAD, PART_WHOLE_RAD)) * share(tilt, YAW_LEVEL_RAD, YAW_STEEP_RAD)
    X = X - part * sin_pitch * Z
    Y = Y + part * sin_roll * Z
    cos = math.cos(roll) * math.cos(pitch)
    along_z = Z + sin_pitch * X - sin_roll * math.cos(pitch) * Y
    return X, Y, along_z * cos / max(cos * cos, MIN_COS * MIN_COS)


def level_force(roll: float, pitch: float, force: Force) -> Force:
    """Return what `force` along the body's axes pushes in the level frame of the heading (Fossen 2.18), N."""
    X, Y, Z = force
    sin_roll, cos_roll = math.sin(roll), math.cos(roll)
    sin_pitch, cos_pitch = math.sin(pitch), math.cos(pitch)
    upright = sin_roll * Y + cos_roll * Z
    return (
        cos_pitch * X + sin_pitch * upright,
        cos_roll * Y - sin_roll * Z,
        cos_pitch * upright - sin_pitch * X,
    )


class TiltLimit(NamedTuple):
    """The largest horizontal force (N) at which a vehicle stays level enough, found as it tilts.

    `start_n` and from there FAST_N_PER_S up to `most_n`, until the tilt alarms: then the limit is a share of
    what was pushed of late, and rises by `again_n_per_s`. Where nobody levels the vehicle that is slow: so
    waves, which tilt it again and again, find it drifting and not pitching. Where it is levelled a tilt is a
    transient, such as stopping a drift on engaging: then the place is soon held again.
    """

    start_n: float
    most_n: float
    alarm_rad: float
    again_n_per_s: float
    levelled: bool = False
    """Then the limit is a share of what is pushed now, where that is more (on engaging the mean is low), and
    never below the mean: that is what a current takes, and the vehicle was level with it."""


class TiltState(NamedTuple):
    """What was found."""

    limit_n: float
    borne_n: float
    """The force without a tilt alarm since the last one; infinite before the first."""
    pushed_n: float
    """Mean of what was pushed over MEMORY_S."""
    alarmed: bool


def start(limit: TiltLimit) -> TiltState:
    """Return the state in which this force is not known."""
    return TiltState(limit.start_n, math.inf, 0.0, False)


def find_limit(limit: TiltLimit, state: TiltState, tilt: float, pushed_n: float, dt_s: float) -> TiltState:
    """Take one tick's tilt (rad) and the force that was pushed."""
    now_n = pushed_n if limit.levelled else 0.0
    pushed_n = state.pushed_n + (pushed_n - state.pushed_n) * dt_s / (dt_s + MEMORY_S)
    limit_n, borne_n = state.limit_n, state.borne_n
    if tilt > limit.alarm_rad and not state.alarmed:
        least_n = min(limit_n, pushed_n) if limit.levelled else 0.0
        borne_n = max(CUT * min(limit_n, max(now_n, pushed_n, LEAST_N)), least_n)
        limit_n = borne_n
    alarmed = tilt > limit.alarm_rad * (CALM if state.alarmed else 1.0)
    if not alarmed:
        rise_n_per_s = FAST_N_PER_S if limit_n < borne_n else limit.again_n_per_s
        limit_n = min(limit_n + rise_n_per_s * dt_s, limit.most_n)
    return TiltState(limit_n, borne_n, pushed_n, alarmed)


def allowed_n(state: TiltState, tilt: float) -> float:
    """Return the largest horizontal force (N) that is allowed at a tilt (rad)."""
    return state.limit_n * share(tilt)


def pace(before: float, saturated: bool, dt_s: float) -> float:
    """Return the share of a reference's largest rate that is left after a tick, LEAST_PACE..1.

    A target that is far away is approached with this rate, which against a current, with a load or on a
    tilted vehicle can be more than it bears. What saturates is slowed: it arrives later and not aslant.
    """
    now = before * math.exp(-dt_s / SLOW_DOWN_S) if saturated else before + dt_s / RECOVER_S
    return clamped(now, LEAST_PACE, 1.0)


def slowed(pace: float, tilt_share: float) -> float:
    """Return what a tilt leaves of a pace in x, y or z; `tilt_share` (0..1) is what it leaves of thrust."""
    most = LEAST_PACE if tilt_share < LEAST_PACE else tilt_share
    return most if pace > most else pace
