"""The messages for one vehicle: steering, commands and questions; `Codec.encode` packs them.

Source: docs/ardusub.md, "Who may steer", "MANUAL_CONTROL", "RC_CHANNELS_OVERRIDE", "Modes and arming".
"""

import math
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.mavlink.ardusub import LEAVE_ALONE, NEUTRAL_US, to_channels, to_sticks
from companion.mavlink.messages import Message, message_type
from companion.records import AxisCommand, PilotSticks
from companion.telemetry.modes import Mode

HEARTBEAT: Final = message_type(mavlink.MAVLINK_MSG_ID_HEARTBEAT)
MANUAL_CONTROL: Final = message_type(mavlink.MAVLINK_MSG_ID_MANUAL_CONTROL)
RC_CHANNELS_OVERRIDE: Final = message_type(mavlink.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE)
COMMAND_LONG: Final = message_type(mavlink.MAVLINK_MSG_ID_COMMAND_LONG)
SET_GPS_GLOBAL_ORIGIN: Final = message_type(mavlink.MAVLINK_MSG_ID_SET_GPS_GLOBAL_ORIGIN)
TIMESYNC: Final = message_type(mavlink.MAVLINK_MSG_ID_TIMESYNC)
PARAM_REQUEST_READ: Final = message_type(mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ)
MARKS: Final = 10_000
"""What is below 10 µs in our TIMESYNC tells whose question it is, as ArduSub does in its own."""


def clock_mark(system: int, component: int) -> int:
    """Return what the questions of these ids carry."""
    return (256 * system + component) % MARKS


class Commands:
    """Builds the messages for one vehicle."""

    def __init__(self, target_system: int = 1, target_component: int = 1, mark: int = 0) -> None:
        self._system = target_system
        self._component = target_component
        self._mark = mark

    def heartbeat(self) -> Message:
        """Our own sign of life, as an onboard controller."""
        return HEARTBEAT(
            type=mavlink.MAV_TYPE_ONBOARD_CONTROLLER,
            autopilot=mavlink.MAV_AUTOPILOT_INVALID,
            system_status=mavlink.MAV_STATE_ACTIVE,
            mavlink_version=3,
        )

    def rc_override(self, command: AxisCommand, *, tilts: bool = False) -> Message:
        """Four axes as PWM, with `tilts` all six; camera and all further channels are left alone."""
        surge, sway, throttle, yaw, roll, pitch = to_channels(command)
        return RC_CHANNELS_OVERRIDE(
            target_system=self._system,
            target_component=self._component,
            chan1_raw=pitch if tilts else LEAVE_ALONE,
            chan2_raw=roll if tilts else LEAVE_ALONE,
            chan3_raw=throttle,
            chan4_raw=yaw,
            chan5_raw=surge,
            chan6_raw=sway,
            chan7_raw=LEAVE_ALONE,
            chan8_raw=LEAVE_ALONE,
        )

    def manual_control(
        self, command: AxisCommand, gain: float, throttle_gain: float, pilot: PilotSticks | None = None
    ) -> Message:
        """Axes as sticks that undo the pilot's `gain` and JS_THR_GAIN, within `manual_control_reach`.

        Pitch and roll go as s and t, which ArduSub adds in µs. Buttons and all further fields are those of
        the pilot, where there is one.
        """
        x, y, z, r = to_sticks(command, gain, throttle_gain)
        *_, roll, pitch = to_channels(command)
        his: dict[str, int] = {}
        if pilot is not None:
            buttons2, extensions = pilot.extensions
            his = {f"aux{number}": value for number, value in enumerate(pilot.aux, start=1)}
            his |= {"buttons": pilot.buttons, "buttons2": buttons2, "enabled_extensions": extensions}
        return MANUAL_CONTROL(
            target=self._system, x=x, y=y, z=z, r=r, s=pitch - NEUTRAL_US, t=roll - NEUTRAL_US, **his
        )

    def set_mode(self, mode: Mode) -> Message:
        """Ask for a flight mode; HEARTBEAT tells whether it was granted."""
        return self._command(
            mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, float(mode)
        )

    def arm(self, armed: bool) -> Message:
        """Ask to arm or disarm; HEARTBEAT tells whether it was granted."""
        return self._command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, float(armed))

    def message_interval(self, message_id: int, rate_hz: float) -> Message:
        """Ask for a message `rate_hz` times a second; 0 stops it."""
        interval_us = 1e6 / rate_hz if rate_hz > 0.0 else -1.0
        return self._command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, float(message_id), interval_us)

    def request_message(self, message_id: int) -> Message:
        """Ask for one message, once."""
        return self._command(mavlink.MAV_CMD_REQUEST_MESSAGE, float(message_id))

    def set_origin(self, latitude_deg: float, longitude_deg: float) -> Message:
        """Tell the EKF where on earth it is, at sea level; dropped silently if it knows already."""
        return SET_GPS_GLOBAL_ORIGIN(
            target_system=self._system,
            latitude=round(latitude_deg * 1e7),
            longitude=round(longitude_deg * 1e7),
        )

    def timesync(self, now_s: float) -> Message:
        """Ask for the autopilot's clock; the answer carries our `now_s` back."""
        return TIMESYNC(ts1=math.floor(now_s * 1e9 / MARKS) * MARKS + self._mark)

    def read_parameter(self, name: str) -> Message:
        """Ask for a parameter's value; `name` has at most 16 ASCII characters."""
        return PARAM_REQUEST_READ(
            target_system=self._system, target_component=self._component, param_id=name, param_index=-1
        )

    def _command(self, command: int, *params: float) -> Message:
        given = {f"param{i}": value for i, value in enumerate(params, start=1)}
        return COMMAND_LONG(
            target_system=self._system, target_component=self._component, command=command, **given
        )
