"""`holdfast bench fleet`: many vehicles at one router with TLS, and what its subscribers cost.

The router is a Zenoh session of mode "router", opened in Python by router.json5 of `holdfast keys`. A vehicle
is the companion's own publisher at 50 Hz, by its file of `holdfast keys`, fed with a dive that was simulated
before: twenty simulators and companions need more than two cores. Dashboard with a browser, and `holdfast
watch`, come as the laptop does, by TLS; the recorder, of one vehicle, by loopback. First with one vehicle,
then with all: on a busy machine the ratio tells more than the figures.
"""

import asyncio
import datetime
import json
import math
import os
import pty
import select
import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from subprocess import Popen

import numpy as np
import zenoh
from msgspec.structs import replace
from rich.table import Table

from companion.config import load_config
from companion.engine import Engine
from companion.io import certificates
from companion.io.process import Ticker
from companion.io.zenoh_publisher import Publisher
from companion.records import ControlSample, Request
from companion.telemetry import schemas as telemetry
from companion.telemetry.session import client_configuration
from dashboard.losses import Losses
from dashboard.zenoh_client import Subscription
from lab.demo.crew import ChildError, Crew
from lab.loop.lockstep import LinkDelay, Lockstep
from lab.loop.scenarios import four
from lab.operations.bounds import HOLDFAST, Bound
from lab.operations.soak import browse
from lab.ports import free_port
from lab.study import ruled
from lab.usage import cpu_s, memory_kb
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import load_config as load_plant
from sim_bridge.vehicle import Vehicle

PERIOD_NS = 20_000_000
DIVE_S = 10.0
START_S = 120.0
SETTLE_S = 8.0
WINDOW_S = 30.0
IN_A_PROCESS = 5
ROUTER = "from lab.operations.many_vehicles import route; route({file!r})"
VEHICLES = "from lab.operations.many_vehicles import publish; publish({files!r})"
FORMS = {"%": ".1f", "ms": ".2f", "load": ".1f"}
SHOWN = ("router", "dashboard", "watch", "record")


@dataclass
class Window:
    """What was measured with so many vehicles."""

    vehicles: int
    cpu: dict[str, float] = field(default_factory=dict)
    """Share of a core."""
    memory_mb: dict[str, float] = field(default_factory=dict)
    delays_s: list[float] = field(default_factory=list)
    """From the sample's stamp to the callback of a client by TLS."""
    samples: int = 0
    lost: int = 0
    recorder: telemetry.Recorder | None = None
    seconds: float = 0.0
    load: float = 0.0

    def bounds(self) -> list[Bound]:
        """Return the figures; no sample may be lost."""
        ages_ms = 1e3 * np.percentile(self.delays_s, (50, 99, 100)) if self.delays_s else [math.nan] * 3
        return [
            *(Bound(f"{name}: % of a core", 100.0 * share, "%") for name, share in self.cpu.items()),
            *(Bound(f"{name}: memory, MB", self.memory_mb[name], "MB") for name in SHOWN),
            *(
                Bound(f"age at a client: {name}, ms", float(age_ms), "ms")
                for name, age_ms in zip(("50 % within", "99 % within", "largest"), ages_ms, strict=True)
            ),
            Bound("samples a second", self.samples / self.seconds, ""),
            Bound("samples lost", self.lost, "", limit=0),
            Bound("recorder: lost", self.recorder.lost if self.recorder else -1, ""),
            Bound("load of the machine", self.load, "load"),
        ]


def table(columns: Sequence[tuple[int, Sequence[Bound]]]) -> Table:
    """Return all figures, a column for each number of vehicles, and the ratio of the last to the first."""
    rows = ruled("Vehicles at one router, TLS", "", *(str(vehicles) for vehicles, _ in columns), "ratio")
    for same in zip(*(bounds for _, bounds in columns), strict=True):
        form, first = FORMS.get(same[0].unit, ".0f"), same[0].value
        ratio = f"{same[-1].value / first:.1f}" if first else ""
        rows.add_row(same[0].name, *(f"{bound.value:{form}}" for bound in same), ratio)
    return rows


