"""The wires of the companion's process: UDP, TCP and serial lines, opened again with back-off when lost.

Whatever arrives is stamped with the monotonic clock and passed on at once.
"""

import asyncio
import errno
import fcntl
import logging
import os
import socket
import termios
import time
import tty
from collections import deque
from collections.abc import Callable, Sequence
from io import FileIO
from ipaddress import ip_address, ip_network
from typing import NamedTuple, cast

from companion.endpoint import Endpoint
from companion.records import Sender
from holdfast import port_taken

PEER_SILENT_NS = 2_500_000_000
"""Longest silence of a peer: of a ground station that sends heartbeats alone, two may be lost."""
PEER_LOOK_NS = 100_000_000
"""The sender of a peer's datagrams is checked once in this time."""
RECONNECT_S = (0.25, 4.0)
HELLO_NS = 200_000_000
MAX_DATAGRAM = 65507
MAX_UNSENT_BYTES = 1 << 16
"""A stream with more unsent bytes gets nothing until it has caught up: old commands are worse than none."""
TCP_GIVE_UP_MS = 5000
"""A TCP peer that acknowledges nothing for so long is gone: a pulled cable closes no connection."""

log = logging.getLogger("holdfast")


class Admission(NamedTuple):
    """Who may become the peer of a link that listens.

    `sender` says who sent a datagram; a sender that is BEHIND gets the time by `hello`. `allow` lists
    addresses and networks; empty allows all; `barred` gets the others.
    """

    sender: Callable[[bytes], Sender]
    hello: Callable[[], bytes]
    allow: Sequence[str] = ()
    barred: Callable[[str], None] = lambda _: None

    def allows(self, host: str) -> bool:
        """Tell whether an address is within `allow`."""
        address = ip_address(host)
        address = getattr(address, "ipv4_mapped", None) or address
        return not self.allow or any(address in ip_network(network) for network in self.allow)


