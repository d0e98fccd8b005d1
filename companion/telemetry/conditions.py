"""Conditions in sentences: lists of what is awaited or so; the words of each stand in `Condition`."""

from collections.abc import Iterable

from companion.records import Condition

C = Condition

UNSAID = C.RAMPED_DOWN | C.HAND_OVER_HELD | C.HANDED_OVER | C.SURFACED | C.HAND_OVER_REFUSED
UNSAID |= C.OPERATOR_STOP | C.ENGAGE_ASKED | C.CLEAR_ASKED
"""What somebody asked for, or the supervisor's own bookkeeping: reported as a command or a state."""

ENDED = {condition.ended: condition.text for condition in C}
"""For the words that a condition has ended, those of its beginning."""


def awaited(conditions: Condition, preflight_failure: str) -> str:
    """Return what is awaited while these conditions hold; `preflight_failure` names rows of the list."""
    return ", ".join(_detailed(condition, condition.awaited, preflight_failure) for condition in conditions)


def text(conditions: Condition, preflight_failure: str = "") -> str:
    """Return what is so while these conditions hold."""
    said = conditions & ~UNSAID
    return ", ".join(_detailed(condition, condition.text, preflight_failure) for condition in said)


def _detailed(condition: Condition, words: str, preflight_failure: str) -> str:
    return f"{words} ({preflight_failure})" if condition is C.PREFLIGHT_FAILURE else words


def named(names: Iterable[str]) -> Condition:
    """Return the conditions of these published names; those of another version are left out."""
    return Condition(sum({Condition[name] for name in names if name in Condition.__members__}))
