"""MAVLink frames in bytes, without I/O: from the vehicle and from the ground station by the same rules.

Framing is done here and not by pymavlink's parser: after junk that parser waits for a bogus length and
swallows the good frames within it, and on a stream its buffer may grow. Here a header that proves false costs
one byte.
"""

import re
import struct
from collections.abc import Iterator
from typing import Final

import msgspec

from companion.mavlink.messages import CHECKSUM_BYTES, Message, checksum, is_known, unpack

V1_MARKER: Final = 0xFE
MARKER: Final = 0xFD
SIGNED: Final = 0x01
HEADER: Final = struct.Struct("<BBBBBBBHB")
"""Marker, payload's bytes, flags, flags, sequence number, system, component, 16 and 8 bits of message id."""
V1_HEADER_BYTES: Final = 6
HEADER_BYTES: Final = 10
SIGNATURE_BYTES: Final = 13
PARTIAL_TIMEOUT_S: Final = 0.2  # 280 bytes at 57600 baud take 0.05 s
MAX_FRAMES_LOOKED_AT: Final = 32
"""Frames read of a datagram whose sender is not known yet."""

HEADERS: Final = re.compile(rb"\xfd(?=.[\x00\x01]|.?\Z)", re.DOTALL)
"""Where a MAVLink 2 frame may begin: the marker, and flags that we know, unless those are cut off."""
HEADERS_OF_BOTH: Final = re.compile(rb"\xfe|" + HEADERS.pattern, re.DOTALL)
"""Where a frame of MAVLink 1 or 2 may begin."""


class WireFrame(msgspec.Struct, frozen=True, gc=False):
    """A whole frame with a good checksum, of an id that the dialect knows."""

    version: int
    system: int
    component: int
    id: int
    payload: bytes

    def message(self) -> Message:
        """Return the message, cut-off zeros filled in."""
        return unpack(self.id, self.payload)


def frame_at(data: bytes, at: int) -> tuple[int, WireFrame | None]:
    """Return the size that a frame at `at` claims, 0 if it is none, and the frame if whole and sound."""
    remaining = len(data) - at
    if data[at] == MARKER:
        size = HEADER_BYTES + CHECKSUM_BYTES
        if remaining < HEADER_BYTES:
            return size, None
        _, payload_bytes, flags, _, _, system, component, low, high = HEADER.unpack_from(data, at)
        if flags & ~SIGNED:
            return 0, None
        size += payload_bytes + (SIGNATURE_BYTES if flags else 0)
        version, start, message_id = 2, at + HEADER_BYTES, low | high << 16
    elif data[at] == V1_MARKER:
        size = V1_HEADER_BYTES + CHECKSUM_BYTES
        if remaining < V1_HEADER_BYTES:
            return size, None
        size += data[at + 1]
        version, start, system, component = 1, at + V1_HEADER_BYTES, data[at + 3], data[at + 4]
        message_id = data[at + 5]
    else:
        return 0, None
    if not is_known(message_id):
        return 0, None
    if remaining < size:
        return size, None
    end = start + data[at + 1]
    if checksum(data[at + 1 : end], message_id) != data[end] | data[end + 1] << 8:
        return 0, None
    return size, WireFrame(version, system, component, message_id, data[start:end])


def leading_frames(data: bytes) -> Iterator[tuple[WireFrame, bytes]]:
    """Give the sound frames with which `data` begins, and their bytes, MAX_FRAMES_LOOKED_AT at most."""
    at = 0
    for _ in range(MAX_FRAMES_LOOKED_AT):
        size, frame = frame_at(data, at) if at < len(data) else (0, None)
        if frame is None:
            return
        yield frame, data[at : at + size]
        at += size


class Splitter:
    """Cuts what arrives into whole frames and junk; `rest` is the beginning of a frame that is still to come.

    A datagram holds whole frames: nothing is kept from one to the next. Of a stream the rest (at most 279
    bytes) waits, PARTIAL_TIMEOUT_S at most: a false header in junk delays the good frames behind it, and
    never loses them. Frames of MAVLink 1 are junk unless `version_1`.
    """

    def __init__(self, stream: bool, *, version_1: bool) -> None:
        self._stream = stream
        self._headers = HEADERS_OF_BOTH if version_1 else HEADERS
        self._markers = (MARKER, V1_MARKER) if version_1 else (MARKER,)
        self._since_s = 0.0
        self.rest = b""

    def cut(self, t_s: float, data: bytes) -> list[tuple[WireFrame | None, bytes]]:
        """Return the pieces in order, each with its frame; together with `rest` they are all that came."""
        old = len(self.rest)
        data = self.rest + data
        self.rest = b""
        pieces: list[tuple[WireFrame | None, bytes]] = []
        at, end = 0, len(data)
        while at < end:
            size, frame = frame_at(data, at) if data[at] in self._markers else (0, None)
            if frame is None and size > end - at and self._stream:
                waited = at < old
                if not (waited and t_s - self._since_s > PARTIAL_TIMEOUT_S):
                    self.rest = data[at:]
                    if not waited:
                        self._since_s = t_s
                    break
            if frame is None:
                header = self._headers.search(data, at + 1)
                size = (header.start() if header else end) - at
            pieces.append((frame, data[at : at + size]))
            at += size
        return pieces
