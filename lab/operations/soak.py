"""`holdfast bench soak`: everything at once, live, for as long as asked, and whether anything grows.

Simulator, companion with a ground station behind it, dashboard with one browser, recorder. Once a minute a
new Zenoh client comes, moves the setpoint, engages again if the companion let go, and leaves.
"""

import asyncio
import math
import socket
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import aiohttp
import numpy as np
from mcap.reader import make_reader
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from rich.console import Console, Group, RenderableType

from companion.telemetry import schemas as telemetry
from dashboard.losses import Losses
from dashboard.zenoh_client import Subscription
from lab.demo.crew import ChildError, Crew
from lab.operations.bounds import Bound
from lab.ports import free_port
from lab.study import ruled
from lab.usage import Memory, Slope, cpu_s, memory_kb, slope

VEHICLE = "soak"
WARM_UP_S = 600.0
"""Buffers fill and caches grow: the slope of the memory counts from here, or from a tenth of a short run."""
DEPTHS_M = (2.0, 5.0)
START_S = 60.0
EMPTY_LOOP = "from lab.operations.bounds import empty_loop\nwhile True: empty_loop(60.0)"
EMPTY = "empty loop"
LOOK_S = 0.1
MINUTE_S = 60.0
STEERS = "ACTIVE"


class Minute(NamedTuple):
    """What a minute was like."""

    at_s: float
    memory_kb: dict[str, Memory]
    lateness_ms: tuple[float, float, float]
    """Of the ticks: median, p99, largest."""
    empty_ms: float
    """p99 of a timer loop that does nothing, at the same time."""
    load: float
    """The machine's processes that wanted a core, on average."""


@dataclass
class Soak:
    """What was measured so far."""

    minutes: list[Minute] = field(default_factory=list)
    cpu: dict[str, float] = field(default_factory=dict)
    """Share of a core."""
    let_go: Counter[str] = field(default_factory=Counter)
    """How often the companion left ACTIVE, by its reason."""
    missed: Losses = field(default_factory=Losses)
    """Samples that did not come to us."""
    loop: telemetry.Loop | None = None
    supervisor: telemetry.Supervisor | None = None
    recorder: telemetry.Recorder | None = None
    commands: int = 0
    refused: Counter[str] = field(default_factory=Counter)
    tracebacks: Counter[str] = field(default_factory=Counter)
    late_ms: list[float] = field(default_factory=list)

    def take(self, key: str, payload: bytes) -> None:
        """Take a sample."""
        tail = key.split("/", 2)[2]
        if tail not in ("loop", "supervisor", "recorder"):
            self.missed.take(tail, 0)
            return
        record = telemetry.decode(key, payload)
        self.missed.take(tail, record.tick if isinstance(record, telemetry.Loop) else 0)
        if isinstance(record, telemetry.Loop):
            self.loop = record
            self.late_ms.append(record.lateness_ms)
        elif isinstance(record, telemetry.Recorder):
            self.recorder = record
        elif isinstance(record, telemetry.Supervisor):
            previous, self.supervisor = self.supervisor, record
            if previous is not None and previous.state == STEERS != record.state:
                self.let_go[record.reason] += 1

    def lateness_ms(self) -> tuple[float, float, float]:
        """Return median, p99 and largest of the ticks since the last call."""
        late, self.late_ms = self.late_ms, []
        if not late:
            return math.nan, math.nan, math.nan
        p50, p99 = np.percentile(late, [50, 99])
        return float(p50), float(p99), max(late)

    def typical_p99_ms(self) -> tuple[float, float]:
        """Return the median of the minutes' p99: of the ticks, and of the loop that does nothing."""
        late = np.median([row.lateness_ms[1] for row in self.minutes])
        return float(late), float(np.median([row.empty_ms for row in self.minutes[1:] or self.minutes]))

    def slopes(self, minutes: float) -> dict[str, Slope]:
        """Return how what each process allocated grew, kB/h, since `counts_from_s`."""
        counted = [row for row in self.minutes if row.at_s >= counts_from_s(minutes)]
        hours = [row.at_s / 3600.0 for row in counted]
        return {
            name: slope(hours, [row.memory_kb[name].own for row in counted])
            for name in self.minutes[0].memory_kb
        }


