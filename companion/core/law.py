"""The Lyapunov-based law of the paper, for a system of any order and for one degree of freedom of an ROV.

Another law may take its place on an axis: one file, which defines, as this one does,

    Parameters   a NamedTuple of numbers, each named as a key of the axis or of `[laws.NAME]`
    State        a NamedTuple of what it remembers
    initial      State at rest, from Parameters
    step         State and Terms after one tick of Motion

The lab compiles these functions with numba: so only `math`, floats, ints, bools, tuples, lists of floats.

The general law takes a sequence of n errors; each a float, or an array of as many as the paper's study has.

| symbol  | meaning                                          | unit (heave; yaw)    | source      |
|---------|--------------------------------------------------|----------------------|-------------|
| x_tilde | tracking error [x̃, x̃', …, x̃^(n-1)], measured − desired | m, m/s, …      | sec. 2      |
| lam     | λ, the slope of the error surface                | 1/s                  | eq. 2       |
| c       | binomial coefficients with powers of λ           | –                    | eqs. 2, 3   |
| eps     | ε = cᵀ x̃, the combined error                     | m/s; rad/s           | eq. 2       |
| kappa   | κ, how fast ε decays                             | 1/s                  | eq. 5       |
| f, b, d | drift, input gain, disturbance of x^(n) = f + b u + d |                 | eq. 1       |
| m       | m̄, inertia with added mass                      | kg; kg·m²            | eq. rov     |
| k, h    | Coriolis and damping forces                      | N; N·m               | eq. rov     |
| d_hat   | d̂, estimated disturbance, m ẍ = τ − k − h − d    | N; N·m               | eq. ann     |
| tau     | τ, the control force                             | N; N·m               | eq. lei2    |
"""

from collections.abc import Callable, Sequence
from math import comb
from typing import Any, NamedTuple, TypeVar

from companion.records import Array

NumberT = TypeVar("NumberT", float, Array)


def error_coefficients(n: int, lam: float) -> list[float]:
    """Return c = [c_{n-1} λ^{n-1}, …, c_1 λ, c_0] (eqs. 2 and 3) of a system of order n."""
    return [comb(n - 1, i) * lam**i for i in range(n - 1, -1, -1)]


def combined_error(x_tilde: Sequence[NumberT], lam: float) -> NumberT:
    """Return ε = cᵀ x̃ (eq. 2)."""
    return _weighted(error_coefficients(len(x_tilde), lam), x_tilde)


def control_law(
    f: NumberT,
    b: NumberT,
    d: NumberT,
    x_d_n: NumberT,
    x_tilde: Sequence[NumberT],
    lam: float,
    kappa: float,
) -> NumberT:
    """Return u = (−f − d + x_d^(n) − c̄ᵀ x̃ − κ ε) / b (eq. 5).

    c̄ = [0, c_{n-1} λ^{n-1}, …, c_1 λ] (eq. 4). `b` must not be zero.
    """
    c_bar = [0.0, *error_coefficients(len(x_tilde), lam)[:-1]]
    return (-f - d + x_d_n - _weighted(c_bar, x_tilde) - kappa * combined_error(x_tilde, lam)) / b


def _weighted(c: Sequence[float], x: Sequence[NumberT]) -> NumberT:
    total = c[0] * x[0]
    for i in range(1, len(c)):
        total = total + c[i] * x[i]
    return total


class Terms(NamedTuple):
    """The parts of a law's force, N or N·m: it asks for their sum."""

    feedforward: float
    feedback: float
    d_hat: float


def rov_law(
    k_plus_h: float,
    d_hat: float,
    m: float,
    x_d_ddot: float,
    e: float,
    e_dot: float,
    lam: float,
    kappa: float,
) -> Terms:
    """Return the terms of τ = k + h + d̂ + m (ẍ_d − λ ė) − m κ ε, with ε = ė + λ e (eqs. lei1, lei2).

    It is `control_law` for n = 2, f = −(k + h)/m, b = 1/m. The paper prints the last term as −κ ε; its own
    general law (eq. 5) divides by b and so gives −m κ ε, the only form with which its figures hold.
    """
    eps = e_dot + lam * e
    return Terms(k_plus_h + m * x_d_ddot, -m * (lam * e_dot + kappa * eps), d_hat)


class Motion(NamedTuple):
    """What a law of one's own sees: one degree of freedom where the next command acts, NED, SI units.

    `e`, `e_dot` are measured − desired; `m` and `k_plus_h` are the nominal model's; `d_hat` is what the axis'
    compensators estimate; `lam` and `kappa` are drawn back for delay and oscillation already, by powers of
    `share` (0..1, `schedule.py`). Where not `free`, the last command was cut off or is not in force: there
    nothing may be learnt.
    """

    e: float
    e_dot: float
    x_dot: float
    x_d_ddot: float
    m: float
    k_plus_h: float
    d_hat: float
    lam: float
    kappa: float
    share: float
    free: bool


def law_with(motion: Motion, d_hat: float) -> Terms:
    """Return the terms of `rov_law` for a motion, with a d̂ of one's own."""
    return rov_law(
        motion.k_plus_h,
        d_hat,
        motion.m,
        motion.x_d_ddot,
        motion.e,
        motion.e_dot,
        motion.lam,
        motion.kappa,
    )


class ChosenLaw(NamedTuple):
    """A law as an axis uses it: its functions and its parameters."""

    initial: Callable[[Any], Any]
    step: Callable[[Any, Any, Motion, float], tuple[Any, Terms]]
    parameters: Any


class Parameters(NamedTuple):
    """The paper's law needs none of its own: λ and κ come with Motion."""


class State(NamedTuple):
    """It remembers nothing."""


def initial(parameters: Parameters) -> State:
    """Return nothing remembered."""
    return State()


def step(parameters: Parameters, state: State, motion: Motion, dt_s: float) -> tuple[State, Terms]:
    """Return the terms of `rov_law`."""
    return state, law_with(motion, motion.d_hat)
