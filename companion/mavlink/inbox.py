"""What arrived since the last tick, limited to what a tick has time for.

A flood costs as much as its bytes that look like the beginning of a frame: each may take a checksum, or prove
to be a message. They are counted by a regular expression, much faster than any of them is looked at.
"""

from collections import deque
from typing import Final

from companion.mavlink.frames import HEADERS

MAX_BYTES: Final = 1 << 14
"""Fifty times what a vehicle says in a tick, and more than any serial line carries."""

MAX_LOOKS: Final = 256
"""Largest number of datagrams, or of beginnings of frames, that a tick looks at."""


class Inbox:
    """Keeps the newest: drops the oldest where there is no room, and counts the dropped bytes.

    A datagram is kept as a whole or not at all. Of a stream the end is kept.
    """

    def __init__(self, stream: bool) -> None:
        self.left_out = 0
        self._stream = stream
        self._waiting: deque[tuple[int, bytes]] = deque()
        self._bytes = 0

    def add(self, t_ns: int, data: bytes) -> None:
        """Take what arrived at `t_ns` (monotonic)."""
        if self._stream:
            self.left_out += max(0, len(data) - MAX_BYTES)
            data = data[-MAX_BYTES:]
        self._waiting.append((t_ns, data))
        self._bytes += len(data)
        while self._bytes > MAX_BYTES or len(self._waiting) > MAX_LOOKS:
            _, oldest = self._waiting.popleft()
            self._bytes -= len(oldest)
            self.left_out += len(oldest)

    def take(self) -> list[tuple[int, bytes]]:
        """Return what a tick shall look at, oldest first: (arrival in monotonic ns, bytes)."""
        taken: list[tuple[int, bytes]] = []
        looks = MAX_LOOKS
        self._bytes = 0
        while self._waiting:
            t_ns, data = self._waiting.pop()
            kept, cost = self._within(looks, data)
            self.left_out += len(data) - len(kept)
            if kept:
                taken.append((t_ns, kept))
                looks -= cost
        return taken[::-1]

    def _within(self, looks: int, data: bytes) -> tuple[bytes, int]:
        """Return what may be kept of a piece for `looks` at most, and how many it costs."""
        starts = [header.start() for header in HEADERS.finditer(data)]
        cost = max(1, len(starts))
        if cost <= looks:
            return data, cost
        return (data[starts[-looks] :], looks) if self._stream and looks else (b"", 0)
