"""MAVLink FTP: the files that a ground station reads, which are parameters, missions, fences, rally points.

The rest of a flight controller's file system is empty here, and nothing can be written.
"""

import math
import struct
import zlib
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_bridge.firmware.missions import DEBUG, FENCE, MISSION, RALLY, Missions
from sim_bridge.firmware.params import DEFAULTS, FLOAT, INT8, INT16, INT32, Parameters

Message = Any

HEADER = struct.Struct("<HBBBBBBI")
MOST_BYTES = 239
NONE, TERMINATE, RESET, LIST, OPEN, READ, CHECKSUM, BURST = 0, 1, 2, 3, 4, 5, 14, 15
ACK, NAK = 128, 129
FAIL, FAIL_ERRNO, INVALID_SIZE, INVALID_SESSION, END_OF_FILE, NOT_FOUND = 1, 2, 3, 4, 6, 10
EINVAL = 22
WRITES = (6, 7, 8, 9, 10, 11, 13)
SESSION_S = 3.0
"""A file whose session has been silent for so long is closed when another one asks."""
BUSY_S = 1.0
BURST_PIECES = 500
MOST_PARAMETERS = 0xFFFE
CHECKSUM_BLOCK = 64
"""By so many bytes the firmware reads a file for its checksum."""

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


class Request(NamedTuple):
    """A FILE_TRANSFER_PROTOCOL payload, and who sent it on which link."""

    peer: tuple[int, int]
    link: int
    sequence: int
    session: int
    opcode: int
    size: int
    offset: int
    data: bytes

    @property
    def path(self) -> str:
        """The file or directory that it names."""
        return self.data.rstrip(b"\0").decode(errors="replace")


class Reply(NamedTuple):
    """What is answered."""

    opcode: int
    content: bytes = b""
    offset: int = 0
    done: bool = False
    further: int = 0
    """How many replies to the same request went before."""


class Files:
    """Answers FILE_TRANSFER_PROTOCOL; one file is open at a time, whatever the link.

    Args:
        send: sends a message on a link.
        say: sends a STATUSTEXT of a severity.
        banner: says on a link which firmware this is.

    """

    def __init__(
        self,
        params: Parameters,
        missions: Missions,
        send: Callable[[int, Message], None],
        say: Callable[[int, str], None],
        banner: Callable[[int], None],
    ) -> None:
        self._params, self._missions = params, missions
        self._send, self._say, self._banner = send, say, banner
        self._open: str | None = None
        self._content: bytes | None = None
        """The open file, packed when it is first read: its padding depends on the size of the reads."""
        self._block = 0
        self._session = -1
        self._sent_s = -math.inf
        self._last: tuple[Request, Reply] | None = None

    def is_busy(self, now_s: float) -> bool:
        """Whether it has just answered, which slows every stream."""
        return now_s - self._sent_s < BUSY_S

    def handle(self, link: int, message: Message, now_s: float) -> None:
        """Answer a request; one that comes again gets the same reply again."""
        payload = bytes(message.payload)
        sequence, session, opcode, size, _, _, _, offset = HEADER.unpack_from(payload)
        peer = (message.get_srcSystem(), message.get_srcComponent())
        data = payload[HEADER.size : HEADER.size + size]
        request = Request(peer, link, sequence, session, opcode, size, offset, data)
        if self._last is not None:
            previous, reply = self._last
            whose = (previous.peer, previous.session, previous.sequence + reply.further)
            if whose == (peer, session, sequence):
                self._reply(previous, reply, now_s)
                return
        for reply in self._replies(request, now_s):
            self._reply(request, reply, now_s)
            if opcode == OPEN and reply.opcode == ACK and request.path.startswith(PARAMETER_FILE):
                self._banner(link)

    def _reply(self, request: Request, reply: Reply, now_s: float) -> None:
        head = HEADER.pack(
            (request.sequence + 1 + reply.further) & 0xFFFF,
            *(request.session, reply.opcode, len(reply.content), request.opcode, reply.done, 0, reply.offset),
        )
        padded = (head + reply.content).ljust(251, b"\0")
        self._send(request.link, mavlink.MAVLink_file_transfer_protocol_message(0, *request.peer, padded))
        self._last = request, reply
        self._sent_s = -math.inf if request.opcode == TERMINATE else now_s

    def _replies(self, request: Request, now_s: float) -> Iterable[Reply]:
        foreign, ends = request.session != self._session, request.opcode in (TERMINATE, RESET)
        silent = now_s - self._sent_s >= SESSION_S
        if request.opcode in (ACK, NAK):
            return ()
        if request.size > MOST_BYTES:
            return (_refusal(INVALID_SIZE),)
        if self._open is not None and foreign and not ends:
            if not silent:
                return (_refusal(INVALID_SESSION),)
            self._close()
        if request.opcode == BURST:
            return self._burst(request)
        if request.opcode == NONE or (ends and foreign):
            return (Reply(ACK),)
        if ends:
            self._close()
            return (Reply(ACK),)
        if request.opcode == OPEN and self._open is not None and silent:
            self._close()
        return (self._answer(request),)

    def _close(self) -> None:
        self._open = self._content = None
        self._session = -1

    def _answer(self, request: Request) -> Reply:
        if request.opcode == READ:
            content = self._read(request.size)
            if isinstance(content, Reply):
                return content
            piece = content[request.offset : request.offset + request.size]
            return Reply(ACK, piece, request.offset) if piece else _refusal(END_OF_FILE)
        if request.opcode == LIST:
            return self._list(request)
        if request.opcode not in (OPEN, CHECKSUM):
            if request.opcode not in WRITES:
                self._say(DEBUG, f"Unsupported FTP: {request.opcode}")
            return _refusal(FAIL)
        if request.opcode == OPEN and self._open is not None:
            return _refusal(FAIL)
        if not request.data:
            return _refusal(INVALID_SIZE)
        path = request.path.partition("?")[0]
        if path != PARAMETER_FILE and path not in MISSION_FILES:
            return _refusal(NOT_FOUND)
        if max(_range(request.path)) > MOST_PARAMETERS:
            return Reply(NAK, bytes((FAIL_ERRNO, EINVAL)))
        if request.opcode == CHECKSUM:
            content = self._packed(request.path, CHECKSUM_BLOCK)
            return Reply(ACK, struct.pack("<I", ~zlib.crc32(content, 0xFFFFFFFF) & 0xFFFFFFFF))
        self._open, self._session = request.path, request.session
        size = ENTRY_BYTES * len(self._params.names) if path == PARAMETER_FILE else MISSION_SIZE
        return Reply(ACK, struct.pack("<I", size))

    def _list(self, request: Request) -> Reply:
        if not request.data:
            return _refusal(INVALID_SIZE, request.offset)
        if request.path != "/":
            return _refusal(NOT_FOUND, request.offset)
        return _refusal(END_OF_FILE, request.offset) if request.offset else Reply(ACK, ROOT)

    def _read(self, size: int) -> bytes | Reply:
        """Return the open file, or why it cannot be read in pieces of `size` bytes."""
        if self._open is None:
            return _refusal(NOT_FOUND)
        if size == 0:
            return _refusal(END_OF_FILE)
        if self._content is None:
            self._block = size
            self._content = self._packed(self._open, size)
        if size != self._block and self._open.startswith(PARAMETER_FILE):
            return Reply(NAK, bytes((FAIL_ERRNO, EINVAL)))
        return self._content

    def _packed(self, name: str, block_bytes: int) -> bytes:
        path, _, query = name.partition("?")
        if path in MISSION_FILES:
            return packed_items(self._missions, MISSION_FILES[path])
        with_defaults = "withdefaults=1" in query.split("&")
        return packed_parameters(self._params, with_defaults, block_bytes, *_range(name))

    def _burst(self, request: Request) -> Iterable[Reply]:
        """Send the rest of the open file in pieces, and that it has ended."""
        step = request.size or MOST_BYTES
        content = self._read(step)
        if isinstance(content, Reply):
            yield content
            return
        starts = range(request.offset, len(content), step)[:BURST_PIECES]
        end, full = request.offset, True
        for further, start in enumerate(starts):
            piece = content[start : start + step]
            full = len(piece) == step
            end = start if full else start + len(piece)
            yield Reply(ACK, piece, start, not full or further == BURST_PIECES - 1, further)
        if len(starts) < BURST_PIECES:
            yield Reply(NAK, bytes((END_OF_FILE,)), end if starts else 0, not full, len(starts))


