"""`python -m tests.tools.soak --minutes 120`: everything at once, live, and whether anything grows.

Simulator, companion, dashboard with one browser, recorder. Once a minute `holdfast tell` moves the depth,
and engages again if the companion released it.
"""

import argparse
import asyncio
import math
import shlex
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from socket import SOCK_DGRAM
from typing import Any, NamedTuple

import aiohttp
import numpy as np

from companion.telemetry import schemas as telemetry
from dashboard.zenoh_client import Subscription
from lab.options import add_count, add_out
from lab.study import Row, Study, start

from .processes import HOLDFAST, free_port, running

VEHICLE = "soak"
STEERS = "ACTIVE"
DEPTHS_M = (2.0, 5.0)
START_S = 60.0
WARM_UP_S = 600.0
"""Buffers fill and caches grow: the slope of the memory counts from here, or from a tenth of a short run."""
LOOK_S = 0.1
LAST_LINES = 15


class Duration(NamedTuple):
    """How long a soak lasts."""

    minutes: int


class Minute(NamedTuple):
    """When a minute ended, and what each process had allocated by then."""

    at_s: float
    memory_kb: Mapping[str, float]


class ChildError(Exception):
    """A process ended, or nothing is held; the message holds the last lines of its log."""


@dataclass
class SoakLog:
    """What came over Zenoh, minute by minute."""

    lateness_ms: list[float] = field(default_factory=list)
    """Of each tick."""
    state: str = ""
    let_go: Counter[str] = field(default_factory=Counter)
    """How often the companion left ACTIVE, by its reason."""
    loop: telemetry.Loop | None = None
    recorder: telemetry.Recorder | None = None
    not_done: int = 0
    """Visits of which a command was refused."""
    minutes: list[Minute] = field(default_factory=list)

    def take(self, key: str, payload: bytes) -> None:
        """Take a sample."""
        if not key.endswith(("/loop", "/supervisor", "/recorder")):
            return
        record = telemetry.decode(key, payload)
        if isinstance(record, telemetry.Loop):
            self.loop = record
            self.lateness_ms.append(record.lateness_ms)
        elif isinstance(record, telemetry.Recorder):
            self.recorder = record
        elif isinstance(record, telemetry.Supervisor):
            if self.state == STEERS != record.state:
                self.let_go[record.reason] += 1
            self.state = record.state

    def figures(self) -> Row:
        """Return memory (MB, and its slope in kB/h), lateness (ms), and counts."""
        if not self.minutes:
            return {}
        begin_s = min(WARM_UP_S, 0.1 * self.minutes[-1].at_s)
        counted = [minute for minute in self.minutes if minute.at_s >= begin_s]
        hours, found = [minute.at_s / 3600.0 for minute in counted], Row()
        for name, now_kb in self.minutes[-1].memory_kb.items():
            used = [minute.memory_kb[name] for minute in counted]
            found[f"{name}_memory_mb"] = now_kb / 1024.0
            found[f"{name}_slope_kb_h"] = float(np.polyfit(hours, used, 1)[0]) if len(hours) > 2 else math.nan
        p50, p99, most = np.percentile(self.lateness_ms or [math.nan], [50, 99, 100]).tolist()
        recorder = self.recorder
        return found | {
            "lateness_p50_ms": p50,
            "lateness_p99_ms": p99,
            "lateness_max_ms": most,
            "ticks": self.loop.tick if self.loop else 0,
            "ticks_skipped": self.loop.late_ticks if self.loop else 0,
            "let_go": self.let_go.total(),
            "let_go_why": "; ".join(self.let_go),
            "visits_not_done": self.not_done,
            "records": recorder.messages if recorder else 0,
            "records_lost": recorder.lost + recorder.dropped if recorder else math.inf,
        }


class Soak(Study[Duration]):
    """Everything live for hours, in the command's own process."""

    command = "soak"
    about = "Runs everything live for hours, and measures memory, lateness and lost records."
    unit = rows_key = "minutes"

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        """Add --out and --minutes."""
        add_out(parser, "out/bench")
        add_count(parser, "--minutes", 120, "of the soak")

    def __init__(self, arguments: argparse.Namespace) -> None:
        self.steps = arguments.minutes

    def cases(self) -> Sequence[Duration]:
        """Return the one soak."""
        return [Duration(self.steps)]

    def dive(self, cases: Sequence[Duration]) -> Iterator[Row]:
        """Soak; `error` says why it ended early."""
        for case in cases:
            heard, error = SoakLog(), ""
            with tempfile.TemporaryDirectory(prefix="holdfast-soak-") as logs:
                try:
                    for _ in soaked(case.minutes, Path(logs), heard):
                        self.advance(1)
                except (ChildError, KeyboardInterrupt) as raised:
                    error = str(raised) or "stopped"
                said = [log.read_text(errors="replace") for log in Path(logs).glob("*.log")]
            tracebacks = sum(text.count("Traceback") for text in said)
            yield {"error": error, "tracebacks": tracebacks, **heard.figures()}

    def failed(self, rows: Sequence[Row]) -> bool:
        """Return whether a process ended or said Traceback, or a record was lost."""
        return any(row["error"] or row["tracebacks"] or row.get("records_lost") != 0 for row in rows)

    def summary(self, rows: Sequence[Row]) -> dict[str, Any]:
        """Return every figure."""
        shown = [
            [name, f"{value:.4g}" if isinstance(value, float) else str(value)]
            for name, value in rows[0].items()
        ]
        return {"columns": ["figure", "measured"], "rows": shown, "soak": rows}


