"""Bytes to MAVLink 2 messages and back, without I/O.

Framing is done here and not by pymavlink's parser: after junk that parser waits for a bogus length and
swallows the good frames within it, and on a stream its buffer may grow. Here a header that proves false costs
one byte.
"""

import re
import struct
from collections.abc import Container
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.mavlink.messages import CHECKSUM_BYTES, Message, checksum, is_known, pack, unpack
from companion.mavlink.signing import Signing
from companion.records import LinkCounters, Sender

MARKER: Final = 0xFD
HEADERS: Final = re.compile(rb"\xfd(?=.[\x00\x01]|.?\Z)", re.DOTALL)
"""Where a frame may begin: the marker, and flags that we know, unless those are cut off."""
SIGNED: Final = 0x01
HEADER_BYTES: Final = 10
SIGNATURE_BYTES: Final = 13
PARTIAL_TIMEOUT_S: Final = 0.2
MAX_FRAMES_LOOKED_AT: Final = 32
"""Of a datagram, before it is known whose it is."""

_STEERING: Final = frozenset(
    {mavlink.MAVLINK_MSG_ID_MANUAL_CONTROL, mavlink.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE}
)
_HEADER: Final = struct.Struct("<BBBBBBBHB")
"""Marker, payload's bytes, flags, flags, sequence number, system, component, 16 and 8 bits of message id."""


class Packer:
    """Packs one sender's messages with its sequence numbers, signed where there is a key."""

    def __init__(self, system: int, component: int, signing: Signing | None = None) -> None:
        self._sender = (system, component)
        self._signing = signing
        self._sequence = 0

    def encode(self, message: Message) -> bytes:
        """Pack `message` with the next sequence number."""
        payload, message_id = pack(message), message.MESSAGE_ID
        flags = 0 if self._signing is None else SIGNED
        low, high = message_id & 0xFFFF, message_id >> 16
        header = _HEADER.pack(MARKER, len(payload), flags, 0, self._sequence, *self._sender, low, high)
        self._sequence = (self._sequence + 1) & 0xFF
        frame = header + payload
        frame += checksum(frame[1:], message_id).to_bytes(CHECKSUM_BYTES, "little")
        return frame if self._signing is None else self._signing.signed(frame)


class Codec:
    """One link to one vehicle.

    Every frame's checksum is tested. Garbage is what fails, MAVLink 1 and ids that the dialect does not know;
    each stretch of it counts once. Frames from others are foreign, except steering (docs/ardusub.md, "Who
    may steer"): MANUAL_CONTROL to this vehicle, and RC_CHANNELS_OVERRIDE to whomever.

    A datagram holds whole frames: nothing is kept from one to the next, so several peers' datagrams may mix.
    With `stream` the unfinished frame at the end (at most 279 bytes) waits for its rest, PARTIAL_TIMEOUT_S at
    most: a false header in junk delays the good frames behind it, and never loses them.

    With `signing`, what is not signed with its key, or is replayed, is refused; without, none is looked at.

    `wanted` are the message ids worth unpacking, all if None: others are counted as messages and dropped.
    """

    def __init__(
        self,
        source_system: int,
        source_component: int,
        target_system: int,
        target_component: int,
        *,
        stream: bool = False,
        wanted: Container[int] | None = None,
        counters: LinkCounters | None = None,
        signing: Signing | None = None,
    ) -> None:
        self.counters = counters or LinkCounters()
        self.encode = Packer(source_system, source_component, signing).encode
        self._signing = signing
        self._source = (source_system, source_component)
        self._target = (target_system, target_component)
        self._stream = stream
        self._wanted = wanted
        self._rest = b""
        self._rest_since_s = 0.0
        self._in_junk = False

    def decode(self, t_s: float, data: bytes) -> list[Message]:
        """Give the vehicle's messages in `data`, which came at `t_s`. Never raises: see `counters`."""
        self.counters.datagrams += 1
        old = len(self._rest)
        data = self._rest + data
        self._rest = b""
        if not self._stream:
            self._in_junk = False
        messages: list[Message] = []
        at, end = 0, len(data)
        while at < end:
            size = _frame_size(data, at)
            if size > end - at and self._may_wait(t_s, at < old):
                self._rest = data[at:]
                if at >= old:
                    self._rest_since_s = t_s
                break
            if 0 < size <= end - at and self._open(data[at : at + size], messages):
                self._in_junk = False
                at += size
            else:
                self._junk()
                header = HEADERS.search(data, at + 1)
                if header is None:
                    break
                at = header.start()
        return messages

    def sender(self, data: bytes) -> Sender:
        """Tell whose a datagram is. The vehicle's begins with sound frames, one of which is its own.

        With `signing` that must be signed and new as well; `decode` will still find it new. Junk costs one
        checksum.
        """
        at = 0
        for _ in range(MAX_FRAMES_LOOKED_AT):
            size = _frame_size(data, at) if at < len(data) else 0
            frame = data[at : at + size]
            if len(frame) < max(size, 1) or not _is_sound(frame, _message_id(frame)):
                break
            if (frame[5], frame[6]) == self._target:
                sender = Sender.EXPECTED if self._signing is None else self._signing.sender(frame)
                self.counters.refused += sender is not Sender.EXPECTED
                return sender
            at += size
        return Sender.STRANGER

    def _may_wait(self, t_s: float, waited: bool) -> bool:
        return self._stream and not (waited and t_s - self._rest_since_s > PARTIAL_TIMEOUT_S)

    def _junk(self) -> None:
        if not self._in_junk:
            self.counters.garbage += 1
        self._in_junk = True

    def _open(self, frame: bytes, messages: list[Message]) -> bool:
        """Append the frame's message if it is for us; False if it is no frame at all."""
        sender = (frame[5], frame[6])
        message_id = _message_id(frame)
        from_vehicle = sender == self._target
        rival = message_id in _STEERING and not from_vehicle and sender != self._source
        if not _is_sound(frame, message_id):
            return False
        if self._signing and (rival or from_vehicle) and not self._signing.accepts(frame):
            self.counters.refused += 1
            return True
        if not rival and not (from_vehicle and (self._wanted is None or message_id in self._wanted)):
            if from_vehicle:
                self.counters.messages += 1
            else:
                self.counters.foreign += 1
            return True
        message = unpack(message_id, frame[HEADER_BYTES : HEADER_BYTES + frame[1]])
        if rival and getattr(message, "target", self._target[0]) != self._target[0]:
            self.counters.foreign += 1
            return True
        self.counters.messages += 1
        messages.append(message)
        return True


def _message_id(frame: bytes) -> int:
    return frame[7] | frame[8] << 8 | frame[9] << 16


def _frame_size(data: bytes, at: int) -> int:
    """Give the bytes that the frame at `at` claims: more than there are if cut, 0 if it is none."""
    if data[at] != MARKER:
        return 0
    if at + HEADER_BYTES > len(data):
        return HEADER_BYTES + CHECKSUM_BYTES
    flags = data[at + 2]
    if flags & ~SIGNED:
        return 0
    return HEADER_BYTES + data[at + 1] + CHECKSUM_BYTES + (SIGNATURE_BYTES if flags else 0)


def _is_sound(frame: bytes, message_id: int) -> bool:
    """Tell whether the dialect knows the id and the checksum is right."""
    end = HEADER_BYTES + frame[1]
    claimed = int.from_bytes(frame[end : end + CHECKSUM_BYTES], "little")
    return is_known(message_id) and checksum(frame[1:end], message_id) == claimed
