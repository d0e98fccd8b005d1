"""What the firmware tells of its control and sensors, with ArduSub's units, signs and gaps.

The function `_attitude` builds ATTITUDE, and so on; `s` is the board that tells. NaN is the firmware's own
answer where it knows nothing.
"""

import math
from collections.abc import Callable
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_bridge.firmware.board import Board
from sim_bridge.firmware.packing import Message
from sim_bridge.physics.plant import GRAVITY
from sim_bridge.physics.sensors import SURFACE_PRESSURE_HPA

AUTOPILOT_CAPABILITIES = 0xF9C7
"""Those of the firmware without MAVLink FTP."""
FLIGHT_VERSION_4_7_DEV = 0x04070000
M_PER_DEGREE = 111_319.5
WATER_CENTIDEGREES = 1500
EKF_WITHOUT_POSITION = 1 | 2 | 4 | 32 | 128
EKF_WITH_POSITION = 1 | 2 | 4 | 8 | 16 | 32 | 256 | 512
EKF_DEAD_RECKONING = 1 | 2 | 4 | 8 | 32 | 256
"""Flags of the EKF with odometry alone."""
EKF_UNINITIALIZED = 1024
SENSORS_PRESENT, SENSORS_ENABLED, SENSORS_HEALTHY = 305265679, 304192527, 305241103
"""As the firmware tells them of a healthy vehicle."""
CAMERA_TILT_PWM = 1754
"""Where the firmware's camera mount rests, on servo 10."""
FIELD_NORTH_MG, FIELD_DOWN_MG = 219.0, 422.0
IMU_CENTIDEGREES = 2720
RECEIVER_CHANNELS = 16


_heartbeat = Board.heartbeat


def _attitude(s: Board) -> Message:
    e = s.estimate()
    return mavlink.MAVLink_attitude_message(
        s.boot_ms, e.roll, e.pitch, e.yaw, e.rollspeed, e.pitchspeed, e.yawspeed
    )


def _ahrs2(s: Board) -> Message:
    e = s.estimate()
    lat, lon = place(s) if s.has_position else (0, 0)
    return mavlink.MAVLink_ahrs2_message(e.roll, e.pitch, e.yaw, round(e.raw_altitude_m, 2), lat, lon)


def _vfr_hud(s: Board) -> Message:
    e = s.estimate()
    speed = math.hypot(e.position[2], e.position[3])
    throttle = round(abs(s.pilot.channels[2] - 1500) / 4.0) if s.armed else 0
    return mavlink.MAVLink_vfr_hud_message(
        speed, speed, heading_cdeg(e.yaw) // 100, min(100, throttle), _absolute_m(s), e.climb_m_s
    )


def _global_position_int(s: Board) -> Message:
    e = s.estimate()
    homeless = s.origin is None and s.sensors.barometer_without_home
    relative_m = e.raw_altitude_m if homeless else -e.depth_m
    heights = (int32(_absolute_m(s) * 1000), int32(relative_m * 1000))
    speeds = (int16(speed * 100) for speed in (*e.position[2:], -e.climb_m_s))
    return mavlink.MAVLink_global_position_int_message(
        s.boot_ms, *place(s), *heights, *speeds, heading_cdeg(e.yaw)
    )


def _local_position_ned(s: Board) -> Message:
    if not s.has_position or s.origin is None:
        return None
    x, y, vx, vy = s.estimate().position
    return mavlink.MAVLink_local_position_ned_message(
        s.boot_ms, x, y, -s.estimate().altitude_m, vx, vy, -s.estimate().climb_m_s
    )


def _servo_output_raw(s: Board) -> Message:
    motors = [*s.motor_pwm, *[0] * (8 - len(s.motor_pwm))]
    return mavlink.MAVLink_servo_output_raw_message(
        s.boot_us & 0xFFFFFFFF, 0, *motors, 0, CAMERA_TILT_PWM, 0, 0, 0, 0, 0, 0
    )


def _rc_channels(s: Board) -> Message:
    """Tell eight channels; without a receiver none counts, and its signal is unknown."""
    count = RECEIVER_CHANNELS if s.rc_receiver else 0
    return mavlink.MAVLink_rc_channels_message(s.boot_ms, count, *s.pilot.channels[:8], *[0] * 10, 255)


