"""What both are asked with a position: POSHOLD and GUIDED on the same plant, with a DVL in still water."""

import math
from collections.abc import Callable
from typing import Any, TypeVar

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from lab.parity.answers import Answers, Near
from lab.parity.partner import Message, Partner, of_type, result, texts
from sim_bridge.firmware.messages import M_PER_DEGREE

T = TypeVar("T")
POSHOLD, GUIDED, STABILIZE = 16, 4, 0
LOCAL, OFFSET, BODY = (
    mavlink.MAV_FRAME_LOCAL_NED,
    mavlink.MAV_FRAME_LOCAL_OFFSET_NED,
    mavlink.MAV_FRAME_BODY_NED,
)
DEPTH_M = 3.0
POSITION_ONLY, VELOCITY_ONLY, MOVING = 0b110111111000, 0b110111000111, 0b110111000000
"""Bits of type_mask for what is to be ignored."""
WITH_YAW, WITH_YAW_RATE = ~(1 << 10), ~(1 << 11)


def poshold(partner: Partner) -> Answers:
    """Hold, go by stick, let go, and turn on the spot."""
    stick = [0, 0, 500, 0]
    partner.streaming = lambda: mavlink.MAVLink_manual_control_message(1, *stick, 0)
    yield "mode", _outcome(partner.set_mode(POSHOLD))
    partner.arm()
    partner.listen(4.0)
    for name, axis, value in (("x 1000", 0, 1000), ("x -500", 0, -500), ("y 700", 1, 700)):
        begin = _place(partner)
        stick[axis] = value
        partner.listen(1.5)
        yield f"{name}: way after 1.5 s, m", Near(abs(_place(partner) - begin), 0.05)
        partner.listen(1.5)
        yield f"{name}: speed after 3 s, m/s", Near(_speed(partner), 0.05)
        stick[axis] = 0
        begin = _place(partner)
        ways = [abs(place - begin) for place in _watched(partner, 5.0, lambda: _place(partner))]
        yield f"{name}: goes on after the release, m", Near(max(ways), 0.08)
        yield f"{name}: and comes back, m", Near(max(ways) - ways[-1], 0.05)
    begin = _place(partner)
    stick[3] = 400
    partner.listen(3.0)
    yield "r 400: yaw rate, rad/s", Near(float(partner.vehicle.truth().nu[5]), 0.06)
    stick[3] = 0
    partner.listen(3.0)
    yield "r 400: place after the turn is off by, m", Near(abs(_place(partner) - begin), 0.08)


def guided(partner: Partner) -> Answers:
    """Waypoints, velocities, places that move, headings, DO_REPOSITION."""
    partner.streaming = lambda: mavlink.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0)
    yield "mode", _outcome(partner.set_mode(GUIDED))
    depth = _now(partner)[2]
    partner.arm()
    depths = _watched(partner, 3.0, lambda: _now(partner)[2])
    yield "dips after arming, m", Near(max(depths) - depth, 0.05)
    partner.send(_target(LOCAL, POSITION_ONLY, (2.0, 1.0, DEPTH_M)))
    for second in (1.0, 2.0, 3.0, 4.0, 8.0):
        partner.listen(1.0 if second < 8.0 else 4.0)
        yield f"2 m north, 1 m east: left after {second:.0f} s, m", _left(partner, 2.0 + 1.0j)
    partner.send(_target(OFFSET, POSITION_ONLY, (0.0, 0.0, 1.0)))
    for seconds in (2.0, 5.0):
        partner.listen(seconds)
        yield f"1 m deeper: depth {seconds:.0f} s later, m", Near(_now(partner)[2], 0.08)
    begin = _place(partner)
    partner.send(_target(BODY, VELOCITY_ONLY, velocity=(0.4, 0.0, -0.1)))
    partner.listen(2.5)
    yield "0.4 m/s ahead: speed after 2.5 s, m/s", Near(_speed(partner), 0.04)
    yield "0.4 m/s ahead: way, m", Near(abs(_place(partner) - begin), 0.08)
    yield "0.1 m/s up: sinks, m/s", Near(float(partner.vehicle.truth().nu[2]), 0.03)
    partner.listen(4.5)
    yield "velocity is not repeated: speed after 7 s, m/s", Near(_speed(partner), 0.03)
    partner.send(_target(LOCAL, MOVING, (1.0, 0.0, DEPTH_M), (0.1, 0.0, 0.0)))
    for seconds in (3.0, 9.0):
        partner.listen(seconds)
        yield f"a place that moves: left {seconds:.0f} s later, m", _left(partner, 1.6 + 0.0j)
    partner.send(_target(OFFSET, POSITION_ONLY & WITH_YAW, yaw=1.0))
    partner.listen(3.0)
    yield from _turning(partner, "heading 1 rad")
    partner.send(_target(LOCAL, VELOCITY_ONLY & WITH_YAW_RATE, yaw_rate=-0.3))
    partner.listen(1.0)
    begun = _now(partner)[5]
    partner.listen(3.0)
    yield (
        "yaw rate -0.3 rad/s: turns in 3 s, rad",
        Near(math.remainder(_now(partner)[5] - begun, math.tau), 0.15),
    )
    heard = partner.command(mavlink.MAV_CMD_CONDITION_YAW, 90.0, 20.0, 1, 0)
    yield "CONDITION_YAW", result(heard, mavlink.MAV_CMD_CONDITION_YAW)
    partner.send(_target(OFFSET, POSITION_ONLY))
    partner.listen(10.0)
    yield from _turning(partner, "CONDITION_YAW to 90 degrees")
    yield from _repositions(partner)