def measure(count: int) -> list[Bound]:
    """Measure so many vehicles. Raises ChildError."""
    names = [f"vehicle{number:02}" for number in range(1, count + 1)]
    local, port = f"tcp/127.0.0.1:{free_port()}", free_port()
    with tempfile.TemporaryDirectory(prefix="holdfast-fleet-") as folder, ExitStack() as stack:
        router, laptop, *files = certificates.make(
            Path(folder) / "keys",
            ["127.0.0.1"],
            allow_control=False,
            now=datetime.datetime.now(datetime.UTC),
            vehicles=names,
            port=free_port(),
            local=local,
        )
        for file in files:  # on one machine they cannot all listen on the same port
            config = json.loads(file.read_text(encoding="utf-8"))
            config["listen"]["endpoints"] = []
            file.write_text(json.dumps(config), encoding="utf-8")
        crew = stack.enter_context(Crew(Path(folder)))
        crew.run("router", [sys.executable, "-c", ROUTER.format(file=str(router))])
        for first in range(0, count, IN_A_PROCESS):
            some = [(file.stem, str(file)) for file in files[first : first + IN_A_PROCESS]]
            crew.run(f"vehicles {first}", [sys.executable, "-c", VEHICLES.format(files=some)])
        crew.start("dashboard", "--connect", str(laptop), "--listen", f"127.0.0.1:{port}")
        crew.start("record", "--connect", local, "--name", names[0], "--out", f"{folder}/dives")
        watch = stack.enter_context(_on_a_terminal("watch", "--connect", str(laptop)))
        threading.Thread(target=asyncio.run, args=(browse(port),), daemon=True).start()
        _await(local, count, crew)
        time.sleep(SETTLE_S)
        pids = {**crew.pids(), "watch": watch}
        window = Window(count)
        with _listening(str(laptop), local, names[0], window):
            at_first, begun_s = {name: cpu_s(pid) for name, pid in pids.items()}, time.monotonic()
            time.sleep(WINDOW_S)
            window.seconds = time.monotonic() - begun_s
            used = {name: (cpu_s(pid) - at_first[name]) / window.seconds for name, pid in pids.items()}
        crew.check()
        window.cpu = {name: used[name] for name in SHOWN}
        window.cpu["all vehicles"] = sum(share for name, share in used.items() if name not in SHOWN)
        window.memory_mb = {name: memory_kb(pids[name]).share / 1024.0 for name in SHOWN}
        window.load = os.getloadavg()[0]
    return window.bounds()


def _await(local: str, count: int, crew: Crew) -> None:
    """Return when so many vehicles are heard; raise ChildError."""
    heard: set[str] = set()
    until_s = time.monotonic() + START_S
    with Subscription("holdfast/*/loop", local) as seen:
        while len(heard) < count:
            crew.check()
            if time.monotonic() > until_s:
                raise ChildError(f"{len(heard)} of {count} vehicles came within {START_S:g} s")
            heard.update(message.key for message in seen.take())
            time.sleep(0.1)


@contextmanager
def _listening(laptop: str, local: str, recorded: str, window: Window) -> Iterator[None]:
    """Take every sample by TLS, with its age, and the recorder's state by loopback."""
    losses: dict[str, Losses] = defaultdict(Losses)

    def take(sample: zenoh.Sample) -> None:
        stamp, now_s = sample.timestamp, time.time()
        _, name, tail = str(sample.key_expr).split("/", 2)
        if stamp is None or tail not in telemetry.EVERY_TICK:
            return
        window.delays_s.append(now_s - stamp.get_time().timestamp())
        window.samples += 1
        tick = 0
        if tail == "loop":
            record = telemetry.decode(str(sample.key_expr), sample.payload.to_bytes())
            assert isinstance(record, telemetry.Loop)
            tick = record.tick
        losses[name].take(tail, tick)

    def take_recorder(sample: zenoh.Sample) -> None:
        record = telemetry.decode(str(sample.key_expr), sample.payload.to_bytes())
        assert isinstance(record, telemetry.Recorder)
        window.recorder = record

    with (
        zenoh.open(client_configuration(laptop)) as far,
        zenoh.open(client_configuration(local)) as near,
        near.declare_subscriber(telemetry.recorder_key(recorded)[0], take_recorder),
        far.declare_subscriber("holdfast/**", take),
    ):
        yield
    window.lost = sum(loss.lost for loss in losses.values())


@contextmanager
def _on_a_terminal(*command: str) -> Iterator[int]:
    """Run a `holdfast` command on a terminal that somebody reads; give its process."""
    ours, its = pty.openpty()
    child = Popen(
        [*HOLDFAST, *command], stdin=its, stdout=its, stderr=its, env={**os.environ, "TERM": "xterm"}
    )
    os.close(its)

    def read() -> None:
        with suppress(OSError):
            while os.read(ours, 65536):
                pass

    threading.Thread(target=read, daemon=True).start()
    try:
        yield child.pid
    finally:
        child.kill()
        child.wait()


# --- Processes of their own -------------------------------------------------------------------------------


def route(file: str) -> None:
    """Be the router."""
    with zenoh.open(zenoh.Config.from_file(file)):
        threading.Event().wait()


def publish(files: Sequence[tuple[str, str]]) -> None:
    """Be these vehicles: each by its file, 50 times a second, not all at the same moment."""
    samples = dive()
    publishers = [Publisher(name, file, "file") for name, file in files]
    for publisher in publishers:
        publisher.start()
    ticker, tick = Ticker(PERIOD_NS // len(publishers)), 0
    while True:
        select.select([ticker.fd], [], [])
        for _ in range(ticker.read()):
            publisher = publishers[tick % len(publishers)]
            sample, number = samples[tick // len(publishers) % len(samples)], tick // len(publishers)
            publisher.offer(
                replace(
                    sample,
                    state=replace(sample.state, t_s=time.monotonic()),
                    loop=replace(sample.loop, tick=number, samples_dropped=publisher.dropped),
                )
            )
            tick += 1


def dive() -> list[ControlSample]:
    """Simulate a dive in waves, and return its ticks."""
    scenario, config = four(0)[0], load_config()
    vehicle = Vehicle(scenario.plant(load_plant(DEFAULT_CONFIG), 0), 0)
    loop = Lockstep(vehicle, Engine(config, scenario.target(0.0), arm=True), LinkDelay(), 0)
    loop.requests = [Request.ENGAGE]
    return [step.sample for step in loop.run(2.0 * DIVE_S)][-round(DIVE_S * 50.0) :]
