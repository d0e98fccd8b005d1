"""Telemetry beside control's own: further views of the motion, and equipment that is not there.

What a field holds at rest was read from the firmware; NaN is its own answer where it knows nothing.
"""

import math
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_bridge.firmware.messages import (
    IMU_CENTIDEGREES,
    M_PER_DEGREE,
    Message,
    Origin,
    Snapshot,
    body_field_mg,
    heading_cdeg,
    inertial,
    int32,
    place,
    quaternion,
)
from sim_bridge.physics.plant import euler

NAN = math.nan
NO_MISSION, NOT_STARTED = 1, 2
GIMBAL_FLAGS, MANAGER_FLAGS, MANAGER_CAPABILITIES = 44, 12, 205027
GIMBAL = 1


def _first_imu(s: Snapshot) -> Message:
    return mavlink.MAVLink_scaled_imu_message(s.boot_ms, *inertial(s), IMU_CENTIDEGREES)


def _second_imu(s: Snapshot) -> Message:
    return mavlink.MAVLink_scaled_imu2_message(s.boot_ms, *inertial(s), IMU_CENTIDEGREES)


def _third_imu(s: Snapshot) -> Message:
    """Tell a compass without accelerometer and gyro."""
    return mavlink.MAVLink_scaled_imu3_message(s.boot_ms, *[0] * 6, *body_field_mg(s), 0)


def _highres_imu(s: Snapshot) -> Message:
    e = s.estimate
    return mavlink.MAVLink_highres_imu_message(
        s.boot_us,
        *e.accel,
        e.rollspeed,
        e.pitchspeed,
        e.yawspeed,
        *(1000.0 * value for value in body_field_mg(s)),
        e.pressure_hpa,
        0.0,
        e.raw_altitude_m,
        15.0,
        8191,
    )


def _attitude_quaternion(s: Snapshot) -> Message:
    e = s.estimate
    return mavlink.MAVLink_attitude_quaternion_message(
        s.boot_ms, *quaternion(e), e.rollspeed, e.pitchspeed, e.yawspeed, [0.0] * 4
    )


def _ahrs(_: Snapshot) -> Message:
    return mavlink.MAVLink_ahrs_message(0.0, 0.0, 0.0, 0.0, 0.0, 5e-5, 1e-4)


def _simstate(s: Snapshot) -> Message:
    origin = s.origin or Origin(0, 0, 0)
    return mavlink.MAVLink_simstate_message(
        *euler(s.state),
        *s.estimate.accel,
        *s.state[10:],
        int32(origin.lat + s.state[0] / M_PER_DEGREE * 1e7),
        int32(origin.lon + s.state[1] / M_PER_DEGREE * 1e7),
    )


def _vibration(s: Snapshot) -> Message:
    return mavlink.MAVLink_vibration_message(s.boot_us, 0.003, 0.003, 0.003, 0, 0, 0)


def _nav_controller_output(s: Snapshot) -> Message:
    e = s.estimate
    return mavlink.MAVLink_nav_controller_output_message(
        math.degrees(e.roll), math.degrees(e.pitch), 0, 0, 0, 0.0, 0.0, 0.0
    )


def _mission_current(s: Snapshot) -> Message:
    current, total = s.mission
    return mavlink.MAVLink_mission_current_message(current, total, NOT_STARTED if total else NO_MISSION, 0)


def _gps_raw_int(_: Snapshot) -> Message:
    return mavlink.MAVLink_gps_raw_int_message(0, 0, 0, 0, 0, 65535, 65535, 0, 0, 0)


def _power_status(_: Snapshot) -> Message:
    return mavlink.MAVLink_power_status_message(5000, 0, 0)


def _hwstatus(_: Snapshot) -> Message:
    return mavlink.MAVLink_hwstatus_message(5000, 0)


def _meminfo(_: Snapshot) -> Message:
    return mavlink.MAVLink_meminfo_message(0, 65535, 524288)


def _terrain_report(_: Snapshot) -> Message:
    return mavlink.MAVLink_terrain_report_message(0, 0, 0, 0.0, 0.0, 0, 0)


