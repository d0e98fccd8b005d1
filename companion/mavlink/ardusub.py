"""ArduSub's signs, scales and names: the only place that knows them, for `decode` and `encode`.

| ArduSub's | ours |
|---|---|
| altitude, climb, throttle: up positive | depth, depth rate, heave: down positive |
| mm, cm/s, mV, µs, ms, ns | m, m/s, V, s |
| PWM 1100..1900 µs, sticks -1000..1000 | axis demand -1..1 |
| uint32 boot stamps that wrap (71.6 min in µs, 49.7 days in ms) | seconds since boot that do not |

Source: docs/ardusub.md, "MANUAL_CONTROL", "RC_CHANNELS_OVERRIDE", "From axis to newton".
"""

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Final, Literal, TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.records import AxisCommand

DepthSource: TypeAlias = Literal["relative_alt", "pressure"]
ThrustPath: TypeAlias = Literal["rc_override", "manual_control"]

NS_PER_S: Final = 1_000_000_000
READING_REPEATS_S: Final = 0.2
"""A barometer's reading is repeated for this time at most: it gives ten a second, its stream more."""
NEUTRAL_US: Final = 1500
SPAN_US: Final = 400
LEAVE_ALONE: Final = 0xFFFF
STICK: Final = 1000
STICK_NEUTRAL_Z: Final = 500
INT16_MAX: Final = 0x7FFF
MAX_GAIN: Final = 10.0  # JS_GAIN_MAX is 1, JS_THR_GAIN at most 4
MAX_SPEED_MPS: Final = 20.0
MAX_DISTANCE_M: Final = 1e5
"""A speed or a place beyond these is neither measured nor asked for."""
FLOAT32_HALF_STEP_US: Final = 6e-5
"""The firmware computes PWM in float32: a value within this of a whole µs becomes that µs."""

PRESSURES: Final = (
    mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE,
    mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE2,
    mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE3,
)
"""Names by barometer: BARO_PRIMARY, where ArduSub notes which one is in the water, counts from 0."""

DIRECTIONS: Final = tuple(f"MOT_{motor}_DIRECTION" for motor in range(1, 9))
"""Parameters by motor: below zero it is reversed."""

FUNCTIONS: Final = tuple(f"SERVO{output}_FUNCTION" for output in range(1, 17))
"""Parameters by output: FIRST_MOTOR for motor 1, and so on."""
FIRST_MOTOR: Final = 33

QUALITY_PARAMETER: Final = "RNGFND_SQ_MIN"
"""A rangefinder's least signal quality, %, since ArduSub 4.5."""

FRAMES: Final = {0.0: "bluerov1", 1.0: "vectored", 2.0: "vectored_6dof"}
"""Names of FRAME_CONFIG's values."""


def stick_demand(sticks: AxisCommand, gain: float, throttle_gain: float) -> AxisCommand:
    """Return what the vehicle makes of the pilot's sticks: demands as `AxisCommand` counts them."""
    reach = manual_control_reach(gain, throttle_gain)
    return sticks._replace(
        surge=sticks.surge * reach.surge,
        sway=sticks.sway * reach.sway,
        heave=sticks.heave * reach.heave,
        yaw=sticks.yaw * reach.yaw,
    )


@lru_cache(maxsize=1)
def manual_control_reach(gain: float, throttle_gain: float) -> AxisCommand:
    """Largest demand on each axis, 0..1, that MANUAL_CONTROL can express at this gain."""
    level, throttle = _full_stick(gain, throttle_gain)
    level = min(1.0, level)
    return AxisCommand(surge=level, sway=level, heave=min(1.0, throttle), yaw=level)


