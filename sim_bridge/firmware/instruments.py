"""Telemetry beside control's own: further views of the motion, and equipment that is not there.

What a field holds at rest was read from the firmware; NaN is its own answer where it knows nothing.
"""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_bridge.firmware import messages
from sim_bridge.firmware.messages import (
    IMU_CENTIDEGREES,
    M_PER_DEGREE,
    NOWHERE,
    Message,
    body_field_mg,
    inertial,
    int32,
)
from sim_bridge.physics.plant import euler

if TYPE_CHECKING:
    from sim_bridge.firmware.autopilot import Autopilot

NAN = math.nan
NO_MISSION = 1
GIMBAL_FLAGS, GIMBAL = 44, 1

AT_REST: dict[int, tuple[float, ...]] = {
    mavlink.MAVLINK_MSG_ID_AHRS: (0.0, 0.0, 0.0, 0.0, 0.0, 5e-5, 1e-4),
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: (0, 0, NO_MISSION, 0),
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: (0, 0, 0, 0, 0, 65535, 65535, 0, 0, 0),
    mavlink.MAVLINK_MSG_ID_POWER_STATUS: (5000, 0, 0),
    mavlink.MAVLINK_MSG_ID_MEMINFO: (0, 65535, 524288),
    mavlink.MAVLINK_MSG_ID_TERRAIN_REPORT: (0, 0, 0, 0.0, 0.0, 0, 0),
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: (0, 0),
}
"""Messages that always tell the same, and their fields."""


def _second_imu(s: "Autopilot") -> Message:
    return mavlink.MAVLink_scaled_imu2_message(s.boot_ms, *inertial(s), IMU_CENTIDEGREES)


def _third_imu(s: "Autopilot") -> Message:
    """Tell a compass without accelerometer and gyro."""
    return mavlink.MAVLink_scaled_imu3_message(s.boot_ms, *[0] * 6, *body_field_mg(s), 0)


def _simstate(s: "Autopilot") -> Message:
    origin = s.origin or NOWHERE
    return mavlink.MAVLink_simstate_message(
        *euler(s.state),
        *s.estimate().accel,
        *s.state[10:],
        int32(origin.lat + s.state[0] / M_PER_DEGREE * 1e7),
        int32(origin.lon + s.state[1] / M_PER_DEGREE * 1e7),
    )


def _vibration(s: "Autopilot") -> Message:
    return mavlink.MAVLink_vibration_message(s.boot_us, 0.003, 0.003, 0.003, 0, 0, 0)


def _nav_controller_output(s: "Autopilot") -> Message:
    e = s.estimate()
    return mavlink.MAVLink_nav_controller_output_message(
        math.degrees(e.roll), math.degrees(e.pitch), 0, 0, 0, 0.0, 0.0, 0.0
    )


def _gimbal_device_attitude_status(s: "Autopilot") -> Message:
    return mavlink.MAVLink_gimbal_device_attitude_status_message(
        0, 0, s.boot_ms, GIMBAL_FLAGS, [1.0, 0.0, 0.0, 0.0], NAN, NAN, NAN, 0, NAN, NAN, GIMBAL
    )


def _distance_sensor(s: "Autopilot") -> Message:
    """Tell the rangefinder that looks down; one without an echo says nothing."""
    reading = s.estimate().range_m
    if math.isnan(reading):
        return None
    least, most = s.sensors.range_limits_m
    return mavlink.MAVLink_distance_sensor_message(
        s.boot_ms,
        _whole_cm(least),
        _whole_cm(most),
        _whole_cm(reading),
        mavlink.MAV_DISTANCE_SENSOR_ULTRASOUND,
        0,
        mavlink.MAV_SENSOR_ROTATION_PITCH_270,
        0,
        signal_quality=s.range_quality,
    )


def _rangefinder(s: "Autopilot") -> Message:
    """Tell the same; without a rangefinder nothing, and without an echo no distance."""
    if not s.sensors.range_limits_m[1]:
        return None
    reading = s.estimate().range_m
    return mavlink.MAVLink_rangefinder_message(0.0 if math.isnan(reading) else reading, 0.0)


def _whole_cm(metres: float) -> int:
    return min(int(100.0 * metres), 65535)


BUILDERS: dict[int, Callable[["Autopilot"], Message]] = messages.BUILDERS | {
    mavlink.MAVLINK_MSG_ID_SCALED_IMU2: _second_imu,
    mavlink.MAVLINK_MSG_ID_SCALED_IMU3: _third_imu,
    mavlink.MAVLINK_MSG_ID_SIMSTATE: _simstate,
    mavlink.MAVLINK_MSG_ID_VIBRATION: _vibration,
    mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT: _nav_controller_output,
    mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS: _gimbal_device_attitude_status,
    mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR: _distance_sensor,
    mavlink.MAVLINK_MSG_ID_RANGEFINDER: _rangefinder,
}

TOLD = frozenset(BUILDERS) | frozenset(AT_REST) | {mavlink.MAVLINK_MSG_ID_HOME_POSITION}
"""Numbers of the messages that the stand-in knows; there is no home to tell."""


def build(message: int, autopilot: "Autopilot") -> list[Message]:
    """Messages of one id, in the order they are sent; empty if there is nothing to tell.

    It reads the sensors whatever is told, so that their noise does not depend on what is asked.
    """
    autopilot.estimate()
    if message in AT_REST:
        return [mavlink.mavlink_map[message](*AT_REST[message])]
    builder = BUILDERS.get(message)
    built = builder(autopilot) if builder else None
    if built is None:
        return []
    return built if isinstance(built, list) else [built]
