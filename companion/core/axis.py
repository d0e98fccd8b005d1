"""One degree of freedom: reference, errors, gains, disturbance, law; no step in thrust where the law changes.

| symbol      | meaning                                              | unit (heave; yaw) | source           |
|-------------|------------------------------------------------------|-------------------|------------------|
| e, e_dot    | x − x_d and its rate, x at the command's time        | m, m/s; rad       | eq. 2            |
| eps         | ε = ė + λ e                                          | m/s; rad/s        | eq. 2            |
| d_hat       | d̂, by observer and compensator                       | N; N·m            | eq. ann          |
| tau         | τ = k + h + d̂ + m (ẍ_d − λ ė) − m κ ε, and the bias  | N; N·m            | eqs. lei1, lei2  |
| bias        | what a change of law left in thrust          | N; N·m            |                  |
"""

import math
from typing import Any, NamedTuple

from companion.core import oscillation, reference, several
from companion.core.bounds import limited, wrap
from companion.core.compensator import ChosenCompensator, Signals
from companion.core.law import ChosenLaw, Motion
from companion.core.oscillation import mean_disturbance, scaled_disturbance
from companion.core.schedule import Gains, ScheduledGains, scheduled

BLEND_S = 2.0
"""How slowly the difference that a change of law made is let go."""


class Axis(NamedTuple):
    """How one degree of freedom is controlled; `by_observer`: the observer's d is fed back."""

    gains: Gains
    reference: reference.Parameters
    oscillation: oscillation.Parameters
    law: ChosenLaw
    compensator: ChosenCompensator
    by_observer: bool
    max_disturbance: float


class AxisMemory(NamedTuple):
    """What is remembered of one degree of freedom."""

    reference: reference.State
    oscillation: oscillation.State
    law: Any
    learnt: Any
    mean_d: float
    d_hat: float
    d_share: float
    """What d̂ was scaled by in the last tick."""
    asked: float
    """τ of the last tick, whether or not it was engaged."""
    bias: float
    """Let go over BLEND_S."""
    seeds: bool
    """The compensator is another one now, and knows nothing: it takes `d_hat` over."""


class Aim(NamedTuple):
    """Where it should be, how far it is from there, and the gains that are left."""

    reference: reference.State
    e: float
    e_dot: float
    gains: ScheduledGains


class Point(NamedTuple):
    """Where the next command finds it: motion, vehicle, and what is permitted."""

    x: float
    x_dot: float
    d_observer: float
    m: float
    k_plus_h: float
    gain: float
    """Force per command over inertia, relative to the nominal vehicle."""
    delay_s: float
    """For which the gains are drawn back."""
    engaged: bool
    free: bool
    """Engaged, and the last command was delivered."""
    learns: bool
    watched: bool
    """At full authority: an oscillation is the loop's own."""


class AxisSample(NamedTuple):
    """The law's inside, as telemetry has it."""

    x_d: float
    x_d_dot: float
    x_d_ddot: float
    x: float
    x_dot: float
    e: float
    e_dot: float
    eps: float
    tau: float
    feedforward: float
    feedback: float
    d_hat: float
    d_observer: float
    weight_norm: float
    adapting: bool


def at_rest(axis: Axis, x: float, x_dot: float, d_observer: float) -> AxisMemory:
    """Return the memory of one that stays where the vehicle is, and has learnt nothing."""
    return AxisMemory(
        reference.start(axis.reference, x, x_dot),
        oscillation.START,
        axis.law.initial(axis.law.parameters),
        axis.compensator.initial(axis.compensator.parameters),
        observed(axis, d_observer),
        0.0,
        1.0,
        0.0,
        0.0,
        False,
    )


def aim(
    axis: Axis,
    memory: AxisMemory,
    target: tuple[float, float, float],
    pace: float,
    ahead_s: float,
    x: float,
    x_dot: float,
    delay_s: float,
    lag_s: float,
    dt_s: float,
) -> Aim:
    """Advance the reference toward where `target` (x, ẋ, ẍ) will be `ahead_s` later; take errors there."""
    there, there_dot, there_ddot = reference.ahead(target[0], target[1], target[2], ahead_s)
    desired = reference.step(axis.reference, memory.reference, there, there_dot, there_ddot, pace, dt_s)
    e = wrap(x - desired.x_d) if axis.reference.angular else x - desired.x_d
    gains = scheduled(axis.gains, delay_s, memory.oscillation.gain_scale, lag_s)
    return Aim(desired, e, x_dot - desired.x_d_dot, gains)


