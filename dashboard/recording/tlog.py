"""Raw MAVLink as a .tlog, which every ground station and pymavlink read: UTC in µs, then the frame."""

import struct

V1, V2, SIGNED = 0xFE, 0xFD, 0x01
_STAMP = struct.Struct(">Q")


class Frames:
    """Cuts a stream of bytes into MAVLink frames by their headers; what is cut waits for its rest.

    Checksums are not looked at: readers of a .tlog do that, and step over junk.
    """

    def __init__(self) -> None:
        self._rest = b""

    def take(self, data: bytes) -> list[bytes]:
        """Return the frames that are complete with `data`."""
        data = self._rest + data
        frames: list[bytes] = []
        at = 0
        while at < len(data):
            size = _size(data, at)
            if size == 0:
                at += 1
            elif at + size > len(data):
                break
            else:
                frames.append(data[at : at + size])
                at += size
        self._rest = data[at:]
        return frames


def stamped(utc_ns: int, frame: bytes) -> bytes:
    """Return one record of a .tlog."""
    return _STAMP.pack(utc_ns // 1000) + frame


def _size(data: bytes, at: int) -> int:
    """Return the length that the frame at `at` claims, more than there is if its header is cut, 0 if none."""
    if data[at] not in (V1, V2):
        return 0
    if len(data) < at + 3:
        return 3
    if data[at] == V1:
        return 8 + data[at + 1]
    return 12 + data[at + 1] + (13 if data[at + 2] & SIGNED else 0)
