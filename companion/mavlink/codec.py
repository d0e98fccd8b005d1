"""Bytes to MAVLink 2 messages and back, without I/O."""

import math
from collections import deque
from collections.abc import Container
from typing import Final

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import LinkSection
from companion.mavlink.encode import MARKS, clock_mark
from companion.mavlink.frames import HEADER, MARKER, SIGNED, Splitter, WireFrame, leading_frames
from companion.mavlink.heard import OLD, OTHER_KEY, UNSIGNED, Overheard
from companion.mavlink.messages import CHECKSUM_BYTES, Message, checksum, pack
from companion.mavlink.signing import Signing
from companion.records import LinkCounters, Sender

STEERING: Final = frozenset(
    {mavlink.MAVLINK_MSG_ID_MANUAL_CONTROL, mavlink.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE}
)

REMEMBERED: Final = 8192
"""Frames that we sent, at least: of the last two minutes at 64 a second."""

CLIMBS: Final = 256
"""Frames of the climb rate, at least: of the last five seconds."""

QUESTIONS: Final = 512
"""TIMESYNC questions that we asked, of as long a time."""

THRICE_S: Final = 1.0
"""Three answers to another's questions within this time are another Holdfast's; fewer may be by chance."""


ADDRESSED: Final = frozenset(
    message_id
    for message_id, kind in mavlink.mavlink_map.items()
    if {"target_system", "target_component"} <= {*kind.fieldnames}
    and not (message_id in STEERING or kind.msgname.endswith("_ACK") or kind.msgname in ("PING", "TIMESYNC"))
)
"""What asks one component for something; an answer is not answered."""


def addresses_us(frame: WireFrame, link: LinkSection) -> bool:
    """Tell whether a frame asks for something of our component alone."""
    if frame.id not in ADDRESSED:
        return False
    message = frame.message()
    systems = (link.vehicle_system, link.system)
    return message.target_component == link.component and message.target_system in systems


class Frames:
    """The last frames, `least` or more."""

    def __init__(self, least: int) -> None:
        self._least = least
        self._newer, self._older = set[int](), set[int]()
        """Their hashes, in two generations."""

    def __contains__(self, frame: bytes) -> bool:
        digest = hash(frame)
        return digest in self._newer or digest in self._older

    def add(self, frame: bytes) -> None:
        """Take one more."""
        if len(self._newer) >= self._least:
            self._newer, self._older = set(), self._newer
        self._newer.add(hash(frame))


class Sent:
    """What this process sent in the last minutes: what else comes with its ids is of another Holdfast."""

    def __init__(self) -> None:
        self.frames = Frames(REMEMBERED)
        self._asked: dict[int, int] = {}
        """The first answer's tc1 (0 before it) by ts1 of our TIMESYNC questions, oldest first."""
        self._answered_ns = 0
        self._unasked_s: deque[float] = deque((-math.inf,) * 3, maxlen=3)

    def add(self, frame: bytes, message: Message) -> None:
        """Take what is sent now."""
        self.frames.add(frame)
        if message.MESSAGE_ID == mavlink.MAVLINK_MSG_ID_TIMESYNC:
            self._asked[message.ts1] = 0
            if len(self._asked) > QUESTIONS:
                del self._asked[next(iter(self._asked))]

    def answers_us(self, message: Message) -> bool:
        """Tell whether a TIMESYNC answers a question of ours, and does not repeat its first answer.

        Another answer to the same question is a second autopilot's, or came another way.
        """
        first_ns = self._asked.get(message.ts1)
        if message.tc1 == 0 or first_ns is None or message.tc1 == first_ns:
            return False
        if first_ns == 0:
            self._asked[message.ts1] = self._answered_ns = message.tc1
        return True

    def answers_another(self, message: Message, mark: int, t_s: float) -> bool:
        """Tell whether a TIMESYNC, with two before it, answers what another with our `mark` asks now.

        What is older than our own newest answer was recorded.
        """
        answers_now = message.tc1 > 0 and message.tc1 >= self._answered_ns
        if not answers_now or message.ts1 % MARKS != mark or message.ts1 in self._asked:
            return False
        self._unasked_s.append(t_s)
        return 0.0 <= t_s - self._unasked_s[0] <= THRICE_S


class Packer:
    """Packs one sender's messages with its sequence numbers, signed where there is a key."""

    def __init__(
        self, system: int, component: int, signing: Signing | None = None, sent: Sent | None = None
    ) -> None:
        self._sender = (system, component)
        self._sent = sent or Sent()
        self._signing = signing
        self._sequence = 0

    def encode(self, message: Message) -> bytes:
        """Pack `message` with the next sequence number."""
        payload, message_id = pack(message), message.MESSAGE_ID
        flags = 0 if self._signing is None else SIGNED
        low, high = message_id & 0xFFFF, message_id >> 16
        header = HEADER.pack(MARKER, len(payload), flags, 0, self._sequence, *self._sender, low, high)
        self._sequence = (self._sequence + 1) & 0xFF
        frame = header + payload
        frame += checksum(frame[1:], message_id).to_bytes(CHECKSUM_BYTES, "little")
        if self._signing is not None:
            frame = self._signing.signed(frame)
        self._sent.add(frame, message)
        return frame


class Decoded(msgspec.Struct, frozen=True):
    """What a datagram held."""

    messages: list[Message]
    """The vehicle's, and steering of others."""
    others: list[WireFrame]
    """What another Holdfast with our ids said, or was answered."""
    addressed: list[WireFrame]
    """What somebody asks of our component."""


