"""A log of another kind as the MAVLink that its vehicle would have sent: what `ground_log` reads."""

import math
from collections.abc import Iterator
from typing import Final

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.control.allocation import FACTORS
from lab.logs.dive_log import DiveLog
from lab.logs.telemetry_log import TlogRecord

NOTE: Final = "this log has no MAVLink: it counts as armed in MANUAL, and what it does not hold as absent"
MANUAL: Final = 19
SOUND_EKF: Final = 0b1010_0111
"""Attitude, vertical velocity and position; no horizontal position."""
SLOW_ROWS: Final = 10
"""Every so many rows what ArduSub sends once a second."""


def frames_of(log: DiveLog, frame: str) -> Iterator[TlogRecord]:
    """Give the messages of each row: attitude, depth, vertical speed, motors; heartbeat, battery, EKF."""
    link = mavlink.MAVLink(None, 1, 1)
    mixer = np.array(FACTORS[frame]).T
    at = np.clip(np.searchsorted(log.command_s, log.t_s, side="right") - 1, 0, None)
    for row, t_s in enumerate(log.t_s.tolist()):
        boot_ms = 10_000 + round(1e3 * t_s)
        demands = np.clip(log.commands[at[row]] @ mixer, -1.0, 1.0).tolist()
        pwm_us = [round(1500 + 400 * demand) for demand in demands] + [1500] * (8 - len(demands))
        roll, pitch, heading = log.attitude[row].tolist()
        down, (p, q, r), depth = (
            float(log.velocity[row, 2]),
            log.velocity[row, 3:].tolist(),
            float(log.depth[row]),
        )
        messages = [mavlink.MAVLink_servo_output_raw_message(1000 * boot_ms % (1 << 32), 0, *pwm_us)]
        if math.isfinite(roll + pitch + heading + p + q + r):
            turned = math.remainder(heading, 2.0 * math.pi)
            messages.append(mavlink.MAVLink_attitude_message(boot_ms, roll, pitch, turned, p, q, r))
        if math.isfinite(depth + down):
            up_mm, down_cms = round(-1e3 * depth), round(100.0 * down)
            messages += [
                mavlink.MAVLink_global_position_int_message(
                    boot_ms, 0, 0, up_mm, up_mm, 0, 0, down_cms, 65535
                ),
                mavlink.MAVLink_vfr_hud_message(0.0, 0.0, 0, 0, -depth, -down),
            ]
        if row % SLOW_ROWS == 0:
            millivolts = round(1e3 * float(log.voltage_v[at[row]]))
            armed = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | mavlink.MAV_MODE_FLAG_SAFETY_ARMED
            messages += [
                mavlink.MAVLink_heartbeat_message(12, 3, armed, MANUAL, mavlink.MAV_STATE_ACTIVE, 3),
                mavlink.MAVLink_sys_status_message(0, 0, 0, 0, millivolts, -1, -1, 0, 0, 0, 0, 0, 0),
                mavlink.MAVLink_ekf_status_report_message(SOUND_EKF, 0.1, 0.1, 0.1, 0.1, 0.1),
            ]
        for message in messages:
            yield TlogRecord(t_s, bytes(message.pack(link)))
