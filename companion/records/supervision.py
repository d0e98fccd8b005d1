"""What the supervisor looks at, and what it says."""

from enum import StrEnum

import msgspec

from companion.records.conditions import Condition


class State(StrEnum):
    """The supervisor's states."""

    IDLE = "IDLE"
    READY = "READY"
    ACTIVE = "ACTIVE"
    RAMP_DOWN = "RAMP_DOWN"
    HAND_OVER = "HAND_OVER"
    PILOT = "PILOT"
    FAULT = "FAULT"


class Verdict(msgspec.Struct, frozen=True):
    """The supervisor's word for this tick. `authority` 0..1 scales the wrench: 0 is neutral.

    `warnings` are the conditions that only warn; with `freeze` learning is frozen.
    `remedy` is the one thing to do that gets the operator on.
    """

    state: State
    conditions: Condition
    authority: float
    reason: str
    warnings: Condition = Condition(0)
    freeze: bool = False
    remedy: str = ""
