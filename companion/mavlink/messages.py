"""MAVLink's messages as records with the fields that the dialect defines: from a payload and back.

The dialect's own objects parse and pack the same bytes, and take five times as long.
"""

import functools
import struct
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Final, NamedTuple, TypeAlias

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

Message: TypeAlias = Any
"""A record of one of the types that `message_type` gives; `MESSAGE_ID` says which."""

CHECKSUM_BYTES: Final = 2
CHUNK_CHARS: Final = 50  # of a STATUSTEXT


class _Format(NamedTuple):
    """How a message stands in a payload: its fields in the order of the wire."""

    record: Any
    packer: struct.Struct
    lengths: tuple[int, ...]
    """How many values each field has: 1 for a number or a text, else those of an array."""
    is_plain: bool
    """Whether all fields are numbers."""


def is_known(message_id: int) -> bool:
    """Tell whether the dialect defines the message."""
    return message_id in mavlink.mavlink_map


def message_name(message_id: int) -> str:
    """Return MAVLink's name of a message that the dialect defines."""
    return str(mavlink.mavlink_map[message_id].msgname)


def checksum(data: bytes, message_id: int) -> int:
    """Return the checksum of a frame, whose `data` lies between the marker and the checksum."""
    return int(mavlink.mcrf4xx(data + _extras[message_id]))


def message_type(message_id: int) -> Any:
    """Return the type of a message: a record of its fields, which are 0 unless given by name."""
    return _format(message_id).record


def unpack(message_id: int, payload: bytes) -> Message:
    """Return the message in a payload: zeros cut off its end are filled in, fields unknown here dropped."""
    record, packer, lengths, is_plain = _format(message_id)
    if len(payload) != packer.size:
        payload = payload.ljust(packer.size, b"\0")[: packer.size]
    values = packer.unpack(payload)
    return record(*values) if is_plain else record(*_fields(values, lengths))


def pack(message: Message) -> bytes:
    """Return a message's payload, without the zeros at its end. Raises struct.error for a value too large."""
    _, packer, _, is_plain = _format(message.MESSAGE_ID)
    values = msgspec.structs.astuple(message)
    return packer.pack(*(values if is_plain else _values(values))).rstrip(b"\0") or b"\0"


def _fields(values: Sequence[Any], lengths: Iterable[int]) -> Iterator[Any]:
    at = 0
    for length in lengths:
        value = values[at] if length == 1 else tuple(values[at : at + length])
        yield value.partition(b"\0")[0].decode("ascii", "replace") if isinstance(value, bytes) else value
        at += length


def _values(fields: Iterable[Any]) -> Iterator[Any]:
    for field in fields:
        if isinstance(field, tuple):
            yield from field
        else:
            yield field.encode("ascii") if isinstance(field, str) else field


@functools.cache
def _format(message_id: int) -> _Format:
    kind = mavlink.mavlink_map[message_id]
    record = msgspec.defstruct(
        kind.msgname,
        [(field, Any, 0) for field in kind.ordered_fieldnames],
        namespace={"MESSAGE_ID": message_id},
        frozen=True,
        gc=False,
    )
    return _Format(record, kind.unpacker, tuple(kind.lengths), is_plain=not any(kind.array_lengths))


_extras: Final = {key: bytes((kind.crc_extra,)) for key, kind in mavlink.mavlink_map.items()}
