"""Reference, error, compensators and law of all four degrees of freedom, in the order in which they act."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from operator import sub
from typing import Any, NamedTuple, Self

from companion.control import oscillation, reference
from companion.control.bounds import limited
from companion.control.compensator import Signals
from companion.control.frames import turned
from companion.control.law import Motion
from companion.control.oscillation import mean_disturbance, scaled_disturbance
from companion.control.positioning import (
    Jacobian,
    Model,
    coriolis_and_damping,
    inertia,
    pose_error,
    to_body,
)
from companion.control.reference import ReferenceModel
from companion.control.schedule import Gains, scheduled
from companion.records import (
    PSI,
    DofSample,
    Flags,
    FrameShift,
    Setpoint,
    Vector,
    VehicleState,
    Verdict,
    vector,
)

BLEND_S = 2.0
"""How slowly the difference that a change of law made is let go."""


class Chosen(NamedTuple):
    """A compensator or a law, and its parameters on one axis."""

    functions: Any
    parameters: Any


@dataclass(frozen=True, slots=True)
class Dof:
    """How one degree of freedom is controlled; `by_observer`: the observer's d is fed back."""

    gains: Gains
    reference: reference.Parameters
    oscillation: oscillation.Parameters
    law: Chosen
    compensators: tuple[Chosen, ...]
    by_observer: bool
    max_disturbance: float


@dataclass(slots=True)
class DofState:
    """What the controller remembers of one degree of freedom, beside its reference."""

    oscillation: oscillation.State
    law: Any
    learnt: list[Any]
    """The state of each compensator."""
    mean_d: float = 0.0
    d_hat: float = 0.0
    bumpless_bias: float = 0.0
    """What a change of law, or of frame, left in thrust: let go over BLEND_S."""
    d_share: float = 1.0
    """What d̂ was scaled by in the last tick."""
    inherited: bool = False
    """What its compensators know came from their predecessors."""


