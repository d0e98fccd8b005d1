"""One degree of freedom: errors, schedule, disturbance, law, bias. No step in thrust where the law changes.

The bias, N or N·m, is what a change of law left; it decays over BLEND_S.
"""

import math
from typing import Any, NamedTuple

from companion.core import oscillation, reference
from companion.core.bounds import limited, wrap
from companion.core.compensator import NO_COMPENSATOR, ChosenCompensator, Signals
from companion.core.law import ChosenLaw, Motion
from companion.core.observers import Estimates
from companion.core.oscillation import mean_disturbance, scaled_disturbance
from companion.core.schedule import NO_GAINS, Gains, ScheduledGains, scheduled
from companion.records import DofSample, Flags, Setpoint, Vector

BLEND_S = 2.0

Sample = DofSample[float, bool]
Aimed = tuple[reference.ReferenceState, ScheduledGains]


class Axis(NamedTuple):
    """How one degree of freedom is controlled.

    `by_observer`: the observer's d is fed back; `predicts`: as it is predicted for when the command acts.
    """

    gains: Gains
    reference: reference.Parameters
    oscillation: oscillation.Parameters
    law: ChosenLaw
    compensator: ChosenCompensator
    by_observer: bool
    predicts: bool
    max_disturbance: float


class AxisMemory(NamedTuple):
    """What is remembered of one degree of freedom."""

    reference: reference.ReferenceState
    oscillation: oscillation.Swings
    law: Any
    learnt: Any
    mean_d: float
    d_hat: float
    d_share: float
    """Factor on d̂ in the last tick."""
    asked: float
    """τ of the last tick, whether or not it was engaged."""
    bias: float
    seeds: bool
    """The compensator is a new one that has learnt nothing: it begins with `d_hat`."""


class Orders(NamedTuple):
    """What the law is to do in this tick."""

    engaged: Flags
    saturated: Flags
    """The last command gave less than the law asked: nothing may be learnt."""
    idle: Flags
    """Not held, and nothing is known of its motion."""
    learns: bool
    watched: bool
    """Whether the guard watches it: at full authority an oscillation is the loop's own."""
    pace: Vector
    """Share of the reference's largest rate."""


class Place(NamedTuple):
    """Where the command acts: the vehicle, its nominal inertia and drag there, and what is to be done."""

    motion: Estimates
    gain: Vector
    """Force per command over inertia that the law assumes, relative to the nominal vehicle."""
    m: Vector
    k_plus_h: Vector
    orders: Orders
    free: Flags
    """The law is in force, and got what it asked for."""


