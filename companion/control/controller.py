"""Reference, law and compensators of all four degrees of freedom, in the order in which they act."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from companion.control.bounds import bounded
from companion.control.compensator import Compensator, inputs
from companion.control.frames import turned
from companion.control.law import rov_law
from companion.control.oscillation import Oscillation, ScaledDisturbance
from companion.control.positioning import Model, pose_error, to_body
from companion.control.reference import ReferenceModel
from companion.records import PSI, Array, DofSample, Flags, FrameShift, Setpoint, VehicleState

BLEND_S = 2.0
"""How slowly the difference that a change of law made is let go."""

LAMBDA_POWER, KAPPA_POWER, LEARNING_POWER = 0.6, 1.4, 2.0


@dataclass(frozen=True, slots=True)
class Gains:
    """λ and κ (1/s) of each DOF, where the observer's d is fed back, the bound on d̂ (N, N·m); shape (4,).

    They bear a loop that is `delay_s` late in all. Where it is later they are drawn back, by the powers that
    keep a gain margin of 2 (shared/paper.md, "Gains against a known total delay").
    """

    lam: Array
    kappa: Array
    by_observer: Flags
    d_max: Array
    start_delay_s: float
    delay_s: Array | float

    def scheduled(
        self, delay_s: Array | float, gain_scale: Array | float = 1.0
    ) -> tuple[Array, Array, Array]:
        """Return λ, κ and the share of its learning rate that a compensator keeps at a delay of `delay_s`.

        `gain_scale` is what `Oscillation` leaves of them.
        """
        share = gain_scale * np.minimum(1.0, self.delay_s / np.maximum(delay_s, 1e-3))
        return self.lam * share**LAMBDA_POWER, self.kappa * share**KAPPA_POWER, share**LEARNING_POWER


class Controller:
    """Steps the law; holds the reference, the compensators and how long it has been engaged.

    `compensators` are those that learn, each with the DOFs it serves; a DOF may have none or several.
    """

    def __init__(
        self,
        model: Model,
        gains: Gains,
        reference: ReferenceModel,
        compensators: Sequence[tuple[Flags, Compensator]],
        oscillation: Oscillation,
    ) -> None:
        self._model = model
        self._gains = gains
        self.reference = reference
        self._compensators = compensators
        self.frozen = False
        """Whether nothing may be learnt for the time being."""
        self.authority = 1.0
        """What share of the demand becomes thrust: while it grows, nothing is learnt and nothing watched."""
        self._oscillation = oscillation
        self._engaged_s = 0.0
        self._bumpless_bias = np.zeros(4)
        self._scaled_disturbance = ScaledDisturbance(np.zeros(4))
        self._inherited = np.zeros(4, bool)
        self._predecessor: Self | None = None
        self._d_hat = np.zeros(4)
        self._turned_d_hat: Array | None = None

    def transfer_from(self, predecessor: Self) -> None:
        """Go on where `predecessor` is, without a step in thrust.

        Whoever learns goes on with what was learnt, or with the d̂ of whoever served before. What the new law
        would still ask more or less than the old one did is carried along as d̂, and let go over BLEND_S.
        """
        self.reference.go_on(predecessor.reference)
        self._engaged_s = predecessor._engaged_s
        self._oscillation = predecessor._oscillation
        self._scaled_disturbance = predecessor._scaled_disturbance
        self._predecessor = predecessor
        for serves, compensator in self._compensators:
            for served, old in predecessor._compensators:
                if type(old) is type(compensator):
                    compensator.inherit(old, serves & served)
                    self._inherited = self._inherited | (serves & served)

    @property
    def gain_scale(self) -> Array:
        """What is left of the gains, (…, 4): less than 1 while the loop oscillates."""
        return self._oscillation.gain_scale

    def rest(self, state: VehicleState) -> None:
        """Stay where the vehicle is, with nothing learnt: engaging from here is no step."""
        self.reference.reset(np.array(state.eta_ahead), np.array(state.eta_dot_ahead))
        for _, compensator in self._compensators:
            compensator.reset()
        self._oscillation.reset()
        self._engaged_s = 0.0
        self._bumpless_bias = np.zeros_like(self.reference.x_d)
        self._scaled_disturbance.mean = self._observed(state)
        self._predecessor = None
        self._turned_d_hat = None

    def shift(self, shift: FrameShift, vehicle: Array) -> None:
        """Go on in the frame of a reset estimate, without a step in thrust; `vehicle` is its pose there.

        What was learnt along north and east is another direction now. The difference is carried along and let
        go over BLEND_S, as after a change of law.
        """
        self.reference.shift(shift, vehicle)
        if shift.turn_rad:
            self._turned_d_hat = turned(shift, self._d_hat)
            self._scaled_disturbance.mean = turned(shift, self._scaled_disturbance.mean)
        if self._predecessor is not None:
            self._predecessor.shift(shift, vehicle)

    def step(
        self, state: VehicleState, J: Array, target: Setpoint, engaged: Flags, free: Flags, dt_s: float
    ) -> DofSample:
        """Return the law's inside, NED; learn only where `engaged` and `free` of saturation.

        J is the Jacobian at the heading where the command acts.
        """
        gains, reference = self._gains, self.reference
        ahead_s = state.ahead_s
        target_dot = target.eta_d_dot + ahead_s * target.eta_d_ddot
        reference.step(
            target.eta_d + (0.5 * ahead_s) * (target.eta_d_dot + target_dot),
            target_dot,
            target.eta_d_ddot,
            dt_s,
        )
        self._engaged_s += dt_s

        scale = self.gain_scale
        x, x_dot = np.array(state.eta_ahead), np.array(state.eta_dot_ahead)
        e = pose_error(x, reference.x_d)
        e_dot = x_dot - reference.x_d_dot
        nu = to_body(J, x_dot - (1.0 - scale) * e_dot)
        lam, kappa, learning_scale = gains.scheduled(state.delays.total_s, scale)
        eps = e_dot + lam * e
        theta = inputs(e, e_dot, x_dot, reference.x_d_dot, reference.x_d_ddot)
        frozen = self.frozen or self.authority < 1.0
        may_learn = engaged & free & (not frozen) & (self._engaged_s >= gains.start_delay_s)
        d_hat = self._observed(state)
        adapting, weight_norm = np.zeros(e.shape, bool), np.zeros(e.shape)
        before: DofSample | None = None
        if self._predecessor is not None:
            before = self._predecessor.step(state, J, target, engaged, free, dt_s)
            self._predecessor = None
        for serves, compensator in self._compensators:
            if before is not None:
                compensator.seed(theta, before.d_hat - d_hat, serves & ~self._inherited)
            d_hat = d_hat + serves * compensator.step(theta, eps, learning_scale * dt_s, may_learn & serves)
            adapting = adapting | compensator.learning_now
            weight_norm = weight_norm + serves * compensator.weight_norm

        d_hat = self._scaled_disturbance.step(d_hat, scale, dt_s)
        carried = self._bumpless_bias * math.exp(-dt_s / BLEND_S)
        if self._turned_d_hat is not None:
            carried[..., :PSI] = (self._turned_d_hat - d_hat)[..., :PSI]
            self._turned_d_hat = None
        law = rov_law(
            k_plus_h=self._model.coriolis_and_damping(J, nu),
            d_hat=d_hat,
            m=self._model.inertia(J),
            x_d_ddot=reference.x_d_ddot,
            e=e,
            e_dot=e_dot,
            lam=lam,
            kappa=kappa,
        )
        if before is not None:
            self._bumpless_bias = before.feedforward + before.feedback + before.d_hat - law.tau
        else:
            self._bumpless_bias = carried
        self._d_hat = d_hat + self._bumpless_bias
        tau = (law.tau + self._bumpless_bias) * engaged
        if self.authority >= 1.0:
            self._oscillation.step(tau, dt_s, state.delays.total_s)
        return DofSample(
            x_d=reference.x_d,
            x_d_dot=reference.x_d_dot,
            x_d_ddot=reference.x_d_ddot,
            x=x,
            x_dot=x_dot,
            e=e,
            e_dot=e_dot,
            eps=law.eps,
            tau=tau,
            feedforward=law.feedforward,
            feedback=law.feedback,
            d_hat=self._d_hat,
            d_observer=np.array(state.disturbance),
            weight_norm=weight_norm,
            saturated=~free,
            adapting=adapting,
            engaged=engaged,
        )

    def _observed(self, state: VehicleState) -> Array:
        """Return the observer's d̂ where it is fed back."""
        return bounded(np.array(state.disturbance), self._gains.d_max) * self._gains.by_observer
