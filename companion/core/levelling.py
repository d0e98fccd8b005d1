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
| τ, τ_f  | the nominal thrusters' lag, and what of it is left   | s          |
| z       | how far below the centre of gravity X and Y push     | m          |
| μ       | Munk moment for a radian and a newton of mean push   | m          |
| X, Y    | forces of the horizontal thrusters, forward, right   | N          |
| K, M    | moments: starboard down, bow up                      | N·m        |

The last terms cancel what the horizontal thrusters tilt. z is what the file says until K shows another one:
in the mean over SLOW_S levelling needs K = z Y + b, whatever factor the thrusters share. The z in use stays
as it is as long as it may be true. What is left is the Munk moment (Za − Xa) u w (Fossen 2011, 6.3): a
vehicle that is held in a current u and tilted by θ meets the water with w = u θ; the moment tilts it more.
For a Heavy it is 4 N·m/rad at 0.6 m/s and 9 at 0.85, and its weight rights it with 1.3: hence the stiffness.
A delay lowers ω, and from 80 ms on ω² I is less than this moment: then the vehicle tips to and fro. What is
pushed against the drag d2 u² tells the moment: μ = (m_w − m_u) / d2 times the mean push. Twice that is what
waves then meet in a current as in still water.
"""

import math
from typing import NamedTuple

from companion.core import oscillation
from companion.core.bounds import clamped, limited
from companion.core.schedule import LEAST_DELAY_S

FILTER_S = 0.05
INTEGRAL = 0.2
MOST_TRIMMED_RAD = 0.1
"""Largest tilt that the integral counts: so a swing leaves no moment that pushes the other way."""

DELAY_PHASE_RAD = 0.18
"""ω times the delay, rad: gain margin 2.3, phase margin 30° with a lag of 0.15 s."""

STIFFNESS_PHASE_RAD = 0.5
"""√c times the delay, rad: beyond it too little damping is left."""

LEAST_SHARE = 0.3
"""Share of ω that an oscillation leaves: with less a vehicle in a current tips over. Large amplitudes do not
shorten the time of detection here: the swing that ends a large tilt is no limit cycle."""

PUSHED_S = 1.0
"""The mean of a push is taken over this time: a current's, not the waves'."""

SLOW_S, MEMORY_S = 1.0, 20.0
"""Moment and force are compared over SLOW_S, for levelling is quicker, and remembered for MEMORY_S."""

SLOW_NM, ASKEW_NM, TOLD_M = 1.0, 0.5, 0.05
"""Standard deviations: of K from z Y + b, and beforehand of b and of z from what was told."""

MOST_LEVER_M = 0.2


class Levelling(NamedTuple):
    """The model of roll or of pitch."""

    inertia: float
    """I, kg m²."""
    frequency_radps: float
    """The highest ω."""
    lever_m: float
    """z for roll, whose force is Y; −z for pitch, whose force is X: as it was told."""
    max_moment_nm: float
    lead: float
    """τ / τ_f − 1, not below zero."""
    munk_m: float
    """μ, m."""
    oscillation: oscillation.Parameters


class Response(NamedTuple):
    """How what levels answers: the thrusters of heave do, and are taken to do it as they do in heave."""

    delay_s: float
    """Delay from sensor to motor."""
    gain: float
    """Relative to the nominal vehicle: its inertia is I/gain."""
    adapts: bool
    """Whether what was found of z is used."""


class Turn(NamedTuple):
    """What levelling of roll or pitch has to counter."""

    angle: float
    rate: float
    """φ and p, or θ and q."""
    force: float
    """Y, or X."""
    moment: float
    """Asked for beside what levels (`attitude`), N·m."""
    learns: bool
    """The integral may move, and an oscillation is the loop's own."""
    straight: bool
    """Only then z is found."""


class Lever(NamedTuple):
    """What was found of z: K = z Y + b in the mean over SLOW_S, as sums over MEMORY_S of what z was told."""

    lever_m: float
    """The lever in use minus the configured one; it stays as long as it may be true."""
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
    oscillation: oscillation.Swings
    pushed_n: float
    """Mean of Y, or of X."""
    lever: Lever


