"""Who may stay connected, and how much of it is logged: half-finished requests stop nobody.

aiohttp ends a connection that waits for a request, but not one whose body never comes or whose answer nobody
reads. One connection too many takes the place of another. Nobody is refused for their address: behind a
proxy, such as BlueOS's, all browsers have the same.
"""

import asyncio
import logging
from collections import Counter
from collections.abc import Collection

from aiohttp import web
from aiohttp.http_exceptions import HttpProcessingError

MOST = 128
"""Connections that are no WebSockets. A browser opens six."""
PATIENCE_S = 12.0
"""For a request to arrive, and from there for its answer and the next: a command takes 9 s at most."""
LINGER_S = 1.0  # for what is still sent of a refused request
MOST_HEADERS = 64  # browsers send about twenty


class Connection(web.RequestHandler):
    """One connection; it ends where no whole request comes in time.

    `others` are all that are open, the oldest first; without WebSockets, which have a limit of their own.
    """

    def __init__(self, server: web.Server, others: "dict[Connection, None]") -> None:
        super().__init__(
            server,
            loop=asyncio.get_running_loop(),
            access_log=None,  # type: ignore[arg-type]
            keepalive_timeout=PATIENCE_S,
            lingering_time=LINGER_S,
            max_headers=MOST_HEADERS,
        )
        self.address = ""
        self.asked = False
        """A whole request came."""
        self._others = others
        self._end: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take a place; where there is none, that of the oldest without a whole request."""
        super().connection_made(transport)
        if len(self._others) >= MOST:
            waiting = [connection for connection in self._others if not connection.asked]
            most_crowded(waiting or self._others).drop()
        self.address = (transport.get_extra_info("peername") or ("",))[0]
        self._others[self] = None
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
        self._others.pop(self, None)
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
