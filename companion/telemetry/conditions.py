"""Conditions in sentences: lists of what is awaited or so; the words of each stand in `Condition`."""

from collections.abc import Iterable, Mapping
from types import MappingProxyType

from companion.records import Condition

C = Condition

UNSAID = C.RAMPED_DOWN | C.HAND_OVER_HELD | C.HANDED_OVER | C.SURFACED | C.HAND_OVER_REFUSED
UNSAID |= C.OPERATOR_STOP | C.ENGAGE_ASKED | C.CLEAR_ASKED | C.INTERRUPTED
"""What somebody asked for, or the supervisor's own bookkeeping: reported as a command or a state.

INTERRUPTED is reported as UNSTEADY."""

ENDED = {condition.ended: condition.text for condition in C if condition.ended}
"""For the words that a condition has ended, those of its beginning."""


Details = Mapping[Condition, tuple[str, str]]
"""What is found of a condition now, and a remedy in place of the usual one; either may be empty."""

NO_DETAILS: Details = MappingProxyType({})


def awaited(conditions: Condition, details: Details) -> str:
    """Return what is awaited while these conditions hold."""
    return ", ".join(detailed(condition, condition.awaited, details) for condition in conditions)


def text(conditions: Condition, details: Details = NO_DETAILS) -> str:
    """Return what is so while these conditions hold."""
    return ", ".join(detailed(condition, condition.text, details) for condition in conditions & ~UNSAID)


def detailed(condition: Condition, words: str, details: Details) -> str:
    """Return the words of a condition, and what is found of it."""
    found, _ = details.get(condition, ("", ""))
    return f"{words} ({found})" if found else words


def named(names: Iterable[str]) -> Condition:
    """Return the conditions of these published names; those of another version are left out."""
    return Condition(sum({Condition[name] for name in names if name in Condition.__members__}))