NO_SIGNALS = Signals(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def at_rest(axis: Axis, x: float, x_dot: float, d_observer: float) -> AxisMemory:
    """Return the memory of one that stays where the vehicle is, and has learnt nothing."""
    return AxisMemory(
        reference=reference.start(axis.reference, x, x_dot),
        oscillation=oscillation.START._replace(gain_scale=axis.oscillation.first),
        law=axis.law.initial(axis.law.parameters),
        learnt=axis.compensator.initial(axis.compensator.parameters),
        mean_d=observed(axis, d_observer),
        d_hat=0.0,
        d_share=1.0,
        asked=0.0,
        bias=0.0,
        seeds=False,
    )


def aim(
    i: int, axis: Axis, memory: AxisMemory, motion: Estimates, target: Setpoint, orders: Orders, dt_s: float
) -> Aimed:
    """Advance the reference toward where the target will be when the command acts; draw back the gains."""
    if orders.idle[i]:
        return memory.reference, NO_GAINS
    there = reference.ahead(target.eta_d[i], target.eta_d_dot[i], target.eta_d_ddot[i], motion.ahead_s)
    desired = reference.advance(axis.reference, memory.reference, *there, orders.pace[i], dt_s)
    return desired, scheduled(axis.gains, motion.delay_s, memory.oscillation.gain_scale)


def step(
    i: int, axis: Axis, memory: AxisMemory, aimed: Aimed, at: Place, dt_s: float
) -> tuple[AxisMemory, Sample]:
    """Return the memory and τ of degree of freedom `i`, with what it is made of."""
    if at.orders.idle[i]:
        return idle(i, axis, memory, at, dt_s)
    desired, left = aimed
    x, x_dot = at.motion.eta_ahead[i], at.motion.eta_dot_ahead[i]
    e = wrap(x - desired.x_d) if axis.reference.angular else x - desired.x_d
    e_dot = x_dot - desired.x_d_dot
    signals = Signals(e, e_dot, e_dot + left.gains.lam * e, x_dot, desired.x_d_dot, desired.x_d_ddot)
    learnt, mean_d, d_hat, adapting = disturbance(i, axis, memory, signals, left, at, dt_s)
    motion = moved(i, signals, left, d_hat, at)
    law, force, d_hat = axis.law.step(axis.law.parameters, memory.law, motion, dt_s)
    bias = memory.bias * math.exp(-dt_s / BLEND_S)
    asked = force + bias
    tau = asked if at.orders.engaged[i] else 0.0
    memory = AxisMemory(
        reference=desired,
        oscillation=watched(i, axis, memory, tau, at, dt_s),
        law=law,
        learnt=learnt,
        mean_d=mean_d,
        d_hat=d_hat + bias,
        d_share=left.d_share,
        asked=asked,
        bias=bias,
        seeds=False,
    )
    return memory, sampled(i, axis, memory, signals, tau, adapting, at)


def disturbance(
    i: int,
    axis: Axis,
    memory: AxisMemory,
    signals: Signals,
    left: ScheduledGains,
    at: Place,
    dt_s: float,
) -> tuple[Any, float, float, bool]:
    """Return what the compensator has learnt, the mean of d, d̂ (N; N·m), and whether it learnt."""
    compensator, learnt = axis.compensator, memory.learnt
    predicted = at.motion.predicted[i]
    d = observed(axis, at.motion.disturbance[i] + (predicted.rise if axis.predicts else 0.0))
    if memory.seeds:
        learnt = compensator.seed(compensator.parameters, learnt, signals, memory.d_hat - d)
    learns, learn_s = at.orders.learns and at.free[i], left.share * left.share / at.gain[i] * dt_s
    learnt, found, adapting = compensator.step(compensator.parameters, learnt, signals, learn_s, learns)
    mean_d = mean_disturbance(memory.mean_d, d + found, dt_s)
    adapting = adapting or (axis.predicts and predicted.learns)
    return learnt, mean_d, scaled_disturbance(mean_d, d + found, left.d_share), adapting


def observed(axis: Axis, d_observer: float) -> float:
    """Return the observer's d where it is fed back."""
    return limited(d_observer, axis.max_disturbance) if axis.by_observer else 0.0


def moved(i: int, signals: Signals, left: ScheduledGains, d_hat: float, at: Place) -> Motion:
    """Return what the law sees."""
    return Motion(
        e=signals.e,
        e_dot=signals.e_dot,
        eps=signals.eps,
        x_dot=signals.x_dot,
        x_d_ddot=signals.x_d_ddot,
        m=at.m[i] / at.gain[i],
        k_plus_h=at.k_plus_h[i] / at.gain[i],
        d_hat=d_hat,
        gains=left.gains,
        share=left.share,
        free=at.free[i],
    )


def watched(i: int, axis: Axis, memory: AxisMemory, tau: float, at: Place, dt_s: float) -> oscillation.Swings:
    """Look for an oscillation of the loop's own."""
    # A weak vehicle is asked for more, to move as much: that is no oscillation.
    demand = tau * min(at.gain[i], 1.0)
    return oscillation.watch(axis.oscillation, memory.oscillation, demand, dt_s, at.orders.watched)


def sampled(
    i: int,
    axis: Axis,
    memory: AxisMemory,
    signals: Signals,
    tau: float,
    adapting: bool,
    at: Place,
) -> Sample:
    """Return the law's inside, as telemetry has it: τ is feedforward, feedback and d̂."""
    desired = memory.reference
    x, d_hat, d_observer, feedforward, feedback = desired.x_d, 0.0, 0.0, 0.0, 0.0
    if not at.orders.idle[i]:
        x, d_hat, d_observer = at.motion.eta_ahead[i], memory.d_hat, at.motion.disturbance[i]
        feedforward = (at.k_plus_h[i] + at.m[i] * desired.x_d_ddot) / at.gain[i]
        feedback = memory.asked - feedforward - d_hat
    return DofSample(  # Python takes up to thirty arguments quickly, and counts a keyword twice
        desired.x_d,
        desired.x_d_dot,
        desired.x_d_ddot,
        x,
        x_dot=signals.x_dot,
        e=signals.e,
        e_dot=signals.e_dot,
        eps=signals.eps,
        tau=tau,
        feedforward=feedforward,
        feedback=feedback,
        d_hat=d_hat,
        d_observer=d_observer,
        weight_norm=weight_norm(i, axis, memory, at),
        saturated=at.orders.saturated[i],
        adapting=adapting,
        engaged=at.orders.engaged[i],
    )


def weight_norm(i: int, axis: Axis, memory: AxisMemory, at: Place) -> float:
    """Return the norm of the weights of what learns."""
    if axis.predicts:
        return at.motion.predicted[i].weight_norm
    return axis.compensator.weight_norm(memory.learnt)


def idle(i: int, axis: Axis, memory: AxisMemory, at: Place, dt_s: float) -> tuple[AxisMemory, Sample]:
    """Keep what was learnt of one that is not held, and whose motion is not known."""
    mean_d = mean_disturbance(memory.mean_d, 0.0, dt_s)
    memory = memory._replace(mean_d=mean_d, asked=0.0, bias=0.0)
    return memory, sampled(i, axis, memory, NO_SIGNALS, 0.0, False, at)


def caught_up(axis: Axis, memory: AxisMemory, x: float, x_dot: float) -> AxisMemory:
    """Start the reference again where the vehicle is, with its rate."""
    return memory._replace(reference=reference.start(axis.reference, x, x_dot))


def without_thrust(memory: AxisMemory, lost: float) -> AxisMemory:
    """Take from d̂ what a motor was believed to give; the step that this makes is no oscillation."""
    seen = memory.oscillation._replace(slow=memory.oscillation.slow - lost)
    return memory._replace(oscillation=seen, mean_d=memory.mean_d - lost)


def taken_over(old: Axis, axis: Axis, memory: AxisMemory) -> AxisMemory:
    """Go on with another law or other gains.

    What learns goes on with what was learnt, or with the d̂ of what served before.
    """
    learner, keeps = axis.compensator, axis.compensator.step is old.compensator.step
    return memory._replace(
        law=memory.law if old.law.step is axis.law.step else axis.law.initial(axis.law.parameters),
        learnt=memory.learnt if keeps else learner.initial(learner.parameters),
        seeds=not keeps and learner.step is not NO_COMPENSATOR.step,
    )


def bumpless(memory: AxisMemory, before: AxisMemory) -> AxisMemory:
    """Ask as much as `before`; the difference to what the new law asks decays over BLEND_S."""
    return memory._replace(bias=memory.bias + before.asked - memory.asked, asked=before.asked)