def soak(minutes: int, advance: Callable[[], object]) -> list[Bound]:
    """Run, print the summary every minute, and return the figures. Raises ChildError if a process ended."""
    found, console = Soak(), Console()
    with tempfile.TemporaryDirectory(prefix="holdfast-soak-") as folder, Crew(Path(folder)) as crew:
        dives = Path(folder) / "dives"
        try:
            for _ in _run(60.0 * minutes, crew, dives, found):
                console.print(summary(found, minutes))
                advance()
        except KeyboardInterrupt:
            console.print(summary(found, minutes), "stopped: these are the figures until now")
            raise
        crew.close()
        found.tracebacks = crew.count("Traceback")
        written = sum(_messages(file) for file in dives.glob("*.mcap"))
    recorder = found.recorder
    lost = math.inf if recorder is None else recorder.lost + recorder.dropped
    late_ms, empty_ms = found.typical_p99_ms()
    return [
        *(Bound(f"memory slope, {name}", line.slope, "kB/h") for name, line in found.slopes(minutes).items()),
        *(Bound(f"processor, {name}", 100.0 * share, "% of a core") for name, share in found.cpu.items()),
        Bound("tick lateness, median of the minutes' p99", late_ms, "ms"),
        Bound("empty timerfd loop: the same", empty_ms, "ms"),
        Bound("let go", found.let_go.total(), "x"),
        Bound("commands not done", found.refused.total(), f"of {found.commands}"),
        Bound("records in the recorder's files, read again", written, ""),
        Bound("records lost", lost, "", limit=0),
        Bound("Traceback in the logs", found.tracebacks.total(), "x", limit=0),
    ]


def counts_from_s(minutes: float) -> float:
    """Return from when on the slope of the memory counts."""
    return min(WARM_UP_S, 6.0 * minutes)


def summary(found: Soak, minutes: float) -> RenderableType:
    """Return the figures so far, for a terminal or a log."""
    rows = found.minutes
    if not rows:
        return "starting"
    passed = rows[-1].at_s / 60.0
    memory = ruled(
        f"{passed:.0f} of {minutes:g} minutes",
        "process", "% of\na core", "memory MB\nfirst", "\nnow",
        "allocated\nMB, now", "slope\nkB/h", "± standard\nerror",
    )  # fmt: skip
    for name, line in found.slopes(minutes).items():
        memory.add_row(
            name,
            f"{100.0 * found.cpu.get(name, math.nan):.1f}",
            f"{rows[0].memory_kb[name].share / 1024.0:.1f}",
            f"{rows[-1].memory_kb[name].share / 1024.0:.1f}",
            f"{rows[-1].memory_kb[name].own / 1024.0:.1f}",
            f"{line.slope:.0f}",
            f"{line.error:.0f}",
        )
    loop, recorder, last = found.loop, found.recorder, rows[-1]
    late_ms, empty_ms = found.typical_p99_ms()
    lines = [
        f"slopes count from minute {counts_from_s(minutes) / 60.0:.0f}; "
        f"load of the machine now {last.load:.1f}, mean {np.mean([row.load for row in rows]):.1f}",
        f"tick lateness ms, last minute: median {last.lateness_ms[0]:.2f}, p99 {last.lateness_ms[1]:.2f} "
        f"(a loop that does nothing: {last.empty_ms:.2f})",
        f"  median of all minutes' p99 {late_ms:.2f} ({empty_ms:.2f}), "
        f"worst tick {max(row.lateness_ms[2] for row in rows):.0f}",
    ]
    if loop is not None:
        lines.append(
            f"ticks {loop.tick}, skipped {loop.late_ticks}; samples dropped before Zenoh "
            f"{loop.samples_dropped}; missing here {found.missed.lost}"
        )
    if recorder is not None:
        lines.append(
            f"recorder: {recorder.messages} records, lost {recorder.lost}, dropped {recorder.dropped}"
        )
    state = found.supervisor.state if found.supervisor else "unknown"
    lines.append(f"state {state}; commands {found.commands}, not done {found.refused.total()}")
    lines += [f"  not done {count} x: {said}" for said, count in found.refused.items()]
    lines.append(f"let go {found.let_go.total()} x")
    lines += [f"  {count} x: {reason}" for reason, count in found.let_go.most_common()]
    lines += [f"Traceback in the log of {name}: {count} x" for name, count in found.tracebacks.items()]
    return Group(memory, *lines)


def _run(seconds: float, crew: Crew, dives: Path, found: Soak) -> Iterator[None]:
    """Keep everything running, and come back every minute."""
    endpoint, port = f"tcp/127.0.0.1:{free_port()}", free_port()
    _start(crew, dives, endpoint, port, ground := _GroundStation())
    with Subscription(f"holdfast/{VEHICLE}/**", endpoint) as seen, ground:
        begun_s = time.monotonic()
        while not (found.supervisor is not None and found.supervisor.state == STEERS):
            crew.check()
            if time.monotonic() - begun_s > START_S:
                raise ChildError(f"the companion did not engage within {START_S:g} s\n{crew.last_lines()}")
            _listen(seen, found, LOOK_S)
        found.let_go.clear()
        threading.Thread(target=asyncio.run, args=(browse(port),), daemon=True).start()
        pids = {name: pid for name, pid in crew.pids().items() if name != EMPTY}
        begun_s, cpu = time.monotonic(), {name: cpu_s(pid) for name, pid in pids.items()}
        while (now_s := time.monotonic() - begun_s) < seconds:
            _listen(seen, found, min(MINUTE_S, seconds - now_s))
            crew.check()
            at_s = time.monotonic() - begun_s
            found.cpu = {name: (cpu_s(pid) - cpu[name]) / at_s for name, pid in pids.items()}
            found.minutes.append(
                Minute(
                    at_s,
                    {name: memory_kb(pid) for name, pid in pids.items()},
                    found.lateness_ms(),
                    _last_number(crew.last_lines(EMPTY)),
                    float(Path("/proc/loadavg").read_text(encoding="ascii").split()[0]),
                )
            )
            _visit(endpoint, found)
            yield


