"""From the messages of the pilot's ground station to events: sticks, commands, targets, a sign of life.

Source: docs/ardusub.md, "MANUAL_CONTROL", "Modes and arming".
"""

import math
from collections.abc import Callable, Iterator
from typing import Final, TypeAlias

from msgspec.structs import replace
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion import records
from companion.config import LinkSection
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
from companion.mavlink.codec import addresses_us
from companion.mavlink.frames import WireFrame
from companion.mavlink.messages import Message, message_name, message_type
from companion.records import Angles, AxisCommand, Event, GlobalOrigin, PilotAction, Vector
from companion.telemetry.degrees import metres

COMMANDS: Final = (mavlink.MAVLINK_MSG_ID_COMMAND_LONG, mavlink.MAVLINK_MSG_ID_COMMAND_INT)
COMMAND_ACK: Final = message_type(mavlink.MAVLINK_MSG_ID_COMMAND_ACK)
MISSION_ACK: Final = message_type(mavlink.MAVLINK_MSG_ID_MISSION_ACK)
ACTIONS: Final = frozenset(map(float, PilotAction))


def pilot_events(
    frame: WireFrame, t_s: float, origin: GlobalOrigin | None, link: LinkSection
) -> Iterator[Event]:
    """Convert one of the pilot's frames, by EVENTS; `origin` is the EKF's. Never raises for any bytes.

    What asks our component for something else, or is not of `link.system`, is refused.
    """
    if addresses_us(frame, link) and not (frame.id in EVENTS and frame.system == link.system):
        yield _refused(frame, t_s, link.system)
    elif frame.id in EVENTS:
        for event in EVENTS[frame.id](frame.message(), t_s, origin):
            if isinstance(event, records.Refused):
                event = replace(event, words=f"{message_name(frame.id)}: {event.words}")
            yield event


def _refused(frame: WireFrame, t_s: float, commander: int) -> Event:
    message, name, answer = frame.message(), message_name(frame.id), None
    words, result = "Holdfast takes commands and targets alone", mavlink.MAV_RESULT_UNSUPPORTED
    if frame.system != commander:
        words, result = f"system {commander} alone commands (link.system)", mavlink.MAV_RESULT_DENIED
    if frame.id in COMMANDS:
        answer = COMMAND_ACK(command=message.command, result=result)
    elif name.startswith("MISSION_"):
        to, kind = (frame.system, frame.component), getattr(message, "mission_type", 0)
        answer = MISSION_ACK(*to, mavlink.MAV_MISSION_UNSUPPORTED, kind)
    return records.Refused(t_s, f"{name}: {words}", answer)


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
    """Convert a COMMAND_LONG or COMMAND_INT to our component."""
    if m.command == mavlink.MAV_CMD_USER_1 and m.param1 in ACTIONS:
        yield records.PilotCommand(t_s, PilotAction(int(m.param1)))
    else:
        words = f"{m.command} with {m.param1:g} is not known: MAV_CMD_USER_1 with 1, 2 or 3 is"
        answer = COMMAND_ACK(command=m.command, result=mavlink.MAV_RESULT_UNSUPPORTED)
        yield records.Refused(t_s, words, answer)


def override_deflection(m: Message) -> float | None:
    """Return how far an RC_CHANNELS_OVERRIDE moves the six axes, 0..1; None if it leaves them all alone."""
    channels = (m.chan1_raw, m.chan2_raw, m.chan3_raw, m.chan4_raw, m.chan5_raw, m.chan6_raw)
    offsets = [abs(us - NEUTRAL_US) for us in channels if us not in (0, LEAVE_ALONE)]
    return min(1.0, max(offsets) / SPAN_US) if offsets else None


POSITION, VELOCITY, ACCELERATION, DEPTH_ALONE = 0b111, 0b111 << 3, 0b111 << 6, 0b011
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
"""Whether an altitude is over the sea, not over the surface of the water."""


def position_target(m: Message, t_s: float, origin: GlobalOrigin | None = None) -> Iterator[Event]:
    """Convert SET_POSITION_TARGET_LOCAL_NED; what asks for what is not supported, or for nothing, is refused.

    A force is not followed, and an acceleration only beside a velocity.
    """
    heading = math.nan if m.type_mask & IGNORES_YAW else m.yaw
    rate = math.nan if m.type_mask & IGNORES_YAW_RATE else m.yaw_rate
    yield from _target(m, t_s, (m.x, m.y, m.z, heading), rate, TARGET_FRAMES.get(m.coordinate_frame))


