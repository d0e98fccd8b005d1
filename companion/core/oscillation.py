"""Notices that the loop oscillates by itself, and says by how much the gains are reduced.

A loop with more delay, or a vehicle with more gain, than the gains tolerate oscillates faster than any sea or
path, and the oscillation does not die away. So a limit cycle is demand that is faster than HIGH_PASS_S and
whose RMS exceeds a share of the largest force for longer than any transient lasts. Engaging, a load or a
setpoint ring for a second at most, with far less than the largest force: a larger demand counts for longer.
The gains then shrink until the limit cycle has ended. They come back slowly, and stop below the value at
which it began, so that they do not hunt.
"""

import math
from typing import NamedTuple

from companion.core.bounds import clamped, limited

SHARES = (0.1, 0.1, 0.12, 0.04)
"""Shares of the largest force of surge, sway, heave and yaw: an RMS of fast demand that stays above it is a
limit cycle."""

FIRST_SCALES = (1.0, 1.0, 0.5, 1.0)
"""Control begins with this share of the gains of surge, sway, heave and yaw. With full gains in heave a
vertical motor that is reversed tilts the vehicle further before it is found (decision 46)."""

LEVELLING_SHARE = 0.06
"""Share of the largest moment of roll and pitch."""

HIGH_PASS_S = 0.15
MEMORY_S = 0.2
TRANSIENT_S, AGAIN_S = 1.1, 0.4
"""A limit cycle lasts this long, longer than any transient: the first time, and soon after another."""

SWINGS = 2
"""Changes of sign of the fast demand by then: an approach or a wave has fewer."""

VIOLENT = 12.0
"""Times the limit's mean square: more is no transient. Its time counts share / VIOLENT times, and it
needs no second cycle."""

QUICK_S, QUICK_SWINGS, QUICK_LEAVES = 0.12, 3, 0.35
"""This many swings in a row, each shorter than QUICK_S and beyond the limit, are a cycle: in seas, currents
and turns three in a row reach 0.6 of it. Such a cycle doubles with each swing: the gains fall to this share
at once."""

SHRINK_S = 0.3
RECOVER_S = 10.0
LEAST = 0.1
CONFIRMED_S = 12.0
"""A cycle that begins within this time of another, while the gains return or just after, confirms it: an
approach or a load rings once."""

RELAPSE_SHARE = 0.7
"""Share of the scale at which a confirmed limit cycle began, to which the gains return within RECOVER_S."""

FORGET_S = 600.0
"""The gains grow beyond that share at 1/FORGET_S per second."""

MEAN_S = 0.5
"""What of d̂ is slower, as on a path, is never reduced; with 0.25 s a light vehicle's yaw cycles further."""


class Parameters(NamedTuple):
    """The largest force asked of an axis, N or N·m: more moves nothing; and the `limit` of the RMS.

    The gains begin at `first` and fall to `least` at most; a mean square above `violent` times
    the limit's shortens the time of detection.
    """

    max_force: float
    limit: float
    least: float = LEAST
    violent: float = VIOLENT
    first: float = 1.0


class Swings(NamedTuple):
    """The share of the gains (LEAST..1), and the signals that decide it."""

    gain_scale: float
    ceiling: float
    slow: float
    """The demand's low-passed part; NaN before the first."""
    power: float
    """Mean square of the rest."""
    lasts_s: float
    ended_s: float
    """How long ago the last cycle ended."""
    fast: float
    """The rest, of the last tick."""
    swings: int
    """Number of changes of its sign while it exceeded the limit."""
    swing_s: float
    """How long ago it changed its sign."""
    peak: float
    """Its largest magnitude since."""
    quick: int
    """Number of swings in a row before that were quick and beyond the limit."""


START = Swings(1.0, 1.0, math.nan, 0.0, 0.0, math.inf, 0.0, 0, 0.0, 0.0, 0)
"""Full gains, before any demand."""


def watch(parameters: Parameters, state: Swings, tau: float, dt_s: float, full: bool = True) -> Swings:
    """Take one tick's demand; without `full` authority only quick swings are a cycle."""
    tau = limited(tau, parameters.max_force)
    slow = tau if math.isnan(state.slow) else state.slow
    slow = slow + (tau - slow) * (1.0 - math.exp(-dt_s / HIGH_PASS_S))
    fast = tau - slow
    turns = (fast < 0.0) != (state.fast < 0.0)
    swing_s, peak, quick = state.swing_s + dt_s, max(state.peak, abs(fast)), state.quick
    if turns:
        quick = quick + 1 if state.swing_s < QUICK_S and state.peak > parameters.limit else 0
        swing_s, peak = 0.0, abs(fast)
    if quick >= QUICK_SWINGS - 1 and peak > parameters.limit:
        scale = clamped(QUICK_LEAVES * state.gain_scale, parameters.least, 1.0)
        ceiling = clamped(RELAPSE_SHARE * state.ceiling, parameters.least, 1.0)
        return Swings(scale, ceiling, slow, 0.0, 0.0, 0.0, fast, 0, swing_s, peak, 0)
    if not full:
        return state._replace(slow=slow, fast=fast, swing_s=swing_s, peak=peak, quick=quick)
    power = state.power + (fast * fast - state.power) * (1.0 - math.exp(-dt_s / MEMORY_S))
    share = power / (parameters.limit * parameters.limit)
    violent = share > parameters.violent
    counts = share / parameters.violent if violent else 1.0
    lasts_s = state.lasts_s + counts * dt_s if share > 1.0 else 0.0
    swings = state.swings + turns if share > 1.0 else 0
    known = state.ended_s < CONFIRMED_S or state.ceiling < 1.0
    goes_on = state.ended_s == 0.0
    cycles = (goes_on or swings >= SWINGS or violent) and lasts_s > (AGAIN_S if known else TRANSIENT_S)
    if cycles and not goes_on:
        ceiling = RELAPSE_SHARE * state.gain_scale if known or violent else 1.0
    else:
        ceiling = state.ceiling + dt_s / FORGET_S
    scale = state.gain_scale * math.exp(-dt_s / SHRINK_S) if cycles else state.gain_scale + dt_s / RECOVER_S
    ceiling = clamped(ceiling, parameters.least, 1.0)
    ended_s = 0.0 if cycles else state.ended_s + dt_s
    scale = clamped(scale, parameters.least, ceiling)
    return Swings(scale, ceiling, slow, power, lasts_s, ended_s, fast, swings, swing_s, peak, quick)


def mean_disturbance(mean: float, d: float, dt_s: float) -> float:
    """Return the mean over MEAN_S of a disturbance, after one tick of it."""
    return mean + (d - mean) * (1.0 - math.exp(-dt_s / MEAN_S))


def scaled_disturbance(mean: float, d: float, gain_scale: float) -> float:
    """Return a disturbance as it may become thrust: its mean, and of what differs from that gain_scale².

    At full gains it is the disturbance itself. A constant one stays compensated whatever the scale: only what
    is faster than 1/MEAN_S is reduced.
    """
    return d - (1.0 - gain_scale * gain_scale) * (d - mean)