def _raw_imu(s: Board) -> Message:
    """Tell accelerometer (mg), gyro (mrad/s) and compass (mGauss), the last as if it were level."""
    e = s.estimate()
    accel = (int16(a / GRAVITY * 1000) for a in e.accel)
    gyro = (int16(rate * 1000) for rate in (e.rollspeed, e.pitchspeed, e.yawspeed))
    ahead, right = FIELD_NORTH_MG * math.cos(e.yaw), -FIELD_NORTH_MG * math.sin(e.yaw)
    field = (round(ahead), round(right), round(FIELD_DOWN_MG))
    return mavlink.MAVLink_raw_imu_message(s.boot_us, *accel, *gyro, *field, 0, IMU_CENTIDEGREES)


def _scaled_pressure(s: Board) -> Message:
    """Tell the hull's own barometer, which sees no water."""
    return mavlink.MAVLink_scaled_pressure_message(s.boot_ms, SURFACE_PRESSURE_HPA, 0.0, 2500)


def _scaled_pressure2(s: Board) -> Message:
    """Tell the depth sensor, as a BlueROV2 has it."""
    return mavlink.MAVLink_scaled_pressure2_message(
        s.boot_ms, s.estimate().pressure_hpa, 0.0, WATER_CENTIDEGREES
    )


def _battery(s: Board) -> tuple[int, int, int]:
    """Voltage (mV), current (cA), and what remains (%)."""
    remaining = round(max(0.0, 100.0 * (1.0 - s.consumed_mah / s.capacity_mah)))
    return round(max(0.0, min(65535.0, s.voltage_v * 1000))), int16(s.current_a * 100), remaining


def _sys_status(s: Board) -> Message:
    sensors = (SENSORS_PRESENT, SENSORS_ENABLED, SENSORS_HEALTHY)
    return mavlink.MAVLink_sys_status_message(*sensors, 0, *_battery(s), *[0] * 6)


def _battery_status(s: Board) -> Message:
    """Tell one cell's voltage for all, and no temperature."""
    millivolts, current, remaining = _battery(s)
    used = (int32(s.consumed_mah), int32(s.consumed_mah * s.voltage_v * 0.036))
    cells = [millivolts, *[65535] * 9]
    return mavlink.MAVLink_battery_status_message(0, 0, 0, 32767, cells, current, *used, remaining, 0, 1)


def _system_time(s: Board) -> Message:
    """Tell no UTC: there is no GPS."""
    return mavlink.MAVLink_system_time_message(0, s.boot_ms)


def _ekf_flags(s: Board) -> int:
    if s.ekf_doubt is not None:
        return EKF_UNINITIALIZED
    if not s.has_position:
        return EKF_WITHOUT_POSITION
    return EKF_DEAD_RECKONING if s.sensors.dead_reckons else EKF_WITH_POSITION


def _ekf_status_report(s: Board) -> Message:
    doubt = s.ekf_doubt
    variances = (0.0, 0.0, 0.001, 0.0) if doubt is None else (doubt,) * 4
    return mavlink.MAVLink_ekf_status_report_message(_ekf_flags(s), *variances, 0.0, 0.0)


def _named_value_float(s: Board) -> list[Message]:
    values = (
        (b"CamTilt", 1.0 - (CAMERA_TILT_PWM - 1100) / 800),
        (b"CamPan", 0.5),
        (b"TetherTrn", 0.0),
        (b"Lights1", 0.5),
        (b"Lights2", 0.5),
        (b"PilotGain", s.pilot.gain),
        (b"InputHold", float(s.pilot.input_hold)),
        (b"RollPitch", float(s.pilot.roll_pitch)),
        (b"RFTarget", -0.01),
    )
    return [mavlink.MAVLink_named_value_float_message(s.boot_ms, name, value) for name, value in values]


def _autopilot_version(_: Board) -> Message:
    none = [0] * 8
    return mavlink.MAVLink_autopilot_version_message(
        AUTOPILOT_CAPABILITIES, FLIGHT_VERSION_4_7_DEV, 0, 0, 0, none, none, none, 0, 0, 1
    )


def _gps_global_origin(s: Board) -> Message:
    if s.origin is None:
        return None
    return mavlink.MAVLink_gps_global_origin_message(*s.origin, s.boot_us)


def _distance_sensor(s: Board) -> Message:
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


