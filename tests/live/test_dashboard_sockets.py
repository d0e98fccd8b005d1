"""As many browsers as there may be: nobody keeps others out of the dashboard by opening more."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AsyncExitStack, asynccontextmanager

import aiohttp
from aiohttp import WSCloseCode, WSMsgType, test_utils

from dashboard.web import app
from dashboard.web.options import DashboardOptions
from lab.ports import free_port

WAIT_S = 10.0
STATUSES = round(3.0 / app.STATUS_S)
Opened = Callable[[int], Awaitable[aiohttp.ClientWebSocketResponse]]


@asynccontextmanager
async def served() -> AsyncIterator[Opened]:
    """A dashboard, and what opens a WebSocket of it from 127.0.0.N."""
    settings = DashboardOptions("127.0.0.1", 0, (), f"tcp/127.0.0.1:{free_port()}", token="")
    async with AsyncExitStack() as stack:
        server = test_utils.TestServer(app.Dashboard(settings).application())
        await stack.enter_async_context(server)

        async def opened(number: int) -> aiohttp.ClientWebSocketResponse:
            connector = aiohttp.TCPConnector(local_addr=(f"127.0.0.{number}", 0))
            client = await stack.enter_async_context(aiohttp.ClientSession(connector=connector))
            address = f"http://127.0.0.1:{server.port}"
            return await client.ws_connect(f"{address}/ws", headers={"Origin": address})

        yield opened


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


def test_one_more_takes_the_place_of_the_oldest_of_the_address_that_has_the_most() -> None:
    async def main() -> None:
        async with served() as opened:
            ours = await opened(1)
            oldest = await opened(2)
            code = asyncio.create_task(closed(oldest))
            crowd = [await opened(2) for _ in range(app.MOST_BROWSERS + 2)]
            other = await opened(3)
            assert await code == WSCloseCode.TRY_AGAIN_LATER
            alive = await live([ours, other, *crowd])
            assert alive == [True, True] + [False] * 4 + [True] * (app.MOST_BROWSERS - 2)

    asyncio.run(main())


def test_a_browser_that_leaves_makes_room() -> None:
    async def main() -> None:
        async with served() as opened:
            browsers = [await opened(1) for _ in range(app.MOST_BROWSERS)]
            await browsers.pop().close()
            await asyncio.sleep(0.2)
            browsers.append(await opened(1))
            assert all(await live(browsers))

    asyncio.run(main())
