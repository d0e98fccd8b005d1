"""Poses and vectors in the frame of a reset estimate: by what whoever holds one moves it."""

import math

from companion.records import FrameShift, Vector


def joined(first: FrameShift | None, second: FrameShift) -> FrameShift:
    """Return both together; either may come first."""
    if first is None:
        return second
    return FrameShift(
        first.turn_rad + second.turn_rad, first.north_m + second.north_m, first.east_m + second.east_m
    )


def turned(shift: FrameShift, vector: Vector) -> Vector:
    """Return a velocity, a force or the like, in DOF order, after the frame has turned."""
    if not shift.turn_rad:
        return vector
    x, y, z, psi = vector
    c, s = math.cos(shift.turn_rad), math.sin(shift.turn_rad)
    return (c * x - s * y, s * x + c * y, z, psi)


def shifted(shift: FrameShift, eta: Vector) -> Vector:
    """Return a pose, in DOF order, by as much further as the vehicle's own; psi is not wrapped.

    A place that was asked for keeps its numbers when yaw alone is reset: they are north and east of a frame
    that the new yaw knows better.
    """
    x, y, z, psi = eta
    return (x + shift.north_m, y + shift.east_m, z, psi + shift.turn_rad)


def shifted_along(shift: FrameShift, eta: Vector, vehicle: Vector) -> Vector:
    """Return the pose that lies where it lay as seen from `vehicle`, its pose after the shift."""
    x, y, z, psi = shifted(shift, eta)
    x_v, y_v, z_v, _ = vehicle
    dx, dy, dz, _ = turned(shift, (x - x_v, y - y_v, z - z_v, 0.0))
    return (x_v + dx, y_v + dy, z_v + dz, psi)