def _rangefinder(s: Board) -> Message:
    """Tell the same; without a rangefinder nothing, and without an echo no distance."""
    if not s.sensors.range_limits_m[1]:
        return None
    reading = s.estimate().range_m
    return mavlink.MAVLink_rangefinder_message(0.0 if math.isnan(reading) else reading, 0.0)


def _whole_cm(metres: float) -> int:
    return min(int(100.0 * metres), 65535)


BUILDERS: Final[dict[int, Callable[[Board], Message]]] = {
    number: globals()[name]
    for number, kind in mavlink.mavlink_map.items()
    if (name := f"_{kind.msgname.lower()}") in globals()
}
NAN = math.nan
AT_REST: Final[dict[int, tuple[object, ...]]] = {
    mavlink.MAVLINK_MSG_ID_AHRS: (0.0, 0.0, 0.0, 0.0, 0.0, 5e-5, 1e-4),
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: (0, 0, 1, 0),
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: (0, 0, 0, 0, 0, 65535, 65535, 0, 0, 0),
    mavlink.MAVLINK_MSG_ID_POWER_STATUS: (5000, 0, 0),
    mavlink.MAVLINK_MSG_ID_MEMINFO: (0, 65535, 524288),
    mavlink.MAVLINK_MSG_ID_TERRAIN_REPORT: (0, 0, 0, 0.0, 0.0, 0, 0),
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: (0, 0),
    mavlink.MAVLINK_MSG_ID_VIBRATION: (0, 0.003, 0.003, 0.003, 0, 0, 0),
    mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT: (0.0,) * 2 + (0,) * 3 + (0.0,) * 3,
    mavlink.MAVLINK_MSG_ID_SCALED_IMU2: (0,) * 10 + (IMU_CENTIDEGREES,),
    mavlink.MAVLINK_MSG_ID_SCALED_IMU3: (0,) * 11,
    mavlink.MAVLINK_MSG_ID_SIMSTATE: (0.0,) * 9 + (0, 0),
    mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS: (
        *(0, 0, 0, 44, [1.0, 0.0, 0.0, 0.0], NAN, NAN, NAN, 0, NAN, NAN, 1),
    ),
}
"""Fields of what nobody steers by, as the firmware tells them at rest: load for the link, at its rates."""
TOLD: Final = {*BUILDERS, *AT_REST, mavlink.MAVLINK_MSG_ID_HOME_POSITION}
"""Numbers of the messages that the stand-in knows; there is no home to tell."""
STREAMED: Final = TOLD - {mavlink.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT}
"""What REQUEST_MESSAGE and SET_MESSAGE_INTERVAL take. NAMED_VALUE_FLOAT streams with its group."""


def build(message: int, board: Board) -> list[Message]:
    """Messages of one id, in the order they are sent; empty if there is nothing to tell.

    It reads the sensors whatever is told, so that their noise does not depend on what is asked.
    """
    board.estimate()
    if message in AT_REST:
        return [mavlink.mavlink_map[message](*AT_REST[message])]
    builder = BUILDERS.get(message)
    built = builder(board) if builder else None
    if built is None:
        return []
    return built if isinstance(built, list) else [built]


def int16(value: float) -> int:
    """Round and clamp."""
    return round(max(-32768.0, min(32767.0, value)))


def int32(value: float) -> int:
    """Round and clamp."""
    return round(max(-2147483648.0, min(2147483647.0, value)))


def heading_cdeg(yaw: float) -> int:
    """Heading in hundredths of a degree, 0..35999."""
    return round(math.degrees(yaw) * 100) % 36000


def _absolute_m(s: Board) -> float:
    """Altitude above the sea: exactly 0 until the EKF has an origin."""
    return 0.0 if s.origin is None else s.origin.alt_mm / 1000.0 + s.estimate().altitude_m


def place(s: Board) -> tuple[int, int]:
    """Latitude and longitude, degrees·1e7; 0 without an origin."""
    if s.origin is None:
        return 0, 0
    x, y = s.estimate().position[:2]
    shrink = max(0.01, math.cos(math.radians(s.origin.lat / 1e7)))
    return (
        int32(s.origin.lat + x / M_PER_DEGREE * 1e7),
        int32(s.origin.lon + y / (M_PER_DEGREE * shrink) * 1e7),
    )
