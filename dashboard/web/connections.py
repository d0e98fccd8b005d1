"""Who may stay connected, and how much of it is logged: half-finished requests stop nobody.

aiohttp ends a connection that waits for a request, but not one whose body never comes or whose answer nobody
reads. asyncio's own server accepts all that come; without a free file it logs and tries again, in growing
numbers. `Connections.accept` takes its place.
"""

import asyncio
import logging
import socket
from collections import Counter
from collections.abc import Collection

from aiohttp import web
from aiohttp.http_exceptions import HttpProcessingError

MOST = 128
"""Connections that are no WebSockets. A browser opens six."""
PATIENCE_S = 12.0
"""For a request to arrive, and from there for its answer and the next: a command takes 8 s at most."""
LINGER_S = 1.0  # for what is still sent of a refused request
MOST_HEADERS = 64  # browsers send about twenty
BACKLOG = 128  # as MOST
AGAIN_S = 0.1
"""After a connection could not be accepted."""

_log = logging.getLogger(__name__)


class Connections:
    """All connections of a server. One too many takes the place of another.

    Nobody is refused for their address: behind a proxy, such as BlueOS's, all browsers have the same. What
    gives way is the oldest connection without a whole request, of the address that has the most of them.
    """

    def __init__(self, server: web.Server) -> None:
        self.server = server
        self.open: dict[Connection, None] = {}
        """The oldest first; without WebSockets, which have a limit of their own."""

    def make_room(self) -> None:
        """Drop one connection."""
        waiting = [connection for connection in self.open if not connection.asked]
        if self.open:
            most_crowded(waiting or self.open).drop()

    async def accept(self, listener: socket.socket) -> None:
        """Take connections for ever; close nothing but them."""
        loop, told = asyncio.get_running_loop(), ""
        while True:
            try:
                line, _ = await loop.sock_accept(listener)
                await loop.connect_accepted_socket(lambda: Connection(self), line)
            except ConnectionError:
                continue  # it has gone already
            except OSError as error:
                if str(error) != told:  # a flood of them is told once
                    _log.warning("no connection can be accepted: %s", error)
                told = str(error)
                self.make_room()
                await asyncio.sleep(AGAIN_S)


class Connection(web.RequestHandler):
    """One connection; it ends where no whole request comes in time."""

    def __init__(self, connections: Connections) -> None:
        super().__init__(
            connections.server,
            loop=asyncio.get_running_loop(),
            access_log=None,  # type: ignore[arg-type]
            keepalive_timeout=PATIENCE_S,
            lingering_time=LINGER_S,
            max_headers=MOST_HEADERS,
        )
        self.address = ""
        self.asked = False
        """A whole request came."""
        self._connections = connections
        self._end: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take a place, and another's if there is none."""
        super().connection_made(transport)
        if len(self._connections.open) >= MOST:
            self._connections.make_room()
        self.address = (transport.get_extra_info("peername") or ("",))[0]
        self._connections.open[self] = None
        self.ends_within(PATIENCE_S)

    def connection_lost(self, exc: BaseException | None) -> None:
        """Give the place back."""
        self.stay()
        super().connection_lost(exc)

    def request_came(self) -> None:
        """Start the time again."""
        self.asked = True
        self.ends_within(PATIENCE_S)

    def ends_within(self, timeout_s: float) -> None:
        """Drop it after a time, unless a request comes."""
        if self._end is not None:
            self._end.cancel()
        self._end = self._loop.call_later(timeout_s, self.drop)

    def drop(self) -> None:
        """Close it now. What it has not read is forgotten: `close` would keep that until it is read."""
        self.stay()
        if self.transport is not None:
            self.transport.abort()

    def stay(self) -> None:
        """Let it be, such as a WebSocket: it has a heartbeat, and its number is limited elsewhere."""
        self._connections.open.pop(self, None)
        if self._end is not None:
            self._end.cancel()


def most_crowded(connections: Collection[Connection]) -> Connection:
    """Return the oldest of the address that has the most, so that nobody locks others out."""
    count = Counter(connection.address for connection in connections)
    most = max(count.values())
    return next(connection for connection in connections if count[connection.address] == most)


def is_ours(record: logging.LogRecord) -> bool:
    """Tell whether to log a record: what a stranger sent is no error of ours."""
    return not (record.exc_info and isinstance(record.exc_info[1], HttpProcessingError))