NO_LEVER = Lever(lever_m=0.0, moment=0.0, force=0.0, ones=0.0, f=0.0, ff=0.0, m=0.0, mf=0.0)
START = LevellingState(0.0, math.nan, oscillation.START, 0.0, NO_LEVER)
"""Nothing is known: no integral, no rate of change, no push, no lever."""


def rested(state: LevellingState) -> LevellingState:
    """Return START with what was found."""
    return START._replace(lever=state.lever)


def trimmed(levelling: Levelling, state: LevellingState, moment: float) -> LevellingState:
    """Return the state whose integral asks for this much less moment, N·m."""
    return state._replace(integral=state.integral + moment / levelling.inertia)


def levelling_of(
    inertia: float,
    frequency_radps: float,
    lever_m: float,
    max_moment_nm: float,
    lag_s: float,
    munk_m: float = 0.0,
) -> Levelling:
    """Return the parameters of `level` for roll or pitch of a vehicle whose thrusters lag by `lag_s`."""
    limits = oscillation.Parameters(
        max_moment_nm, oscillation.LEVELLING_SHARE * max_moment_nm, LEAST_SHARE, math.inf
    )
    lead = max(lag_s / FILTER_S - 1.0, 0.0)
    return Levelling(inertia, frequency_radps, lever_m, max_moment_nm, lead, munk_m, limits)


NO_LEVELLING = levelling_of(1.0, 0.0, 0.0, 0.0, 0.0)
"""In place of levelling where the autopilot controls roll and pitch."""


def level(
    levelling: Levelling, state: LevellingState, turn: Turn, response: Response, dt_s: float
) -> tuple[LevellingState, float]:
    """Return K, or M; the integral stands where the moment is at its bound."""
    pushed_n = state.pushed_n + (turn.force - state.pushed_n) * (1.0 - math.exp(-dt_s / PUSHED_S))
    omega, stiffness = softened(levelling, state.oscillation.gain_scale, pushed_n, response.delay_s)
    inertia = levelling.inertia / response.gain
    ahead = turn.angle + response.delay_s * turn.rate
    a = stiffness * ahead + 2.0 * omega * turn.rate
    slow = a if math.isnan(state.slow) else state.slow
    slow = slow + (a - slow) * (1.0 - math.exp(-dt_s / FILTER_S))
    feedback = -inertia * (a + levelling.lead * (a - slow))

    integral, seen, lever = state.integral, state.oscillation, state.lever
    if turn.learns:
        integral += INTEGRAL * omega * omega * omega * dt_s * limited(ahead, MOST_TRIMMED_RAD)
        seen = oscillation.watch(levelling.oscillation, seen, feedback, dt_s)
    lever_m = lever_in_use_m(levelling, state, response.adapts)
    moment = lever_m * turn.force + feedback - inertia * integral + turn.moment
    if not abs(moment) <= levelling.max_moment_nm:
        integral = state.integral
    moment = limited(moment, levelling.max_moment_nm)
    if turn.learns and turn.straight:
        lever = levers(lever, moment - levelling.lever_m * turn.force, turn.force, dt_s)
    return LevellingState(integral, slow, seen, pushed_n, lever), moment


def softened(levelling: Levelling, share: float, pushed_n: float, delay_s: float) -> tuple[float, float]:
    """Return ω and c for the share that an oscillation leaves of ω, the mean push, and the delay."""
    frequency, late_s = levelling.frequency_radps * share, max(delay_s, LEAST_DELAY_S) / share
    omega, most = min(frequency, DELAY_PHASE_RAD / late_s), min(frequency, STIFFNESS_PHASE_RAD / late_s)
    munk = 2.0 * levelling.munk_m * abs(pushed_n) / levelling.inertia
    return omega, min(omega * omega + munk, most * most)


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
