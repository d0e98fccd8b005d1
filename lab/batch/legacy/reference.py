"""A reference that stays bounded and continuous in x_d, ẋ_d and ẍ_d, whatever the operator asks for.

The law needs the desired path to be twice differentiable with known bounds (the paper's assumption 2). The
model works on δ = x_d − x_target: when the target steps, δ steps the other way and x_d does not, and a moving
target is followed with its own rate and acceleration as feedforward. δ returns to zero by

    rate wanted   v_c = −sign(δ) min(s v_max, ω |δ|, √(a_max |δ|))  brakes before it arrives
    acceleration  a_c = clip((v_c − δ') / T_v, ±a_max)              follows that rate
    jerk          a'  = (a_c − a) / T_a                             so a is continuous too

with T_v = 4 T_a and ω T_v = 1/4, so that neither rate nor position overshoots (Fossen 2011, ch. 10.2).
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from lab.batch.legacy.bounds import bounded, wrap
from lab.batch.legacy.frames import shifted_along, turned
from lab.batch.legacy.records import Array, Flags, FrameShift

ACCELERATION_LAG_S = 0.06
RATE_LAG_S = 4.0 * ACCELERATION_LAG_S
APPROACH_PER_S = 0.25 / RATE_LAG_S


@dataclass(frozen=True, slots=True)
class Limits:
    """Bounds on |δ'| and |δ''|, shape of x_d: m/s and m/s², or rad/s and rad/s². Both above zero."""

    rate: Array
    acceleration: Array


class ReferenceModel:
    """x_d, ẋ_d, ẍ_d for any leading shape; where `angular`, targets are angles and the short way is taken."""

    def __init__(self, limits: Limits, angular: Flags) -> None:
        self.limits = limits
        self.pace: Array | float = 1.0
        """The share of `limits.rate` that may be used now: less where the vehicle does not follow."""
        self._angular = angular
        self.reset(np.zeros_like(limits.rate), np.zeros_like(limits.rate))

    def reset(self, x: Array, x_dot: Array) -> None:
        """Start from where the vehicle is and how it moves, so that engaging it is no step."""
        self.x_d = x.copy()
        self.x_d_dot = bounded(x_dot, self.limits.rate)
        self.x_d_ddot = np.zeros_like(x)
        self._target_dot = np.zeros_like(x)
        self._target_ddot = np.zeros_like(x)

    def catch_up(self, x: Array, x_dot: Array, where: Flags) -> None:
        """Start anew `where` asked, from how the vehicle is and moves."""
        kept = self.x_d, self.x_d_dot, self.x_d_ddot, self._target_dot, self._target_ddot
        self.reset(x, x_dot)
        anew = self.x_d, self.x_d_dot, self.x_d_ddot, self._target_dot, self._target_ddot
        self.x_d, self.x_d_dot, self.x_d_ddot, self._target_dot, self._target_ddot = (
            np.where(where, new, old) for new, old in zip(anew, kept, strict=True)
        )

    def go_on(self, other: Self) -> None:
        """Stand where `other` stands, with the same rates and the same target."""
        self.x_d, self.x_d_dot, self.x_d_ddot = other.x_d, other.x_d_dot, other.x_d_ddot
        self._target_dot, self._target_ddot = other._target_dot, other._target_ddot

    def shift(self, shift: FrameShift, vehicle: Array) -> None:
        """Stay where it is as seen from the vehicle (its pose after the shift), with the same motion."""
        self.x_d = shifted_along(shift, self.x_d, vehicle)
        self.x_d_dot, self.x_d_ddot = turned(shift, self.x_d_dot), turned(shift, self.x_d_ddot)
        self._target_dot, self._target_ddot = (
            turned(shift, self._target_dot),
            turned(shift, self._target_ddot),
        )

    def step(self, target: Array, target_dot: Array, target_ddot: Array, dt_s: float) -> None:
        """Advance by `dt_s` toward a target that moves by `target_dot`, `target_ddot`."""
        limits = self.limits
        a_max, jerk_dt = limits.acceleration, limits.acceleration * (dt_s / ACCELERATION_LAG_S)

        # What of the target's change was no motion along its own path is a step: δ and its rates take it up.
        path_step = 0.5 * dt_s * (self._target_dot + target_dot)
        delta = self.x_d + path_step - target
        delta = np.where(self._angular, wrap(delta), delta)
        delta_dot = self.x_d_dot + 0.5 * dt_s * (self._target_ddot + target_ddot) - target_dot
        turn = target_ddot - self._target_ddot
        delta_ddot = self.x_d_ddot - self._target_ddot - (turn - bounded(turn, jerk_dt))

        distance = np.abs(delta)
        most = self.pace * limits.rate
        rate = np.minimum(np.minimum(most, APPROACH_PER_S * distance), np.sqrt(a_max * distance))
        wanted = bounded((-np.copysign(rate, delta) - delta_dot) / RATE_LAG_S, a_max)
        delta_ddot = delta_ddot + (wanted - delta_ddot) * (dt_s / (ACCELERATION_LAG_S + dt_s))
        bound = np.maximum(limits.rate, np.abs(delta_dot))
        delta_dot = bounded(delta_dot + dt_s * delta_ddot, bound)

        self.x_d = self.x_d + path_step + dt_s * delta_dot
        self.x_d_dot = target_dot + delta_dot
        self.x_d_ddot = target_ddot + delta_ddot
        self._target_dot, self._target_ddot = target_dot, target_ddot