class Controller:
    """Steps the equations of four degrees of freedom, and holds their states."""

    def __init__(self, model: Model, dofs: Sequence[Dof], start_delay_s: float) -> None:
        """Take how each DOF is controlled, and how long after engaging nothing is learnt."""
        self._model = model
        self._dofs = dofs
        self._start_delay_s = start_delay_s
        self.reference = ReferenceModel([dof.reference for dof in dofs])
        self._states = [_rested(dof, 0.0) for dof in dofs]
        self._engaged_s = 0.0
        self._predecessor: Self | None = None
        self._turned_d_hat: Vector | None = None

    @property
    def d_share(self) -> Vector:
        """What d̂ is scaled by: less than 1 while the loop is too late for it, or oscillates."""
        x, y, z, psi = self._states
        return (x.d_share, y.d_share, z.d_share, psi.d_share)

    def transfer_from(self, predecessor: Self) -> None:
        """Go on where `predecessor` is, without a step in thrust.

        Whoever learns goes on with what was learnt, or with the d̂ of whoever served before. What the new law
        would still ask more or less than the old one did is carried along as d̂, and let go over BLEND_S.
        """
        self.reference.go_on(predecessor.reference)
        self._engaged_s = predecessor._engaged_s
        self._predecessor = predecessor
        both = zip(self._dofs, self._states, predecessor._dofs, predecessor._states, strict=True)
        for dof, state, old, before in both:
            state.oscillation, state.mean_d, state.d_share = before.oscillation, before.mean_d, before.d_share
            if old.law.functions is dof.law.functions:
                state.law = before.law
            known = [chosen.functions for chosen in old.compensators]
            for i, chosen in enumerate(dof.compensators):
                if chosen.functions in known:
                    state.learnt[i] = before.learnt[known.index(chosen.functions)]
                    state.inherited = True

    def rest(self, state: VehicleState) -> None:
        """Stay where the vehicle is, with nothing learnt: engaging from here is no step."""
        self.reference.reset(state.eta_ahead, state.eta_dot_ahead)
        self._states = [_rested(dof, d) for dof, d in zip(self._dofs, state.disturbance, strict=True)]
        self._engaged_s = 0.0
        self._predecessor = None
        self._turned_d_hat = None

    def shift(self, shift: FrameShift, vehicle: Vector) -> None:
        """Go on in the frame of a reset estimate, without a step in thrust; `vehicle` is its pose there.

        What was learnt along north and east is another direction now. The difference is carried along and let
        go over BLEND_S, as after a change of law.
        """
        self.reference.shift(shift, vehicle)
        mean_d = turned(shift, vector([one.mean_d for one in self._states]))
        for one, mean in zip(self._states, mean_d, strict=True):
            one.mean_d = mean
        if shift.turn_rad:
            self._turned_d_hat = turned(shift, vector([one.d_hat for one in self._states]))
        if self._predecessor is not None:
            self._predecessor.shift(shift, vehicle)

    def lose(self, tau_ned: Vector) -> None:
        """Take from d̂ what a motor that gives no thrust was believed to give, N and N·m.

        The demand becomes less by it in one tick: that is no oscillation.
        """
        for one, lost in zip(self._states, tau_ned, strict=True):
            one.mean_d -= lost
            one.oscillation = one.oscillation._replace(slow=one.oscillation.slow - lost)

    def step(
        self,
        state: VehicleState,
        J: Jacobian,
        target: Setpoint,
        engaged: Flags,
        saturated: Flags,
        verdict: Verdict,
        dt_s: float,
    ) -> DofSample:
        """Return the law's inside, NED; learn only where `engaged` and not `saturated`.

        While the authority grows nothing is learnt and nothing watched; `verdict` may forbid learning.
        J is the Jacobian at the heading where the command acts.
        """
        delay_s, x, x_dot = state.delays.total_s, state.eta_ahead, state.eta_dot_ahead
        before: DofSample | None = None
        if self._predecessor is not None:
            before = self._predecessor.step(state, J, target, engaged, saturated, verdict, dt_s)
            self._predecessor = None
        self._engaged_s += dt_s
        let_go = math.exp(-dt_s / BLEND_S)
        full = verdict.authority >= 1.0
        learns = full and not verdict.freeze and self._engaged_s >= self._start_delay_s

        x_d, x_d_dot, x_d_ddot = self.reference.step(target, state.ahead_s, dt_s)
        e, e_dot = pose_error(x, x_d), vector(map(sub, x_dot, x_d_dot))
        gains, later_s = state.model.dof_gain, state.model.dof_later_s
        left = [
            scheduled(dof.gains, delay_s + late_s, one.oscillation.gain_scale, state.model.longest_lag_s)
            for dof, one, late_s in zip(self._dofs, self._states, later_s, strict=True)
        ]
        nu = to_body(J, vector([x_dot[i] - (1.0 - left[i].d_share) * e_dot[i] for i in range(4)]))
        m, k_plus_h = inertia(self._model, J), coriolis_and_damping(self._model, J, nu)

        rows: list[tuple[Any, ...]] = []
        for i, (dof, one) in enumerate(zip(self._dofs, self._states, strict=True)):
            free = engaged[i] and not saturated[i]
            gain = gains[i]
            lam, kappa, learning_scale, share, one.d_share = left[i]
            eps = e_dot[i] + lam * e[i]

            d, weight_norm, adapting = _observed(dof, state.disturbance[i]), 0.0, False
            if dof.compensators:
                signals = Signals(e[i], e_dot[i], eps, x_dot[i], x_d_dot[i], x_d_ddot[i])
                if before is not None and not one.inherited:
                    _seed(dof, one, signals, before.d_hat[i] - d)
                learn_s, adapt = learning_scale / gain * dt_s, learns and free
                found, weight_norm, adapting = _learn(dof, one, signals, learn_s, adapt)
                d += found
            one.mean_d = mean_disturbance(one.mean_d, d, dt_s)
            d_hat = scaled_disturbance(one.mean_d, d, one.d_share)

            motion = Motion(
                e[i],
                e_dot[i],
                x_dot[i],
                x_d_ddot[i],
                m[i] / gain,
                k_plus_h[i] / gain,
                d_hat,
                lam,
                kappa,
                share,
                free,
            )
            one.law, (feedforward, feedback, d_hat) = dof.law.functions.step(
                dof.law.parameters, one.law, motion, dt_s
            )
            asked = feedforward + feedback + d_hat
            if before is not None:
                one.bumpless_bias = before.feedforward[i] + before.feedback[i] + before.d_hat[i] - asked
            elif self._turned_d_hat is not None and i != PSI:
                one.bumpless_bias = self._turned_d_hat[i] - d_hat
            else:
                one.bumpless_bias *= let_go
            one.d_hat = d_hat + one.bumpless_bias
            tau = asked + one.bumpless_bias if engaged[i] else 0.0
            if full:
                believed_s = delay_s + later_s[i] + oscillation.LOG_GAIN_COUNTS_S * math.log(gain)
                one.oscillation = oscillation.step(dof.oscillation, one.oscillation, tau, dt_s, believed_s)
            rows.append((eps, tau, feedforward, feedback, one.d_hat, weight_norm, adapting))
        self._turned_d_hat = None

        by_dof: Iterable[Any] = zip(*rows, strict=True)
        all_eps, taus, feedforwards, feedbacks, d_hats, weight_norms, learnt = by_dof
        return DofSample(
            x_d=x_d,
            x_d_dot=x_d_dot,
            x_d_ddot=x_d_ddot,
            x=x,
            x_dot=x_dot,
            e=e,
            e_dot=e_dot,
            eps=all_eps,
            tau=taus,
            feedforward=feedforwards,
            feedback=feedbacks,
            d_hat=d_hats,
            d_observer=state.disturbance,
            weight_norm=weight_norms,
            saturated=saturated,
            adapting=learnt,
            engaged=engaged,
        )


def _rested(dof: Dof, disturbance: float) -> DofState:
    return DofState(
        oscillation.START,
        dof.law.functions.initial(dof.law.parameters),
        [chosen.functions.initial(chosen.parameters) for chosen in dof.compensators],
        mean_d=_observed(dof, disturbance),
    )


def _observed(dof: Dof, disturbance: float) -> float:
    """Return the observer's d̂ where it is fed back."""
    return limited(disturbance, dof.max_disturbance) if dof.by_observer else 0.0


def _seed(dof: Dof, one: DofState, signals: Signals, d_hat: float) -> None:
    """Let the first compensator answer with `d_hat`, N or N·m."""
    functions, parameters = dof.compensators[0]
    one.learnt[0] = functions.seed(parameters, one.learnt[0], signals, d_hat)


def _learn(
    dof: Dof, one: DofState, signals: Signals, learn_s: float, adapt: bool
) -> tuple[float, float, bool]:
    """Step the compensators; return the sums of their d̂ and weight norms, and whether any of them learnt."""
    d_hat, weight_norm, adapting = 0.0, 0.0, False
    for i, (functions, parameters) in enumerate(dof.compensators):
        one.learnt[i], found, learning = functions.step(parameters, one.learnt[i], signals, learn_s, adapt)
        d_hat += found
        weight_norm += functions.weight_norm(one.learnt[i])
        adapting = adapting or learning
    return d_hat, weight_norm, adapting
