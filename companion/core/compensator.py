"""What a compensator is: it estimates the disturbance d̂ of one degree of freedom, which the law then cancels.

One file each, such as `integrator.py`, which is the shortest. A file defines

    Parameters      a NamedTuple of numbers, each named as a key of the configuration
    State           a NamedTuple of what is learnt
    initial         State before anything was learnt; d̂ is then 0: the plain law
    step            State, d̂ (N or N·m) and whether it learnt, after one tick of Signals
    seed            State that answers these Signals with a given d̂: to take over without a step in thrust
    weight_norm     Euclidean norm of what was learnt: for telemetry
    integral_gain   K by which d̂ integrates −ε near rest, N/m or N·m/rad: what is too fast is refused by it

and gets its name in `companion/registry.py`, by an entry point, or in the configuration.
A key is one of the axis (`heave.learning_rate`), or of the compensator's own table (`[compensators.NAME]`).
Where Parameters are made of keys and not keys themselves, `parameters(values)` makes them: see `network.py`.

All learn by the same conventions, which `dead_zone_error` holds: leak, dead zone on ε, projection |d̂| ≤ d_max
without pushing further outward, freeze where not allowed. The observer's d comes with the vehicle's state.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

from companion.core.bounds import limited

Inputs = tuple[float, float, float, float, float, float]
INPUTS = 6


class Signals(NamedTuple):
    """One degree of freedom where the next command acts; NED, m or rad and s; errors are measured − desired.

    `eps` is the combined error ε = ė + λ e, from which a compensator learns.
    """

    e: float
    e_dot: float
    eps: float
    x_dot: float
    x_d_dot: float
    x_d_ddot: float


class ChosenCompensator(NamedTuple):
    """A compensator as an axis uses it: its functions, as above, and its parameters."""

    initial: Callable[[Any], Any]
    step: Callable[[Any, Any, Signals, float, bool], tuple[Any, float, bool]]
    seed: Callable[[Any, Any, Signals, float], Any]
    weight_norm: Callable[[Any], float]
    parameters: Any


def dead_zone_error(
    d_hat: float, eps: float, adapt: bool, dead_zone: float, d_max: float
) -> tuple[bool, float]:
    """Return whether learning goes on, and the ε that is learnt from, zero where it does not.

    Learning stops where the projection holds and ε would push d̂ further outward.
    """
    outward = abs(d_hat) >= d_max and d_hat * eps < 0.0
    learning = adapt and not outward
    return learning, eps - limited(eps, dead_zone) if learning else 0.0


def inputs(signals: Signals) -> Inputs:
    """Return θ = [1, 10 e, 5 ė, 5 ẋ, 5 ẋ_d, 5 ẍ_d].

    The rates matter: a network with a bias alone has a limit cycle under delay.
    """
    return (
        1.0,
        10.0 * signals.e,
        5.0 * signals.e_dot,
        5.0 * signals.x_dot,
        5.0 * signals.x_d_dot,
        5.0 * signals.x_d_ddot,
    )


def _none(parameters: float) -> float:
    return 0.0


def _silent(
    parameters: float, state: float, signals: Signals, learn_s: float, adapt: bool
) -> tuple[float, float, bool]:
    return 0.0, 0.0, False


def _deaf(parameters: float, state: float, signals: Signals, d_hat: float) -> float:
    return 0.0


NO_COMPENSATOR = ChosenCompensator(_none, _silent, _deaf, _none, 0.0)
"""It knows nothing and never learns."""
