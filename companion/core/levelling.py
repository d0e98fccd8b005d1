"""Roll and pitch held level, one at a time, where the flight mode leaves them to us.

    a = c φ + 2 ω p + 0.2 ω³ ∫φ dt             critically damped; the integral takes what is constant
    c = ω² + 2 μ |Y| / I                        stiffer by what the water turns
    b' = (a − b) / τ_f                          and so the thruster's lag is led:
    K = −I (a + (τ / τ_f − 1) (a − b)) + z Y    (1 + τ s) / (1 + τ_f s)
    M   the same for θ, q                − z X

| symbol  | meaning                                              | unit       |
|---------|------------------------------------------------------|------------|
| φ, θ    | roll, pitch where the command acts                   | rad        |
| p, q    | their body rates                                     | rad/s      |
| I       | inertia with the added mass                          | kg m²      |
| ω       | frequency, as high as delay and guard allow          | rad/s      |
| τ, τ_f  | the thrusters' lag, and what of it is left           | s          |
| z       | how far below the centre of gravity X and Y push     | m          |
| μ       | Munk moment for a radian and a newton of mean push   | m          |
| X, Y    | forces of the horizontal thrusters, forward, right   | N          |
| K, M    | moments: starboard down, bow up                      | N·m        |

The last terms cancel what the horizontal thrusters tilt. z is what the file says until K shows another one:
in the mean over SLOW_S levelling needs K = z Y + b, whatever factor the thrusters share. The z in use stays
as it is as long as it may be true. What is left is the Munk moment (Za − Xa) u w
(Fossen 2011, 6.3): held against a current of u, a tilt θ makes w = u θ, and the moment turns it further. For
a Heavy it is 4 N·m/rad at 0.6 m/s and 9 at 0.85, where its weight rights it with 1.3: hence the stiffness.
A delay lowers ω, and from 80 ms on ω² I is less than this moment: then the vehicle tips to and fro. What is
pushed against the drag d2 u² tells the moment: μ = (m_w − m_u) / d2 times the mean push. Twice that is what
waves then meet in a current as in still water.
"""

import math
from typing import NamedTuple

from companion.core import oscillation
from companion.core.bounds import clamped, limited

FILTER_S = 0.05
INTEGRAL = 0.2
MOST_TRIMMED_RAD = 0.1
"""What the integral takes a tilt for at most: so a swing leaves no moment that pushes the other way."""

DELAY_PHASE_RAD = 0.18
"""ω times the delay, rad: gain margin 2.3, phase margin 30° with a lag of 0.15 s."""

STIFFNESS_PHASE_RAD = 0.5
"""√c times the delay, rad: beyond it too little damping is left."""

LEAST_SHARE = 0.3
"""Of ω, that an oscillation leaves: with less a vehicle in a current tips over. A violent swing counts for no
more than its time: the one that ends a large tilt is none of the loop's own."""

PUSHED_S = 1.0
"""The mean of a push is taken over this time: a current's, not the waves'."""

MIN_DELAY_S = 1e-3

SLOW_S, MEMORY_S = 1.0, 20.0
"""Moment and force are compared over SLOW_S, for levelling is quicker, and remembered for MEMORY_S."""

SLOW_NM, ASKEW_NM, TOLD_M = 1.0, 0.5, 0.05
"""Standard deviations: of K from z Y + b, and beforehand of b and of z from what was told."""

MOST_LEVER_M = 0.2


class Levelling(NamedTuple):
    """What is believed of roll or of pitch."""

    inertia: float
    """I, kg m²."""
    frequency_radps: float
    """The highest ω."""
    lever_m: float
    """z for roll, whose force is Y; −z for pitch, whose force is X: as it was told."""
    max_moment_nm: float
    lag_s: float
    """τ of the nominal thrusters."""
    munk_m: float
    """μ, m."""
    oscillation: oscillation.Parameters


class Lever(NamedTuple):
    """What was found of z: K = z Y + b in the mean over SLOW_S, as sums over MEMORY_S of what z was told."""

    lever_m: float
    """In use, less what was told: it stays where it may be true."""
    moment: float
    force: float
    """K less the told z Y, and Y, over SLOW_S."""
    ones: float
    f: float
    ff: float
    m: float
    mf: float
    """Sums of 1, Y, Y², K and K Y."""


class LevellingState(NamedTuple):
    """What is known of roll or of pitch."""

    integral: float
    """0.2 ω³ ∫φ dt, rad/s²."""
    slow: float
    """b, rad/s²; NaN before the first step."""
    oscillation: oscillation.State
    pushed_n: float
    """Mean of Y, or of X."""
    lever: Lever


