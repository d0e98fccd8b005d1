"""Poses and vectors in the frame of a reset estimate: by what whoever holds one moves it."""

import math

from lab.batch.legacy.records import PSI, Array, FrameShift, X, Y


def joined(first: FrameShift | None, second: FrameShift) -> FrameShift:
    """Return both together; either may come first."""
    if first is None:
        return second
    return FrameShift(
        first.turn_rad + second.turn_rad, first.north_m + second.north_m, first.east_m + second.east_m
    )


def turned(shift: FrameShift, vectors: Array) -> Array:
    """Return velocities, forces or the like, (…, 4) in DOF order, after the frame has turned."""
    out = vectors.copy()
    if shift.turn_rad:
        c, s = math.cos(shift.turn_rad), math.sin(shift.turn_rad)
        out[..., X] = c * vectors[..., X] - s * vectors[..., Y]
        out[..., Y] = s * vectors[..., X] + c * vectors[..., Y]
    return out


def shifted(shift: FrameShift, eta: Array) -> Array:
    """Return poses, (…, 4) in DOF order, by as much further as the vehicle's own; psi is not wrapped.

    A place that was asked for keeps its numbers when yaw alone is reset: they are north and east of a frame
    that the new yaw knows better.
    """
    out = eta.copy()
    out[..., X] += shift.north_m
    out[..., Y] += shift.east_m
    out[..., PSI] += shift.turn_rad
    return out


def shifted_along(shift: FrameShift, eta: Array, vehicle: Array) -> Array:
    """Return poses that lie where they lay as seen from `vehicle`, its pose after the shift."""
    out = shifted(shift, eta)
    out[..., :PSI] = vehicle[..., :PSI] + turned(shift, out - vehicle)[..., :PSI]
    return out
