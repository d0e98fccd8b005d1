"""Model-predictive control of one axis, with the observer's disturbance: a quadratic programme in each tick.

    min Σ_j (e_j² + (T_e ė_j)²) + ρ² Σ_j (u_j − u_{j−1})²      |u_j| ≤ max_force,  j = 1 … STEPS
    f' = (u − f)/τ_l        m ë = f − k − h − d̂ − m ẍ_d        over STEPS steps of STEP_S

Thrust follows through the lag, and is bounded. The disturbance and what Coriolis and damping take stay as
they are over the horizon; the reference goes on with its acceleration. (With a disturbance observer: Hu,
Li, Jiang, Huang and Wen, J. Mar. Sci. Eng. 2024, 12, 94.) Solved by projected Newton steps (Bertsekas, SIAM
J. Control Optim. 1982, 20, 221) from the plan of the tick before.

| symbol | meaning                                              | key, or unit                    |
|--------|------------------------------------------------------|---------------------------------|
| T_e    | weight of the rate of the error, s                   | laws.mpc.rate_s                 |
| ρ      | weight of a change of thrust, mm/N                   | laws.mpc.change_mm_per_n        |
| u, f   | thrust that is asked for, and there, N               | max_force                       |
| τ_l    | lag of the thrusters, s                              | thrusters.lag_s                 |
| d̂      | of the axis' compensators, N                         |                                 |
"""

import math
from typing import NamedTuple

from companion.core.bounds import limited
from companion.core.law import Motion
from lab.rivals.thrust import there

STEPS, STEP_S, ROUNDS = 20, 0.06, 3


class Parameters(NamedTuple):
    """Weights; `lag_s` is the thrusters' lag, `lead_s` how far beyond its arrival a command is looked at."""

    rate_s: float
    change_mm_per_n: float
    max_force: float
    lag_s: float
    lead_s: float


class State(NamedTuple):
    """The plan of the tick before, and the thrust that is believed to be there."""

    plan: list[float]
    """u, N (STEPS,)."""
    asked: float
    thrust: float
    bends: list[float]
    """The Hessian of the errors' part, row by row (STEPS²,); [0] before the first tick."""


def initial(parameters: Parameters) -> State:
    """Return an empty plan."""
    return State([0.0] * STEPS, 0.0, 0.0, [0.0])


def step(parameters: Parameters, state: State, motion: Motion, dt_s: float) -> tuple[State, float, float]:
    """Return the force for this tick: the first of the plan. A late loop weighs a change more."""
    lag_s, m, rate_s = parameters.lag_s, motion.m, parameters.rate_s
    lagging, thrust = there(state.asked, state.thrust, parameters.lag_s, parameters.lead_s, dt_s)
    change = 1e-3 * parameters.change_mm_per_n / max(motion.share * motion.share, 1e-3)
    pull = -(motion.k_plus_h + motion.d_hat) / m - motion.x_d_ddot
    bends = state.bends if len(state.bends) > 1 else _bends(rate_s, lag_s, m)
    plan, most = state.plan, parameters.max_force
    for _ in range(ROUNDS):
        slope = _slope(plan, motion.e, motion.e_dot, thrust, state.asked, pull, rate_s, change, lag_s, m)
        held = [abs(plan[j]) >= most and plan[j] * slope[j] < 0.0 for j in range(STEPS)]
        by = _solved(bends, change, slope, held)
        plan = [limited(plan[j] - by[j], most) for j in range(STEPS)]
    return State(plan, plan[0], lagging, bends), plan[0], motion.d_hat


def _slope(
    plan: list[float],
    e: float,
    e_dot: float,
    thrust: float,
    asked: float,
    pull: float,
    rate_s: float,
    change: float,
    lag_s: float,
    m: float,
) -> list[float]:
    """Return the cost's gradient by u: forward through the model, and back by its adjoint."""
    keep = math.exp(-STEP_S / lag_s)
    errors, rates = [0.0] * STEPS, [0.0] * STEPS
    for j in range(STEPS):
        thrust = plan[j] + (thrust - plan[j]) * keep
        e_dot = e_dot + STEP_S * (thrust / m + pull)
        e = e + STEP_S * e_dot
        errors[j], rates[j] = e, e_dot
    slope = [0.0] * STEPS
    by_e, by_rate, by_thrust = 0.0, 0.0, 0.0
    for i in range(STEPS):
        j = STEPS - 1 - i
        by_e = by_e + 2.0 * errors[j]
        by_rate = by_rate + 2.0 * rate_s * rate_s * rates[j] + STEP_S * by_e
        by_thrust = by_thrust + STEP_S * by_rate / m
        slope[j] = (1.0 - keep) * by_thrust
        by_thrust = keep * by_thrust
        before = plan[j - 1] if j > 0 else asked
        after = plan[j + 1] if j < STEPS - 1 else plan[j]
        slope[j] = slope[j] + 2.0 * change * change * (2.0 * plan[j] - before - after)
    return slope


def _bends(rate_s: float, lag_s: float, m: float) -> list[float]:
    """Return the Hessian of the errors' part: its columns are the gradients of single steps."""
    bends = [0.0] * (STEPS * STEPS)
    for j in range(STEPS):
        unit = [0.0] * STEPS
        unit[j] = 1.0
        column = _slope(unit, 0.0, 0.0, 0.0, 0.0, 0.0, rate_s, 0.0, lag_s, m)
        for i in range(STEPS):
            bends[STEPS * i + j] = column[i]
    return bends


def _solved(bends: list[float], change: float, slope: list[float], held: list[bool]) -> list[float]:
    """Return H⁻¹ g for the steps that are not `held`, 0 for these: by Cholesky's factors."""
    n, two = STEPS, 2.0 * change * change
    factor, by = [0.0] * (n * n), [0.0] * n
    for i in range(n):
        for j in range(i + 1):
            if held[i] or held[j]:
                factor[n * i + j] = 1.0 if i == j else 0.0
                continue
            sum_ = bends[n * i + j]
            if i == j:
                sum_ += two * (2.0 if i < n - 1 else 1.0)
            elif i == j + 1:
                sum_ -= two
            for k in range(j):
                sum_ -= factor[n * i + k] * factor[n * j + k]
            factor[n * i + j] = math.sqrt(sum_) if i == j else sum_ / factor[n * j + j]
    for i in range(n):
        left = 0.0 if held[i] else slope[i]
        for k in range(i):
            left -= factor[n * i + k] * by[k]
        by[i] = left / factor[n * i + i]
    for back in range(n):
        i = n - 1 - back
        for k in range(i + 1, n):
            by[i] -= factor[n * k + i] * by[k]
        by[i] /= factor[n * i + i]
    return by