def _distance_sensor(s: Snapshot) -> Message:
    """Tell the rangefinder that looks down; one without an echo says nothing."""
    reading = s.estimate.range_m
    if math.isnan(reading):
        return None
    least, most = s.range_limits_m
    return mavlink.MAVLink_distance_sensor_message(
        s.boot_ms,
        _whole_cm(least),
        _whole_cm(most),
        _whole_cm(reading),
        mavlink.MAV_DISTANCE_SENSOR_ULTRASOUND,
        0,
        mavlink.MAV_SENSOR_ROTATION_PITCH_270,
        0,
    )


def _rangefinder(s: Snapshot) -> Message:
    """Tell the same; without a rangefinder nothing, and without an echo no distance."""
    if not s.range_limits_m[1]:
        return None
    reading = s.estimate.range_m
    return mavlink.MAVLink_rangefinder_message(0.0 if math.isnan(reading) else reading, 0.0)


def _whole_cm(metres: float) -> int:
    return min(int(100.0 * metres), 65535)


def _mission_item_reached(_: Snapshot) -> Message:
    return mavlink.MAVLink_mission_item_reached_message(65535)


def _message_interval(_: Snapshot) -> Message:
    return mavlink.MAVLink_message_interval_message(0, 1_000_000)


def _extended_sys_state(_: Snapshot) -> Message:
    return mavlink.MAVLink_extended_sys_state_message(0, 0)


def _flight_information(s: Snapshot) -> Message:
    return mavlink.MAVLink_flight_information_message(s.boot_ms, 0, 0, 0)


def _relay_status(s: Snapshot) -> Message:
    return mavlink.MAVLink_relay_status_message(s.boot_ms, 0, 1)


def _gimbal_manager_information(s: Snapshot) -> Message:
    limits = (math.radians(degrees) for degrees in (-30.0, 30.0, -90.0, 20.0, -180.0, 180.0))
    return mavlink.MAVLink_gimbal_manager_information_message(
        s.boot_ms, MANAGER_CAPABILITIES, GIMBAL, *limits
    )


def _gimbal_manager_status(s: Snapshot) -> Message:
    return mavlink.MAVLink_gimbal_manager_status_message(s.boot_ms, MANAGER_FLAGS, GIMBAL, 0, 0, 0, 0)


def _gimbal_device_attitude_status(s: Snapshot) -> Message:
    return mavlink.MAVLink_gimbal_device_attitude_status_message(
        0, 0, s.boot_ms, GIMBAL_FLAGS, [1.0, 0.0, 0.0, 0.0], NAN, NAN, NAN, 0, NAN, NAN, GIMBAL
    )


def _autopilot_state_for_gimbal_device(s: Snapshot) -> Message:
    e = s.estimate
    return mavlink.MAVLink_autopilot_state_for_gimbal_device_message(
        1, 0, s.boot_us, quaternion(e), 0, *e.position[2:], -e.climb_m_s, 0, 0.0, s.ekf_flags, 0, e.yawspeed
    )


def _high_latency2(s: Snapshot) -> Message:
    lat, lon = place(s)
    return mavlink.MAVLink_high_latency2_message(
        s.boot_ms,
        mavlink.MAV_TYPE_SUBMARINE,
        mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
        s.mode,
        lat,
        lon,
        *(0, 0),
        heading_cdeg(s.estimate.yaw) // 200,
        *(0, 0, 0, 0, 0, 0, 0, 0, 0, 0),
        -128,
        0,
        s.battery_remaining,
        0,
        67,
        s.base_mode,
        0,
        0,
    )


