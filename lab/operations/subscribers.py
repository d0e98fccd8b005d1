"""What bad subscribers cost the tick: its lateness with nobody, a reader, a slow, a stopped and a killed one.

One companion, one run, the cases interleaved in an order that changes from round to round, so that a noisy
machine is noisy to all. The companion notes its own lateness in memory: to subscribe to it would be a reader.
"""

import asyncio
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import zenoh

from companion.app import App
from companion.config import load_config
from companion.engine import Engine
from companion.records import Array, Request, Setpoint
from companion.telemetry import schemas as telemetry
from companion.telemetry.session import client_configuration
from lab.operations.bounds import HOLDFAST, Bound, running
from lab.ports import free_port

NOBODY = "nobody"
CASES = (NOBODY, "reading", "50 ms a sample", "stopped", "killed")
SLOW_S = 0.05
KEYS_PER_S = 50 * len(telemetry.EVERY_TICK)
SETTLE_S = 1.0
FILL_S = 20.0
"""Until the sockets' buffers towards one that does not read are full, and Zenoh has to drop."""

ROUNDS = 3
WINDOW_S = 10.0
P99_RATIO = 1.1
TELL_S = 0.5
HERE_S = 30.0
"""A reader that has nothing to read for so long is none."""

COMPANION = "from lab.operations.subscribers import companion; companion({link!r}, {endpoint!r}, {file!r})"
READER = "from lab.operations.subscribers import read; read({endpoint!r}, {pause_s})"


def subscriber_bounds(advance: Callable[[], object]) -> list[Bound]:
    """Measure, and `advance` after each of ROUNDS."""
    link, endpoint = f"127.0.0.1:{free_port(socket.SOCK_DGRAM)}", f"tcp/127.0.0.1:{free_port()}"
    simulator = ("sim", "--udp-connect", link, "--tcp", f"127.0.0.1:{free_port()}", "--no-zenoh")
    windows: list[tuple[str, float, float]] = []
    with TemporaryDirectory() as scratch:
        file = f"{scratch}/ticks.npy"
        program = COMPANION.format(link=link, endpoint=endpoint, file=file)
        with running(*HOLDFAST, *simulator), running(sys.executable, "-c", program):
            time.sleep(6.0)
            for number in range(ROUNDS):
                for case in np.random.default_rng(number).permutation(CASES):
                    windows.append((str(case), *_window(str(case), endpoint)))
                advance()
        ticks = np.load(file)
    return bounds_of(windows, ticks)


def companion(link: str, endpoint: str, file: str) -> None:
    """Dive at 3 m as `holdfast run` does, and leave (now_s, lateness_ms) of every tick in `file`."""
    config = load_config(
        overrides=[f"link.endpoint=udp-listen:{link}", f"telemetry.endpoint={endpoint}"],
    )
    ticks: list[tuple[float, float]] = []
    step = Engine.step

    def noted(engine: Engine, now_s: float, inbox: Any, health: Any, *more: Any) -> Any:
        ticks.append((now_s, health.lateness_ms))
        return step(engine, now_s, inbox, health, *more)

    async def run() -> None:
        app = App(config, Setpoint((np.nan, np.nan, 3.0, 0.0)), arm=True, requests=[Request.ENGAGE])
        await app.run()

    with suppress(PermissionError):  # as systemd/holdfast.service runs it, and then others do not matter
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(20))
    Engine.step = noted  # type: ignore[method-assign, assignment]
    asyncio.run(run())
    np.save(file, np.array(ticks))
    os._exit(0)


class NoReaderError(Exception):
    """Nobody read where a reader was to be measured."""


def read(endpoint: str, pause_s: float) -> None:
    """Take everything, as soon as somebody is there, with a pause after each sample; print the count."""
    reported_s = 0.0
    while True:
        with suppress(zenoh.ZError), zenoh.open(client_configuration(endpoint)) as session:
            samples = session.declare_subscriber("holdfast/**", zenoh.handlers.FifoChannel(16))
            for count, _ in enumerate(samples, 1):
                if time.monotonic() - reported_s > TELL_S:
                    reported_s = time.monotonic()
                    sys.stdout.write(f"{count}\n")
                    sys.stdout.flush()
                time.sleep(pause_s)
        time.sleep(0.2)


