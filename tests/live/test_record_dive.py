"""One dive as a user would have it: recorded, the recorder killed, and everything that a recording is for."""

import json
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from mcap.reader import make_reader
from tools.processes import HOLDFAST, free_port, running
from waiting import until

from companion.io.zenoh_publisher import Publisher
from companion.records import ControlSample
from companion.telemetry import schemas as telemetry
from dashboard.recording.mcap_file import Item, Reader, Recording
from dashboard.recording.record import RecorderThread
from dashboard.recording.recorder import FileLimits
from dashboard.zenoh_client import Subscription

RESERVE = ("--reserve-mb", "1")


@contextmanager
def diving(zenoh: str) -> Iterator[None]:
    link = f"127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
    simulator = ("sim", "--udp-connect", link, "--zenoh", zenoh, "--name", "kelp")
    companion = (
        *("run", "--engage", "--arm", "--depth", "1", "--set", "vehicle.name=kelp"),
        *("--set", f"link.endpoint=udp-listen:{link}", "--set", f"telemetry.endpoint={zenoh}"),
        *("--set", "telemetry.raw=true"),
    )
    with running(*HOLDFAST, *simulator), running(*HOLDFAST, *companion):
        yield


def test_a_dive_whose_recorder_was_killed(tmp_path: Path) -> None:
    zenoh = f"tcp/127.0.0.1:{free_port()}"
    command = (*HOLDFAST, "record", "--connect", zenoh, "--out", str(tmp_path), *RESERVE)
    recorder = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    try:
        with diving(zenoh), Subscription("holdfast/kelp/**", zenoh) as seen:
            latest: dict[str, telemetry.Schema] = {}

            def holding() -> bool:
                for key, payload in seen.take():
                    if not key.endswith("/raw"):
                        latest[key.split("/", 2)[2]] = telemetry.decode(key, payload)
                supervisor, status = latest.get("supervisor"), latest.get("recorder")
                return (
                    isinstance(supervisor, telemetry.Supervisor)
                    and supervisor.state == "ACTIVE"
                    and isinstance(status, telemetry.Recorder)
                    and status.recording
                )

            until(holding)
            reported = seen.tell("kelp", "goto", {"depth_m": 1.5, "at_once": True})
            assert reported.done, reported.said
            retuned = seen.tell("kelp", "gains", {"axis": "heave", "kappa_per_s": 9.0})
            assert retuned.done, retuned.said
            time.sleep(6.0)
            recorder.kill()
            killed_s = time.monotonic()
            recorder.wait()
    finally:
        recorder.kill()
        recorder.wait()

    (path,) = tmp_path.glob("*.mcap")
    reader = Reader(path)
    items = list(reader)
    last_s = {item.key: json.loads(item.payload)["t_s"] for item in items if item.key.endswith("/state")}
    assert not reader.whole
    assert killed_s - last_s["holdfast/kelp/state"] < 1.2  # a second, and the tick's way to the file
    tails = {item.key for item in items}
    assert {f"holdfast/kelp/{tail}" for tail in (*telemetry.EVERY_TICK, "raw", "event", "recorder")} <= tails
    assert "sim/kelp/truth" in tails
    assert json.loads(reader.metadata["config"]["json"])["vehicle"]["name"] == "kelp"
    assert reader.metadata["holdfast"]["vehicle"] == "kelp"

    again = holdfast("lab", "rerun", str(path))
    assert again.returncode == 0, again.stdout + again.stderr
    assert "1 orders and 1 retunes" in again.stdout
    assert "every byte sent is the same" in again.stdout

    whole = tmp_path / "foxglove" / "whole.mcap"
    whole.parent.mkdir()
    report = holdfast("report", str(path), "--foxglove", str(whole))
    assert report.returncode == 0, report.stderr
    with whole.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count > len(items)
    assert "phase 1" in report.stdout
    assert path.with_suffix(".html").stat().st_size > 100_000

    here = f"tcp/127.0.0.1:{free_port()}"
    with Subscription("holdfast/**", here) as seen:
        player_of = (*HOLDFAST, "replay", str(path), "--connect", here)
        with subprocess.Popen(player_of, stderr=subprocess.DEVNULL) as player:
            heard: dict[str, bytes] = {}

            def all_heard() -> bool:
                heard.update(seen.take())
                return {f"holdfast/kelp-replay/{tail}" for tail in telemetry.EVERY_TICK} <= heard.keys()

            until(all_heard)
            twin = replayed(tmp_path, here)
            assert twin.returncode == 1
            assert "kelp-replay is alive" in twin.stderr
            player.send_signal(signal.SIGINT)
            assert player.wait(5.0) == 0
    assert "holdfast/kelp-replay/recorder" not in heard  # nobody records now
    payloads = {item.payload for item in items}
    assert {heard["holdfast/kelp-replay/state"], heard["holdfast/kelp-replay/dof/z"]} <= payloads


def test_a_slow_recorder_delays_nobody(
    tmp_path: Path, make_sample: Callable[..., ControlSample], monkeypatch: pytest.MonkeyPatch
) -> None:
    add = Recording.add

    def slowly(recording: Recording, item: Item) -> None:
        """About as slow as they come."""
        time.sleep(0.002)
        add(recording, item)

    monkeypatch.setattr(Recording, "add", slowly)
    zenoh = f"tcp/127.0.0.1:{free_port()}"
    stop = threading.Event()
    offered: list[float] = []

    def tick(publisher: Publisher) -> None:
        while not stop.wait(0.02):
            begun_s = time.perf_counter()
            publisher.offer(make_sample(t_s=time.monotonic()))
            offered.append(time.perf_counter() - begun_s)

    limits = FileLimits(tmp_path, reserve_bytes=1)
    recorder = RecorderThread("kelp", zenoh, limits)
    with Publisher("kelp", zenoh) as publisher:
        ticking = threading.Thread(target=tick, args=(publisher,))
        ticking.start()
        try:
            with recorder, Subscription("holdfast/kelp/loop", zenoh) as seen:
                until(lambda: bool(list(tmp_path.glob("*.mcap"))))
                seen.take()
                time.sleep(3.0)
                came = seen.take()
                assert len(came) > 0.8 * 3.0 / 0.02  # the others get theirs
                assert publisher.dropped == 0
                assert sorted(offered)[len(offered) // 2] < 0.001
        finally:
            stop.set()
            ticking.join()
    (file,) = tmp_path.glob("*.mcap")
    reader = Reader(file)
    assert len(list(reader)) > 0
    assert reader.whole


def test_a_recorder_whose_thread_fails_ends_the_process(
    tmp_path: Path, make_sample: Callable[..., ControlSample]
) -> None:
    zenoh = f"tcp/127.0.0.1:{free_port()}"
    broken = (
        "import dashboard.recording.record as record; record.DiveRecorder = None; "
        f"raise SystemExit(record.main(['--connect', '{zenoh}', '--out', '{tmp_path}']))"
    )
    with Publisher("kelp", zenoh) as publisher:
        publisher.offer(make_sample())
        ended = subprocess.run(
            [sys.executable, "-c", broken], capture_output=True, text=True, timeout=60.0, check=False
        )
    assert ended.returncode == 1
    assert "recorder failed: TypeError" in ended.stderr


def holdfast(*arguments: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run([*HOLDFAST, *arguments], capture_output=True, text=True, timeout=60.0, check=False)


def replayed(directory: Path, zenoh: str) -> "subprocess.CompletedProcess[str]":
    (path,) = directory.glob("*.mcap")
    return holdfast("replay", str(path), "--connect", zenoh)
