"""No compensator, and two as one: their d̂ are added, and each learns as if it were alone."""

from collections.abc import Sequence
from functools import reduce
from typing import Any, NamedTuple

from companion.core.compensator import ChosenCompensator, Signals


class Pair(NamedTuple):
    """What both are."""

    first: ChosenCompensator
    second: ChosenCompensator


class PairState(NamedTuple):
    """What both have learnt, and the sum of their weight norms."""

    first: Any
    second: Any
    weight_norm: float


def together(chosen: Sequence[ChosenCompensator]) -> ChosenCompensator:
    """Return one compensator that is all of these; none for an empty sequence."""
    return reduce(_both, chosen) if chosen else NO_COMPENSATOR


def joined(chosen: ChosenCompensator) -> list[ChosenCompensator]:
    """Return what `together` joined."""
    return [law for law, _ in members(chosen, chosen.initial(chosen.parameters))]


def members(chosen: ChosenCompensator, state: Any) -> list[tuple[ChosenCompensator, Any]]:
    """Return what `together` joined, each with its state."""
    if chosen.step is step:
        return [*members(chosen.parameters.first, state.first), (chosen.parameters.second, state.second)]
    return [] if chosen.step is NO_COMPENSATOR.step else [(chosen, state)]


def rejoined(chosen: ChosenCompensator, states: Sequence[Any]) -> Any:
    """Return the state of `together` for the states of its members."""
    if chosen.step is not step:
        return states[0] if states else chosen.initial(chosen.parameters)
    pair = chosen.parameters
    return _joined(pair, rejoined(pair.first, states[:-1]), states[-1])


def _both(first: ChosenCompensator, second: ChosenCompensator) -> ChosenCompensator:
    return ChosenCompensator(initial, step, seed, weight_norm, Pair(first, second))


def _joined(pair: Pair, first: Any, second: Any) -> PairState:
    return PairState(first, second, pair.first.weight_norm(first) + pair.second.weight_norm(second))


def initial(pair: Pair) -> PairState:
    """Return what both begin with."""
    first, second = pair
    return _joined(pair, first.initial(first.parameters), second.initial(second.parameters))


def step(
    pair: Pair, state: PairState, signals: Signals, learn_s: float, adapt: bool
) -> tuple[PairState, float, bool]:
    """Return the new states, the sum of both d̂, and whether one of them learnt."""
    one, two = pair
    first, d_first, first_learns = one.step(one.parameters, state.first, signals, learn_s, adapt)
    second, d_second, second_learns = two.step(two.parameters, state.second, signals, learn_s, adapt)
    return _joined(pair, first, second), d_first + d_second, first_learns or second_learns


def seed(pair: Pair, state: PairState, signals: Signals, d_hat: float) -> PairState:
    """Let the first answer with `d_hat`."""
    first = pair.first
    return _joined(pair, first.seed(first.parameters, state.first, signals, d_hat), state.second)


def weight_norm(state: PairState) -> float:
    """Return the sum of both norms."""
    return state.weight_norm


def _nothing(parameters: float) -> float:
    return 0.0


def _silent(
    parameters: float, state: float, signals: Signals, learn_s: float, adapt: bool
) -> tuple[float, float, bool]:
    return 0.0, 0.0, False


def _deaf(parameters: float, state: float, signals: Signals, d_hat: float) -> float:
    return 0.0


NO_COMPENSATOR = ChosenCompensator(_nothing, _silent, _deaf, _nothing, 0.0)
"""It knows nothing and never learns."""
