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
from contextlib import suppress
from io import FileIO
from ipaddress import ip_address, ip_network
from typing import NamedTuple

from companion.endpoint import Endpoint
from companion.mavlink.ardusub import NS_PER_S
from companion.records import Sender
from holdfast import port_taken

PEER_SILENT_NS = 2_500_000_000
"""Longest silence of a peer: of a ground station that sends heartbeats alone, two may be lost."""
PEER_LOOK_NS = 100_000_000
"""The sender of a peer's datagrams is checked once in this time."""
RECONNECT_S = (0.25, 4.0)  # first and longest wait
HELLO_NS = 200_000_000  # at most 5 heartbeats a second to a stranger
MAX_DATAGRAM = 65507  # of UDP over IPv4
MOST_READ = 16
"""Pieces that are read at once: a vehicle says five in a row, and what waits behind may be a flood."""
MAX_UNSENT_BYTES = 1 << 16
"""A stream with more unsent bytes gets nothing until it has caught up: old commands are worse than none."""
TCP_GIVE_UP_MS = 5000
"""A TCP peer that acknowledges nothing for this time is gone: a pulled cable closes no connection."""

log = logging.getLogger("holdfast")


class Admission(NamedTuple):
    """Who may become the peer of a link that listens.

    `sender` says who sent a datagram, by its arrival (s) and bytes; who is BEHIND gets the time by `hello`.
    `allow` lists addresses and networks; empty allows all; `barred` gets arrival and host of the others.
    """

    sender: Callable[[float, bytes], Sender]
    hello: Callable[[], bytes]
    allow: Sequence[str] = ()
    barred: Callable[[float, str], None] = lambda *_: None

    def allows(self, host: str) -> bool:
        """Tell whether an address is within `allow`."""
        address = ip_address(host)
        address = getattr(address, "ipv4_mapped", None) or address
        return not self.allow or any(address in ip_network(network) for network in self.allow)


