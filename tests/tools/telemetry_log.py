"""The records of a ground station's log (.tlog): UTC in µs (8 bytes, big-endian), then one MAVLink frame."""

import mmap
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from companion.mavlink.frames import frame_at
from holdfast import RefusedError

MAX_GAP_S = 10.0
"""A longer silence, or a jump of UTC, is shortened to this."""

MAX_JUNK_BYTES = 1 << 16
MAX_BYTES = 1 << 31
"""Days of a ground station's log."""
_STAMP = struct.Struct(">Q")
_MARKERS = (0xFD, 0xFE)


class TlogError(RefusedError):
    """The file holds no telemetry log; says why."""


class TlogRecord(NamedTuple):
    """One record: when it came (s since the first record, never decreasing) and the frame's bytes."""

    t_s: float
    data: bytes

    @property
    def system(self) -> int:
        """The sender's system id, 0 where the bytes are no frame."""
        if len(self.data) < 8 or self.data[0] not in _MARKERS:
            return 0
        return self.data[5 if self.data[0] == _MARKERS[0] else 3]


def read(path: Path) -> Iterator[TlogRecord]:
    """Give the records of a .tlog. Bytes that are no record are given as they are, with the last time.

    Raises TlogError where no sound frame is in it, OSError.
    """
    if path.stat().st_size > MAX_BYTES:
        raise TlogError(f"{path}: is larger than {MAX_BYTES >> 20} MiB: cut it into parts")
    if not path.stat().st_size:
        raise TlogError(f"{path}: is empty, no telemetry log")
    with path.open("rb") as file:
        data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    at, last_us, t_s, found = 0, None, 0.0, False
    while at + _STAMP.size < len(data):
        size = _record_size(data, at)
        if not size:
            end = _next_record(data, at + 1)
            yield TlogRecord(t_s, data[at:end])
            at = end
            continue
        (stamp_us,) = _STAMP.unpack_from(data, at)
        if last_us is not None:
            t_s += min(max(stamp_us - last_us, 0) / 1e6, MAX_GAP_S)
        frame = data[at + _STAMP.size : at + size]
        last_us, found = stamp_us, found or frame_at(frame, 0)[1] is not None
        yield TlogRecord(t_s, frame)
        at += size
    if not found:
        raise TlogError(f"{path}: holds no record of a telemetry log (.tlog)")


def _record_size(data: mmap.mmap, at: int) -> int:
    """Return how long the record at `at` is with its stamp, 0 if there is none whole."""
    frame = at + _STAMP.size
    if frame + 8 > len(data) or data[frame] not in _MARKERS:
        return 0
    if data[frame] == _MARKERS[0]:
        size = 12 + data[frame + 1] + (13 if data[frame + 2] & 1 else 0)
    else:
        size = 8 + data[frame + 1]
    end = frame + size
    if end > len(data):
        return 0
    followed = end + _STAMP.size >= len(data) or data[end + _STAMP.size] in _MARKERS
    return _STAMP.size + size if followed else 0


def _next_record(data: mmap.mmap, at: int) -> int:
    """Return where the next record begins, at most MAX_JUNK_BYTES on."""
    end = min(len(data), at + MAX_JUNK_BYTES)
    while at < end and not _record_size(data, at):
        at += 1
    return at
