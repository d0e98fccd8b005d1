"""L1 adaptive control: a fast velocity predictor finds the disturbance, a low-pass filter lets it in.

    predictor   v̂' = (f − k − h − σ)/m − a ṽ          ṽ = v̂ − ẋ
    adaptation  σ = m a e^{−a T} ṽ/(1 − e^{−a T})      piecewise constant: undoes ṽ within one tick T
    filter      d̂' = ω (σ − d̂)
    law         τ = k + h + m (ẍ_d − λ ė − κ ε) + d̂

(Hovakimyan and Cao, L1 Adaptive Control Theory, 2010, ch. 3.3.) f is the thrust there: what was asked for,
through the thrusters' lag. The disturbance has the paper's sign.
"""

from dataclasses import dataclass

import numpy as np

from lab.batch.legacy.bounds import bounded
from lab.batch.legacy.controller import KAPPA_POWER, LAMBDA_POWER, LEARNING_POWER
from lab.batch.legacy.records import Array
from lab.batch.legacy.rival_law import Forces, Motion

PREDICTOR_PER_S = 1.0


@dataclass(frozen=True, slots=True)
class L1Gains:
    """λ, κ, ω (1/s); bounds on d̂ and on the force (N). Scalars, or of the motion's shape.

    `lag_s` is the thrusters' lag and `lead_s` how far beyond its arrival a command is looked at.
    """

    lam: Array | float
    kappa: Array | float
    omega: Array | float
    d_max: float
    max_force: float
    lag_s: float
    lead_s: Array | float


class L1:
    """Law, predictor and filter; while the command is cut off the predictor follows and nothing is learnt."""

    def __init__(self, gains: L1Gains) -> None:
        self._gains = gains
        self.reset()

    def reset(self) -> None:
        """Know of no disturbance and of no motion."""
        self._started = False
        self._v: Array = np.zeros(())
        self._pull: Array = np.zeros(())
        self._asked: Array = np.zeros(())
        self._thrust: Array = np.zeros(())
        self._d_hat: Array = np.zeros(())

    def step(self, motion: Motion, dt_s: float) -> Forces:
        """Return the force for this tick."""
        gains, m = self._gains, motion.inertia
        self._thrust = self._asked + (self._thrust - self._asked) * np.exp(-dt_s / gains.lag_s)
        thrust = self._asked + (self._thrust - self._asked) * np.exp(-gains.lead_s / gains.lag_s)
        known = motion.free if self._started else np.zeros_like(motion.free)
        self._started = True
        v_hat = np.where(known, self._v + dt_s * (thrust / m + self._pull), motion.x_dot)
        ahead = v_hat - motion.x_dot
        keep = np.exp(-PREDICTOR_PER_S * dt_s)
        sigma = m * PREDICTOR_PER_S * ahead * (keep / (1.0 - keep) if dt_s > 0.0 else 0.0)
        self._v, self._pull = v_hat, -(motion.drag + sigma) / m - PREDICTOR_PER_S * ahead
        omega = gains.omega * motion.share**LEARNING_POWER
        let_in = (1.0 - np.exp(-omega * dt_s)) * motion.free
        self._d_hat = bounded(self._d_hat + let_in * (sigma - self._d_hat), np.asarray(gains.d_max))

        lam, kappa = gains.lam * motion.share**LAMBDA_POWER, gains.kappa * motion.share**KAPPA_POWER
        eps = motion.e_dot + lam * motion.e
        feedforward = motion.drag + m * motion.x_d_ddot
        feedback = -m * (lam * motion.e_dot + kappa * eps)
        self._asked = bounded(feedforward + feedback + self._d_hat, np.asarray(gains.max_force))
        return Forces(feedforward, feedback, self._d_hat)
