"""ArduSub's flight modes."""

from enum import IntEnum


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

FAILSAFE = 5
"""MAV_STATE_CRITICAL: what ArduSub reports while any failsafe is latched."""
