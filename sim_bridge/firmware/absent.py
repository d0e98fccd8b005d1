"""What ArduSub has and the stand-in does not: storage for missions, and files. Refused as a bare board does.

A ground station goes on: its mission has no items, and it asks for parameters one message each.
"""

import struct
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

Message = Any

MISSION_PROTOCOL = (
    *("MISSION_REQUEST_LIST", "MISSION_REQUEST_INT", "MISSION_REQUEST", "MISSION_COUNT"),
    *("MISSION_ITEM_INT", "MISSION_ITEM", "MISSION_WRITE_PARTIAL_LIST", "MISSION_CLEAR_ALL"),
)
LISTS = (mavlink.MAV_MISSION_TYPE_MISSION, mavlink.MAV_MISSION_TYPE_FENCE, mavlink.MAV_MISSION_TYPE_RALLY)
REFUSED = {
    "MISSION_REQUEST_INT": mavlink.MAV_MISSION_INVALID_SEQUENCE,
    "MISSION_REQUEST": mavlink.MAV_MISSION_INVALID_SEQUENCE,
    "MISSION_COUNT": mavlink.MAV_MISSION_NO_SPACE,
    "MISSION_WRITE_PARTIAL_LIST": mavlink.MAV_MISSION_NO_SPACE,
}
NO_SPACE_TEXT = "Only 0 items are supported; ArduSub: docs/sitl.md"

HEADER = struct.Struct("<HBBBBBBI")
"""MAVLink FTP: sequence, session, operation, size, what is answered, burst complete, padding, offset."""
NONE, TERMINATE, RESET, ACK, NAK = 0, 1, 2, 128, 129
NOT_FOUND = bytes((10,))


def mission_answer(message: Message) -> Message:
    """Return what answers a message of the mission protocol: no list has items, and none takes any."""
    kind, listed = message.get_type(), getattr(message, "mission_type", 0)
    peer = (message.get_srcSystem(), message.get_srcComponent())
    if listed not in LISTS:
        return mavlink.MAVLink_mission_ack_message(*peer, mavlink.MAV_MISSION_UNSUPPORTED, listed)
    if kind == "MISSION_REQUEST_LIST":
        return mavlink.MAVLink_mission_count_message(*peer, 0, listed)
    if kind == "MISSION_CLEAR_ALL" or (kind == "MISSION_COUNT" and message.count == 0):
        return mavlink.MAVLink_mission_ack_message(*peer, mavlink.MAV_MISSION_ACCEPTED, listed)
    return mavlink.MAVLink_mission_ack_message(*peer, REFUSED.get(kind, mavlink.MAV_MISSION_ERROR), listed)


def file_answer(message: Message) -> Message | None:
    """Return what answers a request of MAVLink FTP: there is no file. None answers another's reply."""
    sequence, session, operation, *_ = HEADER.unpack_from(bytes(message.payload))
    if operation in (ACK, NAK):
        return None
    verdict, content = (ACK, b"") if operation in (NONE, TERMINATE, RESET) else (NAK, NOT_FOUND)
    head = HEADER.pack((sequence + 1) & 0xFFFF, session, verdict, len(content), operation, 0, 0, 0)
    return mavlink.MAVLink_file_transfer_protocol_message(
        0, message.get_srcSystem(), message.get_srcComponent(), (head + content).ljust(251, b"\0")
    )
