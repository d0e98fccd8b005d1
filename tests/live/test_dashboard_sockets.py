"""As many browsers as there may be: nobody keeps others out, or takes memory without end, by opening more."""

import asyncio
import socket
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from typing import NamedTuple

import aiohttp
import msgspec
import pytest
from aiohttp import WSCloseCode, WSMsgType
from tools.processes import free_port
from waiting import in_a_loop

from companion.telemetry.schemas import Reply
from dashboard.heard_vehicles import MOST_VEHICLES
from dashboard.web import app, connections
from dashboard.web.command import DashboardOptions, serve
from dashboard.web.fleet import ROWS, Histories, VehicleHistory
from dashboard.web.rows import empty_row
from dashboard.zenoh_client import Subscription

WAIT_S = 10.0
STATUSES = round(3.0 / app.STATUS_S)
UPGRADE = (
    b"GET /ws HTTP/1.1\r\nHost: 127.0.0.1:%d\r\nOrigin: http://127.0.0.1:%d\r\nUpgrade: websocket\r\n"
    b"Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
)
HALF = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: "
NO_BODY = b"POST /api/token HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 4000\r\n\r\n"
UNREAD = 40 * b"GET /static/uplot/uPlot.iife.min.js HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
NO_HTTP = b"GET / HTTP/1.1\r\nno header\r\n\r\n"
Opened = Callable[[int], Awaitable[aiohttp.ClientWebSocketResponse]]


class Served(NamedTuple):
    """A dashboard: its port, what opens a WebSocket of it from 127.0.0.N, and all connections ever."""

    port: int
    opened: Opened
    made: list[connections.Connection]

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def alive(self) -> list[connections.Connection]:
        return [one for one in self.made if one.transport is not None]


@asynccontextmanager
async def served(monkeypatch: pytest.MonkeyPatch, token: str = "") -> AsyncIterator[Served]:
    made: list[connections.Connection] = []

    class Noted(connections.Connection):
        def connection_made(self, transport: asyncio.BaseTransport) -> None:
            super().connection_made(transport)
            made.append(self)

    monkeypatch.setattr(connections, "Connection", Noted)
    settings = DashboardOptions("127.0.0.1", 0, (), f"tcp/127.0.0.1:{free_port()}", token=token)
    stop = asyncio.Event()
    port: asyncio.Future[int] = asyncio.get_running_loop().create_future()
    serving = asyncio.create_task(serve(settings, stop, port.set_result))
    address = f"http://127.0.0.1:{await port}"
    async with AsyncExitStack() as stack:

        async def opened(number: int) -> aiohttp.ClientWebSocketResponse:
            connector = aiohttp.TCPConnector(local_addr=(f"127.0.0.{number}", 0))
            client = await stack.enter_async_context(aiohttp.ClientSession(connector=connector))
            return await client.ws_connect(f"{address}/ws", headers={"Origin": address})

        yield Served(port.result(), opened, made)
    stop.set()
    await serving


async def live(browsers: list[aiohttp.ClientWebSocketResponse]) -> list[bool]:
    """Read what waits and three seconds more; tell which of them are still open."""

    async def read(browser: aiohttp.ClientWebSocketResponse) -> bool:
        for _ in range(STATUSES):
            message = await browser.receive(WAIT_S)
            if message.type in (WSMsgType.CLOSE, WSMsgType.CLOSING, WSMsgType.CLOSED):
                return False
        return True

    return await asyncio.gather(*map(read, browsers))


async def closed(browser: aiohttp.ClientWebSocketResponse) -> int | None:
    """Read to the end; return why it ended."""
    async for _ in browser:
        pass
    return browser.close_code


