"""`holdfast foxglove`, as a program that speaks Foxglove's WebSocket protocol sees it."""

import json
import math
import re
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import aiohttp
import msgspec
import pytest
from waiting import in_a_loop

from companion.io.zenoh_publisher import Publisher
from companion.records import ControlSample
from companion.telemetry import schemas as telemetry
from lab.ports import free_port

WAIT_S = 20.0
MESSAGE_DATA = 1
HEAD = struct.Struct("<BIQ")
"""Opcode, subscription, log time in ns."""
MakeSample = Callable[..., ControlSample]


@contextmanager
def published(endpoint: str, make_sample: MakeSample) -> Iterator[None]:
    """A companion called kelp, at 50 Hz."""
    stop = threading.Event()

    def run(publisher: Publisher) -> None:
        while not stop.wait(0.02):
            publisher.offer(make_sample(t_s=time.monotonic()))

    with Publisher("kelp", endpoint) as publisher:
        thread = threading.Thread(target=run, args=(publisher,))
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join()


@contextmanager
def served(endpoint: str, *options: str) -> Iterator[str]:
    """`holdfast foxglove` on a free port; yield its address."""
    command = [sys.executable, "-m", "holdfast", "foxglove", "--connect", endpoint, *options]
    with subprocess.Popen(
        [*command, "--listen", f"127.0.0.1:{free_port()}"], stdout=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdout is not None
            said = process.stdout.readline()
            yield re.findall(r"ws://127\.0\.0\.1:\d+", said)[0]
            process.send_signal(signal.SIGINT)
            assert process.wait(10) == 130
        finally:
            process.kill()


async def texts(client: aiohttp.ClientWebSocketResponse) -> dict[str, Any]:
    """The next message of the server that is JSON."""
    while True:
        message = await client.receive(WAIT_S)
        if message.type is aiohttp.WSMsgType.TEXT:
            return dict(json.loads(message.data))


async def advertised(client: aiohttp.ClientWebSocketResponse, topics: set[str]) -> dict[str, Any]:
    """Channels by topic, as soon as all of these are there."""
    channels: dict[str, Any] = {}
    while not topics <= channels.keys():
        message = await texts(client)
        if message["op"] == "advertise":
            channels |= {channel["topic"]: channel for channel in message["channels"]}
    return channels


async def sample(client: aiohttp.ClientWebSocketResponse, number: int) -> tuple[int, dict[str, Any]]:
    """The next message of a subscription: its time, and what is in it."""
    while True:
        message = await client.receive(WAIT_S)
        if message.type is aiohttp.WSMsgType.BINARY:
            opcode, subscription, log_ns = HEAD.unpack_from(message.data)
            if (opcode, subscription) == (MESSAGE_DATA, number):
                return log_ns, dict(json.loads(message.data[HEAD.size :]))


async def subscribed(client: aiohttp.ClientWebSocketResponse, *channels: dict[str, Any]) -> None:
    subscriptions = [{"id": number, "channelId": channel["id"]} for number, channel in enumerate(channels)]
    await client.send_json({"op": "subscribe", "subscriptions": subscriptions})


def layout_topics(file: Path) -> dict[str, set[str]]:
    """The fields of each topic that a layout shows."""
    panels = json.loads(file.read_text())["configById"].values()
    topics: dict[str, set[str]] = {topic: set() for panel in panels for topic in panel.get("topics", ())}
    for path in (path["value"] for panel in panels for path in panel.get("paths", ())):
        topic, _, name = path.partition(".")
        topics.setdefault(topic, set()).add(name)
    return topics


@in_a_loop
async def test_a_client_finds_all_that_the_layout_shows_and_decodes_it(
    make_sample: MakeSample, tmp_path: Path
) -> None:
    endpoint, layout = f"tcp/127.0.0.1:{free_port()}", tmp_path / "layout.json"
    subprocess.run(
        [sys.executable, "-m", "holdfast", "foxglove", "--name", "kelp", "--layout", str(layout)], check=True
    )
    shown = layout_topics(layout)
    assert {"/tf", "/degrees", "holdfast/kelp/state", "holdfast/kelp/dof/z"} <= shown.keys() | {"/tf"}
    with published(endpoint, make_sample), served(endpoint) as address:
        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(address, protocols=["foxglove.sdk.v1"]) as client,
        ):
            assert (await texts(client))["name"] == "Holdfast"
            channels = await advertised(client, shown.keys() | {"/tf", *telemetry.keys("kelp")})
            for topic, names in shown.items():
                schema = json.loads(channels[topic]["schema"])
                assert names <= schema["properties"].keys(), topic
            state, pose = channels["holdfast/kelp/state"], channels["/pose"]
            assert (state["encoding"], state["schemaName"]) == ("json", "holdfast.State.v1")
            assert pose["schemaName"] == "foxglove.PoseInFrame"
            await subscribed(client, state, pose)
            first_ns, content = await sample(client, 0)
            decoded = msgspec.convert(content, telemetry.State)
            times_ns = [first_ns, *[(await sample(client, 0))[0] for _ in range(50)]]
            assert abs(times_ns[-1] / 1e9 - time.time()) < 2.0
            steps_s = [(new - old) / 1e9 for old, new in pairwise(times_ns)]
            assert sum(steps_s) / len(steps_s) == pytest.approx(0.02, rel=0.5)
            assert len(set(times_ns)) == len(times_ns), "each at its own time, not at that of the look"
            _, posed = await sample(client, 1)
            assert posed["pose"]["position"]["z"] == pytest.approx(-decoded.depth_m)
            turned = posed["pose"]["orientation"]
            assert math.hypot(*turned.values()) == pytest.approx(1.0)


def test_a_port_that_is_taken_is_named_with_who_has_it() -> None:
    with socket.create_server(("127.0.0.1", 0)) as held:
        port = held.getsockname()[1]
        command = [sys.executable, "-m", "holdfast", "foxglove", "--listen", f"127.0.0.1:{port}"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=False)
    assert done.returncode == 1
    assert f"holdfast foxglove: tcp port {port} is taken by '" in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_without_its_extra_it_says_what_to_install() -> None:
    program = """if True:
        import sys
        sys.modules["foxglove"] = None
        import holdfast
        sys.exit(holdfast.main(["foxglove"]))
    """
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith("holdfast foxglove: needs foxglove. Install the extra: ")
    assert line.endswith("pip install 'holdfast-rov[foxglove]'")