def quantise(
    command: AxisCommand, path: ThrustPath, gain: float = 1.0, throttle_gain: float = 1.0
) -> AxisCommand:
    """Give what the vehicle applies of `command`.

    RC_CHANNELS_OVERRIDE: whole µs. MANUAL_CONTROL: whole stick steps, then µs with the fraction cut off, as
    the firmware's integers do; so up to 1 µs less forward, right and clockwise, 2 µs less up.
    """
    surge, sway, up, yaw, roll, pitch = to_channels(command)
    if path == "manual_control":
        x, y, z, r = to_sticks(command, gain, throttle_gain)
        level, throttle = _full_stick(gain, throttle_gain)
        scale, throttle_scale = SPAN_US / STICK * level, SPAN_US / STICK_NEUTRAL_Z * throttle
        surge, sway, yaw = (_whole_us(NEUTRAL_US + stick * scale) for stick in (x, y, r))
        up = _whole_us(_whole_us(NEUTRAL_US - STICK_NEUTRAL_Z * throttle_scale) + z * throttle_scale)
    surge_d, sway_d, up_d, yaw_d, roll_d, pitch_d = map(from_pwm_us, (surge, sway, up, yaw, roll, pitch))
    return AxisCommand(surge_d, sway_d, -up_d, yaw_d, roll_d, pitch_d)


@lru_cache(maxsize=1)
def to_channels(command: AxisCommand) -> tuple[int, int, int, int, int, int]:
    """Return the PWM of surge, sway, throttle (up), yaw, roll and pitch; each command is asked for twice."""
    surge, sway, heave, yaw, roll, pitch = command
    return (
        to_pwm_us(surge),
        to_pwm_us(sway),
        to_pwm_us(-heave),
        to_pwm_us(yaw),
        to_pwm_us(roll),
        to_pwm_us(pitch),
    )


def motor_outputs(parameters: Mapping[str, float]) -> tuple[int, ...]:
    """Return by motor which output drives it, from 1, by the FUNCTIONS that are known; 0 for none.

    An output whose function is not known counts as the motor of its number.
    """
    return _motor_outputs(tuple(map(parameters.get, FUNCTIONS)))


@lru_cache(maxsize=1)
def _motor_outputs(functions: tuple[float | None, ...]) -> tuple[int, ...]:
    drives = {function: output for output, function in enumerate(functions, start=1)}
    return tuple(
        drives.get(FIRST_MOTOR + motor, motor + 1 if functions[motor] is None else 0)
        for motor in range(len(DIRECTIONS))
    )


def motor_demand(pwm_us: Sequence[int]) -> tuple[float, ...]:
    """Motor demands -1..1 from servo outputs in µs; no pulse (0) is no thrust."""
    return tuple((us - NEUTRAL_US) / SPAN_US if us else 0.0 for us in pwm_us)


def to_pwm_us(demand: float) -> int:
    """Return the PWM for an axis demand; neutral for one that is not finite."""
    if not math.isfinite(demand):
        return NEUTRAL_US
    return NEUTRAL_US + round(SPAN_US * clip(demand))


def from_pwm_us(pwm_us: int) -> float:
    """Return the axis demand that a PWM makes."""
    return clip((pwm_us - NEUTRAL_US) / SPAN_US)


def _whole_us(us: float) -> int:
    return int(us + FLOAT32_HALF_STEP_US)


def _full_stick(gain: float, throttle_gain: float) -> tuple[float, float]:
    """Give what full stick demands on the level axes and on the throttle; 0 where the gains are absurd."""
    level = gain if 0.0 < gain <= MAX_GAIN else 0.0
    return level, level * (throttle_gain if 0.0 < throttle_gain <= MAX_GAIN else 0.0)


def to_sticks(command: AxisCommand, gain: float, throttle_gain: float) -> tuple[int, int, int, int]:
    """Return x, y, z, r of the MANUAL_CONTROL that makes `command` at these gains."""
    level, throttle = _full_stick(gain, throttle_gain)
    return (
        round(STICK * _deflection(command.surge, level)),
        round(STICK * _deflection(command.sway, level)),
        STICK_NEUTRAL_Z - round(STICK_NEUTRAL_Z * _deflection(command.heave, throttle)),
        round(STICK * _deflection(command.yaw, level)),
    )


def _deflection(demand: float, full_stick: float) -> float:
    if not math.isfinite(demand) or full_stick == 0.0:
        return 0.0
    return clip(clip(demand) / full_stick)


def from_stick(stick: int) -> float:
    """Return a stick as a fraction of full deflection; one that is not there rests."""
    return 0.0 if stick == INT16_MAX else clip(stick / STICK)


def clip(value: float) -> float:
    """Return a number within -1..1."""
    return -1.0 if value < -1.0 else 1.0 if value > 1.0 else value
