"""MAVLink FTP: the files that a ground station reads, which are parameters, missions, fences, rally points.

The rest of a flight controller's file system is empty here, and nothing can be written.
"""

import struct
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_bridge.firmware.missions import FENCE, MISSION, RALLY, Missions
from sim_bridge.firmware.params import DEFAULTS, FLOAT, INT8, INT16, INT32, Parameters

Message = Any

HEADER = struct.Struct("<HBBBBBBI")
MOST_BYTES = 239
NONE, TERMINATE, RESET, LIST, OPEN, READ, CHECKSUM, BURST = 0, 1, 2, 3, 4, 5, 14, 15
ACK, NAK = 128, 129
FAIL, INVALID_SIZE, END_OF_FILE, NOT_FOUND = 1, 3, 6, 10

PACKED = {INT8: (1, "<b"), INT16: (2, "<h"), INT32: (3, "<i"), FLOAT: (4, "<f")}
"""By MAVLink's type: the type's number in the file, and how a value is packed."""
ENTRY_BYTES = 12
"""By parameter: what the firmware takes for the file's size before it has packed it."""
PARAMETER_FILE, PARAMETER_MAGIC, PARAMETER_MAGIC_WITH_DEFAULTS = "@PARAM/param.pck", 0x671B, 0x671C
MISSION_FILES = {"@MISSION/mission.dat": MISSION, "@MISSION/fence.dat": FENCE, "@MISSION/rally.dat": RALLY}
MISSION_MAGIC, MISSION_SIZE = 0x763D, 0x100000
"""The size that the firmware tells of a mission's file, whatever it holds."""
ITEM = struct.Struct("<ffffiifHHBBBBBB")
WITH_DEFAULT = 0x10
ROOT = b"D.\0\0D..\0\0"


class Files:
    """Answers FILE_TRANSFER_PROTOCOL; one file is open at a time.

    Args:
        send: sends a message on a link.

    """

    def __init__(self, params: Parameters, missions: Missions, send: Callable[[int, Message], None]) -> None:
        self._params, self._missions, self._send = params, missions, send
        self._open: str | None = None
        self._content: bytes | None = None
        """The open file, packed when it is first read: its padding depends on the size of the reads."""

    def handle(self, link: int, message: Message) -> None:
        """Answer a request."""
        payload = bytes(message.payload)
        sequence, session, opcode, size, _, _, _, offset = HEADER.unpack_from(payload)
        data = payload[HEADER.size : HEADER.size + size]
        peer = (link, message.get_srcSystem(), message.get_srcComponent())

        def answer(kind: int, content: bytes, *, at: int = offset, done: int = 0, number: int = 1) -> None:
            head = HEADER.pack((sequence + number) & 0xFFFF, session, kind, len(content), opcode, done, 0, at)
            padded = (head + content).ljust(251, b"\0")
            self._send(link, mavlink.MAVLink_file_transfer_protocol_message(0, peer[1], peer[2], padded))

        if opcode == BURST:
            self._burst(answer, offset, size)
        elif opcode == READ and size > MOST_BYTES:
            answer(NAK, bytes((FAIL,)))
        else:
            answer(*self._answer(opcode, data, offset, size))

    def _answer(self, opcode: int, data: bytes, offset: int, size: int) -> tuple[int, bytes]:
        if opcode in (NONE, TERMINATE, RESET):
            self._open = self._content = None
            return ACK, b""
        if opcode == LIST:
            if not data:
                return NAK, bytes((INVALID_SIZE,))
            if data.rstrip(b"\0") != b"/":
                return NAK, bytes((NOT_FOUND,))
            return (ACK, ROOT) if offset == 0 else (NAK, bytes((END_OF_FILE,)))
        if opcode == OPEN:
            if self._open is not None:
                return NAK, bytes((FAIL,))
            return self._opened(data.rstrip(b"\0").decode(errors="replace"))
        if opcode == READ:
            content = self._read(size)
            if content is None:
                return NAK, bytes((NOT_FOUND,))
            piece = content[offset : offset + size]
            return (ACK, piece) if piece else (NAK, bytes((END_OF_FILE,)))
        return NAK, bytes((FAIL,))

    def _opened(self, name: str) -> tuple[int, bytes]:
        path = name.partition("?")[0]
        if path == PARAMETER_FILE:
            size = ENTRY_BYTES * len(self._params.names)
        elif path in MISSION_FILES:
            size = MISSION_SIZE
        else:
            return NAK, bytes((NOT_FOUND,))
        self._open = name
        return ACK, struct.pack("<I", size)

    def _read(self, size: int) -> bytes | None:
        """Return the open file, None where there is none; `size` is that of this read, bytes."""
        if self._open is not None and self._content is None:
            path, _, query = self._open.partition("?")
            if path == PARAMETER_FILE:
                self._content = packed_parameters(self._params, "withdefaults=1" in query, size)
            else:
                self._content = packed_items(self._missions, MISSION_FILES[path])
        return self._content

    def _burst(self, answer: Callable[..., None], offset: int, size: int) -> None:
        """Send the rest of the open file in pieces, and that it has ended."""
        step = min(size or MOST_BYTES, MOST_BYTES)
        content = self._read(step)
        if content is None:
            answer(NAK, bytes((NOT_FOUND,)))
            return
        starts = range(offset, len(content), step)
        for number, start in enumerate(starts, 1):
            answer(ACK, content[start : start + step], at=start, done=start == starts[-1], number=number)
        answer(NAK, bytes((END_OF_FILE,)), at=max(offset, len(content)), done=1, number=len(starts) + 1)


def packed_parameters(params: Parameters, with_defaults: bool, block_bytes: int) -> bytes:
    """Return all parameters in the packed format of ArduPilot's parameter file.

    Each one: type and flags (4 bits each), length of what its name shares with the one before and of the rest
    less 1 (4 bits each), that rest, the value; and the default, flagged, where it is asked for and differs.
    Zeros before it keep a value from lying across two blocks of `block_bytes`.
    """
    magic = PARAMETER_MAGIC_WITH_DEFAULTS if with_defaults else PARAMETER_MAGIC
    out = bytearray(struct.pack("<HHH", magic, len(params.names), len(params.names)))
    before = ""
    for name in params.names:
        number, form = PACKED[DEFAULTS[name].type]
        shared = min(_shared(before, name), len(name) - 1, 15)
        rest = name[shared:].encode()
        value = _packed(form, params[name])
        default = _packed(form, DEFAULTS[name].default)
        flagged = with_defaults and default != value
        head = bytes((number | (WITH_DEFAULT if flagged else 0), shared | (len(rest) - 1) << 4))
        record = head + rest + value + (default if flagged else b"")
        over = (len(out) + len(record)) % block_bytes
        if 0 < over < len(value):
            out += bytes(len(value) - over)
        out += record
        before = name
    return bytes(out)


def _shared(one: str, other: str) -> int:
    """Return how many characters two names begin with in common."""
    same = 0
    while same < min(len(one), len(other)) and one[same] == other[same]:
        same += 1
    return same


def _packed(form: str, value: float) -> bytes:
    return struct.pack(form, value if form == "<f" else int(value))


def packed_items(missions: Missions, kind: int) -> bytes:
    """Return a list in the packed format of ArduPilot's AP_Filesystem_Mission."""
    items = missions.items(kind)
    out = bytearray(struct.pack("<HHHHH", MISSION_MAGIC, kind, 0, 0, len(items)))
    for number, one in enumerate(items):
        out += ITEM.pack(
            *one.params, one.x, one.y, one.z, number, one.command, 0, 0, one.frame, 0, one.autocontinue, kind
        )
    return bytes(out)