def _refusal(error: int, offset: int = 0) -> Reply:
    return Reply(NAK, bytes((error,)), offset)


def _range(name: str) -> tuple[int, int]:
    """Return `start` and `count` behind the question mark of a parameter file's name; 0 where not given."""
    given = dict(option.partition("=")[::2] for option in name.partition("?")[2].split("&"))
    start, count = (given.get(key, "") for key in ("start", "count"))
    return int(start) if start.isdecimal() else 0, int(count) if count.isdecimal() else 0


def packed_parameters(
    params: Parameters, with_defaults: bool, block_bytes: int, start: int = 0, count: int = 0
) -> bytes:
    """Return `count` parameters (0: all) from `start` on in the packed format of ArduPilot's parameter file.

    Each one: type and flags (4 bits each), length of what its name shares with the one before and of the rest
    less 1 (4 bits each), that rest, the value; and the default, flagged, where it is asked for and differs.
    Zeros before it keep a value from lying across two blocks of `block_bytes`.
    """
    magic = PARAMETER_MAGIC_WITH_DEFAULTS if with_defaults else PARAMETER_MAGIC
    names = params.names[start : start + count if count else None]
    out = bytearray(struct.pack("<HHH", magic, len(names), len(params.names)))
    previous = ""
    for name in names:
        number, form = PACKED[DEFAULTS[name].type]
        shared = min(_shared(previous, name), len(name) - 1, 15)
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
        previous = name
    return bytes(out)


def _shared(name: str, other: str) -> int:
    """Return how many characters two names begin with in common."""
    same = 0
    while same < min(len(name), len(other)) and name[same] == other[same]:
        same += 1
    return same


def _packed(form: str, value: float) -> bytes:
    return struct.pack(form, value if form == "<f" else int(value))


def packed_items(missions: Missions, kind: int) -> bytes:
    """Return a list in the packed format of ArduPilot's AP_Filesystem_Mission."""
    items = missions.items(kind)
    out = bytearray(struct.pack("<HHHHH", MISSION_MAGIC, kind, 0, 0, len(items)))
    for number, item in enumerate(items):
        out += ITEM.pack(
            *item.params,
            item.x,
            item.y,
            item.z,
            number,
            item.command,
            0,
            0,
            item.frame,
            0,
            item.autocontinue,
            kind,
        )
    return bytes(out)