def global_target(m: Message, t_s: float, origin: GlobalOrigin | None) -> Iterator[Event]:
    """Convert SET_POSITION_TARGET_GLOBAL_INT, as above; a place is refused while no origin is known.

    As in ArduSub its heading is not read, and a depth that stands alone is under the EKF's origin.
    """
    over_the_sea, places = GLOBAL_FRAMES.get(m.coordinate_frame), not m.type_mask & POSITION
    if places and origin is None:
        yield records.Refused(t_s, "the EKF has no origin: set one")
        return
    if ~m.type_mask & (IGNORES_YAW | IGNORES_YAW_RATE):
        yield records.Refused(t_s, "its heading is not followed")
    north_m, east_m, depth_m = math.nan, math.nan, -m.alt
    if places and origin is not None:
        north_m, east_m = metres((m.lat_int / 1e7, m.lon_int / 1e7), origin.place_deg)
        depth_m += origin.altitude_m if over_the_sea else 0.0
    yield from _target(
        m,
        t_s,
        (north_m, east_m, depth_m, math.nan),
        math.nan,
        None if over_the_sea is None else (False, False, False),
    )


def _target(
    m: Message, t_s: float, place: Vector, rate: float, frame: tuple[bool, bool, bool] | None
) -> Iterator[Event]:
    """Give what the mask leaves of a target, and say what is left out of it."""
    x, y, z, heading = place
    mask, nan = m.type_mask, math.nan
    if mask & POSITION:
        x, y, z = nan, nan, z if mask & POSITION == DEPTH_ALONE else nan
    u, v, w = (nan, nan, nan) if mask & VELOCITY else (m.vx, m.vy, m.vz)
    a, b, c = (nan, nan, nan) if mask & (VELOCITY | ACCELERATION) else (m.afx, m.afy, m.afz)
    places, speeds, accelerations = (x, y, z, heading), (u, v, w, rate), (a, b, c, nan)
    limits = (places, MAX_DISTANCE_M), (speeds, MAX_SPEED_MPS), (accelerations, MAX_SPEED_MPS)
    if frame is None:
        yield records.Refused(t_s, f"frame {m.coordinate_frame} is not supported")
    elif any(abs(value) > most for values, most in limits for value in values):
        yield records.Refused(t_s, "a number in it is too large")
    elif all(map(math.isnan, (*places, *speeds))):
        yield records.Refused(t_s, f"type_mask {mask} leaves nothing that can be followed")
    elif mask & IS_FORCE:
        yield records.Refused(t_s, "a force is not followed")
    else:
        yield records.PositionTarget(t_s, places, speeds, accelerations, *frame)
        parts = (POSITION, z), (VELOCITY, u), (ACCELERATION, a)
        if any(bits & ~mask and math.isnan(one) for bits, one in parts):
            yield records.Refused(t_s, f"type_mask {mask} has a part of three alone, which is left out")


def attitude_target(m: Message, t_s: float, origin: GlobalOrigin | None = None) -> Iterator[Event]:
    """Convert SET_ATTITUDE_TARGET, or refuse what says nothing. As in ArduSub half thrust keeps the depth."""
    angles, heading, climb = Angles(math.nan, math.nan), math.nan, 0.0
    w, x, y, z = m.q
    if not m.type_mask & IGNORES_ATTITUDE and 0.9 < w * w + x * x + y * y + z * z < 1.1:
        roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
        pitch = math.asin(clip(2.0 * (w * y - z * x)))
        angles, heading = Angles(roll, pitch), math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    climbs = not m.type_mask & IGNORES_THRUST and math.isfinite(m.thrust)
    if climbs:
        climb = clip(2.0 * m.thrust - 1.0)
    if math.isnan(heading) and not (climbs and m.type_mask & IGNORES_ATTITUDE):
        yield records.Refused(t_s, f"no quaternion of length 1 is in it (type_mask {m.type_mask})")
    if climbs or not math.isnan(heading):
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
    **dict.fromkeys(COMMANDS, pilot_commands),
    **TARGETS,
}
"""What becomes of each message."""
