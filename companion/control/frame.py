"""Poses and vectors in the frame of a reset estimate: by what whoever holds one moves it."""

import math

import numpy as np

from companion.types import PSI, Array, FrameShift


def turn_about(turn_rad: float, x_m: float, y_m: float) -> FrameShift:
    """Return the shift of a yaw reset: the frame turns, and the vehicle's own place (x, y) stays what it is.

    A position that is integrated from body velocities (DVL) goes on from there in the new direction.
    """
    c, s = math.cos(turn_rad), math.sin(turn_rad)
    return FrameShift(turn_rad, x_m - (c * x_m - s * y_m), y_m - (s * x_m + c * y_m))


def joined(first: FrameShift | None, second: FrameShift) -> FrameShift:
    """Return `first` followed by `second`."""
    if first is None:
        return second
    c, s = math.cos(second.turn_rad), math.sin(second.turn_rad)
    return FrameShift(
        first.turn_rad + second.turn_rad,
        c * first.north_m - s * first.east_m + second.north_m,
        s * first.north_m + c * first.east_m + second.east_m,
    )


def turned(shift: FrameShift, vectors: Array) -> Array:
    """Return velocities, forces or the like, (…, 4) in DOF order, in the frame after the shift."""
    out = vectors.copy()
    if shift.turn_rad:
        c, s = math.cos(shift.turn_rad), math.sin(shift.turn_rad)
        out[..., 0] = c * vectors[..., 0] - s * vectors[..., 1]
        out[..., 1] = s * vectors[..., 0] + c * vectors[..., 1]
    return out


def shifted(shift: FrameShift, eta: Array) -> Array:
    """Return poses, (…, 4) in DOF order, in the frame after the shift; psi is not wrapped."""
    out = turned(shift, eta)
    out += np.array((shift.north_m, shift.east_m, 0.0, 0.0))
    out[..., PSI] += shift.turn_rad
    return out