NO_LEVER = Lever(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
START = LevellingState(0.0, math.nan, oscillation.START, 0.0, NO_LEVER)
"""No integral, no rate of change known, nothing pushed, nothing found."""


def rested(state: LevellingState) -> LevellingState:
    """Return START with what was found."""
    return LevellingState(0.0, math.nan, oscillation.START, 0.0, state.lever)


def trimmed(state: LevellingState, more: float) -> LevellingState:
    """Return the state whose integral holds so much more, rad/s²."""
    return LevellingState(state.integral + more, state.slow, state.oscillation, state.pushed_n, state.lever)


def levelling_of(
    inertia: float,
    frequency_radps: float,
    lever_m: float,
    max_moment_nm: float,
    lag_s: float,
    munk_m: float = 0.0,
) -> Levelling:
    """Return what `step` needs for roll or pitch of a vehicle whose thrusters lag by `lag_s`."""
    limits = oscillation.Parameters(
        max_moment_nm, oscillation.LEVELLING_SHARE * max_moment_nm, LEAST_SHARE, math.inf
    )
    return Levelling(inertia, frequency_radps, lever_m, max_moment_nm, lag_s, munk_m, limits)


NO_LEVELLING = levelling_of(1.0, 0.0, 0.0, 0.0, 0.0)
"""What stands where roll and pitch are not ours."""


def step(
    levelling: Levelling,
    state: LevellingState,
    angle: float,
    rate: float,
    force: float,
    delay_s: float,
    dt_s: float,
    learn: bool,
    gain: float,
    lag_s: float,
    adapts: bool,
    beside: float = 0.0,
    level: bool = True,
) -> tuple[LevellingState, float]:
    """Return K for φ, p and the force Y, or M for θ, q and X; `delay_s` from sensor to motor.

    `beside` is a moment that is asked for beside these (`attitude`); the lever is found while it is `level`.

    `learn` allows the integral to move; it stands where the moment is at its bound. A roll or pitch that
    oscillates by itself lowers ω. A vehicle of `gain` times the nominal one has I/gain, and thrusters quicker
    than the nominal ones τ = `lag_s`. Where it `adapts`, z is what was found of it.
    """
    inertia = levelling.inertia / gain
    lead = max(min(lag_s, levelling.lag_s) / FILTER_S - 1.0, 0.0)
    frequency = levelling.frequency_radps * state.oscillation.gain_scale
    late_s = max(delay_s, MIN_DELAY_S) / state.oscillation.gain_scale
    omega, most = min(frequency, DELAY_PHASE_RAD / late_s), min(frequency, STIFFNESS_PHASE_RAD / late_s)
    pushed_n = state.pushed_n + (force - state.pushed_n) * (1.0 - math.exp(-dt_s / PUSHED_S))
    munk = 2.0 * levelling.munk_m * abs(pushed_n) / levelling.inertia
    stiffness = min(omega * omega + munk, most * most)
    ahead = angle + delay_s * rate
    a = stiffness * ahead + 2.0 * omega * rate
    slow = a if math.isnan(state.slow) else state.slow
    slow = slow + (a - slow) * (1.0 - math.exp(-dt_s / FILTER_S))
    feedback = -inertia * (a + lead * (a - slow))
    trim = INTEGRAL * omega * omega * omega * dt_s * limited(ahead, MOST_TRIMMED_RAD)
    trimmed = state.integral + trim if learn else state.integral
    lever_m = lever_in_use_m(levelling, state, adapts)
    moment = lever_m * force + feedback - inertia * trimmed + beside
    integral = trimmed if abs(moment) <= levelling.max_moment_nm else state.integral
    watched = state.oscillation
    if learn:
        watched = oscillation.step(levelling.oscillation, watched, feedback, dt_s, 0.0)
    moment = limited(moment, levelling.max_moment_nm)
    lever = (
        levers(state.lever, moment - levelling.lever_m * force, force, dt_s)
        if learn and level
        else state.lever
    )
    return LevellingState(integral, slow, watched, pushed_n, lever), moment


def lever_in_use_m(levelling: Levelling, state: LevellingState, adapts: bool) -> float:
    """Return z, m."""
    return state.lever.lever_m + levelling.lever_m if adapts else levelling.lever_m


def levers(lever: Lever, moment: float, force: float, dt_s: float) -> Lever:
    """Take one tick's moment, less what the told z makes of the force, and find z by least squares."""
    new, weight, keep = 1.0 - math.exp(-dt_s / SLOW_S), dt_s / SLOW_S, math.exp(-dt_s / MEMORY_S)
    moment = lever.moment + (moment - lever.moment) * new
    force = lever.force + (force - lever.force) * new
    ones, f = keep * lever.ones + weight, keep * lever.f + weight * force
    ff, m = keep * lever.ff + weight * force * force, keep * lever.m + weight * moment
    mf = keep * lever.mf + weight * moment * force
    found_m, doubt_m = _found(ones, f, ff, m, mf)
    lever_m = limited(clamped(lever.lever_m, found_m - doubt_m, found_m + doubt_m), MOST_LEVER_M)
    return Lever(lever_m, moment, force, ones, f, ff, m, mf)


def lever_doubt_m(lever: Lever) -> float:
    """Return the standard deviation of what was found of z."""
    return _found(lever.ones, lever.f, lever.ff, lever.m, lever.mf)[1]


def _found(ones: float, f: float, ff: float, m: float, mf: float) -> tuple[float, float]:
    """Return z less what was told, and its standard deviation, m."""
    a = ff / (SLOW_NM * SLOW_NM) + 1.0 / (TOLD_M * TOLD_M)
    b, c = f / (SLOW_NM * SLOW_NM), ones / (SLOW_NM * SLOW_NM) + 1.0 / (ASKEW_NM * ASKEW_NM)
    determinant = a * c - b * b
    return (c * mf - b * m) / (SLOW_NM * SLOW_NM * determinant), math.sqrt(c / determinant)
