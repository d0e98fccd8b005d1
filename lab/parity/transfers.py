"""Scenarios of parameters, missions and files."""

import struct
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from lab.parity.answers import TIMES, Answers, Near
from lab.parity.partner import Message, Partner, of_type, texts


def parameters(partner: Partner) -> Answers:
    """Ask for the whole table, then odd requests and settings."""
    heard = partner.ask(mavlink.MAVLink_param_request_list_message(1, 1), 12.0)
    table = {message.param_id: message for message in of_type("PARAM_VALUE", heard)}
    yield "texts with the list", texts(heard)
    yield "count", sorted({message.param_count for message in table.values()})
    for name, message in sorted(table.items()):
        yield f"{name}: type", message.param_type
        yield f"{name}: value", Near(message.param_value, 1e-5 * abs(message.param_value) + 1e-9)
    read = mavlink.MAVLink_param_request_read_message
    for name, request in (
        ("read by name", read(1, 1, b"FS_PILOT_INPUT", -1)),
        ("read by number", read(1, 1, b"", 3)),
        ("read an unknown one", read(1, 1, b"NO_SUCH_THING", -1)),
        ("read number 9999", read(1, 1, b"", 9999)),
    ):
        yield name, _values(partner.ask(request))
    for name, value in (
        ("FS_PILOT_TIMEOUT", 2.5),
        ("FS_PILOT_INPUT", 1.4),
        ("JS_GAIN_STEPS", 300.0),
        ("FS_PILOT_TIMEOUT", float("nan")),
        ("FS_PILOT_TIMEOUT", float("inf")),
        ("NO_SUCH_THING", 1.0),
    ):
        heard = partner.ask(mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, 9))
        yield f"set {name} to {value}", (_values(heard), texts(heard))


def _values(heard: list[Message]) -> tuple[tuple[str, float, int], ...]:
    return tuple(
        (message.param_id, round(message.param_value, 4), message.param_index)
        for message in of_type("PARAM_VALUE", heard)
    )


def missions(partner: Partner) -> Answers:
    """Missions, fences and rally points: count, items, upload, set current, clear."""
    for kind, name in ((0, "mission"), (1, "fence"), (2, "rally")):
        yield (
            f"{name}: count",
            [
                message.count
                for message in of_type(
                    "MISSION_COUNT", partner.ask(mavlink.MAVLink_mission_request_list_message(1, 1, kind))
                )
            ],
        )
        for sequence in (0, 7):
            heard = partner.ask(mavlink.MAVLink_mission_request_int_message(1, 1, sequence, kind))
            yield f"{name}: item {sequence}", _said(heard, "MISSION_ITEM_INT", "MISSION_ACK")
        heard = partner.ask(mavlink.MAVLink_mission_clear_all_message(1, 1, kind))
        yield f"{name}: clear", _said(heard, "MISSION_ACK")
    heard = partner.ask(mavlink.MAVLink_mission_count_message(1, 1, 2, 0))
    yield "upload: asks for", _said(heard, "MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK")
    for sequence in (0, 1):
        item = mavlink.MAVLink_mission_item_int_message(
            1, 1, sequence, 3, 16, 0, 1, 0, 0, 0, 0, 475000000, -25710000, -2.0, 0
        )
        heard = partner.ask(item)
        yield (
            f"upload: after item {sequence}",
            _said(heard, "MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK"),
        )
    heard = partner.ask(mavlink.MAVLink_mission_request_list_message(1, 1, 0))
    yield "count after the upload", [message.count for message in of_type("MISSION_COUNT", heard)]
    heard = partner.ask(mavlink.MAVLink_mission_request_int_message(1, 1, 1, 0))
    yield "item 1 after the upload", _said(heard, "MISSION_ITEM_INT", "MISSION_ACK")
    heard = partner.ask(mavlink.MAVLink_mission_set_current_message(1, 1, 1))
    yield "set current", (_said(heard, "MISSION_CURRENT", "COMMAND_ACK"), texts(heard))
    heard = partner.ask(mavlink.MAVLink_mission_clear_all_message(1, 1, 0))
    yield "clear", (_said(heard, "MISSION_ACK"), texts(heard))


def mission_items(partner: Partner) -> Answers:
    """Missions of one item, for every command: whether it is taken, and what is kept of it."""
    for number, entry in sorted(mavlink.enums["MAV_CMD"].items()):
        if entry.name.endswith("ENUM_END"):
            continue
        partner.ask(mavlink.MAVLink_mission_count_message(1, 1, 2, 0), 0.05)
        for sequence, command in ((0, mavlink.MAV_CMD_NAV_WAYPOINT), (1, number)):
            item = mavlink.MAVLink_mission_item_int_message(
                1, 1, sequence, 3, command, 0, 1, 1.5, 2.5, 3.5, 4.5, 475000000, -25710000, -2.0, 0
            )
            heard = partner.ask(item, 0.08)
        taken = [message.type for message in of_type("MISSION_ACK", heard)]
        kept: tuple[Any, ...] = ()
        if taken == [0]:
            heard = partner.ask(mavlink.MAVLink_mission_request_int_message(1, 1, 1, 0), 0.08)
            kept = _said(heard, "MISSION_ITEM_INT", "MISSION_ACK")
        yield entry.name, (taken, kept)
        partner.ask(mavlink.MAVLink_mission_clear_all_message(1, 1, 0), 0.05)


