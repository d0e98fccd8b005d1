"""Missions, fences and rally points: the MAVLink mission protocol, as the firmware keeps to it.

Nothing is flown: AUTO is refused without a position, and a fence that is not enabled is not watched.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_bridge.firmware import mission_items

Message = Any

MISSION, FENCE, RALLY = 0, 1, 2
ACCEPTED, ERROR, UNSUPPORTED, NO_SPACE, INVALID_SEQUENCE, DENIED, CANCELLED = 0, 1, 3, 4, 13, 14, 15
MOST = {MISSION: 655, FENCE: 84, RALLY: 84}
"""Items that fit into the simulated board's storage; measured for missions."""
ALLOWED = {FENCE: range(5000, 5005), RALLY: range(5100, 5101)}
REPEAT_S, GIVE_UP_S = 1.0, 8.0
GLOBAL, WAYPOINT = 0, 16
WARNING, INFO, DEBUG = 4, 6, 7
RECEIVED = {MISSION: (INFO, "Flight plan received"), FENCE: (DEBUG, "Fence Indexed OK")}


class Item(NamedTuple):
    """A MISSION_ITEM_INT without addressee, number and list."""

    frame: int
    command: int
    autocontinue: int
    params: tuple[float, float, float, float]
    x: int
    y: int
    z: float


HOME = Item(GLOBAL, WAYPOINT, 1, (0.0, 0.0, 0.0, 0.0), 0, 0, 0.0)
"""Item 0 of a mission while no home is known; what is uploaded there is dropped."""


class Upload(NamedTuple):
    """A transfer to us: which list, the number wanted next, the last one's successor, to whom."""

    kind: int
    next: int
    end: int
    peer: tuple[int, int, int]
    asked_s: float
    heard_s: float


