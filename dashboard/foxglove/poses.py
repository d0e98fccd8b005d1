"""The poses of a state as Foxglove, Lichtblick and others can draw them, and its angles in degrees.

Foxglove knows a pose by the names of its own schemas. Its frames: `world` is east, north, up; the vehicle's
is forward, left, up. Ours are north, east, down, and forward, right, down.
"""

import math
from collections.abc import Iterator
from typing import Any

from companion.telemetry.schemas import State

WORLD = "world"
NS_PER_S = 1_000_000_000


def channels(state: State, vehicle: str, log_ns: int) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Give topic, encoding and content of what is added to a state."""
    stamp = {"sec": log_ns // NS_PER_S, "nsec": log_ns % NS_PER_S}
    place = _place(state.x_m, state.y_m, state.depth_m)
    turned = quaternion(state.roll_rad, state.pitch_rad, state.heading_rad)
    yield (
        "/tf",
        "application/json;foxglove.FrameTransform",
        {
            "timestamp": stamp,
            "parent_frame_id": WORLD,
            "child_frame_id": vehicle,
            "translation": place,
            "rotation": turned,
        },
    )
    wanted = _place(state.x_desired_m, state.y_desired_m, state.depth_desired_m)
    level = quaternion(0.0, 0.0, state.heading_desired_rad)
    for topic, position, orientation in (("/pose", place, turned), ("/pose_desired", wanted, level)):
        pose = {"position": position, "orientation": orientation}
        yield (
            topic,
            "application/json;foxglove.PoseInFrame",
            {"timestamp": stamp, "frame_id": WORLD, "pose": pose},
        )
    apart = math.remainder(state.heading_rad - state.heading_desired_rad, math.tau)
    yield (
        "/degrees",
        "application/json;holdfast.Degrees",
        {
            "heading": math.degrees(state.heading_rad),
            "heading_desired": math.degrees(state.heading_desired_rad),
            "heading_error": math.degrees(apart),
            "roll": math.degrees(state.roll_rad),
            "pitch": math.degrees(state.pitch_rad),
        },
    )


def quaternion(roll_rad: float, pitch_rad: float, heading_rad: float) -> dict[str, float]:
    """Return the orientation of forward, left, up in east, north, up.

    Forward stays forward, so roll does; left is minus right, so pitch changes its sign; the angle from east,
    counter-clockwise, is a quarter turn less heading.
    """
    half = (0.5 * roll_rad, -0.5 * pitch_rad, 0.5 * (0.5 * math.pi - heading_rad))
    (cr, cp, cy), (sr, sp, sy) = map(math.cos, half), map(math.sin, half)
    return {
        "x": sr * cp * cy - cr * sp * sy,
        "y": cr * sp * cy + sr * cp * sy,
        "z": cr * cp * sy - sr * sp * cy,
        "w": cr * cp * cy + sr * sp * sy,
    }


def _place(north_m: float, east_m: float, depth_m: float) -> dict[str, float]:
    return {"x": east_m, "y": north_m, "z": -depth_m}
