"""From the messages of the pilot's ground station to events: sticks, commands, targets, a sign of life.

Source: docs/ardusub.md, "MANUAL_CONTROL", "Modes and arming".
"""

import math
from collections.abc import Callable, Iterator
from typing import Final, TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion import records
from companion.mavlink.ardusub import (
    INT16_MAX,
    LEAVE_ALONE,
    MAX_DISTANCE_M,
    MAX_SPEED_MPS,
    NEUTRAL_US,
    SPAN_US,
    STICK_NEUTRAL_Z,
    clip,
    from_stick,
)
from companion.mavlink.frames import WireFrame
from companion.mavlink.messages import Message
from companion.records import Angles, AxisCommand, Event, GlobalOrigin, PilotAction, Vector
from companion.telemetry.degrees import metres

ACTIONS: Final = frozenset(map(float, PilotAction))


def pilot_events(frame: WireFrame, t_s: float, origin: GlobalOrigin | None) -> Iterator[Event]:
    """Convert one of the pilot's frames, by EVENTS; `origin` is the EKF's. Never raises for any bytes."""
    if frame.id in EVENTS:
        yield from EVENTS[frame.id](frame.message(), t_s, origin)


def _heartbeat(m: Message, t_s: float, origin: GlobalOrigin | None) -> Iterator[Event]:
    yield records.PilotHeartbeat(t_s)


def _sticks(m: Message, t_s: float, origin: GlobalOrigin | None) -> Iterator[Event]:
    yield pilot_sticks(m, t_s)


def _override(m: Message, t_s: float, origin: GlobalOrigin | None) -> Iterator[Event]:
    yield records.PilotInput(t_s, override_deflection(m) or 0.0)


def pilot_sticks(m: Message, t_s: float) -> records.PilotSticks:
    """Convert the pilot's MANUAL_CONTROL; INT16_MAX, MAVLink's word for an axis that is not there, rests."""
    return records.PilotSticks(
        t_s,
        AxisCommand(
            surge=from_stick(m.x),
            sway=from_stick(m.y),
            heave=0.0 if m.z == INT16_MAX else clip((STICK_NEUTRAL_Z - m.z) / STICK_NEUTRAL_Z),
            yaw=from_stick(m.r),
            roll=clip(m.t / SPAN_US),
            pitch=clip(m.s / SPAN_US),
        ),
        m.buttons,
        (m.buttons2, m.enabled_extensions),
        (m.aux1, m.aux2, m.aux3, m.aux4, m.aux5, m.aux6),
    )


def pilot_commands(m: Message, t_s: float, origin: GlobalOrigin | None = None) -> Iterator[Event]:
    """Convert a COMMAND_LONG to our component; empty for another command than MAV_CMD_USER_1."""
    if m.command == mavlink.MAV_CMD_USER_1:
        yield records.PilotCommand(t_s, PilotAction(int(m.param1)) if m.param1 in ACTIONS else None)


def override_deflection(m: Message) -> float | None:
    """Return how far an RC_CHANNELS_OVERRIDE moves the six axes, 0..1; None if it leaves them all alone."""
    channels = (m.chan1_raw, m.chan2_raw, m.chan3_raw, m.chan4_raw, m.chan5_raw, m.chan6_raw)
    offsets = [abs(us - NEUTRAL_US) for us in channels if us not in (0, LEAVE_ALONE)]
    return min(1.0, max(offsets) / SPAN_US) if offsets else None


POSITION, VELOCITY, ACCELERATION, DEPTH = 0b111, 0b111 << 3, 0b111 << 6, 1 << 2
IGNORES_YAW, IGNORES_YAW_RATE, IS_FORCE = 1 << 10, 1 << 11, 1 << 9
"""Bits of POSITION_TARGET_TYPEMASK. As in ArduSub one of three leaves out all; a depth may stand alone."""

IGNORES_ATTITUDE, IGNORES_THRUST = 1 << 7, 1 << 6
"""Bits of ATTITUDE_TARGET_TYPEMASK; ArduSub does not look at those of the rates."""

TARGET_FRAMES: Final = {
    mavlink.MAV_FRAME_LOCAL_NED: (False, False, False),
    mavlink.MAV_FRAME_LOCAL_OFFSET_NED: (True, False, False),
    mavlink.MAV_FRAME_BODY_NED: (True, True, False),
    mavlink.MAV_FRAME_BODY_OFFSET_NED: (True, True, True),
    mavlink.MAV_FRAME_BODY_FRD: (True, True, False),
}
"""Whether places count from the vehicle, whether axes are its own, whether headings count from its own."""