class Missions:
    """The three lists and the transfer under way.

    Args:
        send: sends a message on a link.
        say: sends a STATUSTEXT of a severity.

    """

    def __init__(self, send: Callable[[int, Message], None], say: Callable[[int, str], None]) -> None:
        self._send, self._say = send, say
        self._lists: dict[int, list[Item]] = {MISSION: [], FENCE: [], RALLY: []}
        self._upload: Upload | None = None
        self._warned = self._warned_of_items = False
        self.current = 0
        """Number of the mission's present item."""
        self.home = HOME

    @property
    def total(self) -> int:
        """Items of the mission beside home."""
        return max(0, len(self._lists[MISSION]) - 1)

    def asks(self, link: int) -> bool:
        """Whether it asks for items on a link, which slows that link's streams."""
        return self._upload is not None and self._upload.peer[0] == link

    def items(self, kind: int) -> list[Item]:
        """Return a list, home first in a mission."""
        stored = self._lists[kind]
        return [self.home, *stored[1:]] if kind == MISSION and stored else stored

    def handle(self, link: int, message: Message, now_s: float) -> None:
        """Take one message of the protocol."""
        kind = message.get_type()
        peer = (link, message.get_srcSystem(), message.get_srcComponent())
        listed = getattr(message, "mission_type", MISSION)
        if listed not in self._lists:
            self._acknowledge(peer, listed, UNSUPPORTED)
        elif kind == "MISSION_REQUEST_LIST":
            self._count(peer, listed)
        elif kind in ("MISSION_REQUEST_INT", "MISSION_REQUEST"):
            self._item(peer, listed, message.seq, whole=kind == "MISSION_REQUEST_INT")
        elif kind == "MISSION_COUNT":
            self._begin(peer, listed, 0, message.count, now_s)
        elif kind == "MISSION_WRITE_PARTIAL_LIST":
            self._begin(peer, listed, message.start_index, message.end_index + 1, now_s)
        elif kind in ("MISSION_ITEM_INT", "MISSION_ITEM"):
            if kind == "MISSION_ITEM" and not self._warned_of_items:
                self._warned_of_items = True
                self._say(WARNING, "got MISSION_ITEM; GCS should send MISSION_ITEM_INT")
            self._take(peer, listed, message, now_s)
        elif kind == "MISSION_CLEAR_ALL":
            self._lists[listed] = []
            self._acknowledge(peer, listed, ACCEPTED)
            if listed == FENCE:
                self._say(*RECEIVED[FENCE])

    def step(self, now_s: float) -> None:
        """Ask again for what does not come, and give a transfer up in the end."""
        upload = self._upload
        if upload is None:
            return
        if now_s - upload.heard_s > GIVE_UP_S:
            self._upload = None
            self._acknowledge(upload.peer, upload.kind, CANCELLED)
            self._say(WARNING, "Mission upload timeout")
        elif now_s - upload.asked_s > REPEAT_S:
            self._ask(upload._replace(asked_s=now_s))

    def set_current(self, number: int) -> bool:
        """Make an item the present one; False if there is no such item."""
        if not 0 <= number < len(self._lists[MISSION]):
            return False
        self.current = number
        return True

    def _count(self, peer: tuple[int, int, int], kind: int) -> None:
        if self._upload is not None:
            self._acknowledge(peer, kind, DENIED)
            return
        link, system, component = peer
        count = len(self._lists[kind])
        self._send(link, mavlink.MAVLink_mission_count_message(system, component, count, kind))

    def _item(self, peer: tuple[int, int, int], kind: int, number: int, *, whole: bool) -> None:
        link, system, component = peer
        items = self.items(kind) or ([self.home] if kind == MISSION else [])
        if number >= len(items):
            self._acknowledge(peer, kind, INVALID_SEQUENCE)
            return
        entry = items[number]
        head = (system, component, number, entry.frame, entry.command, 0, entry.autocontinue, *entry.params)
        if whole:
            self._send(link, mavlink.MAVLink_mission_item_int_message(*head, entry.x, entry.y, entry.z, kind))
            return
        self._send(
            link, mavlink.MAVLink_mission_item_message(*head, entry.x / 1e7, entry.y / 1e7, entry.z, kind)
        )
        if not self._warned:
            self._warned = True
            self._say(WARNING, "got MISSION_REQUEST; use MISSION_REQUEST_INT!")

    def _begin(self, peer: tuple[int, int, int], kind: int, start: int, end: int, now_s: float) -> None:
        if end > MOST[kind]:
            self._acknowledge(peer, kind, NO_SPACE)
            self._say(WARNING, f"Only {MOST[kind]} items are supported")
        elif start > len(self._lists[kind]) or start < 0:
            self._acknowledge(peer, kind, ERROR)
        elif start >= end:
            self._lists[kind] = []
            self._finish(peer, kind)
        else:
            self._lists[kind] = self._lists[kind][:end]
            self._ask(Upload(kind, start, end, peer, now_s, now_s))

    def _take(self, peer: tuple[int, int, int], kind: int, message: Message, now_s: float) -> None:
        upload = self._upload
        if upload is None or kind != upload.kind:
            self._acknowledge(peer, kind, ERROR)
            return
        if message.seq != upload.next:
            self._acknowledge(peer, kind, INVALID_SEQUENCE)
            return
        item = _stored(kind, message)
        if item is None:
            self._upload = None
            self._acknowledge(peer, kind, UNSUPPORTED)
            return
        self._lists[kind][upload.next : upload.next + 1] = [item]
        if upload.next + 1 == upload.end:
            self._upload = None
            self._finish(peer, kind)
        else:
            self._ask(upload._replace(next=upload.next + 1, asked_s=now_s, heard_s=now_s))

    def _ask(self, upload: Upload) -> None:
        self._upload = upload
        link, system, component = upload.peer
        self._send(link, mavlink.MAVLink_mission_request_message(system, component, upload.next, upload.kind))

    def _finish(self, peer: tuple[int, int, int], kind: int) -> None:
        self._acknowledge(peer, kind, ACCEPTED)
        if kind in RECEIVED:
            self._say(*RECEIVED[kind])

    def _acknowledge(self, peer: tuple[int, int, int], kind: int, result: int) -> None:
        link, system, component = peer
        self._send(link, mavlink.MAVLink_mission_ack_message(system, component, result, kind))


def _stored(kind: int, message: Message) -> Item | None:
    """Return what the storage keeps of an item; None for one that does not belong into its list."""
    if kind in ALLOWED and message.command not in ALLOWED[kind]:
        return None
    params = (message.param1, message.param2, message.param3, message.param4)
    if not all(map(math.isfinite, (message.x, message.y, message.z))):
        return None
    whole = message.get_type() == "MISSION_ITEM_INT"
    x, y = (message.x, message.y) if whole else (round(message.x * 1e7), round(message.y * 1e7))
    if max(abs(x), abs(y)) >= 2**31:
        return None
    if kind == FENCE:
        return Item(GLOBAL, message.command, 0, params, x, y, 0.0)
    if kind == RALLY:
        return Item(message.frame, message.command, 0, params, x, y, message.z)
    kept = mission_items.kept(message.command, params)
    if kept is None:
        return None
    if message.command in mission_items.WITH_PLACE:
        return Item(message.frame, message.command, 1, kept, x, y, message.z)
    return Item(GLOBAL, message.command, 1, kept, 0, 0, 0.0)