class Codec:
    """One link to one vehicle.

    Every frame's checksum is tested. Garbage is what fails, MAVLink 1 and ids that the dialect does not know;
    each stretch of it counts once. Frames from others are foreign, except steering (docs/ardusub.md, "Who
    may steer"), and what asks something of our component.

    With `stream` an unfinished frame at the end waits for its rest (`frames.Splitter`). With `signing`, what
    is not signed with its key, or is replayed, is refused; without, none is looked at. `wanted` are the
    message ids worth unpacking, all if None: others are counted as messages and dropped.
    """

    def __init__(
        self,
        link: LinkSection,
        *,
        stream: bool = False,
        wanted: Container[int] | None = None,
        counters: LinkCounters | None = None,
        signing: Signing | None = None,
    ) -> None:
        self.heard = Overheard(link)
        """What arrives of others, where the heartbeat does not come."""
        self.counters = counters or LinkCounters()
        self.sent = Sent()
        self._link = link
        self._source = (link.system, link.component)
        self._target = (link.vehicle_system, link.vehicle_component)
        self.ours = frozenset({self._source, (link.vehicle_system, link.component)})
        self.encode = Packer(*self._source, signing, self.sent).encode
        self._signing = signing
        self._mark = clock_mark(*self._source)
        self._climbs = Frames(CLIMBS)
        self._stream = stream
        self._wanted = wanted
        self.splitter = Splitter(stream, version_1=False)
        self._in_junk = False

    def decode(self, t_s: float, data: bytes) -> Decoded:
        """Return what is in `data`, which came at `t_s`. Never raises: see `counters`."""
        self.counters.datagrams += 1
        if not self._stream:
            self._in_junk = False
        found = Decoded([], [], [])
        for frame, piece in self.splitter.cut(t_s, data):
            if frame is None:
                self.counters.garbage += not self._in_junk
                self.heard.junk(t_s, piece)
            else:
                if self.is_others(frame, piece):
                    found.others.append(frame)
                self._open(t_s, frame, piece, found)
            self._in_junk = frame is None
        return found

    def sender(self, t_s: float, data: bytes) -> Sender:
        """Tell who sent a datagram. The vehicle's begins with sound frames, one of which is its own.

        With `signing` that must be signed and new as well; `decode` will still find it new. Junk costs two
        checksums. An autopilot that speaks MAVLink 1 is BEHIND: many speak MAVLink 2 once they hear it.
        """
        found, frame = Sender.STRANGER, None
        for frame, piece in leading_frames(data):
            ours = (frame.system, frame.component) == self._target
            if ours and frame.version == 2:
                sender = Sender.EXPECTED if self._signing is None else self._signing.sender(piece)
                if sender is not Sender.EXPECTED:
                    self._refuse(t_s, frame, piece)
                return sender
            self.heard.frame(t_s, frame)
            if ours and self._signing is None:
                found = Sender.BEHIND
        if frame is None:
            self.heard.junk(t_s, data)
        return found

    def _refuse(self, t_s: float, frame: WireFrame, piece: bytes) -> None:
        self.counters.refused += 1
        old = self._signing is not None and self._signing.sender(piece) is Sender.BEHIND
        self.heard.frame(t_s, frame, OLD if old else OTHER_KEY if piece[2] & SIGNED else UNSIGNED)

    def is_others(self, frame: WireFrame, piece: bytes) -> bool:
        """Tell whether a frame with our ids is another Holdfast's.

        Our own come back from some routers, at once or much later, and somebody may have recorded them: then
        we sent them, or their signature is no later than our last.
        """
        if (frame.system, frame.component) not in self.ours or frame.version != 2:
            return False
        if self._signing is None:
            return piece not in self.sent.frames
        others = self._signing.accepts(piece)
        self.counters.refused += not others
        return others

    def _open(self, t_s: float, frame: WireFrame, piece: bytes, found: Decoded) -> None:
        """Add to `found` what is for us."""
        sender = (frame.system, frame.component)
        from_vehicle = sender == self._target
        rival = not from_vehicle and sender != self._source and frame.id in STEERING
        addressed = not (from_vehicle or sender in self.ours) and addresses_us(frame, self._link)
        if self._signing and (rival or from_vehicle or addressed) and not self._signing.accepts(piece):
            self._refuse(t_s, frame, piece)
            return
        if addressed:
            self.counters.messages += 1
            found.addressed.append(frame)
            return
        if from_vehicle and frame.id == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            self.heard.vehicle_signs = bool(piece[2] & SIGNED)
        elif not rival:
            self.heard.frame(t_s, frame)
        if from_vehicle and self._wanted is not None and frame.id not in self._wanted:
            self.counters.messages += 1
            return
        if from_vehicle and frame.id == mavlink.MAVLINK_MSG_ID_VFR_HUD:
            if piece in self._climbs:  # it has no stamp: a copy that took a longer way would be new
                self.counters.messages += 1
                return
            self._climbs.add(piece)
        message = frame.message() if from_vehicle or rival else None
        if message is None or (rival and getattr(message, "target", self._target[0]) != self._target[0]):
            self.counters.foreign += 1
            return
        self.counters.messages += 1
        if frame.id == mavlink.MAVLINK_MSG_ID_TIMESYNC and not self.sent.answers_us(message):
            # Some routers pass no frame on to where the same ids are; answers come everywhere.
            if self.sent.answers_another(message, self._mark, t_s):
                found.others.append(frame)
            return
        found.messages.append(message)
