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
| pace                  | s, the share of v_max that is left (`pace.py`)             | 0..1                 |
"""

import math
from collections.abc import Sequence
from typing import NamedTuple, Self

from companion.control.bounds import limited, square_root, wrap
from companion.control.frames import shifted_along, turned
from companion.records import Flags, FrameShift, Setpoint, Vector, vector

ACCELERATION_LAG_S = 0.06
RATE_LAG_S = 4.0 * ACCELERATION_LAG_S
APPROACH_PER_S = 0.25 / RATE_LAG_S


class Parameters(NamedTuple):
    """v_max and a_max, m/s and m/s² or rad/s and rad/s², above zero; an angle takes the short way."""

    max_rate: float
    max_acceleration: float
    angular: bool


class State(NamedTuple):
    """The reference of one degree of freedom, and the target's motion at the last step."""

    x_d: float
    x_d_dot: float
    x_d_ddot: float
    target_dot: float
    target_ddot: float


def start(parameters: Parameters, x: float, x_dot: float) -> State:
    """Return a reference where the vehicle is and as it moves, so that engaging it is no step."""
    return State(x, limited(x_dot, parameters.max_rate), 0.0, 0.0, 0.0)


def step(
    parameters: Parameters,
    state: State,
    target: float,
    target_dot: float,
    target_ddot: float,
    pace: float,
    dt_s: float,
) -> State:
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

    return State(
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


class ReferenceModel:
    """The references of all four degrees of freedom."""

    def __init__(self, parameters: Sequence[Parameters]) -> None:
        self._parameters = parameters
        self.pace: Vector = (1.0, 1.0, 1.0, 1.0)
        """The share of each `max_rate` that may be used now: less where the vehicle does not follow."""
        self.reset((0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0))

    @property
    def x_d(self) -> Vector:
        """Where it is to be."""
        x, y, z, psi = self.states
        return (x.x_d, y.x_d, z.x_d, psi.x_d)

    def reset(self, x: Vector, x_dot: Vector) -> None:
        """Start where the vehicle is and as it moves."""
        self.states = [start(*each) for each in zip(self._parameters, x, x_dot, strict=True)]

    def catch_up(self, x: Vector, x_dot: Vector, where: Flags) -> None:
        """Start anew `where` asked, where the vehicle is and as it moves."""
        for i, asked in enumerate(where):
            if asked:
                self.states[i] = start(self._parameters[i], x[i], x_dot[i])

    def go_on(self, other: Self) -> None:
        """Stand where `other` stands, with the same rates, target and pace."""
        self.states, self.pace = list(other.states), other.pace

    def shift(self, shift: FrameShift, vehicle: Vector) -> None:
        """Stay where it is as seen from the vehicle (its pose after the shift), with the same motion."""
        x_d, *motion = (vector(column) for column in zip(*self.states, strict=True))
        columns = (shifted_along(shift, x_d, vehicle), *(turned(shift, each) for each in motion))
        self.states = [State(*values) for values in zip(*columns, strict=True)]

    def step(self, target: Setpoint, ahead_s: float, dt_s: float) -> tuple[Vector, Vector, Vector]:
        """Advance by `dt_s` toward where `target` will be `ahead_s` later; return x_d, ẋ_d, ẍ_d."""
        eta_d, eta_d_dot, eta_d_ddot = target.eta_d, target.eta_d_dot, target.eta_d_ddot
        states = []
        for i, parameters in enumerate(self._parameters):
            x, x_dot, x_ddot = ahead(eta_d[i], eta_d_dot[i], eta_d_ddot[i], ahead_s)
            states.append(step(parameters, self.states[i], x, x_dot, x_ddot, self.pace[i], dt_s))
        self.states = states
        x_d, x_d_dot, x_d_ddot, _, _ = zip(*states, strict=True)
        return vector(x_d), vector(x_d_dot), vector(x_d_ddot)
