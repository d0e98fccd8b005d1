"""A copy of a dive with poses that Foxglove, Lichtblick and others can draw, and angles in degrees."""

from collections.abc import Sequence
from pathlib import Path

import msgspec

from companion.telemetry import schemas as telemetry
from companion.telemetry.schemas import State
from dashboard.foxglove.poses import channels
from dashboard.recording.mcap_file import Disk, Item, Reader, Recording


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
                    for topic, encoding, content in channels(state, item.key.split("/")[1], item.log_ns):
                        payload = msgspec.json.encode(content)
                        recording.add(Item(topic, encoding, payload, item.log_ns, item.publish_ns))
        for name, table in reader.metadata.items():
            recording.describe(name, table)
    recording.close()
