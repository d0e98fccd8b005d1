"""As many browsers as there may be: nobody keeps others out, or takes memory without end, by opening more."""

import asyncio
import socket
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AsyncExitStack, asynccontextmanager

import aiohttp
import msgspec
import pytest
from aiohttp import WSCloseCode, WSMsgType
from waiting import in_a_loop

from companion.telemetry.schemas import Reply
from dashboard.vehicles import MOST_VEHICLES
from dashboard.web import app, connections
from dashboard.web.command import DashboardOptions, serve
from dashboard.web.fleet import ROWS, Histories, VehicleHistory
from dashboard.web.rows import empty_row
from dashboard.zenoh_client import Subscription
from lab.ports import free_port

WAIT_S = 10.0
STATUSES = round(3.0 / app.STATUS_S)
UPGRADE = (
    b"GET /ws HTTP/1.1\r\nHost: 127.0.0.1:%d\r\nOrigin: http://127.0.0.1:%d\r\nUpgrade: websocket\r\n"
    b"Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
)
Opened = Callable[[int], Awaitable[aiohttp.ClientWebSocketResponse]]


@asynccontextmanager
async def served(token: str = "") -> AsyncIterator[Opened]:
    """A dashboard, and what opens a WebSocket of it from 127.0.0.N."""
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

        yield opened
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
async def test_one_more_takes_the_place_of_the_oldest_of_the_address_that_has_the_most() -> None:
    async with served() as opened:
        ours = await opened(1)
        oldest = await opened(2)
        code = asyncio.create_task(closed(oldest))
        crowd = [await opened(2) for _ in range(app.MOST_BROWSERS + 2)]
        other = await opened(3)
        assert await code == WSCloseCode.TRY_AGAIN_LATER
        alive = await live([ours, other, *crowd])
        assert alive == [True, True] + [False] * 4 + [True] * (app.MOST_BROWSERS - 2)


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
    async with served(token="kelp") as opened, aiohttp.ClientSession() as client:
        address = str((await opened(1))._response.url.origin())  # noqa: SLF001
        headers = {"Origin": address, "Authorization": "Bearer kelp"}
        async with asyncio.timeout(WAIT_S):
            while len(silent) < 2 * MOST_VEHICLES:
                await asyncio.sleep(0.05)
        others = [
            asyncio.create_task(client.post(f"{address}/api/v{number}/release", headers=headers))
            for number in range(7)
        ]
        await asyncio.sleep(0.2)
        async with asyncio.timeout(1.0), client.post(f"{address}/api/v7/release", headers=headers) as answer:
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
    made: list[connections.Connection] = []

    class Noted(connections.Connection):
        def connection_made(self, transport: asyncio.BaseTransport) -> None:
            super().connection_made(transport)
            made.append(self)

    monkeypatch.setattr(connections, "Connection", Noted)
    monkeypatch.setattr(app, "Histories", lambda: seen)
    async with served() as opened, AsyncExitStack() as stack:
        await opened(1)  # it reads
        assert made[0].transport is not None
        port = made[0].transport.get_extra_info("sockname")[1]
        for _ in range(2 * app.MOST_BROWSERS):
            deaf = stack.enter_context(socket.create_connection(("127.0.0.1", port)))
            deaf.sendall(UPGRADE % (port, port))
        alive = list(made)
        async with asyncio.timeout(WAIT_S):
            while len(made) <= 2 * app.MOST_BROWSERS or len(alive) > app.MOST_BROWSERS:
                await asyncio.sleep(0.05)
                alive = [one for one in made if one.transport is not None]
        waiting = [one.transport.get_write_buffer_size() for one in alive if one.transport is not None]
        assert max(waiting) > 0, "they read it all"
        assert max(waiting) < 400_000
