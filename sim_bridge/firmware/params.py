"""The autopilot's parameters: names of ArduSub 4.7, types and defaults of those that matter here."""

import math
from collections.abc import Mapping
from typing import NamedTuple

INT8, INT16, INT32, FLOAT = 2, 4, 6, 9
_RANGE = {INT8: (-128, 127), INT16: (-32768, 32767), INT32: (-(2**31), 2**31 - 1)}

BUTTON_DEFAULTS = (0, 5, 7, 6, 4, 1, 3, 21, 48, 23, 22, 42, 43, 33, 32, 0)
"""BTN0..15_FUNCTION after ArduSub's joystick.cpp."""


class Kind(NamedTuple):
    """MAVLink parameter type and the firmware's default."""

    type: int
    default: float


DEFAULTS: dict[str, Kind] = {
    "MAV_SYSID": Kind(INT16, 1),
    "MAV_GCS_SYSID": Kind(INT16, 255),
    "FRAME_CONFIG": Kind(INT8, 2),
    "FS_PILOT_INPUT": Kind(INT8, 2),
    "FS_PILOT_TIMEOUT": Kind(FLOAT, 3.0),
    "FS_GCS_ENABLE": Kind(INT8, 2),
    "FS_GCS_TIMEOUT": Kind(FLOAT, 5.0),
    "FS_LEAK_ENABLE": Kind(INT8, 1),
    "FS_EKF_ACTION": Kind(INT8, 0),
    "JS_GAIN_DEFAULT": Kind(FLOAT, 0.5),
    "JS_GAIN_MIN": Kind(FLOAT, 0.25),
    "JS_GAIN_MAX": Kind(FLOAT, 1.0),
    "JS_GAIN_STEPS": Kind(INT8, 4),
    "JS_THR_GAIN": Kind(FLOAT, 1.0),
    "RC_OVERRIDE_TIME": Kind(FLOAT, 3.0),
    "RC_OPTIONS": Kind(INT32, 0),
    "RC_SPEED": Kind(INT16, 200),
    "RC_PROTOCOLS": Kind(INT32, 1),
    "BARO_PRIMARY": Kind(INT8, 1),
    "BARO1_GND_PRESS": Kind(FLOAT, 101325.0),
    "BARO2_GND_PRESS": Kind(FLOAT, 101325.0),
    "BARO_SPEC_GRAV": Kind(FLOAT, 1.0),
    "ARMING_CHECK": Kind(INT32, 1),
    "BATT_MONITOR": Kind(INT8, 4),
    "BATT_CAPACITY": Kind(INT32, 18000),
    "SURFACE_DEPTH": Kind(FLOAT, -10.0),
    "PILOT_SPEED_UP": Kind(INT16, 50),
    "PILOT_SPEED_DN": Kind(INT16, 0),
    "ATC_ANG_RLL_P": Kind(FLOAT, 6.0),
    "ATC_ANG_PIT_P": Kind(FLOAT, 6.0),
    "ATC_ANG_YAW_P": Kind(FLOAT, 6.0),
    "ATC_RAT_RLL_P": Kind(FLOAT, 0.135),
    "ATC_RAT_RLL_I": Kind(FLOAT, 0.135),
    "ATC_RAT_PIT_P": Kind(FLOAT, 0.135),
    "ATC_RAT_PIT_I": Kind(FLOAT, 0.135),
    "ATC_RAT_YAW_P": Kind(FLOAT, 0.18),
    "ATC_RAT_YAW_I": Kind(FLOAT, 0.018),
    "ACRO_YAW_P": Kind(FLOAT, 3.375),
    "ACRO_RP_P": Kind(FLOAT, 4.5),
    "PSC_POSZ_P": Kind(FLOAT, 3.0),
    "PSC_VELZ_P": Kind(FLOAT, 8.0),
    "PSC_ACCZ_P": Kind(FLOAT, 0.5),
    "PSC_ACCZ_I": Kind(FLOAT, 0.1),
    **{f"MOT_{motor}_DIRECTION": Kind(INT8, 1) for motor in range(1, 9)},
    **{f"BTN{button}_FUNCTION": Kind(INT8, function) for button, function in enumerate(BUTTON_DEFAULTS)},
    **{
        f"RC{channel}_{edge}": Kind(INT16, pwm)
        for channel in range(1, 7)
        for edge, pwm in (("MIN", 1100), ("TRIM", 1500), ("MAX", 1900))
    },
}


class Parameters:
    """A table of values by name, in the order that PARAM_REQUEST_LIST tells them."""

    def __init__(self, overrides: Mapping[str, float]) -> None:
        """Start from the defaults.

        Raises:
            ValueError: an override names no known parameter, or does not fit its type.

        """
        self.names = tuple(DEFAULTS)
        self._values = {name: kind.default for name, kind in DEFAULTS.items()}
        for name, value in overrides.items():
            if not self.set(name, value):
                raise ValueError(f"parameter {name} = {value}: unknown, or not fit for its type")

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def set(self, name: str, value: float) -> bool:
        """Store a value, integers rounded and clamped to their type; False if unknown or not finite."""
        if name not in self._values or not math.isfinite(value):
            return False
        kind = DEFAULTS[name].type
        if kind != FLOAT:
            low, high = _RANGE[kind]
            value = max(low, min(high, round(value)))
        elif abs(value) > 3.4e38:
            return False
        self._values[name] = float(value)
        return True