BUILDERS: dict[int, Callable[[Snapshot], Message]] = {
    mavlink.MAVLINK_MSG_ID_SCALED_IMU: _first_imu,
    mavlink.MAVLINK_MSG_ID_SCALED_IMU2: _second_imu,
    mavlink.MAVLINK_MSG_ID_SCALED_IMU3: _third_imu,
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: _highres_imu,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: _attitude_quaternion,
    mavlink.MAVLINK_MSG_ID_AHRS: _ahrs,
    mavlink.MAVLINK_MSG_ID_SIMSTATE: _simstate,
    mavlink.MAVLINK_MSG_ID_VIBRATION: _vibration,
    mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT: _nav_controller_output,
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: _mission_current,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: _gps_raw_int,
    mavlink.MAVLINK_MSG_ID_POWER_STATUS: _power_status,
    mavlink.MAVLINK_MSG_ID_HWSTATUS: _hwstatus,
    mavlink.MAVLINK_MSG_ID_MEMINFO: _meminfo,
    mavlink.MAVLINK_MSG_ID_TERRAIN_REPORT: _terrain_report,
    mavlink.MAVLINK_MSG_ID_MISSION_ITEM_REACHED: _mission_item_reached,
    mavlink.MAVLINK_MSG_ID_MESSAGE_INTERVAL: _message_interval,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: _extended_sys_state,
    mavlink.MAVLINK_MSG_ID_FLIGHT_INFORMATION: _flight_information,
    mavlink.MAVLINK_MSG_ID_RELAY_STATUS: _relay_status,
    mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION: _gimbal_manager_information,
    mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS: _gimbal_manager_status,
    mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS: _gimbal_device_attitude_status,
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_STATE_FOR_GIMBAL_DEVICE: _autopilot_state_for_gimbal_device,
    mavlink.MAVLINK_MSG_ID_HIGH_LATENCY2: _high_latency2,
    mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR: _distance_sensor,
    mavlink.MAVLINK_MSG_ID_RANGEFINDER: _rangefinder,
}

SILENT = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_PARAM_VALUE,
        mavlink.MAVLINK_MSG_ID_RC_CHANNELS_RAW,
        mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET,
        mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED,
        mavlink.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT,
        mavlink.MAVLINK_MSG_ID_OPTICAL_FLOW,
        mavlink.MAVLINK_MSG_ID_GPS2_RAW,
        mavlink.MAVLINK_MSG_ID_GPS_RTK,
        mavlink.MAVLINK_MSG_ID_GPS2_RTK,
        mavlink.MAVLINK_MSG_ID_TERRAIN_REQUEST,
        mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE3,
        mavlink.MAVLINK_MSG_ID_FENCE_STATUS,
        mavlink.MAVLINK_MSG_ID_WIND,
        mavlink.MAVLINK_MSG_ID_CAMERA_FEEDBACK,
        mavlink.MAVLINK_MSG_ID_MAG_CAL_PROGRESS,
        mavlink.MAVLINK_MSG_ID_MAG_CAL_REPORT,
        mavlink.MAVLINK_MSG_ID_PID_TUNING,
        mavlink.MAVLINK_MSG_ID_EFI_STATUS,
        mavlink.MAVLINK_MSG_ID_RPM,
        mavlink.MAVLINK_MSG_ID_ADSB_VEHICLE,
        mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION,
        mavlink.MAVLINK_MSG_ID_CAMERA_SETTINGS,
        mavlink.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS,
        mavlink.MAVLINK_MSG_ID_VIDEO_STREAM_INFORMATION,
        mavlink.MAVLINK_MSG_ID_CAMERA_FOV_STATUS,
        mavlink.MAVLINK_MSG_ID_CAMERA_THERMAL_RANGE,
        mavlink.MAVLINK_MSG_ID_AIRSPEED,
        mavlink.MAVLINK_MSG_ID_AIS_VESSEL,
        mavlink.MAVLINK_MSG_ID_GENERATOR_STATUS,
        mavlink.MAVLINK_MSG_ID_WINCH_STATUS,
        mavlink.MAVLINK_MSG_ID_UAVIONIX_ADSB_OUT_STATUS,
        mavlink.MAVLINK_MSG_ID_ESC_TELEMETRY_1_TO_4,
    }
)
"""Messages that the firmware knows, accepts requests for, and has nothing to tell in."""