class MavlinkLink:
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
        self.changes: deque[str] = deque(maxlen=8)
        self._listens = endpoint.kind == "udp-listen"
        self._name = name
        self._arrived = arrived
        self._admission = admission
        self._wire: socket.socket | FileIO | None = None
        self._unsent = bytearray()
        self._peer: tuple[str, int] | None = None
        self._peer_heard_ns = self._hello_ns = 0
        self._lost = asyncio.Event()

    @property
    def unsent(self) -> int | None:
        """Bytes of a stream that wait; None where nothing is open."""
        return None if self._wire is None else len(self._unsent)

    async def run(self) -> None:
        """Open, and open again whenever the connection is lost; raise OSError if our own port is taken."""
        wait_s, said = RECONNECT_S[0], ""
        while True:
            self._lost.clear()
            try:
                wire = self._wire = await self._opened()
            except OSError as error:
                if self._listens:
                    taken = error.errno == errno.EADDRINUSE
                    why = port_taken("udp", self.endpoint.number) if taken else error.strerror
                    raise OSError(f"{self.endpoint}: {why}") from error
                if str(error) != said:
                    said = str(error)
                    log.warning("%s link: %s: %s; trying again", self._name, self.endpoint, said)
            else:
                asyncio.get_running_loop().add_reader(wire, self.read)
                if self.endpoint.is_stream:
                    log.info("%s link: %s is open", self._name, self.endpoint)
                wait_s, said = RECONNECT_S[0], ""
                await self._lost.wait()
                log.warning("%s link: %s was lost; opening it again", self._name, self.endpoint)
            await asyncio.sleep(wait_s)
            wait_s = min(2.0 * wait_s, RECONNECT_S[1])

    async def _opened(self) -> socket.socket | FileIO:
        kind, place, number = self.endpoint
        if kind == "serial":
            return open_serial(place, number)
        loop, failed = asyncio.get_running_loop(), OSError("no address")
        wanted = socket.SOCK_STREAM if kind == "tcp" else socket.SOCK_DGRAM
        for family, style, protocol, _, address in await loop.getaddrinfo(place, number, type=wanted):
            wire = socket.socket(family, style, protocol)
            wire.setblocking(False)
            try:
                if self._listens:
                    wire.bind(address)
                else:
                    await loop.sock_connect(wire, address)
            except BaseException as error:
                wire.close()
                if not isinstance(error, OSError):
                    raise
                failed = error
                continue
            if kind == "tcp":
                wire.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                wire.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, TCP_GIVE_UP_MS)
            return wire
        raise failed

    def read(self, most: int = MOST_READ) -> None:
        """Stamp and pass on what waits, at most this many pieces."""
        for _ in range(most):
            if self._wire is None:
                return
            address: tuple[str, int] | None = None
            try:
                if self._listens and isinstance(self._wire, socket.socket):
                    data, address = self._wire.recvfrom(MAX_DATAGRAM)
                else:
                    data = os.read(self._wire.fileno(), MAX_DATAGRAM)
            except BlockingIOError:
                return
            except OSError:
                self._failed()
                return
            now_ns = time.monotonic_ns()
            if self.endpoint.is_stream and not data:
                self.close()
            elif address is not None and not self._is_from_peer(now_ns, data, address[:2]):
                self.strangers += 1
            else:
                self._arrived(now_ns, data)

    def send(self, data: bytes) -> None:
        """Send, or drop where nobody is there or where a stream does not keep up."""
        if self._wire is None or len(self._unsent) > MAX_UNSENT_BYTES:
            return
        if self.endpoint.is_stream:
            self._unsent += data
            self._write()
        elif self._peer is not None:
            self._send_to(self._peer, data)
        elif not self._listens:
            try:
                os.write(self._wire.fileno(), data)
            except OSError:
                self._failed()

    def _send_to(self, address: tuple[str, int], data: bytes) -> None:
        if isinstance(self._wire, socket.socket):
            with suppress(OSError):
                self._wire.sendto(data, address)

    def _write(self) -> None:
        """Write what a stream takes now; the rest when it takes more."""
        wire, loop = self._wire, asyncio.get_running_loop()
        if wire is None:
            return
        try:
            del self._unsent[: os.write(wire.fileno(), self._unsent)]
        except BlockingIOError:
            pass
        except OSError:
            self._failed()
            return
        if self._unsent:
            loop.add_writer(wire, self._write)
        else:
            loop.remove_writer(wire)

    def _failed(self) -> None:
        """Let `run` open a stream again; of a datagram nobody listens there yet: the next one tries again."""
        if self.endpoint.is_stream:
            self.close()

    def close(self) -> None:
        """Close the wire; while `run` goes on, it opens another, even where closing fails."""
        self._lost.set()
        wire, self._wire = self._wire, None
        self._unsent.clear()
        if wire is not None:
            loop = asyncio.get_running_loop()
            loop.remove_reader(wire)
            loop.remove_writer(wire)
            wire.close()

    def _is_from_peer(self, now_ns: int, data: bytes, address: tuple[str, int]) -> bool:
        """Tell whether a datagram is the peer's; take its sender as the peer where there is none."""
        silent_ns, t_s = now_ns - self._peer_heard_ns, now_ns / NS_PER_S
        if address == self._peer:
            if silent_ns > PEER_LOOK_NS and self._admission.sender(t_s, data) is Sender.EXPECTED:
                self._peer_heard_ns = now_ns
            return True
        if self._peer is not None and silent_ns < PEER_SILENT_NS:
            return False
        if not self._admission.allows(address[0]):
            self._admission.barred(t_s, address[0])
            return False
        sender = self._admission.sender(t_s, data)
        if sender is not Sender.EXPECTED:
            if sender is Sender.BEHIND and now_ns - self._hello_ns > HELLO_NS:
                self._hello_ns = now_ns
                self._send_to(address, self._admission.hello())
            return False
        if self._peer is None:
            log.info("%s link: heard %s", self._name, _shown(address))
        else:
            change = f"{_shown(address)} speaks now, {_shown(self._peer)} no more"
            self.changes.append(f"{self._name} link: {change}")
        self._peer, self._peer_heard_ns = address, now_ns
        return True


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
