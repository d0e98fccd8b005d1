"""The control of one degree of freedom without MAVLink: reference, compensators, law.

`learn`, `force`, `step_one` and what begins with `initial_` are slots: see `chosen`.
"""

import math
from typing import Any, NamedTuple

from companion.control import oscillation, reference
from companion.control.axis import Axis
from companion.control.bounds import limited
from companion.control.compensator import Signals
from companion.control.law import Motion, Terms
from companion.control.oscillation import mean_disturbance, scaled_disturbance
from companion.control.schedule import ScheduledGains
from companion.control.several import joined
from companion.estimation.vehicle_model import Used
from lab.batch.compiled import Slotted, slotted
from lab.batch.estimation import Estimate
from lab.batch.settings import Dof
from lab.batch.vehicle import TICK_S
from sim_bridge.physics.plant import Three


class Held(NamedTuple):
    """What the controller remembers of a degree of freedom (`companion.control.axis.AxisMemory`)."""

    began: float
    """Where it was engaged."""
    reference: reference.State
    oscillation: oscillation.State
    law: Any
    learnt: Any
    mean_d: float
    pace: float
    allowed_pace: float
    """What a tilt leaves of `pace`."""
    saturated: bool
    d_share: float
    """What d̂ was scaled by in the last tick."""


def learn(parameters: Any, learnt: Any, signals: Signals, learn_s: float, adapt: bool) -> tuple[Any, float]:
    """Step the compensators of a degree of freedom; return their states and the sum of their d̂."""
    raise NotImplementedError


def force(parameters: Any, state: Any, motion: Motion, dt_s: float) -> tuple[Any, Terms]:
    """Step the law of a degree of freedom."""
    raise NotImplementedError


def step_one(
    parameters: Any, learnt: Any, signals: Signals, learn_s: float, adapt: bool
) -> tuple[Any, float, bool]:
    """Step one compensator."""
    raise NotImplementedError


def initial_one(parameters: Any) -> Any:
    """Return one compensator's first state."""
    raise NotImplementedError


def initial_learnt(parameters: Any) -> Any:
    """Return the compensators' first states."""
    raise NotImplementedError


def initial_law(parameters: Any) -> Any:
    """Return the law's first state."""
    raise NotImplementedError


def learn_none(
    parameters: Any, learnt: Any, signals: Signals, learn_s: float, adapt: bool
) -> tuple[Any, float]:
    """Step no compensator."""
    return learnt, 0.0


def learn_one_more(
    parameters: Any, learnt: Any, signals: Signals, learn_s: float, adapt: bool
) -> tuple[Any, float]:
    """Step a compensator, and those before it."""
    others, d_others = learn(parameters[0], learnt[0], signals, learn_s, adapt)
    state, d_hat, _ = step_one(parameters[1], learnt[1], signals, learn_s, adapt)
    return (others, state), d_others + d_hat


def initial_none(parameters: Any) -> float:
    """Return the state of no compensator."""
    return 0.0


def initial_one_more(parameters: Any) -> Any:
    """Return the first states of a compensator, and of those before it."""
    return (initial_learnt(parameters[0]), initial_one(parameters[1]))


def held(dof: Dof, start: Estimate) -> Held:
    """Rest where the vehicle is (`Controller.rest`)."""
    d = limited(start.d, dof.max_disturbance) if dof.by_observer else 0.0
    return Held(
        start.q,
        reference.start(dof.reference, start.q, start.v),
        oscillation.START,
        initial_law(dof.law),
        initial_learnt(dof.compensators),
        d,
        1.0,
        1.0,
        False,
        1.0,
    )


def followed(dof: Dof, before: Held, target: Three, ahead_s: float) -> reference.State:
    """Let the reference go on toward where the target will be `ahead_s` later; NaN: stay where it began."""
    position = before.began if math.isnan(target[0]) else target[0]
    x, x_dot, x_ddot = reference.ahead(position, target[1], target[2], ahead_s)
    return reference.step(dof.reference, before.reference, x, x_dot, x_ddot, before.allowed_pace, TICK_S)


def control(
    dof: Dof,
    before: Held,
    x_d: reference.State,
    x: Estimate,
    e: float,
    m: float,
    k_plus_h: float,
    late_s: float,
    left: ScheduledGains,
    learns: bool,
    used: Used,
) -> tuple[Held, float]:
    """Return what is remembered, and the force (N) or moment (N·m) that is asked for (`Controller.step`)."""
    gain, free = math.exp(used.log_gain), not before.saturated
    e_dot = x.v - x_d.x_d_dot
    lam, kappa, learning_scale, share, d_share = left
    signals = Signals(e, e_dot, e_dot + lam * e, x.v, x_d.x_d_dot, x_d.x_d_ddot)
    d = limited(x.d, dof.max_disturbance) if dof.by_observer else 0.0
    learnt, found = learn(
        dof.compensators, before.learnt, signals, learning_scale / gain * TICK_S, learns and free
    )
    mean_d = mean_disturbance(before.mean_d, d + found, TICK_S)
    d_hat = scaled_disturbance(mean_d, d + found, d_share)
    motion = Motion(e, e_dot, x.v, x_d.x_d_ddot, m / gain, k_plus_h / gain, d_hat, lam, kappa, share, free)
    law, terms = force(dof.law, before.law, motion, TICK_S)
    tau = terms.feedforward + terms.feedback + terms.d_hat
    believed_s = late_s + oscillation.LOG_GAIN_COUNTS_S * used.log_gain
    watched = oscillation.step(dof.oscillation, before.oscillation, tau, TICK_S, believed_s)
    return Held(
        before.began,
        x_d,
        watched,
        law,
        learnt,
        mean_d,
        before.pace,
        before.allowed_pace,
        before.saturated,
        d_share,
    ), tau


def after(law: Held, own_pace: float, allowed_pace: float, saturated: bool) -> Held:
    """Return what is remembered of a degree of freedom once its command is out."""
    return Held(
        law.began,
        law.reference,
        law.oscillation,
        law.law,
        law.learnt,
        law.mean_d,
        own_pace,
        allowed_pace,
        saturated,
        law.d_share,
    )


def chosen(one: Axis) -> tuple[Slotted, Slotted]:
    """Return `control` and `held` with a degree of freedom's compensators and law in their slots."""
    learning, beginning = slotted(learn_none), slotted(initial_none)
    for compensator in joined(one.compensator):
        learning = slotted(learn_one_more, learn=learning, step_one=compensator.step)
        beginning = slotted(initial_one_more, initial_learnt=beginning, initial_one=compensator.initial)
    law = one.law
    return (
        slotted(control, learn=learning, force=law.step),
        slotted(held, initial_learnt=beginning, initial_law=law.initial),
    )