@in_a_loop
async def test_one_more_takes_the_place_of_the_oldest_of_the_address_that_has_the_most(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with served(monkeypatch) as dashboard:
        ours = await dashboard.opened(1)
        oldest = await dashboard.opened(2)
        code = asyncio.create_task(closed(oldest))
        crowd = [await dashboard.opened(2) for _ in range(app.MOST_BROWSERS + 2)]
        other = await dashboard.opened(3)
        assert await code == WSCloseCode.TRY_AGAIN_LATER
        alive = await live([ours, other, *crowd])
        assert alive == [True, True] + [False] * 4 + [True] * (app.MOST_BROWSERS - 2)


@in_a_loop
async def test_half_finished_requests_and_what_is_no_http_keep_nobody_out_and_fill_no_log(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Thousands that were all kept took the files that a process may open."""
    monkeypatch.setattr(connections, "PATIENCE_S", 5.0)
    async with (
        served(monkeypatch) as dashboard,
        aiohttp.ClientSession() as client,
        AsyncExitStack() as stack,
    ):

        async def say(words: bytes) -> asyncio.StreamReader:
            reader, writer = await asyncio.open_connection("127.0.0.1", dashboard.port)
            stack.callback(writer.close)
            writer.write(words)
            return reader

        said = (b"", HALF, NO_BODY, UNREAD, NO_HTTP)
        lines = [await say(words) for words in said * (connections.MOST // 2)]
        for _ in range(10):
            async with client.get(dashboard.address) as page:
                assert page.status == 200
            assert len(dashboard.alive()) <= connections.MOST
        async with asyncio.timeout(WAIT_S + connections.PATIENCE_S):
            await asyncio.gather(*(line.read() for line in lines), return_exceptions=True)
    assert not [record for record in caplog.records if connections.is_ours(record)]


@in_a_loop
async def test_a_release_waits_behind_no_vehicle_that_does_not_answer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """With 31 names on Zenoh it took 12 s."""
    seen = Histories()
    seen.vehicles |= {f"v{number}": VehicleHistory(f"v{number}") for number in range(MOST_VEHICLES)}
    answers = msgspec.json.encode(Reply(done=True, said="released"))
    silent: list[str] = []

    def ask(self: Subscription, key: str, payload: bytes = b"", timeout_s: float = 8.0) -> bytes | None:
        if key.endswith("v7/command/release"):
            return answers
        silent.append(key)
        time.sleep(timeout_s)
        return None

    monkeypatch.setattr(Subscription, "ask", ask)
    monkeypatch.setattr(app, "Histories", lambda: seen)
    async with served(monkeypatch, token="kelp") as dashboard, aiohttp.ClientSession() as client:
        headers = {"Origin": dashboard.address, "Authorization": "Bearer kelp"}
        release = f"{dashboard.address}/api/v%d/release"
        async with asyncio.timeout(WAIT_S):
            while len(silent) < 2 * MOST_VEHICLES:
                await asyncio.sleep(0.05)
        others = [asyncio.create_task(client.post(release % n, headers=headers)) for n in range(7)]
        await asyncio.sleep(0.2)
        async with asyncio.timeout(1.0), client.post(release % 7, headers=headers) as answer:
            assert (await answer.json())["done"]
        for other in others:
            other.cancel()


@in_a_loop
async def test_who_reads_nothing_takes_little_memory_and_is_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    full = VehicleHistory("kelp")
    for number in range(ROWS):
        full.ring.append(0.02 * number, empty_row())
    seen = Histories()
    seen.vehicles["kelp"] = full
    monkeypatch.setattr(app, "Histories", lambda: seen)
    async with served(monkeypatch) as dashboard, AsyncExitStack() as stack:
        await dashboard.opened(1)  # it reads
        for _ in range(2 * app.MOST_BROWSERS):
            deaf = stack.enter_context(socket.create_connection(("127.0.0.1", dashboard.port)))
            deaf.sendall(UPGRADE % (dashboard.port, dashboard.port))
        async with asyncio.timeout(WAIT_S):
            while len(dashboard.made) <= 2 * app.MOST_BROWSERS or len(dashboard.alive()) > app.MOST_BROWSERS:
                await asyncio.sleep(0.05)
        waiting = [one.transport.get_write_buffer_size() for one in dashboard.alive() if one.transport]
        assert max(waiting) > 0, "they read it all"
        assert max(waiting) < 400_000
