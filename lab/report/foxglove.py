"""A copy of a dive with poses that Foxglove, Lichtblick and others can draw, and angles in degrees.

Foxglove knows a pose by the names of its own schemas. Its frames: `world` is east, north, up; the vehicle's
is forward, left, up. Ours are north, east, down, and forward, right, down.
"""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import msgspec

from companion.control.bounds import wrap
from companion.telemetry import schemas as telemetry
from companion.telemetry.schemas import State
from dashboard.recording.mcap_file import Disk, Item, Reader, Recording

WORLD = "world"
NS_PER_S = 1_000_000_000


def write(files: Sequence[Path], path: Path) -> None:
    """Copy `files` to the new file `path`, with the channels of `channels` after each state.

    Raises OSError, FileExistsError where `path` is there already, ValueError for what is no recording.
    """
    recording = Recording(path, Disk(path))
    for file in sorted(files):
        reader = Reader(file)
        for item in reader:
            recording.add(item)
            if item.encoding.endswith(".State.v1"):
                state = telemetry.decode(item.key, item.payload)
                if isinstance(state, State):
                    for topic, schema, content in channels(state, item.key.split("/")[1], item.log_ns):
                        payload = msgspec.json.encode(content)
                        encoding = f"application/json;{schema}"
                        recording.add(Item(topic, encoding, payload, item.log_ns, item.publish_ns))
        for name, table in reader.metadata.items():
            recording.describe(name, table)
    recording.close()


def channels(state: State, vehicle: str, log_ns: int) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Give topic, schema and content of what is added to a state."""
    stamp = {"sec": log_ns // NS_PER_S, "nsec": log_ns % NS_PER_S}
    place = _place(state.x_m, state.y_m, state.depth_m)
    turned = quaternion(state.roll_rad, state.pitch_rad, state.heading_rad)
    yield (
        "/tf",
        "foxglove.FrameTransform",
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
        yield topic, "foxglove.PoseInFrame", {"timestamp": stamp, "frame_id": WORLD, "pose": pose}
    apart = wrap(state.heading_rad - state.heading_desired_rad)
    yield (
        "/degrees",
        "holdfast.Degrees",
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