class Reader:
    """A child that reads. Its count is drained by a thread of ours, so that only SIGSTOP stops it."""

    def __init__(self, endpoint: str, pause_s: float) -> None:
        program = READER.format(endpoint=endpoint, pause_s=pause_s)
        self.child = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
        self.count = 0
        self._first = threading.Event()
        self._drainer = threading.Thread(target=self._drain, daemon=True)
        self._drainer.start()
        if not self._first.wait(HERE_S):
            self.end()
            raise NoReaderError(f"the reader took nothing from {endpoint} for {HERE_S:g} s")

    def end(self) -> None:
        """Kill the child, and wait for it."""
        self.child.kill()
        self.child.wait()
        self._drainer.join()

    def _drain(self) -> None:
        assert self.child.stdout is not None
        with self.child.stdout as lines:
            for line in lines:
                self.count = int(line)
                self._first.set()


@contextmanager
def _reader(endpoint: str, pause_s: float) -> Iterator[Reader]:
    reader = Reader(endpoint, pause_s)
    try:
        yield reader
    finally:
        reader.end()


def _window(case: str, endpoint: str) -> tuple[float, float]:
    """Bring the case about and return when it began and ended, by the monotonic clock.

    Raises NoReaderError if the reader is not what the case says.
    """
    if case == NOBODY:
        time.sleep(SETTLE_S)
        return _wait()
    with _reader(endpoint, SLOW_S if case == "50 ms a sample" else 0.0) as reader:
        time.sleep(SETTLE_S)
        if case in ("stopped", "killed"):
            reader.child.send_signal(signal.SIGSTOP)
        if case != "reading":
            time.sleep(FILL_S)
        if case == "killed":
            reader.child.kill()
        at_first = reader.count
        begun_s, ended_s = _wait()
        check_case(case, reader.count - at_first, ended_s - begun_s, alive=reader.child.poll() is None)
        return begun_s, ended_s


def check_case(case: str, taken: int, during_s: float, *, alive: bool) -> None:
    """Raise NoReaderError unless so many samples are what a reader of this case takes."""
    least, most = {
        "reading": (0.5 * KEYS_PER_S * during_s, np.inf),
        "50 ms a sample": (0.3 * during_s / SLOW_S, (during_s + 2.0 * TELL_S) / SLOW_S),
    }.get(case, (0.0, 0.0))
    if alive == (case == "killed") or not least <= taken <= most:
        state = "lived" if alive else "was dead"
        raise NoReaderError(f"'{case}': the reader {state} and took {taken} samples in {during_s:.0f} s")


def _wait() -> tuple[float, float]:
    begun_s = time.monotonic()
    time.sleep(WINDOW_S)
    return begun_s, time.monotonic()


def bounds_of(windows: list[tuple[str, float, float]], ticks: Array) -> list[Bound]:
    """Return how late (ms) the ticks (n, 2: s, ms) of each case's windows (case, begin, end in s) were."""
    late_ms = {
        case: np.concatenate(
            [
                ticks[(ticks[:, 0] >= begun_s) & (ticks[:, 0] < ended_s), 1]
                for name, begun_s, ended_s in windows
                if name == case
            ]
        )
        for case in CASES
    }
    alone = late_ms[NOBODY]
    bounds = []
    for case, late in late_ms.items():
        bounds.append(Bound(f"tick lateness, {case}: median", float(np.median(late)), "ms"))
        bounds.append(
            Bound(f"tick lateness, {case}: p99 of {late.size}", float(np.percentile(late, 99)), "ms")
        )
        if case != NOBODY:
            ratio = np.percentile(late, 99) / np.percentile(alone, 99)
            bounds.append(Bound(f"p99, {case} over nobody", float(ratio), "x", P99_RATIO))
    return bounds
