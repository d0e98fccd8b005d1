"""What the dashboard costs, measured beside a simulated dive.

Server: processor time of its process with 0, 1, 2, 4 browsers in turn, each turn equally long, twice.
Page: bytes, time to the first plot and frames per second in Chromium, at 1440 and at 820 px.
"""

import asyncio
import shutil
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

import aiohttp

from lab.demo.crew import Crew
from lab.operations.bounds import Bound
from lab.ports import free_port
from lab.usage import cpu_s

TURNS = (0, 1, 2, 4)
START_S = 15.0
CHROMIUM = ("--no-sandbox", "--headless", "--disable-gpu", "--disable-background-networking")
PAGE = """() => {
  const parts = performance.getEntriesByType("resource").concat(performance.getEntriesByType("navigation"));
  return [parts.reduce((sum, part) => sum + part.encodedBodySize, 0), holdfast.count.firstPlot];
}"""
FRAMES = "[holdfast.count.frames, performance.now(), holdfast.count.drawMs]"


def dashboard_cost(seconds: float) -> list[Bound]:
    """Measure with turns of so many seconds. Raises ChildError."""
    return asyncio.run(_measured(seconds))


async def _measured(seconds: float) -> list[Bound]:
    zenoh, mavlink, port = free_port(), free_port(), free_port()
    endpoint = f"tcp/127.0.0.1:{zenoh}"
    with tempfile.TemporaryDirectory() as folder, Crew(Path(folder)) as crew:
        settings = (f"link.endpoint=udp-listen:127.0.0.1:{mavlink}", f"telemetry.endpoint={endpoint}")
        crew.start("run", "--engage", "--arm", "--depth", "2", *(f"--set={setting}" for setting in settings))
        crew.start("dashboard", "--connect", endpoint, "--listen", f"127.0.0.1:{port}")
        crew.start("sim", "--udp-connect", f"127.0.0.1:{mavlink}", "--zenoh", endpoint)
        await asyncio.sleep(START_S)
        crew.check()
        pid = crew.pids()["dashboard"]
        costs: dict[int, list[float]] = defaultdict(list)
        for _ in range(2):
            for browsers in TURNS:
                costs[browsers].append(await _turn(pid, port, browsers, seconds))
        bounds = [
            Bound(f"server with {browsers} browsers", 50.0 * sum(shares), "% of a core")
            for browsers, shares in costs.items()
        ]
        further = 50.0 * (sum(costs[4]) - sum(costs[1])) / 3
        return [*bounds, Bound("each further browser", further, "% of a core"), *await _pages(port, seconds)]


async def _turn(pid: int, port: int, browsers: int, seconds: float) -> float:
    """Return the share of a core that the server takes while so many WebSockets are read."""
    origin = f"http://127.0.0.1:{port}"
    async with aiohttp.ClientSession(headers={"Origin": origin}) as session:
        readers = [asyncio.create_task(_read(session, f"{origin}/ws")) for _ in range(browsers)]
        await asyncio.sleep(1.0)  # the history is sent
        begun, begun_s = cpu_s(pid), time.monotonic()
        await asyncio.sleep(seconds)
        share = (cpu_s(pid) - begun) / (time.monotonic() - begun_s)
        for reader in readers:
            reader.cancel()
        await asyncio.gather(*readers, return_exceptions=True)
    return share


async def _read(session: aiohttp.ClientSession, url: str) -> None:
    async with session.ws_connect(url, max_msg_size=0) as line:
        async for _ in line:
            pass


async def _pages(port: int, seconds: float) -> list[Bound]:
    from playwright.async_api import async_playwright

    chromium = shutil.which("chromium")
    if chromium is None:
        sys.stderr.write("no chromium here: nothing is said of the page. See .ci/apt\n")
        return []
    bounds = []
    async with async_playwright() as play:
        browser = await play.chromium.launch(executable_path=chromium, args=CHROMIUM)
        for width, height in ((1440, 900), (820, 1180)):
            page = await browser.new_page(viewport={"width": width, "height": height})
            await page.goto(f"http://127.0.0.1:{port}/engineer")
            await asyncio.sleep(2.0)
            size, first_ms = await page.evaluate(PAGE)
            at_first: list[Any] = await page.evaluate(FRAMES)
            await asyncio.sleep(seconds)
            after: list[Any] = await page.evaluate(FRAMES)
            frames, ms, draw_ms = (late - early for late, early in zip(after, at_first, strict=True))
            bounds += [
                Bound(f"page at {width} px", size / 1000, "kB"),
                Bound(f"page at {width} px: first plot after", first_ms, "ms"),
                Bound(f"page at {width} px: frames", 1000 * frames / ms, "a second"),
                Bound(f"page at {width} px: to draw a frame", draw_ms / frames, "ms"),
            ]
            await page.close()
        await browser.close()
    return bounds
