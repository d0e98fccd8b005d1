"""What tells GUIDED where to go: SET_POSITION_TARGET_*, DO_REPOSITION and CONDITION_YAW.

ALT_HOLD takes the depth of SET_POSITION_TARGET_GLOBAL_INT as well.
"""

import cmath
import math

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_bridge.firmware import modes
from sim_bridge.firmware.answers import ACCEPTED, DENIED, FAILED, INFO, UNSUPPORTED
from sim_bridge.firmware.board import Board
from sim_bridge.firmware.messages import M_PER_DEGREE, Message
from sim_bridge.firmware.navigation import FASTEST_TURN_RAD_S, Turn

POSITION, VELOCITY, ACCELERATION = 0b111, 0b111 << 3, 0b111 << 6
NO_Z, NO_YAW, NO_YAW_RATE = 1 << 2, 1 << 10, 1 << 11
"""Bits of a type_mask, which tell what to ignore; one of three ignores all three."""
LOCAL, OFFSET, BODY, BODY_OFFSET, BODY_FRD = (
    mavlink.MAV_FRAME_LOCAL_NED,
    mavlink.MAV_FRAME_LOCAL_OFFSET_NED,
    mavlink.MAV_FRAME_BODY_NED,
    mavlink.MAV_FRAME_BODY_OFFSET_NED,
    mavlink.MAV_FRAME_BODY_FRD,
)
ABSOLUTE = (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT)
RELATIVE = (mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)
CHANGE_MODE = 1
FARTHEST_M, DEEPEST_M = 1e6, 1000.0


def take_local(board: Board, message: Message) -> None:
    """SET_POSITION_TARGET_LOCAL_NED."""
    frame, values = message.coordinate_frame, (message.x, message.y, message.z)
    speeds = (message.vx, message.vy, message.vz)
    if board.control.mode != modes.GUIDED or frame not in (LOCAL, OFFSET, BODY, BODY_OFFSET, BODY_FRD):
        return
    e = board.estimate()
    turned = cmath.exp(1j * e.yaw) if frame in (BODY, BODY_OFFSET, BODY_FRD) else 1.0
    place, height = complex(*values[:2]) * turned, -values[2]
    if frame != LOCAL:
        place, height = place + complex(*e.position[:2]), height + e.altitude_m
    mask = message.type_mask
    if _go(board, mask, place, height, complex(*speeds[:2]) * turned, -speeds[2]):
        _turn(board, mask, message.yaw, message.yaw_rate, relative=frame == BODY_OFFSET)


def take_global(board: Board, message: Message) -> None:
    """SET_POSITION_TARGET_GLOBAL_INT; in ALT_HOLD its altitude alone, over the EKF's origin."""
    mask = message.type_mask
    if board.control.mode == modes.ALT_HOLD and not mask & NO_Z:
        _set_depth(board, message)
    elif board.control.mode == modes.GUIDED:
        where = 0j, 0.0
        if not mask & POSITION:
            if not _is_known(board, message.coordinate_frame):
                return
            found = _local(board, message.lat_int, message.lon_int, message.alt, message.coordinate_frame)
            if found is None:
                return
            where = found
        _go(board, mask, *where, complex(message.vx, message.vy), -message.vz)


def reposition(board: Board, message: Message) -> int:
    """Obey DO_REPOSITION, which has to come as COMMAND_INT; the MAV_RESULT."""
    if message.get_type() != "COMMAND_INT":
        return UNSUPPORTED
    may_change = math.isfinite(message.param2) and bool(int(message.param2) & CHANGE_MODE)
    guided = board.control.mode == modes.GUIDED
    if not (guided or may_change) or not (message.x or message.y):
        return DENIED
    if not _is_known(board, message.frame) or not math.isfinite(message.z):
        return DENIED
    found = _local(board, message.x, message.y, message.z, message.frame)
    if found is None:
        return FAILED
    if not guided and board.set_mode(modes.GUIDED) != ACCEPTED:
        return FAILED
    board.control.navigation.go_to(*found)
    return ACCEPTED


def condition_yaw(board: Board, p: list[float]) -> int:
    """Obey CONDITION_YAW: degrees, degrees a second, direction, whether relative; the MAV_RESULT."""
    degrees, rate, way, relative = p[:4]
    if not 0.0 <= degrees <= 360.0 or relative not in (0.0, 1.0):
        return DENIED
    _head(board, degrees, rate if math.isfinite(rate) else 0.0, way < 0.0, relative=bool(relative))
    return ACCEPTED