def _start(crew: Crew, dives: Path, endpoint: str, port: int, ground: "_GroundStation") -> None:
    link = f"127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
    settings = {
        "vehicle.name": VEHICLE,
        "link.endpoint": f"udp-listen:{link}",
        "vehicle.thrust_path": "manual_control",  # as a ground station behind us asks for
        "ground_station.endpoint": f"udp-connect:127.0.0.1:{ground.port}",
        "telemetry.endpoint": endpoint,
    }
    set_all = [f"--set={key}={value}" for key, value in settings.items()]
    crew.start("run", "--engage", "--arm", "--depth", str(DEPTHS_M[0]), *set_all)
    sea = ("--set=waves.enabled=true", "--set=current.enabled=true")
    crew.start("sim", "--udp-connect", link, "--zenoh", endpoint, "--name", VEHICLE, *sea)
    crew.start("dashboard", "--connect", endpoint, "--listen", f"127.0.0.1:{port}")
    crew.start("record", "--connect", endpoint, "--name", VEHICLE, "--out", str(dives))
    crew.run(EMPTY, [sys.executable, "-u", "-c", EMPTY_LOOP])


def _listen(seen: Subscription, found: Soak, seconds: float) -> None:
    until_s = time.monotonic() + seconds
    while time.monotonic() < until_s:
        for key, payload in seen.take():
            found.take(key, payload)
        time.sleep(LOOK_S)


def _visit(endpoint: str, found: Soak) -> None:
    """Come as a new client, say where to be and, if it let go, to engage; and leave."""
    depth_m = DEPTHS_M[len(found.minutes) % len(DEPTHS_M)]
    wishes: list[tuple[str, dict[str, object]]] = [("setpoint", {"depth_m": depth_m})]
    state = found.supervisor.state if found.supervisor else STEERS
    if state == "FAULT":
        wishes.append(("clear_fault", {}))
    if state != STEERS:
        wishes.append(("engage", {}))
    with Subscription(f"holdfast/{VEHICLE}/event", endpoint) as client:
        until_s = time.monotonic() + 5.0
        while not client.connected and time.monotonic() < until_s:
            time.sleep(LOOK_S)
        for command, what in wishes:
            reply = client.tell(VEHICLE, command, what)
            found.commands += 1
            if not reply.done:
                found.refused[f"{command}: {reply.said}"] += 1


def _last_number(text: str) -> float:
    with suppress(ValueError, IndexError):
        return float(text.split()[-1])
    return math.nan


def _messages(file: Path) -> int:
    with file.open("rb") as stream:
        found = make_reader(stream).get_summary()
    return found.statistics.message_count if found is not None and found.statistics is not None else 0


async def browse(port: int) -> None:
    """Read the page's WebSocket, as a browser does."""
    origin = f"http://127.0.0.1:{port}"
    async with aiohttp.ClientSession(headers={"Origin": origin}) as session:
        while True:
            with suppress(aiohttp.ClientError):
                async with session.ws_connect(f"{origin}/ws", max_msg_size=0) as line:
                    async for _ in line:
                        pass
            await asyncio.sleep(1.0)


class _GroundStation:
    """The pilot's, behind the companion: says a heartbeat a second, and takes what is relayed."""

    def __init__(self) -> None:
        self._end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._end.bind(("127.0.0.1", 0))
        self._end.settimeout(0.5)
        self.port: int = self._end.getsockname()[1]
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self) -> "_GroundStation":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.set()
        self._thread.join()
        self._end.close()

    def _serve(self) -> None:
        packer, said_s = mavlink.MAVLink(None, 255, 190), 0.0
        heartbeat = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 4, 3)
        while not self._closing.is_set():
            with suppress(OSError):
                _, companion = self._end.recvfrom(65535)
                if time.monotonic() - said_s > 1.0:
                    said_s = time.monotonic()
                    packer.seq = (packer.seq + 1) & 0xFF
                    self._end.sendto(bytes(heartbeat.pack(packer)), companion)
