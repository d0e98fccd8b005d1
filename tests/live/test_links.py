"""The companion's wires over real sockets and pseudo-terminals: lost, refused, unplugged, and back again."""

import asyncio
import os
import socket
import time
from contextlib import ExitStack, asynccontextmanager

import pytest
from tools.processes import free_port
from waiting import in_a_loop

from companion.endpoint import Endpoint
from companion.io import links
from companion.io.links import Admission, MavlinkLink
from companion.records import Sender

WAIT_S = 5.0


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(links, "RECONNECT_S", (0.02, 0.1))


def sender(_, data):
    """Whose a datagram is, in these tests."""
    said = {b"vehicle": Sender.EXPECTED, b"lagging": Sender.BEHIND}
    return said.get(data[:7], Sender.STRANGER)


ANYBODY = Admission(sender, lambda: b"hello")


@asynccontextmanager
async def linked(endpoint, admission=ANYBODY):
    """A running link and the list of what arrived on it."""
    heard = []
    link = MavlinkLink(
        Endpoint.parse(endpoint), "test", lambda t_ns, data: heard.append((t_ns, data)), admission
    )
    task = asyncio.create_task(link.run())
    try:
        if endpoint.startswith("udp"):
            await until(lambda: link.unsent is not None)
        yield link, heard
    finally:
        task.cancel()
        link.close()
        await asyncio.gather(task, return_exceptions=True)


async def until(done):
    async with asyncio.timeout(WAIT_S):
        while not done():
            await asyncio.sleep(0.005)


def received(heard):
    return b"".join(data for _, data in heard)


class Server:
    """A TCP server that keeps what it hears and can hang up."""

    def __init__(self, port):
        self.port, self.heard, self.writers = port, b"", []

    async def start(self):
        self.server = await asyncio.start_server(self._client, "127.0.0.1", self.port)

    async def _client(self, reader, writer):
        self.writers.append(writer)
        while data := await reader.read(1024):
            self.heard += data

    async def stop(self):
        self.server.close()
        for writer in self.writers:
            writer.transport.abort()
        self.writers.clear()
        await asyncio.sleep(0.01)


@in_a_loop
async def test_tcp_is_tried_again_until_somebody_listens_and_again_after_a_hang_up():
    server = Server(free_port())
    async with linked(f"tcp:127.0.0.1:{server.port}") as (link, heard):
        await asyncio.sleep(0.1)
        link.send(b"nobody hears this")
        for number in (b"one", b"two"):
            await server.start()
            await until(lambda: server.writers)
            server.writers[-1].write(b"vehicle " + number)
            await until(lambda number=number: received(heard).endswith(number))
            link.send(b"companion " + number)
            await until(lambda number=number: server.heard.endswith(number))
            await server.stop()
        assert server.heard == b"companion onecompanion two"


@in_a_loop
async def test_a_wire_that_cannot_be_closed_is_replaced_all_the_same(monkeypatch):
    server = Server(free_port())
    await server.start()
    async with linked(f"tcp:127.0.0.1:{server.port}") as (link, _):
        await until(lambda: link.unsent is not None)
        with monkeypatch.context() as patch:
            patch.setattr(asyncio.get_running_loop(), "remove_writer", lambda wire: wire.close() or 1 / 0)
            with pytest.raises(ZeroDivisionError):
                link.close()
        await until(lambda: link.unsent is not None and len(server.writers) == 2)
        await server.stop()


@in_a_loop
async def test_a_tcp_peer_that_takes_nothing_costs_no_memory():
    port = free_port()
    with socket.create_server(("127.0.0.1", port)) as server:
        async with linked(f"tcp:127.0.0.1:{port}") as (link, _):
            await until(lambda: link.unsent is not None)
            for _ in range(2000):
                link.send(bytes(8192))
            assert link.unsent <= links.MAX_UNSENT_BYTES + 8192
        server.close()


class Line:
    """A pseudo-terminal behind a name that survives being unplugged."""

    def __init__(self, path):
        self.path, self.name = path, str(path)
        self.plug()

    def plug(self):
        self.master, slave = os.openpty()
        os.set_blocking(self.master, False)
        self.path.unlink(missing_ok=True)
        self.path.symlink_to(os.ttyname(slave))
        os.close(slave)

    def unplug(self):
        os.close(self.master)
        self.path.unlink()

    def read(self):
        try:
            return os.read(self.master, 4096)
        except OSError:
            return b""


EVERY_BYTE = bytes(range(256))
"""Among them those that a terminal would eat, turn round or echo: ^C, ^D, ^S, CR, LF."""


@in_a_loop
async def test_serial_carries_every_byte_both_ways_and_survives_being_unplugged(tmp_path):
    line = Line(tmp_path / "ttyROV")
    async with linked(f"serial:{line.name}:115200") as (link, heard):
        for _ in range(2):
            heard.clear()
            await until(lambda: link.unsent is not None)
            os.write(line.master, EVERY_BYTE)
            await until(lambda: received(heard) == EVERY_BYTE)
            link.send(EVERY_BYTE)
            back = b""
            async with asyncio.timeout(WAIT_S):
                while len(back) < 256:
                    back += line.read()
                    await asyncio.sleep(0.005)
            assert back == EVERY_BYTE
            line.unplug()
            await until(lambda: link.unsent is None)
            link.send(b"into the void")
            await asyncio.sleep(0.1)
            line.plug()
    line.unplug()