def _go(board: Board, mask: int, place: complex, height: float, velocity: complex, climb: float) -> bool:
    """Hand a target to GUIDED; whether it was one."""
    asked = (not mask & POSITION, not mask & VELOCITY)
    values = (*((place.real, place.imag, height) if asked[0] else ()),)
    values += (velocity.real, velocity.imag, climb) if asked[1] else ()
    if not mask & ACCELERATION or not values or not all(abs(value) < FARTHEST_M for value in values):
        return False
    navigation = board.control.navigation
    if all(asked):
        navigation.follow(place, height, velocity, climb, board.boot_s)
    elif asked[0]:
        navigation.go_to(place, height)
    else:
        navigation.go_at(velocity, climb, board.boot_s)
    return True


def _turn(board: Board, mask: int, yaw: float, rate: float, *, relative: bool) -> None:
    """Take a target's heading (rad) and rate (rad/s), as far as it has them."""
    navigation = board.control.navigation
    has_yaw = not mask & NO_YAW and math.isfinite(yaw)
    has_rate = not mask & NO_YAW_RATE and math.isfinite(rate)
    if has_yaw:
        degrees = math.degrees(yaw)
        # The firmware takes these degrees for radians where it looks for the shorter way.
        backwards = math.remainder(degrees - board.estimate().yaw, math.tau) < 0.0
        _head(board, degrees, math.degrees(rate) if has_rate else 0.0, backwards, relative=relative)
    elif has_rate:
        slew = min(math.degrees(rate), math.degrees(FASTEST_TURN_RAD_S))
        navigation.turn = Turn(navigation.turn.heading, _whole_degrees(slew))
    navigation.turn = navigation.turn._replace(rate_only=has_rate and not has_yaw)


def _head(board: Board, degrees: float, rate: float, backwards: bool, *, relative: bool) -> None:
    """Set the heading, and the rate towards it in whole degrees a second; 0 is the fastest one."""
    navigation = board.control.navigation
    if relative:
        degrees = math.degrees(board.control.heading_target) + (-degrees if backwards else degrees)
    fastest = math.degrees(FASTEST_TURN_RAD_S)
    navigation.turn = navigation.turn._replace(
        heading=math.radians(degrees), rate=_whole_degrees(min(rate, fastest) if rate else fastest)
    )


def _is_known(board: Board, frame: int) -> bool:
    if frame not in ABSOLUTE + RELATIVE:
        board.say(INFO, f"Unknown mavlink coordinate frame {frame}")
        return False
    return True


def _whole_degrees(degrees: float) -> float:
    return math.radians(int(max(-32768.0, degrees)))


def _local(
    board: Board, latitude: int, longitude: int, altitude_m: float, frame: int
) -> tuple[complex, float] | None:
    """Return a place from the EKF's origin (m) and its height over it; None where it cannot be told."""
    origin, home = board.origin, board.home
    if origin is None or not math.isfinite(altitude_m) or abs(latitude) > 9e8 or abs(longitude) > 18e8:
        return None
    if frame in RELATIVE and home is None:
        return None
    zero_mm = home.alt_mm if frame in RELATIVE and home else 0
    shrink = math.cos(math.radians(0.5e-7 * (latitude + origin.lat)))
    north = (latitude - origin.lat) * 1e-7 * M_PER_DEGREE
    east = (longitude - origin.lon) * 1e-7 * M_PER_DEGREE * shrink
    height = altitude_m + (zero_mm - origin.alt_mm) / 1000.0
    return (complex(north, east), height) if max(abs(north), abs(east), abs(height)) < FARTHEST_M else None


def _set_depth(board: Board, message: Message) -> None:
    altitude_m = message.alt - (board.origin.alt_mm / 1000.0 if board.origin else 0.0)
    is_depth_alone = message.coordinate_frame == mavlink.MAV_FRAME_GLOBAL_INT and (
        message.type_mask & POSITION == POSITION & ~NO_Z
    )
    if is_depth_alone and math.isfinite(altitude_m):
        board.control.depth_target = max(0.0, min(DEEPEST_M, -altitude_m))
