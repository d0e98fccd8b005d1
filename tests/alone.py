"""Parts of the core stepped alone: each keeps its memory, as the engine does."""

# Tuples of four are made by loops here.
# mypy: disable-error-code="arg-type"

import math

from companion import assembly
from companion.config import load_config
from companion.core import controller, model_learner, observers, predictor
from companion.core.actuation import NONE
from companion.core.axis import Orders
from companion.core.observer import Push, Sample
from companion.core.positioning import jacobian
from companion.estimation.belief import believed
from companion.records import PSI, ZERO, Condition, DofSample, State, Verdict, vector

ALL = (True,) * 4
FULL = (1.0,) * 4
NOBODY = (False, False, False, False)
HOLDS = Verdict(State.ACTIVE, Condition(0), 1.0, "")
TICK_S = 0.02


class Law:
    """Reference, compensators and law of all degrees of freedom."""

    def __init__(self, *overrides):
        self.parameters = assembly.control(load_config(overrides=overrides))
        self.memory = controller.at_rest(self.parameters, ZERO, ZERO, ZERO)

    def rest(self, state):
        self.memory = controller.at_rest(
            self.parameters, state.eta_ahead, state.eta_dot_ahead, state.disturbance
        )

    def tick(self, s, target, engaged=ALL, saturated=NONE, verdict=HOLDS, idle=NOBODY):
        self.motion = observers.Estimates(
            s.eta,
            s.eta_dot,
            s.ahead_s,
            s.eta_ahead,
            s.eta_dot_ahead,
            s.disturbance,
            predictor.NONE,
            s.innovation,
            s.delays.total_s,
            s.model.dof_gain,
        )
        self.target = target
        full = verdict.authority >= 1.0
        orders = Orders(engaged, saturated, idle, full and not verdict.freeze, full, FULL)
        J = jacobian(s.eta_ahead[PSI])
        self.memory, samples = controller.demand(
            self.parameters, self.memory, self.motion, J, target, orders, TICK_S
        )
        return DofSample(*zip(*samples, strict=True))

    def taken_over(self, *overrides):
        """The same dive with another configuration."""
        new = Law(*overrides)
        new.memory = controller.taken_over(
            self.parameters,
            new.parameters,
            self.memory,
            self.motion,
            jacobian(self.motion.eta_ahead[PSI]),
            self.target,
        )
        return new

    def set_gain_scale(self, scale):
        axes = tuple(
            one._replace(oscillation=one.oscillation._replace(gain_scale=scale)) for one in self.memory.axes
        )
        self.memory = self.memory._replace(axes=axes)


class Estimate:
    """The estimator and its observers."""

    def __init__(self, config):
        self.shell, self.around = assembly.estimator(config), assembly.surroundings(config)
        self.observers = assembly.observers(config)
        self.memory = observers.start(self.observers)

    def step(self, now_s, events):
        sensed = self.shell.take(now_s, events, observers.outlook(self.memory))
        if sensed.restarted:
            self.memory = observers.restarted(self.memory)
        self.memory, motion = observers.step(self.observers, self.memory, sensed.inputs)
        model = self.memory.learner.model
        return believed(sensed, motion, self.around.step(sensed, motion, model), model)

    def sent(self, now_s, axes, tau_ned):
        self.shell.sent(now_s, axes)
        self.memory = observers.sent(self.memory, now_s, tau_ned, ZERO)


class Learner:
    """What is found of the vehicle."""

    def __init__(self, tables, lag_s, *, adapts):
        self.tables, self.lag_s, self.adapts = tables, lag_s, adapts
        self.reset()

    def reset(self):
        self.memory = model_learner.start(self.tables, self.lag_s)

    def begin(self, dof, position):
        places = vector(position if i == dof else math.nan for i in range(4))
        self.memory = model_learner.begun(self.memory, places)

    def turn(self, J):
        schedule = model_learner.turned(self.tables, self.memory, J)
        self.memory = self.memory._replace(schedule=schedule)

    def step(self, dof, push, sample, learns):
        """Take what one degree of freedom has shown, the others nothing."""
        shown = [observers.NOTHING_SHOWN] * 4
        u, m, c, dt_s = push
        shown[dof] = model_learner.Shown(Push(u, m, c, dt_s, u), Sample(*sample))
        self.memory = model_learner.learnt(
            self.memory, self.memory.schedule, tuple(shown), learns, self.adapts, dt_s
        )

    @property
    def model(self):
        return self.memory.model

    def parameters(self, dof):
        return self.memory.schedule.dofs[dof].control[0]
