"""Sockets and the clock around a `Vehicle`: UDP both ways, a TCP server, real-time pacing, clean exit.

And the socket of `--physics-only`, whose clock is the firmware's.
"""

import asyncio
import contextlib
import errno
import itertools
import logging
import signal
import sys
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import cast

from msgspec.structs import replace

from holdfast import port_taken
from sim_bridge.fault_kinds import Fault
from sim_bridge.physics.body import STEP_S, Physics
from sim_bridge.physics.json_physics import DrivenBody, Responder
from sim_bridge.sim_config import SimConfig
from sim_bridge.vehicle import Truth, Vehicle, truth_of
from sim_bridge.zenoh_link import ZenohLink

LOG = logging.getLogger("holdfast.sim")

Endpoint = tuple[str, int]

MAX_CATCH_UP_STEPS = 40
"""What is later than this is dropped from the clock, so that a stalled machine causes no burst."""
MAX_UNSENT_BYTES = 1 << 18
"""A TCP client that lags behind by more is cut off."""
MAX_INBOX = 4096
TRUTH_PERIOD_STEPS = 4
UNKNOWN_MODE = -1
"""Mode in the truth of `--physics-only`: the firmware does not tell its physics."""


@dataclass(frozen=True)
class Settings:
    """Where the vehicle is found."""

    udp_connect: tuple[Endpoint, ...]
    tcp: tuple[Endpoint, ...]
    zenoh: str
    """Endpoint of a Zenoh router or peer; empty for none."""
    vehicle: str
    physics: Endpoint | None = None
    """Where the real firmware sends its frames; then there is no vehicle of ours, and no other endpoint."""
    live_faults: bool = False
    """Whether everybody on Zenoh may break the vehicle."""


class Peers:
    """Every peer's number, how to reach it, and what came in since the last step."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._numbers = itertools.count()
        self._senders: dict[int, Callable[[bytes], None]] = {}
        self.inbox: list[tuple[int, bytes]] = []

    def open(self, send: Callable[[bytes], None], name: str) -> int:
        """Give a new peer its number and tell the vehicle."""
        number = next(self._numbers)
        self._senders[number] = send
        self._vehicle.open_link(number)
        LOG.info("link %d: %s", number, name)
        return number

    def close(self, number: int) -> None:
        """Forget a peer."""
        if self._senders.pop(number, None):
            self._vehicle.close_link(number)
            LOG.info("link %d: closed", number)

    def receive(self, number: int, data: bytes) -> None:
        """Queue bytes for the next step; a flood is cut off."""
        if number in self._senders and len(self.inbox) < MAX_INBOX:
            self.inbox.append((number, data))

    def __len__(self) -> int:
        return len(self._senders)

    def send(self, datagrams: list[tuple[int, bytes]]) -> None:
        """Send what the vehicle says."""
        for number, data in datagrams:
            if sender := self._senders.get(number):
                sender(data)


class _Udp(asyncio.DatagramProtocol):
    """Keeps its transport; nobody listening there, or a peer that went away, is no reason to stop."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast(asyncio.DatagramTransport, transport)

    def error_received(self, exc: Exception) -> None:
        """Go on."""


class _UdpCaller(_Udp):
    """Calls one peer, as a BlueROV2 calls its topside computer, and hears whoever answers on that socket."""

    def __init__(self, links: Peers, endpoint: Endpoint) -> None:
        self._links, self._name = links, "udp, calling {}:{}".format(*endpoint)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        self._number = self._links.open(self._transport.sendto, self._name)

    def datagram_received(self, data: bytes, addr: object) -> None:
        self._links.receive(self._number, data)


class _TcpClient(asyncio.Protocol):
    """One client of the TCP server."""

    def __init__(self, links: Peers) -> None:
        self._links = links

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast(asyncio.Transport, transport)
        host, port = transport.get_extra_info("peername")[:2]
        self._number = self._links.open(self._send, f"tcp from {host}:{port}")

    def data_received(self, data: bytes) -> None:
        self._links.receive(self._number, data)

    def connection_lost(self, exc: Exception | None) -> None:
        self._links.close(self._number)

    def _send(self, data: bytes) -> None:
        if self._transport.get_write_buffer_size() > MAX_UNSENT_BYTES:
            self._transport.abort()
        else:
            self._transport.write(data)