@in_a_loop
async def test_what_is_no_serial_line_is_said_and_tried_again(tmp_path, caplog):
    plain = tmp_path / "file"
    plain.write_text("")
    async with linked(f"serial:{plain}:115200"):
        await until(lambda: "Inappropriate ioctl" in caplog.text)
        await asyncio.sleep(0.2)
    assert caplog.text.count("Inappropriate ioctl") == 1


@pytest.fixture
def senders():
    """Three senders, each with an address of its own, to a free port: (port, senders)."""
    port = free_port(socket.SOCK_DGRAM)
    with ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(3)]
        for number, peer in enumerate(sockets, start=1):
            peer.bind((f"127.0.0.{number}", 0))
            peer.connect(("127.0.0.1", port))
            peer.setblocking(False)
        yield port, sockets


@in_a_loop
async def test_a_udp_listener_turns_to_another_peer_only_when_the_first_falls_silent(monkeypatch, senders):
    monkeypatch.setattr(links, "PEER_SILENT_NS", 200_000_000)
    port, (first, second, _) = senders
    async with linked(f"udp-listen:127.0.0.1:{port}") as (link, heard):
        link.send(b"to nobody")
        began = time.monotonic_ns()
        first.send(b"vehicle 1")
        await until(lambda: heard)
        second.send(b"vehicle 2")
        await until(lambda: link.strangers == 1)
        link.send(b"answer")
        await until(lambda: _got(first) == b"answer")
        assert [data for _, data in heard] == [b"vehicle 1"]
        assert began <= heard[0][0] <= time.monotonic_ns()
        assert not link.changes
        await asyncio.sleep(0.25)
        second.send(b"vehicle 2")
        await until(lambda: len(heard) == 2)
        link.send(b"new answer")
        await until(lambda: _got(second) == b"new answer")
        assert _got(first) == b""
        (change,) = link.changes
        assert f"127.0.0.2:{second.getsockname()[1]} speaks now" in change
        assert f"127.0.0.1:{first.getsockname()[1]} no more" in change


@in_a_loop
async def test_no_byte_of_a_stranger_takes_the_link_and_none_arrives(senders):
    """Before the vehicle calls anybody may send anything; it is counted, and the vehicle is heard at once."""
    port, (stranger, vehicle, _) = senders
    async with linked(f"udp-listen:127.0.0.1:{port}") as (link, heard):
        stranger.send(b"\0")
        await until(lambda: link.strangers == 1)
        link.send(b"to nobody")
        vehicle.send(b"vehicle")
        stranger.send(b"\0")
        await until(lambda: link.strangers == 2 and heard)
        assert received(heard) == b"vehicle"
        link.send(b"answer")
        await until(lambda: _got(vehicle) == b"answer")
        assert _got(stranger) == b""


@in_a_loop
async def test_whose_clock_is_behind_is_told_the_time_and_does_not_take_the_link(senders):
    """A replay gets no more than that heartbeat."""
    port, (lagging, vehicle, _) = senders
    async with linked(f"udp-listen:127.0.0.1:{port}") as (link, heard):
        lagging.send(b"lagging")
        await until(lambda: _got(lagging) == b"hello")
        assert not heard
        vehicle.send(b"vehicle")
        await until(lambda: heard)
        lagging.send(b"lagging")
        await until(lambda: link.strangers == 2)
        await asyncio.sleep(0.05)
        assert _got(lagging) == b""


@in_a_loop
async def test_a_peer_that_only_makes_noise_loses_the_link(monkeypatch, senders):
    monkeypatch.setattr(links, "PEER_SILENT_NS", 200_000_000)
    port, (first, second, _) = senders
    async with linked(f"udp-listen:127.0.0.1:{port}") as (link, heard):
        first.send(b"vehicle")
        await until(lambda: heard)
        async with asyncio.timeout(WAIT_S):
            while not link.changes:
                first.send(b"\0")
                second.send(b"vehicle")
                await asyncio.sleep(0.02)
        count = len(heard)
        first.send(b"\0")
        second.send(b"vehicle")
        await until(lambda: len(heard) > count)
        assert heard[-1][1] == b"vehicle"


@in_a_loop
async def test_addresses_that_are_not_allowed_never_take_the_link(senders):
    port, (first, second, third) = senders
    admission = ANYBODY._replace(allow=["127.0.0.2/31", "10.0.0.0/8"])
    async with linked(f"udp-listen:127.0.0.1:{port}", admission) as (link, heard):
        first.send(b"vehicle 1")
        await until(lambda: link.strangers == 1)
        third.send(b"vehicle 3")
        second.send(b"vehicle 2")
        await until(lambda: link.strangers == 2)
        assert received(heard) == b"vehicle 3"


def _got(peer):
    try:
        return peer.recv(4096)
    except (BlockingIOError, ConnectionError):
        return b""


@in_a_loop
async def test_a_port_that_is_taken_stops_the_process():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        endpoint = Endpoint.parse(f"udp-listen:127.0.0.1:{taken.getsockname()[1]}")
        with pytest.raises(OSError, match="is taken by"):
            await MavlinkLink(endpoint, "test", lambda t_ns, data: None, ANYBODY).run()