def _repositions(partner: Partner) -> Answers:
    number = mavlink.MAV_CMD_DO_REPOSITION
    origin = of_type(
        "GPS_GLOBAL_ORIGIN",
        partner.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN),
    )[0]

    def go(flags: int, north: float, frame: int = mavlink.MAV_FRAME_GLOBAL) -> tuple[Any, ...]:
        latitude = origin.latitude + round(north / M_PER_DEGREE * 1e7)
        values = (0, 0, -1.0, flags, 0.0, math.nan, latitude, origin.longitude, -DEPTH_M)
        return _outcome(
            partner.ask(mavlink.MAVLink_command_int_message(1, 1, frame, number, *values)), number
        )

    yield "DO_REPOSITION as COMMAND_LONG", _outcome(partner.command(number, -1, 1), number)
    yield "DO_REPOSITION in an unknown frame", go(0, 1.0, mavlink.MAV_FRAME_LOCAL_NED)
    yield "DO_REPOSITION", go(0, 1.0)
    partner.listen(10.0)
    yield "DO_REPOSITION: left after 10 s, m", _left(partner, 1.0 + 0.0j)
    partner.set_mode(STABILIZE)
    yield "DO_REPOSITION in STABILIZE, without the flag", go(0, 1.0)
    yield "DO_REPOSITION in STABILIZE, with the flag", go(1, 1.0)
    yield "mode afterwards", int(partner.vehicle.truth().mode)


def _target(
    frame: int,
    mask: int,
    position: tuple[float, float, float] = (0.0, 0.0, 0.0),
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0),
    yaw: float = 0.0,
    yaw_rate: float = 0.0,
) -> Message:
    still = (0.0, 0.0, 0.0)
    return mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, frame, mask, *position, *velocity, *still, yaw, yaw_rate
    )


def _outcome(heard: list[Message], number: int = mavlink.MAV_CMD_DO_SET_MODE) -> tuple[Any, ...]:
    return result(heard, number), texts(heard)


def _place(partner: Partner) -> complex:
    return complex(*_now(partner)[:2])


def _speed(partner: Partner) -> float:
    surge, sway = partner.vehicle.truth().nu[:2]
    return math.hypot(surge, sway)


def _now(partner: Partner) -> list[float]:
    """Return x, y, z, phi, theta, psi."""
    return [float(value) for value in partner.vehicle.truth().eta]


def _left(partner: Partner, goal: complex) -> Near:
    return Near(abs(goal - _place(partner)), 0.1)


def _turning(partner: Partner, name: str) -> Answers:
    """GUIDED's heading swings about what it shall be; the phase is chance."""
    headings = _watched(partner, 4.0, lambda: math.remainder(_now(partner)[5], math.tau))
    yield f"{name}: mean heading, rad", Near(sum(headings) / len(headings), 0.08)
    yield f"{name}: heading swings by, rad", Near(max(headings) - min(headings), 0.12)


def _watched(partner: Partner, seconds: float, what: Callable[[], T]) -> list[T]:
    values = []
    for _ in range(round(seconds / 0.05)):
        partner.listen(0.05)
        values.append(what())
    return values
