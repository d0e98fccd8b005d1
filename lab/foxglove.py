"""`holdfast report --foxglove`: a recording with channels by Foxglove's schemas, which it shows in space.

Its frames are east-north-up and forward-left-up (REP 103): x, y, z are y, x, -z of ours. Sources: Foxglove's
schemas, https://docs.foxglove.dev/docs/visualization/message-schemas.
"""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from foxglove_schemas_protobuf import FrameTransform_pb2, LocationFix_pb2, Log_pb2, PoseInFrame_pb2
from google.protobuf.timestamp_pb2 import Timestamp
from mcap_protobuf.schema import register_schema

from companion.telemetry import schemas as telemetry
from companion.telemetry.schemas import Event, State
from dashboard.recording.mcap_file import Reader, Recording
from holdfast import RefusedError

WORLD, VEHICLE = "odom", "base_link"
EVERY = 5
"""Of so many ticks one has a pose."""
EARTH_M = 6_378_137.0
LEVELS = {"info": Log_pb2.Log.INFO, "warning": Log_pb2.Log.WARNING, "fault": Log_pb2.Log.ERROR}


class InSpace(NamedTuple):
    """One message for Foxglove: its topic, which are those of the layout, and when."""

    topic: str
    message: Any
    at_ns: int


def convert(recording: Path, out: Path, origin: tuple[float, float] | None) -> int:
    """Write a copy with Foxglove's channels; return how many messages were added.

    `origin` is that of x and y, in degrees; without it there is no /location. Raises RefusedError for a
    recording that has no state. Of one that was cut the copy is whole.
    """
    reader, copy = Reader(recording), Recording(out)
    channels: dict[str, int] = {}
    added = 0
    try:
        for item in reader:
            copy.add(item)
            for topic, message, at_ns in in_space(item.key, item.payload, item.log_ns, origin):
                if topic not in channels:
                    schema = register_schema(copy.writer, type(message))
                    channels[topic] = copy.writer.register_channel(topic, "protobuf", schema)
                copy.writer.add_message(channels[topic], at_ns, message.SerializeToString(), at_ns)
                added += 1
        if "/pose" not in channels:
            raise RefusedError(f"{recording}: no dive in it, for there is no state")
        copy.close()
    except BaseException:
        copy.give_up()
        raise
    return added


def in_space(key: str, payload: bytes, at_ns: int, origin: tuple[float, float] | None) -> Iterator[InSpace]:
    """Give what Foxglove shows of a sample: poses as they are and should be, the place on a map, the log."""
    if not key.startswith("holdfast/") or not key.endswith(("/state", "/event")):
        return
    record, stamp = telemetry.decode(key, payload), Timestamp()
    stamp.FromNanoseconds(at_ns)
    if isinstance(record, Event):
        words: Any = {"message": record.text, "name": record.kind, "level": LEVELS[record.severity]}
        yield InSpace("/log", Log_pb2.Log(timestamp=stamp, **words), at_ns)
    elif isinstance(record, State) and round(record.t_s * 50.0) % EVERY == 0:
        angles = record.roll_rad, record.pitch_rad, record.heading_rad
        place, turn = _place(record.x_m, record.y_m, record.depth_m), _quaternion(*angles)
        transform = FrameTransform_pb2.FrameTransform(
            timestamp=stamp, parent_frame_id=WORLD, child_frame_id=VEHICLE, translation=place, rotation=turn
        )
        yield InSpace("/tf", transform, at_ns)
        yield InSpace("/pose", _pose(stamp, place, turn), at_ns)
        wanted = _place(record.x_desired_m, record.y_desired_m, record.depth_desired_m)
        held = record.roll_desired_rad, record.pitch_desired_rad, record.heading_desired_rad
        yield InSpace("/desired", _pose(stamp, wanted, _quaternion(*held)), at_ns)
        if origin is not None and "x_m" not in record.absent:
            latitude = origin[0] + math.degrees(record.x_m / EARTH_M)
            longitude = origin[1] + math.degrees(record.y_m / EARTH_M / math.cos(math.radians(origin[0])))
            where: Any = {"latitude": latitude, "longitude": longitude, "altitude": -record.depth_m}
            yield InSpace("/location", LocationFix_pb2.LocationFix(timestamp=stamp, **where), at_ns)


def _place(x_m: float, y_m: float, depth_m: float) -> Any:
    return {"x": y_m, "y": x_m, "z": -depth_m}


def _quaternion(roll: float, pitch: float, heading: float) -> Any:
    """Return the turn from forward-left-up to east-north-up; angles in rad, forward-right-down to NED."""
    (sr, cr), (sp, cp), (sy, cy) = (
        (math.sin(angle / 2.0), math.cos(angle / 2.0)) for angle in (roll, -pitch, math.pi / 2.0 - heading)
    )
    return {
        "w": cr * cp * cy + sr * sp * sy,
        "x": sr * cp * cy - cr * sp * sy,
        "y": cr * sp * cy + sr * cp * sy,
        "z": cr * cp * sy - sr * sp * cy,
    }


def _pose(stamp: Timestamp, place: Any, turn: Any) -> Any:
    pose: Any = {"position": place, "orientation": turn}
    return PoseInFrame_pb2.PoseInFrame(timestamp=stamp, frame_id=WORLD, pose=pose)
