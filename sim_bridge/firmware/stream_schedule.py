"""Which telemetry message is due on one link, and when."""

import math

from pymavlink.dialects.v20 import ardupilotmega as mavlink

ATTITUDE, AHRS2, VFR_HUD = (
    mavlink.MAVLINK_MSG_ID_ATTITUDE,
    mavlink.MAVLINK_MSG_ID_AHRS2,
    mavlink.MAVLINK_MSG_ID_VFR_HUD,
)
HEARTBEAT = mavlink.MAVLINK_MSG_ID_HEARTBEAT

GROUPS: dict[int, tuple[float, tuple[int, ...]]] = {
    mavlink.MAV_DATA_STREAM_RAW_SENSORS: (
        2.0,
        (
            mavlink.MAVLINK_MSG_ID_RAW_IMU,
            mavlink.MAVLINK_MSG_ID_SCALED_IMU2,
            mavlink.MAVLINK_MSG_ID_SCALED_IMU3,
            mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE,
            mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE2,
        ),
    ),
    mavlink.MAV_DATA_STREAM_EXTENDED_STATUS: (
        2.0,
        (
            mavlink.MAVLINK_MSG_ID_SYS_STATUS,
            mavlink.MAVLINK_MSG_ID_POWER_STATUS,
            mavlink.MAVLINK_MSG_ID_MEMINFO,
            mavlink.MAVLINK_MSG_ID_MISSION_CURRENT,
            mavlink.MAVLINK_MSG_ID_GPS_RAW_INT,
            mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT,
            mavlink.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT,
        ),
    ),
    mavlink.MAV_DATA_STREAM_RC_CHANNELS: (
        2.0,
        (mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW, mavlink.MAVLINK_MSG_ID_RC_CHANNELS),
    ),
    mavlink.MAV_DATA_STREAM_POSITION: (
        3.0,
        (mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED),
    ),
    mavlink.MAV_DATA_STREAM_EXTRA1: (10.0, (ATTITUDE, mavlink.MAVLINK_MSG_ID_SIMSTATE, AHRS2)),
    mavlink.MAV_DATA_STREAM_EXTRA2: (10.0, (VFR_HUD,)),
    mavlink.MAV_DATA_STREAM_EXTRA3: (
        3.0,
        (
            mavlink.MAVLINK_MSG_ID_AHRS,
            mavlink.MAVLINK_MSG_ID_SYSTEM_TIME,
            mavlink.MAVLINK_MSG_ID_TERRAIN_REPORT,
            mavlink.MAVLINK_MSG_ID_BATTERY_STATUS,
            mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS,
            mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
            mavlink.MAVLINK_MSG_ID_VIBRATION,
        ),
    ),
}
"""REQUEST_DATA_STREAM's groups: the rate in Hz with nobody asking, and the messages."""

DEFAULT_RATE_HZ = {message: rate for rate, group in GROUPS.values() for message in group} | {HEARTBEAT: 1.0}
FASTEST_INTERVAL_US = 3125
"""0.8 of the firmware's 400 Hz loop; what is asked faster is refused."""
TRANSFER_SLOWDOWN = 4.0


class StreamSchedule:
    """Intervals of one link. Times are seconds since boot; messages of one rate share their slots."""

    def __init__(self) -> None:
        self._interval_s = {message: 1.0 / rate for message, rate in DEFAULT_RATE_HZ.items()}
        self._due_s = dict.fromkeys(self._interval_s, 0.0)
        self._next_s = 0.0

    def interval_us(self, message: int) -> int:
        """For MESSAGE_INTERVAL: the interval, or -1 if it is not sent."""
        interval = self._interval_s.get(message)
        return -1 if interval is None else round(interval * 1e6)

    def set_interval(self, message: int, interval_us: float, now_s: float) -> bool:
        """SET_MESSAGE_INTERVAL: -1 stops, 0 restores the default. False if it is refused."""
        if interval_us == 0:
            self._set(message, DEFAULT_RATE_HZ.get(message, 0.0), now_s)
        elif interval_us == -1:
            self._set(message, 0.0, now_s)
        elif interval_us < FASTEST_INTERVAL_US:
            return False
        else:
            self._set(message, 1e6 / interval_us, now_s)
        return True

    def set_group(self, group: int, rate_hz: float, now_s: float) -> None:
        """REQUEST_DATA_STREAM: 0 is all groups; a rate of 0 stops. It overrides single intervals."""
        groups = GROUPS.values() if group == 0 else [GROUPS[group]] if group in GROUPS else []
        for _, group_messages in groups:
            for message in group_messages:
                self._set(message, min(rate_hz, 1e6 / FASTEST_INTERVAL_US), now_s)

    def due(self, now_s: float, slowdown: float = 1.0) -> list[int]:
        """Messages to send now. A missed slot is not made up for."""
        if now_s < self._next_s:
            return []
        ready = []
        for message, due_s in self._due_s.items():
            if due_s <= now_s + 1e-9:
                ready.append(message)
                interval = self._interval_s[message] * (1.0 if message == HEARTBEAT else slowdown)
                self._due_s[message] = due_s + interval * max(1, math.ceil((now_s - due_s) / interval))
        self._next_s = min(self._due_s.values(), default=now_s + 1.0) - 1e-9
        return ready

    def _set(self, message: int, rate_hz: float, now_s: float) -> None:
        if rate_hz <= 0.0:
            self._interval_s.pop(message, None)
            self._due_s.pop(message, None)
            return
        if self._interval_s.get(message) != 1.0 / rate_hz:
            interval = 1.0 / rate_hz
            self._interval_s[message] = interval
            self._due_s[message] = math.ceil(now_s / interval - 1e-6) * interval
            self._next_s = min(self._next_s, self._due_s[message])