def soaked(minutes: int, logs: Path, heard: SoakLog) -> Iterator[None]:
    """Run everything for so long, and come back every minute. Raises ChildError if a process ended."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with ExitStack() as stack:
        children = _start(stack, logs, endpoint)
        seen = stack.enter_context(Subscription(f"holdfast/{VEHICLE}/**", endpoint))

        def listen(until_s: float, wanted: str = "") -> None:
            while time.monotonic() < until_s and (not wanted or heard.state != wanted):
                time.sleep(LOOK_S)
                for key, payload in seen.take():
                    heard.take(key, payload)
                for name, child in children.items():
                    if child.poll() is not None:
                        why = f"`holdfast {name}` ended with status {child.returncode}"
                        raise ChildError(f"{why}\n{_last(logs, name)}")

        listen(time.monotonic() + START_S, STEERS)
        if heard.state != STEERS:
            raise ChildError(f"nothing was engaged in {START_S:g} s\n{_last(logs, 'run')}")
        begun_s, heard.lateness_ms = time.monotonic(), []
        for number in range(1, minutes + 1):
            listen(begun_s + 60.0 * number)
            memory = {name: allocated_kb(child.pid) for name, child in children.items()}
            heard.minutes.append(Minute(time.monotonic() - begun_s, memory))
            yield
            visit = ["goto", f"depth_m={DEPTHS_M[number % len(DEPTHS_M)]:g}", "at_once=true"]
            visit += ["clear_fault"] * (heard.state == "FAULT") + ["engage"] * (heard.state != STEERS)
            told = subprocess.run(
                [*HOLDFAST, "tell", "--connect", endpoint, VEHICLE, *visit], capture_output=True
            )
            heard.not_done += told.returncode != 0


def allocated_kb(pid: int) -> float:
    """Return what a process allocated, whatever files it maps and shares: this grows with a leak."""
    lines = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="utf-8").splitlines()
    return sum(float(line.split()[1]) for line in lines if line.startswith(("Anonymous:", "Swap:")))


def _start(stack: ExitStack, logs: Path, endpoint: str) -> dict[str, subprocess.Popen[str]]:
    link, port = f"127.0.0.1:{free_port(SOCK_DGRAM)}", free_port()
    threading.Thread(target=asyncio.run, args=(_browse(port),), daemon=True).start()
    run = f"--engage --arm --depth {DEPTHS_M[0]:g} --name {VEHICLE} --set=telemetry.endpoint={endpoint}"
    sim = f"--udp-connect {link} --zenoh {endpoint} --name {VEHICLE} --set=waves.enabled=true"
    arguments = {
        "run": f"{run} --set=link.endpoint=udp-listen:{link}",
        "sim": f"{sim} --set=current.enabled=true",
        "dashboard": f"--connect {endpoint} --listen 127.0.0.1:{port}",
        "record": f"{VEHICLE} --connect {endpoint} --out {shlex.quote(str(logs / 'dives'))}",
    }
    children = {}
    for name, words in arguments.items():
        log = stack.enter_context((logs / f"{name}.log").open("wb"))
        children[name] = stack.enter_context(running(*HOLDFAST, name, *shlex.split(words), errors=log))
    return children


def _last(logs: Path, name: str) -> str:
    return "\n".join((logs / f"{name}.log").read_text(errors="replace").splitlines()[-LAST_LINES:])


async def _browse(port: int) -> None:
    origin = f"http://127.0.0.1:{port}"
    async with aiohttp.ClientSession(headers={"Origin": origin}) as session:
        while True:
            with suppress(aiohttp.ClientError):
                async with session.ws_connect(f"{origin}/ws", max_msg_size=0) as line:
                    async for _ in line:
                        pass
            await asyncio.sleep(1.0)


if __name__ == "__main__":
    sys.exit(start(Soak, sys.argv[1:]))
