"""`holdfast init` listens: which vehicle is there, and where.

It sends nothing before a vehicle is heard, but where the other side waits to be called (udp-connect).
"""

import asyncio
import logging
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from msgspec.structs import replace

from companion.config import Config
from companion.endpoint import Endpoint
from companion.mavlink.ardusub import FRAMES, NS_PER_S
from companion.predive.app import wired
from companion.predive.check import ARDUPILOT, PRESET_OF, SUBMARINE
from companion.predive.inspection import Inspection

HEARD_S = 2.5
"""How long an endpoint is listened on: a heartbeat comes every second."""
KNOWN_S = 6.0
"""How long version and frame are waited for, then."""
BAUDS = (921600, 230400, 115200)
SERIAL = ("serial0", "ttyAMA*", "ttyACM*", "ttyUSB*")


class Found(NamedTuple):
    """A vehicle: where, its firmware and frame in words, and the nearest shipped one; empty where unknown."""

    endpoint: str
    firmware: str = ""
    frame: str = ""
    preset: str = ""


def serial_lines(devices: Path = Path("/dev")) -> list[list[str]]:
    """Return the endpoints of each serial line of this computer."""
    lines = {path.resolve(): path for pattern in reversed(SERIAL) for path in sorted(devices.glob(pattern))}
    return [[f"serial:{path}:{baud}" for baud in BAUDS] for path in lines.values()]


def search(config: Config, groups: Sequence[Sequence[str]]) -> Found | None:
    """Return the first ArduSub vehicle that is heard; None if none is.

    Groups are listened on at once, the endpoints of a group one after the other.
    """
    log = logging.getLogger("holdfast")
    level = log.level
    log.setLevel(logging.ERROR)  # most of them are not there
    try:
        return asyncio.run(_search(config, groups))
    finally:
        log.setLevel(level)


async def _search(config: Config, groups: Sequence[Sequence[str]]) -> Found | None:
    tasks = [asyncio.create_task(_one_of(config, group)) for group in groups]
    try:
        for task in asyncio.as_completed(tasks):
            if found := await task:
                return found
        return None
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _one_of(config: Config, endpoints: Sequence[str]) -> Found | None:
    for endpoint in endpoints:
        with suppress(OSError):  # our port is taken
            if found := await _listen(replace(config, link=replace(config.link, endpoint=endpoint))):
                return found
    return None


async def _listen(config: Config) -> Found | None:
    endpoint, inspection = Endpoint.parse(config.link.endpoint), Inspection(config)
    begun_s = time.monotonic()
    async with wired(config, inspection) as (link, inbox, wire):
        while not wire.done():
            now_s = time.monotonic_ns() / NS_PER_S
            frames, seen = inspection.step(now_s, inbox.take()), inspection.observed
            beat, lasted_s = seen.heartbeat, time.monotonic() - begun_s
            heard = beat is not None and (beat.vehicle_type, beat.autopilot) == (SUBMARINE, ARDUPILOT)
            for data in frames if heard or endpoint.kind == "udp-connect" else ():
                link.send(data)
            frame = FRAMES.get(seen.parameters.get("FRAME_CONFIG", -1.0), "")
            if heard and ((seen.firmware and frame) or lasted_s > KNOWN_S):
                version = f"ArduSub {seen.firmware.text}" if seen.firmware else ""
                return Found(str(endpoint), version, frame, PRESET_OF.get(frame, ""))
            if not heard and lasted_s > HEARD_S:
                return None
            await asyncio.sleep(1.0 / config.loop.rate_hz)
        wire.result()
        return None
