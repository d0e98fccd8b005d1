"""ArduSub's flight modes and the supervisor's states, and what each means to people."""

from enum import IntEnum
from typing import Literal

from companion.records import State

Severity = Literal["info", "warning", "fault"]


class Mode(IntEnum):
    """The flight modes that Holdfast may ask for or give back, by HEARTBEAT.custom_mode (docs/ardusub.md)."""

    STABILIZE = 0
    ACRO = 1
    ALT_HOLD = 2
    AUTO = 3
    GUIDED = 4
    SURFACE = 9
    POSHOLD = 16
    MANUAL = 19
    SURFTRAK = 21


MODE_NAMES: dict[int, str] = {mode.value: mode.name for mode in Mode} | {7: "CIRCLE", 20: "MOTOR_DETECT"}
"""The names of all modes; Holdfast never requests the last two."""

MEANINGS: dict[str, str] = {
    State.IDLE: "hands off",
    State.READY: "may engage",
    State.ACTIVE: "holding",
    State.RAMP_DOWN: "letting go",
    State.HAND_OVER: "handing over to ALT_HOLD",
    State.PILOT: "the pilot, or ALT_HOLD, has it",
    State.FAULT: "latched until the operator clears it",
}
"""What each state of the supervisor means, by its name."""

SEVERITIES: dict[str, Severity] = {
    State.IDLE: "info",
    State.READY: "info",
    State.ACTIVE: "info",
    State.RAMP_DOWN: "warning",
    State.HAND_OVER: "warning",
    State.PILOT: "warning",
    State.FAULT: "fault",
}
"""The severity of entering a state, by its name."""