def _said(heard: list[Message], *kinds: str) -> tuple[Any, ...]:
    """Return kind and fields of the answers, without who is addressed."""
    said = []
    for message in heard:
        if message.get_type() in kinds:
            values = message.to_dict()
            for name in ("target_system", "target_component", *TIMES):
                values.pop(name, None)
            said.append(tuple(values.items()))
    return tuple(dict.fromkeys(said))


OPEN_FILE_RO, READ_FILE, LIST_DIRECTORY, TERMINATE, RESET, CRC, BURST = 4, 5, 3, 1, 2, 14, 15
ACK = 128
PARAMETER_MAGICS = (b"\x1b\x67", b"\x1c\x67")
PARAMETERS, MISSION = "@PARAM/param.pck", "@MISSION/mission.dat"
FILE_SESSION_S = 3.5
"""After so long a silence a file belongs to nobody."""


class FileRequest(NamedTuple):
    """A request of MAVLink FTP; an empty path with a `size` reads."""

    opcode: int
    path: str = ""
    size: int | None = None
    offset: int = 0
    session: int = 0


def files(partner: Partner) -> Answers:
    """MAVLink FTP: the parameter file, a directory, what is not there; and the list of logs."""
    asks = [("reset", FileRequest(RESET))]
    for path in ("/", "@PARAM", "@SYS", "@MISSION", "/no-such-directory"):
        asks.append((f"list {path}", FileRequest(LIST_DIRECTORY, path)))
    asks.append(("list @PARAM from 1 on", FileRequest(LIST_DIRECTORY, "@PARAM", offset=1)))
    for path in (PARAMETERS, MISSION, "/no-such-file"):
        asks.append((f"open {path}", FileRequest(OPEN_FILE_RO, path)))
        asks.append((f"open {path} once more", FileRequest(OPEN_FILE_RO, path)))
        asks.append((f"read {path}", FileRequest(READ_FILE, size=8)))
        asks.append((f"read more of {path}", FileRequest(READ_FILE, size=8, offset=8)))
        asks.append((f"read {path} otherwise", FileRequest(READ_FILE, size=10)))
        asks.append((f"read {path} in another session", FileRequest(READ_FILE, size=8, session=3)))
        asks.append((f"close {path} in another session", FileRequest(TERMINATE, session=3)))
        asks.append((f"read {path} beyond its end", FileRequest(READ_FILE, size=8, offset=10_000_000)))
        asks.append((f"close {path}", FileRequest(TERMINATE)))
        asks.append((f"checksum of {path}", FileRequest(CRC, path)))
    for path in (f"{PARAMETERS}?start=20&count=12", f"{PARAMETERS}?start=5&count=2&withdefaults=1", MISSION):
        asks.append((f"open {path} for a burst", FileRequest(OPEN_FILE_RO, path)))
        asks.append((f"burst of {path}", FileRequest(BURST, size=80)))
        asks.append((f"close {path} after a burst", FileRequest(TERMINATE)))
    asks.append(("burst of nothing", FileRequest(BURST, size=80)))
    asks.append(("a start that is too large", FileRequest(OPEN_FILE_RO, f"{PARAMETERS}?start=70000")))
    asks.append(("close that", FileRequest(TERMINATE)))
    asks.append(("too long", FileRequest(READ_FILE, size=250)))
    asks += [(f"opcode {opcode}", FileRequest(opcode)) for opcode in (0, 12, 16, 99, 128, 129)]
    for place, (name, request) in enumerate(asks):
        yield name, _ftp(partner, 50 * place, request)
    again = FileRequest(OPEN_FILE_RO, PARAMETERS)
    for name in ("open", "the same request again"):
        yield name, _ftp(partner, 9000, again)
    partner.listen(FILE_SESSION_S)
    yield "another session after a silence", _ftp(partner, 9010, FileRequest(READ_FILE, size=8, session=7))
    heard = partner.ask(mavlink.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF), 1.0)
    yield "logs", [(entry.num_logs, entry.id, entry.size) for entry in of_type("LOG_ENTRY", heard)]


def _ftp(partner: Partner, sequence: int, request: FileRequest) -> tuple[Any, ...]:
    """Return how much was said, what was no banner, and header and data of the replies.

    Opcode 128 is ACK, 129 NAK. How many parameters there are is left out: the firmware hides those of a GPS.
    """
    data = request.path.encode()
    length = len(data) if request.size is None else request.size
    head = (sequence, request.session, request.opcode, length, 0, 0, 0, request.offset)
    payload = (struct.pack("<HBBBBBBI", *head) + data).ljust(251, b"\0")
    heard = partner.ask(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, payload), 0.5)
    replies = []
    for reply in map(bytes, (message.payload for message in of_type("FILE_TRANSFER_PROTOCOL", heard))):
        content = reply[12 : 12 + reply[4]]
        if request.opcode == OPEN_FILE_RO and reply[3] == ACK:
            content = b"size"  # of all parameters; the next one are their numbers
        elif content[:2] in PARAMETER_MAGICS:
            content = content[:2] + content[6:]
        replies.append((*struct.unpack_from("<HBBBBBBI", reply), content))
    said = texts(heard)
    return (len(said), [text for text in said if not text.startswith("6")], *replies)