def step(axis: Axis, memory: AxisMemory, aim: Aim, at: Point, dt_s: float) -> tuple[AxisMemory, AxisSample]:
    """Return τ and what it is made of."""
    desired, e, e_dot, gains = aim
    eps = e_dot + gains.lam * e
    signals = Signals(e, e_dot, eps, at.x_dot, desired.x_d_dot, desired.x_d_ddot)
    learnt, d, weight_norm, adapting = disturbance(axis, memory, signals, gains, at, dt_s)
    mean_d = mean_disturbance(memory.mean_d, d, dt_s)
    d_hat = scaled_disturbance(mean_d, d, gains.d_share)

    motion = Motion(
        e,
        e_dot,
        at.x_dot,
        desired.x_d_ddot,
        at.m / at.gain,
        at.k_plus_h / at.gain,
        d_hat,
        gains.lam,
        gains.kappa,
        gains.share,
        at.free,
    )
    law, terms = axis.law.step(axis.law.parameters, memory.law, motion, dt_s)
    unbiased = terms.feedforward + terms.feedback + terms.d_hat
    bias = memory.bias * math.exp(-dt_s / BLEND_S)
    asked = unbiased + bias
    tau = asked if at.engaged else 0.0

    watched = memory.oscillation
    if at.watched:
        believed_s = at.delay_s + oscillation.LOG_GAIN_COUNTS_S * math.log(at.gain)
        watched = oscillation.step(axis.oscillation, watched, tau, dt_s, believed_s)
    sample = AxisSample(
        desired.x_d,
        desired.x_d_dot,
        desired.x_d_ddot,
        at.x,
        at.x_dot,
        e,
        e_dot,
        eps,
        tau,
        terms.feedforward,
        terms.feedback,
        terms.d_hat + bias,
        at.d_observer,
        weight_norm,
        adapting,
    )
    remembered = AxisMemory(
        desired, watched, law, learnt, mean_d, terms.d_hat + bias, gains.d_share, asked, bias, False
    )
    return remembered, sample


def idle(axis: Axis, memory: AxisMemory, dt_s: float) -> tuple[AxisMemory, AxisSample]:
    """Keep what was learnt of one that is not held, and whose motion is not known."""
    desired = memory.reference
    remembered = AxisMemory(
        desired,
        memory.oscillation,
        memory.law,
        memory.learnt,
        mean_disturbance(memory.mean_d, 0.0, dt_s),
        memory.d_hat,
        memory.d_share,
        0.0,
        0.0,
        memory.seeds,
    )
    weight_norm = axis.compensator.weight_norm(memory.learnt)
    x_d, x_d_dot, x_d_ddot = desired.x_d, desired.x_d_dot, desired.x_d_ddot
    return remembered, AxisSample(
        x_d, x_d_dot, x_d_ddot, x_d, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, weight_norm, False
    )


def disturbance(
    axis: Axis, memory: AxisMemory, signals: Signals, gains: ScheduledGains, at: Point, dt_s: float
) -> tuple[Any, float, float, bool]:
    """Return what the compensator has learnt, d (N; N·m), its weight norm, and whether it learnt."""
    compensator, learnt = axis.compensator, memory.learnt
    d = observed(axis, at.d_observer)
    if memory.seeds:
        learnt = compensator.seed(compensator.parameters, learnt, signals, memory.d_hat - d)
    learn_s = gains.learning / at.gain * dt_s
    learnt, found, adapting = compensator.step(
        compensator.parameters, learnt, signals, learn_s, at.learns and at.free
    )
    return learnt, d + found, compensator.weight_norm(learnt), adapting


def observed(axis: Axis, d_observer: float) -> float:
    """Return the observer's d where it is fed back."""
    return limited(d_observer, axis.max_disturbance) if axis.by_observer else 0.0


def caught_up(axis: Axis, memory: AxisMemory, x: float, x_dot: float) -> AxisMemory:
    """Start the reference again where the vehicle is, with its rate."""
    return _with(memory, reference.start(axis.reference, x, x_dot), memory.oscillation, memory.mean_d)


def without(memory: AxisMemory, lost: float) -> AxisMemory:
    """Take from d̂ what a motor was believed to give; the step that this makes is no oscillation."""
    seen = memory.oscillation
    later = oscillation.State(
        seen.gain_scale, seen.ceiling, seen.slow - lost, seen.power, seen.lasts_s, seen.delay_s
    )
    return _with(memory, memory.reference, later, memory.mean_d - lost)


def _with(memory: AxisMemory, desired: reference.State, seen: oscillation.State, mean_d: float) -> AxisMemory:
    return AxisMemory(
        desired,
        seen,
        memory.law,
        memory.learnt,
        mean_d,
        memory.d_hat,
        memory.d_share,
        memory.asked,
        memory.bias,
        memory.seeds,
    )


def taken_over(old: Axis, axis: Axis, memory: AxisMemory) -> AxisMemory:
    """Go on with another law or other gains.

    Whoever learns goes on with what was learnt, or with the d̂ of whoever served before.
    """
    known = {chosen.step: state for chosen, state in several.members(old.compensator, memory.learnt)}
    fresh = axis.compensator.initial(axis.compensator.parameters)
    members = several.members(axis.compensator, fresh)
    return memory._replace(
        law=memory.law if old.law.step is axis.law.step else axis.law.initial(axis.law.parameters),
        learnt=several.rejoined(
            axis.compensator, [known.get(chosen.step, state) for chosen, state in members]
        ),
        seeds=bool(members) and not any(chosen.step in known for chosen, _ in members),
    )


def bumpless(memory: AxisMemory, before: AxisMemory) -> AxisMemory:
    """Ask as much as `before`; the difference to what the new law asks is let go over BLEND_S."""
    return memory._replace(bias=memory.bias + before.asked - memory.asked, asked=before.asked)
