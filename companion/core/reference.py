"""A reference that stays bounded and continuous in x_d, ẋ_d and ẍ_d, whatever the operator asks for.

The law needs the desired path to be twice differentiable with known bounds (the paper's assumption 2). The
model works on δ = x_d − x_target: when the target steps, δ steps the other way and x_d does not, and a moving
target is followed with its own rate and acceleration as feedforward. δ returns to zero by

    rate wanted   v_c = −sign(δ) min(s v_max, ω |δ|, √(a_max |δ|))  brakes before it arrives
    acceleration  a_c = clip((v_c − δ') / T_v, ±a_max)              follows that rate
    jerk          a'  = (a_c − a) / T_a                             so a is continuous too

with T_v = 4 T_a and ω T_v = 1/4, so that neither rate nor position overshoots (Fossen 2011, ch. 10.2).

| symbol                | meaning                                                    | unit                 |
|-----------------------|------------------------------------------------------------|----------------------|
| x_d, x_d_dot, …       | the reference and its derivatives                          | m, m/s, …; rad, …    |
| target, target_dot, … | what is asked for, and its own motion                      | m, m/s, …; rad, …    |
| delta                 | δ                                                          | m; rad               |
| pace                  | s, the share of v_max that is left (`tilt.pace`)           | 0..1                 |
"""

import math
from typing import NamedTuple

from companion.core.bounds import limited, square_root, wrap
from companion.records import Vector

ACCELERATION_LAG_S = 0.06
RATE_LAG_S = 4.0 * ACCELERATION_LAG_S
APPROACH_PER_S = 0.25 / RATE_LAG_S


class Parameters(NamedTuple):
    """v_max and a_max, m/s and m/s² or rad/s and rad/s², above zero; an angle takes the short way."""

    max_rate: float
    max_acceleration: float
    angular: bool


class ReferenceState(NamedTuple):
    """The reference of one degree of freedom, and the target's motion at the last step."""

    x_d: float
    x_d_dot: float
    x_d_ddot: float
    target_dot: float
    target_ddot: float


def start(parameters: Parameters, x: float, x_dot: float) -> ReferenceState:
    """Return a reference where the vehicle is and as it moves, so that engaging it is no step."""
    return ReferenceState(x, limited(x_dot, parameters.max_rate), 0.0, 0.0, 0.0)


def advance(
    parameters: Parameters,
    state: ReferenceState,
    target: float,
    target_dot: float,
    target_ddot: float,
    pace: float,
    dt_s: float,
) -> ReferenceState:
    """Advance by `dt_s` toward a target that moves by `target_dot`, `target_ddot`."""
    a_max = parameters.max_acceleration
    jerk_dt = a_max * (dt_s / ACCELERATION_LAG_S)

    # What of the target's change was no motion along its own path is a step: δ and its rates take it up.
    path_step = dt_s * (target_dot - 0.25 * dt_s * (state.target_ddot + target_ddot))
    delta = state.x_d + path_step - target
    if parameters.angular:
        delta = wrap(delta)
    delta_dot = state.x_d_dot + 0.5 * dt_s * (state.target_ddot + target_ddot) - target_dot
    turn = target_ddot - state.target_ddot
    delta_ddot = state.x_d_ddot - state.target_ddot - (turn - limited(turn, jerk_dt))

    distance = abs(delta)
    rate = limited(APPROACH_PER_S * distance, pace * parameters.max_rate)
    rate = limited(rate, square_root(a_max * distance))
    wanted = limited((-math.copysign(rate, delta) - delta_dot) / RATE_LAG_S, a_max)
    delta_ddot = delta_ddot + (wanted - delta_ddot) * (dt_s / (ACCELERATION_LAG_S + dt_s))
    fastest = abs(delta_dot)
    if fastest < parameters.max_rate:
        fastest = parameters.max_rate
    delta_dot = limited(delta_dot + dt_s * delta_ddot, fastest)

    return ReferenceState(
        state.x_d + path_step + dt_s * delta_dot,
        target_dot + delta_dot,
        target_ddot + delta_ddot,
        target_dot,
        target_ddot,
    )


def ahead(target: float, target_dot: float, target_ddot: float, ahead_s: float) -> tuple[float, float, float]:
    """Return where a target that moves steadily will be `ahead_s` later, its rate and acceleration there."""
    later_dot = target_dot + ahead_s * target_ddot
    return target + (0.5 * ahead_s) * (target_dot + later_dot), later_dot, target_ddot


class Reference(NamedTuple):
    """The references of all four degrees of freedom, and the share of each `max_rate` that is left."""

    states: tuple[ReferenceState, ReferenceState, ReferenceState, ReferenceState]
    pace: Vector

    @property
    def x_d(self) -> Vector:
        """Where it is to be."""
        x, y, z, psi = self.states
        return (x.x_d, y.x_d, z.x_d, psi.x_d)