async def _pace(
    vehicle: Vehicle,
    links: Peers,
    asked: deque[Fault],
    publish: Callable[[Truth], None] | None,
    stop: asyncio.Event,
) -> None:
    """Step the vehicle against the monotonic clock without drift; fall behind rather than burst."""
    clock = asyncio.get_running_loop().time
    period_s = vehicle.step_s
    due_s = clock()
    for count in itertools.count(1):
        while asked:
            fault = asked.popleft()
            LOG.info("fault: %s in %g s", fault.kind, fault.at_s)
            vehicle.inject(replace(fault, at_s=vehicle.time_s + fault.at_s))
        inbox, links.inbox = links.inbox, []
        links.send(vehicle.step(inbox))
        if publish and count % TRUTH_PERIOD_STEPS == 0:
            publish(vehicle.truth())
        due_s = max(due_s + period_s, clock() - MAX_CATCH_UP_STEPS * period_s)
        wait_s = due_s - clock()
        if wait_s > 0 or count % TRUTH_PERIOD_STEPS == 0:
            await asyncio.sleep(max(0.0, wait_s))
        if stop.is_set():
            return


def _publisher(
    stack: contextlib.AsyncExitStack, settings: Settings, take: Callable[[Fault], None] | None = None
) -> Callable[[Truth], None] | None:
    if not settings.zenoh:
        return None
    link = ZenohLink(settings.zenoh, settings.vehicle, take)
    stack.callback(link.close)
    return link.put


@contextlib.contextmanager
def _binding(kind: str, port: int) -> Iterator[None]:
    """Let an address that is taken raise an OSError that says by whom."""
    try:
        yield
    except OSError as error:
        if error.errno != errno.EADDRINUSE:
            raise
        raise OSError(port_taken(kind, port)) from error


async def serve(vehicle: Vehicle, settings: Settings, stop: asyncio.Event) -> None:
    """Open every endpoint, then run the vehicle until `stop` is set; OSError for an address that is taken."""
    loop = asyncio.get_running_loop()
    links = Peers(vehicle)
    async with contextlib.AsyncExitStack() as stack:
        for host, port in settings.tcp:
            with _binding("tcp", port):
                server = await loop.create_server(lambda: _TcpClient(links), host, port)
            stack.callback(server.close)
            LOG.info("listening on tcp %s:%d", host, port)
        for endpoint in settings.udp_connect:
            caller, _ = await loop.create_datagram_endpoint(
                partial(_UdpCaller, links, endpoint), remote_addr=endpoint
            )
            stack.callback(caller.close)
            LOG.info("calling udp %s:%d: QGroundControl listens on 14550, and can arm", *endpoint)
        asked: deque[Fault] = deque(maxlen=MAX_INBOX)
        publish = _publisher(stack, settings, asked.append if settings.live_faults else None)
        await _pace(vehicle, links, asked, publish, stop)


class _Physics(_Udp):
    """Answers the frames of the real firmware; whoever sends one gets the reply."""

    def __init__(self, body: DrivenBody, publish: Callable[[Truth], None] | None) -> None:
        self._body, self._publish = body, publish
        self._responder = Responder(body.move)
        self._published_s = 0.0
        self._restarts = -1

    def datagram_received(self, data: bytes, addr: Endpoint) -> None:
        responder, body = self._responder, self._body
        bad = responder.bad
        reply = responder.answer(data, asyncio.get_running_loop().time())
        if reply is None:
            if responder.bad == 1 > bad:
                LOG.warning("%s:%d sends what is no frame of the JSON backend; ignored", *addr)
            return
        self._transport.sendto(reply, addr)
        if responder.restarts != self._restarts:
            self._restarts = responder.restarts
            LOG.info("firmware at %s:%d%s", *addr, ", restarted" if responder.restarts else "")
        time_s = body.physics.time_s
        if self._publish and time_s - self._published_s >= TRUTH_PERIOD_STEPS * STEP_S - 1e-9:
            self._published_s = time_s
            self._publish(truth_of(body.physics, time_s, body.pwm, body.turned_s is not None, UNKNOWN_MODE))


async def serve_physics(
    config: SimConfig, seed: int, endpoint: Endpoint, settings: Settings, stop: asyncio.Event
) -> None:
    """Be the external physics of an ArduSub that sends its frames to `endpoint`, until `stop` is set."""
    body = DrivenBody(Physics(config, seed), config.battery.voltage_v)
    async with contextlib.AsyncExitStack() as stack:
        publish = _publisher(stack, settings)
        with _binding("udp", endpoint[1]):
            transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(
                partial(_Physics, body, publish), local_addr=endpoint
            )
        stack.callback(transport.close)
        LOG.info("physics for ArduSub's JSON backend on udp %s:%d", *endpoint)
        await stop.wait()


def run(config: SimConfig, seed: int, settings: Settings) -> int:
    """Run until SIGINT or SIGTERM; returns the exit status."""
    logging.basicConfig(stream=sys.stderr, level=logging.INFO, format="%(name)s: %(message)s")

    async def main() -> None:
        stop = asyncio.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            asyncio.get_running_loop().add_signal_handler(number, stop.set)
        if settings.physics:
            await serve_physics(config, seed, settings.physics, settings, stop)
        else:
            await serve(Vehicle(config, seed), settings, stop)

    try:
        asyncio.run(main())
    except ValueError as error:
        LOG.error("%s", error)
        return 1
    return 0
