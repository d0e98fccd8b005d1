"""`holdfast check` as a process: a wire, a clock and an `Inspection`; it ends by itself."""

import asyncio
import logging
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from companion.config import Config
from companion.endpoint import Endpoint
from companion.io.links import Admission, MavlinkLink
from companion.io.process import on_ending_signal
from companion.mavlink.ardusub import NS_PER_S
from companion.mavlink.inbox import Inbox
from companion.mavlink.signing import signing_of
from companion.mavlink.timestamps import timestamps_of
from companion.predive.check import CheckRow
from companion.predive.inspection import Inspection

Origin = tuple[float, float]


def inspect(config: Config, *, origin: Origin | None, thrusters: bool) -> tuple[list[CheckRow], list[str]]:
    """Look at the vehicle behind `link.endpoint`; return the list and what was done beside looking.

    Raises OSError when our own port is taken, KeyboardInterrupt when a signal breaks it off.
    """
    logging.getLogger("holdfast").setLevel(logging.WARNING)
    signing = signing_of(config, time.time())
    inspection = Inspection(config, origin=origin, thrusters=thrusters, signing=signing)
    timestamps = timestamps_of(config, vehicle=signing)
    if timestamps is not None:
        timestamps.start()
    try:
        asyncio.run(_inspect(config, inspection))
    except asyncio.CancelledError:
        raise KeyboardInterrupt from None
    finally:
        if timestamps is not None:
            timestamps.close()
    return inspection.rows, inspection.notes


async def _inspect(config: Config, inspection: Inspection) -> None:
    here = asyncio.current_task()
    assert here is not None
    on_ending_signal(asyncio.get_running_loop(), here.cancel)
    async with wired(config, inspection) as (link, inbox, wire):
        try:
            while not inspection.done and not wire.done():
                for data in inspection.step(time.monotonic_ns() / NS_PER_S, inbox.take()):
                    link.send(data)
                await asyncio.sleep(1.0 / config.loop.rate_hz)
            if wire.done():
                wire.result()
        finally:
            for data in inspection.shutdown_frames():
                link.send(data)


@asynccontextmanager
async def wired(
    config: Config, inspection: Inspection
) -> AsyncIterator[tuple[MavlinkLink, Inbox, asyncio.Task[None]]]:
    """Give the link to `link.endpoint`, what arrives, and the task that ends where the link fails."""
    endpoint = Endpoint.parse(config.link.endpoint)
    inbox = Inbox(endpoint.is_stream)
    admission = Admission(inspection.sender, inspection.hello, config.link.allow, inspection.heard.barred)
    link = MavlinkLink(endpoint, "vehicle", inbox.add, admission)
    wire = asyncio.create_task(link.run())
    try:
        yield link, inbox, wire
    finally:
        wire.cancel()
        link.close()
