"""MAVLink channels of the autopilot: bytes to messages and back, streams, who was heard, the signing key."""

import hashlib
from collections import deque
from collections.abc import Sequence

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_bridge.firmware import packing
from sim_bridge.firmware.packing import Message
from sim_bridge.firmware.stream_schedule import StreamSchedule

COMPONENT = 1
UTC_AT_BOOT_S, MAVLINK_EPOCH_S = 1_760_000_000, 1_420_070_400


class KeyStore:
    """The signing key, None for no signing, and the timestamp (10 µs since 2015) that signing starts from.

    It outlives reboots and goes for every link.
    """

    def __init__(self, passphrase: str) -> None:
        self.key = hashlib.sha256(passphrase.encode()).digest() if passphrase else None
        self.timestamp = (UTC_AT_BOOT_S - MAVLINK_EPOCH_S) * 100_000

    def set_up(self, key: bytes, timestamp: int) -> None:
        """Take a new key (SETUP_SIGNING); all zero bytes take it away."""
        self.key = key if any(key) else None
        self.timestamp = max(self.timestamp, timestamp)


class Link:
    """One MAVLink channel: its parser, sequence number, streams, and who has been heard on it."""

    def __init__(self) -> None:
        self.parser = mavlink.MAVLink(None)
        self.parser.robust_parsing = True
        self.packer = mavlink.MAVLink(None, srcComponent=COMPONENT)
        self.streams = StreamSchedule()
        self.parameters: deque[str] = deque()
        self.heard: set[tuple[int, int]] = set()

    def sign(self, keys: KeyStore, number: int) -> None:
        """Sign, and demand signatures, from now on; neither where there is no key."""
        for wire in (self.parser, self.packer):
            wire.signing.secret_key = keys.key
            wire.signing.timestamp = max(wire.signing.timestamp, keys.timestamp)
        self.packer.signing.link_id = number & 0xFF
        self.packer.signing.sign_outgoing = keys.key is not None

    def pack(self, message: Message, system: int) -> bytes:
        """Wire bytes of a message from our system, with this link's next sequence number."""
        self.packer.srcSystem = system
        signing = self.packer.signing
        signing.timestamp = max(signing.timestamp, self.parser.signing.timestamp) % (1 << 64)
        data = None
        if not signing.sign_outgoing:
            data = packing.pack(message, self.packer.seq, system, COMPONENT)
        if data is None:
            data = bytes(message.pack(self.packer))
        self.packer.seq = (self.packer.seq + 1) % 256
        return data

    def parse(self, data: bytes) -> Sequence[Message]:
        """Return the messages that `data` completes; BAD_DATA where it is garbage."""
        parser = self.parser
        if not parser.buf and parser.signing.secret_key is None and (message := packing.parse(data)):
            return (message,)
        return parser.parse_buffer(data) or ()