GLOBAL_FRAMES: Final = {
    mavlink.MAV_FRAME_GLOBAL: True,
    mavlink.MAV_FRAME_GLOBAL_INT: True,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT: False,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT: False,
}
"""Whether an altitude is over the sea, not over the surface of the water that is dived in."""


def position_target(m: Message, t_s: float, origin: GlobalOrigin | None = None) -> Iterator[Event]:
    """Convert SET_POSITION_TARGET_LOCAL_NED; empty where it asks for what is not supported, or for nothing.

    A force is not followed, and an acceleration only beside a velocity.
    """
    frame, mask = TARGET_FRAMES.get(m.coordinate_frame), m.type_mask
    if frame is not None:
        heading = math.nan if mask & IGNORES_YAW else m.yaw
        rate = math.nan if mask & IGNORES_YAW_RATE else m.yaw_rate
        yield from _target(m, t_s, (m.x, m.y, m.z, heading), rate, frame)


def global_target(m: Message, t_s: float, origin: GlobalOrigin | None) -> Iterator[Event]:
    """Convert SET_POSITION_TARGET_GLOBAL_INT, as above; empty for a place while no origin is known.

    As in ArduSub its heading is not read, and a depth that stands alone is under the EKF's origin.
    """
    over_the_sea, places = GLOBAL_FRAMES.get(m.coordinate_frame), not m.type_mask & POSITION
    if over_the_sea is None or (places and origin is None):
        return
    north_m, east_m, depth_m = math.nan, math.nan, -m.alt
    if places and origin is not None:
        north_m, east_m = metres((m.lat_int / 1e7, m.lon_int / 1e7), origin.place_deg)
        depth_m += origin.altitude_m if over_the_sea else 0.0
    yield from _target(m, t_s, (north_m, east_m, depth_m, math.nan), math.nan, (False, False, False))


def _target(
    m: Message, t_s: float, place: Vector, rate: float, frame: tuple[bool, bool, bool]
) -> Iterator[Event]:
    """Give what the mask leaves of a target."""
    x, y, z, heading = place
    mask, nan = m.type_mask, math.nan
    if mask & POSITION:
        x, y, z = nan, nan, z if mask & POSITION == POSITION & ~DEPTH else nan
    u, v, w = (nan, nan, nan) if mask & VELOCITY else (m.vx, m.vy, m.vz)
    a, b, c = (nan, nan, nan) if mask & (VELOCITY | ACCELERATION) else (m.afx, m.afy, m.afz)
    places, speeds, accelerations = (x, y, z, heading), (u, v, w, rate), (a, b, c, nan)
    limits = (places, MAX_DISTANCE_M), (speeds, MAX_SPEED_MPS), (accelerations, MAX_SPEED_MPS)
    far = any(abs(value) > most for values, most in limits for value in values)
    if not (far or mask & IS_FORCE or all(map(math.isnan, (*places, *speeds)))):
        yield records.PositionTarget(t_s, places, speeds, accelerations, *frame)


def attitude_target(m: Message, t_s: float, origin: GlobalOrigin | None = None) -> Iterator[Event]:
    """Convert SET_ATTITUDE_TARGET; empty where it says nothing. As in ArduSub half thrust keeps the depth."""
    angles, heading, climb = Angles(math.nan, math.nan), math.nan, 0.0
    w, x, y, z = m.q
    if not m.type_mask & IGNORES_ATTITUDE and 0.9 < w * w + x * x + y * y + z * z < 1.1:
        roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
        pitch = math.asin(clip(2.0 * (w * y - z * x)))
        angles, heading = Angles(roll, pitch), math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    if not m.type_mask & IGNORES_THRUST and math.isfinite(m.thrust):
        climb = clip(2.0 * m.thrust - 1.0)
    if not math.isnan(heading) or climb != 0.0:
        yield records.AttitudeTarget(t_s, angles, heading, climb)


Converter: TypeAlias = Callable[[Message, float, GlobalOrigin | None], Iterator[Event]]
TARGETS: Final[dict[int, Converter]] = {
    mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED: position_target,
    mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT: global_target,
    mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET: attitude_target,
}
EVENTS: Final[dict[int, Converter]] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: _heartbeat,
    mavlink.MAVLINK_MSG_ID_MANUAL_CONTROL: _sticks,
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE: _override,
    mavlink.MAVLINK_MSG_ID_COMMAND_LONG: pilot_commands,
    **TARGETS,
}
"""What becomes of each message."""