class MavlinkLink(asyncio.DatagramProtocol, asyncio.Protocol):
    """One wire to a peer. `arrived` gets (arrival in monotonic ns, bytes), a datagram or a piece of a stream.

    A UDP listener has one peer at a time. A sender becomes and stays the peer by datagrams that are EXPECTED,
    from an address that `admission` allows. Another can become it once no such datagram has come for
    PEER_SILENT_NS; `changes` then says so. What others send is dropped and counted in `strangers`.

    What cannot be sent is dropped: the next tick has newer commands.
    """

    def __init__(
        self,
        endpoint: Endpoint,
        name: str,
        arrived: Callable[[int, bytes], None],
        admission: Admission,
    ) -> None:
        self.endpoint = endpoint
        self.strangers = 0
        self.received = 0
        """Datagrams or pieces of a stream, strangers' too."""
        self.changes: deque[str] = deque(maxlen=8)
        self._name = name
        self._arrived = arrived
        self._admission = admission
        self._stream: asyncio.WriteTransport | None = None
        self._reader: asyncio.BaseTransport | None = None
        self._datagrams: asyncio.DatagramTransport | None = None
        self._peer: tuple[str, int] | None = None
        self._peer_heard_ns = self._hello_ns = 0
        self._lost = asyncio.Event()

    async def run(self) -> None:
        """Open, and open again whenever the connection is lost; raise OSError if our own port is taken."""
        wait_s, said = RECONNECT_S[0], ""
        while True:
            self._lost.clear()
            try:
                await self._open()
            except OSError as error:
                if error.errno == errno.EADDRINUSE and self.endpoint.kind == "udp-listen":
                    raise OSError(f"{self.endpoint}: {port_taken('udp', self.endpoint.number)}") from error
                if self.endpoint.kind == "udp-listen":
                    raise OSError(f"{self.endpoint}: {error.strerror}") from error
                if str(error) != said:
                    said = str(error)
                    log.warning("%s link: %s: %s; trying again", self._name, self.endpoint, said)
            else:
                if self.endpoint.is_stream:
                    log.info("%s link: %s is open", self._name, self.endpoint)
                wait_s, said = RECONNECT_S[0], ""
                await self._lost.wait()
                log.warning("%s link: %s was lost; opening it again", self._name, self.endpoint)
            await asyncio.sleep(wait_s)
            wait_s = min(2.0 * wait_s, RECONNECT_S[1])

    def send(self, data: bytes) -> None:
        """Send, or drop where nobody is there or where a stream does not keep up."""
        if self._stream is not None:
            if self._stream.get_write_buffer_size() <= MAX_UNSENT_BYTES:
                self._stream.write(data)
        elif self._datagrams is not None and (self.endpoint.kind == "udp-connect" or self._peer is not None):
            self._datagrams.sendto(data, self._peer)

    def close(self) -> None:
        """Close whatever is open."""
        for transport in (self._stream, self._reader, self._datagrams):
            if transport is not None:
                transport.close()

    async def _open(self) -> None:
        loop = asyncio.get_running_loop()
        kind, place, number = self.endpoint
        address = (place, number)
        if kind == "tcp":
            await loop.create_connection(lambda: self, *address)
        elif kind == "udp-connect":
            await loop.create_datagram_endpoint(lambda: self, remote_addr=address)
        elif kind == "udp-listen":
            await loop.create_datagram_endpoint(lambda: self, local_addr=address)
        else:
            with open_serial(place, number) as line:
                self._stream, _ = await loop.connect_write_pipe(
                    asyncio.BaseProtocol, FileIO(os.dup(line.fileno()), "w")
                )
                await loop.connect_read_pipe(lambda: self, FileIO(os.dup(line.fileno()), "r"))

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep the transport (asyncio calls this)."""
        if self.endpoint.kind == "serial":
            self._reader = transport
        elif self.endpoint.kind == "tcp":
            self._stream = cast(asyncio.Transport, transport)
            wire = transport.get_extra_info("socket")
            wire.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            wire.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, TCP_GIVE_UP_MS)
        else:
            self._datagrams = cast(asyncio.DatagramTransport, transport)

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        """Stamp a datagram and pass it on (asyncio calls this)."""
        now_ns = time.monotonic_ns()
        self.received += 1
        if self.endpoint.kind == "udp-listen" and not self._is_from_peer(now_ns, data, addr[:2]):
            self.strangers += 1
            return
        self._arrived(now_ns, data)

    def _is_from_peer(self, now_ns: int, data: bytes, address: tuple[str, int]) -> bool:
        """Tell whether a datagram is the peer's; take its sender as the peer where there is none."""
        silent_ns = now_ns - self._peer_heard_ns
        if address == self._peer:
            if silent_ns > PEER_LOOK_NS and self._admission.sender(data) is Sender.EXPECTED:
                self._peer_heard_ns = now_ns
            return True
        has_peer = self._peer is not None and silent_ns < PEER_SILENT_NS
        if has_peer:
            return False
        if not self._admission.allows(address[0]):
            self._admission.barred(address[0])
            return False
        sender = self._admission.sender(data)
        if sender is not Sender.EXPECTED:
            if sender is Sender.BEHIND and self._datagrams and now_ns - self._hello_ns > HELLO_NS:
                self._hello_ns = now_ns
                self._datagrams.sendto(self._admission.hello(), address)
            return False
        if self._peer is None:
            log.info("%s link: heard %s", self._name, _shown(address))
        else:
            change = f"{_shown(address)} speaks now, {_shown(self._peer)} no more"
            self.changes.append(f"{self._name} link: {change}")
        self._peer, self._peer_heard_ns = address, now_ns
        return True

    def data_received(self, data: bytes) -> None:
        """Stamp a piece of the stream and pass it on (asyncio calls this)."""
        self.received += 1
        self._arrived(time.monotonic_ns(), data)

    def error_received(self, exc: Exception) -> None:
        """Nobody listens there yet (asyncio calls this): the next datagram tries again."""

    def connection_lost(self, exc: Exception | None) -> None:
        """Let `run` open it again (asyncio calls this)."""
        self.close()
        self._stream = self._reader = self._datagrams = None
        self._lost.set()


def _shown(address: tuple[str, int]) -> str:
    return f"{address[0]}:{address[1]}"


def open_serial(device: str, baud: int) -> FileIO:
    """Open a serial line, eight bits raw, without flow control, for us alone; raise OSError if that fails."""
    line = FileIO(os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK), "r+")
    try:
        fcntl.ioctl(line, termios.TIOCEXCL)
        tty.setraw(line.fileno())
        attributes = termios.tcgetattr(line)
        attributes[2] = attributes[2] & ~termios.CRTSCTS | termios.CLOCAL | termios.CREAD
        attributes[4] = attributes[5] = getattr(termios, f"B{baud}")
        termios.tcsetattr(line, termios.TCSANOW, attributes)
    except termios.error as error:
        line.close()
        raise OSError(*error.args) from error
    except OSError:
        line.close()
        raise
    return line
