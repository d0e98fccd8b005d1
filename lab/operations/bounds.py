"""What it costs: the tick's computing time, its lateness, memory, start-up, and the speed of virtual time.

The process is measured from outside, as it runs for a user; its lateness is set beside that of an empty
timerfd loop running at the same moment, so that a noisy machine is seen to be noisy.
"""

import select
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import Config
from companion.engine import Engine
from companion.io.process import Ticker
from companion.records import LoopHealth, Request
from companion.telemetry import schemas as telemetry
from dashboard.zenoh_client import Subscription
from lab.loop.lockstep import LinkDelay, Lockstep
from lab.loop.scenarios import four
from lab.operations.latency import Wire, percentiles_ms
from lab.ports import free_port
from sim_bridge.config import SimConfig
from sim_bridge.vehicle import Vehicle

HOLDFAST = (sys.executable, "-m", "holdfast")
WARM_UP_S = 6.0
PERIOD_NS = 20_000_000
EMPTY_LOOP = "from lab.operations.bounds import empty_loop; empty_loop({seconds})"


@dataclass(frozen=True)
class Bound:
    """One measured figure beside the most it may be; `limit` is None where there is no such bound."""

    name: str
    value: float
    unit: str
    limit: float | None = None
    at_least: float | None = None

    @property
    def held(self) -> bool:
        """Whether the figure is within its bounds."""
        return (self.limit is None or self.value <= self.limit) and (
            self.at_least is None or self.value >= self.at_least
        )


def virtual(config: Config, plant: SimConfig, duration_s: float = 60.0) -> list[Bound]:
    """Measure one dive in waves on this core: the tick beside the simulator, the engine alone, the speed.

    The engine alone is fed the recorded datagrams of that dive, tick after tick; beside the simulator, and
    more so in the process, which sleeps between ticks, its code and data have left the caches each time.
    """
    scenario = four(0)[0]
    vehicle = Vehicle(scenario.plant(plant, 0), 0)
    engine = Engine(config, scenario.target(0.0), arm=True)
    loop = Lockstep(vehicle, engine, LinkDelay(), 0, config.loop.rate_hz)
    loop.requests = [Request.ENGAGE]
    heard: list[_Call] = []
    beside_us = _timed(engine, heard)
    for _ in loop.run(WARM_UP_S):
        pass
    warm = len(beside_us)
    begun = time.perf_counter()
    for _ in loop.run(duration_s):
        pass
    speed = duration_s / (time.perf_counter() - begun)
    again = Engine(config, scenario.target(0.0), arm=True)
    alone_us = _timed(again, [])
    for call in heard:
        again.step(*call)
    return [
        Bound("tick compute, engine alone, median", float(np.median(alone_us[warm:])), "µs", 250.0),
        Bound("tick compute, engine alone, p99", float(np.percentile(alone_us[warm:], 99)), "µs", 1000.0),
        Bound("tick compute beside the simulator, median", float(np.median(beside_us[warm:])), "µs"),
        Bound("lockstep speed", speed, "x real time", at_least=20.0),
    ]


_Call = tuple[float, Sequence[tuple[int, bytes]], LoopHealth, Sequence[Request]]


def _timed(engine: Engine, heard: list[_Call]) -> list[float]:
    """Let `engine` note what each step cost (µs) in the list returned, and what it was given in `heard`."""
    costs_us: list[float] = []
    step = engine.step

    def timed(*call: Any) -> Any:
        heard.append(call)
        begun = time.perf_counter()
        result = step(*call)
        costs_us.append(1e6 * (time.perf_counter() - begun))
        return result

    engine.step = timed  # type: ignore[method-assign, assignment]
    return costs_us


def process(duration_s: float = 20.0) -> list[Bound]:
    """Measure `holdfast run`, diving in the simulator over UDP, from outside."""
    start_s = start_to_neutral_s()
    link, zenoh = f"127.0.0.1:{free_port(socket.SOCK_DGRAM)}", f"tcp/127.0.0.1:{free_port()}"
    simulator = ("sim", "--udp-connect", link, "--tcp", f"127.0.0.1:{free_port()}", "--no-zenoh")
    companion = (
        *("run", "--engage", "--arm", "--depth", "3"),
        *("--set", f"link.endpoint=udp-listen:{link}", "--set", f"telemetry.endpoint={zenoh}"),
    )
    with running(*HOLDFAST, *simulator), running(*HOLDFAST, *companion) as run:
        time.sleep(WARM_UP_S)
        with (
            Subscription("holdfast/*/loop", zenoh) as samples,
            running(sys.executable, "-c", EMPTY_LOOP.format(seconds=duration_s), output=True) as empty,
        ):
            ticks: list[telemetry.Loop] = []
            until_s = time.monotonic() + duration_s
            while time.monotonic() < until_s:
                time.sleep(0.2)
                decoded = (telemetry.decode(message.key, message.payload) for message in samples.take())
                ticks += [record for record in decoded if isinstance(record, telemetry.Loop)]
            rss_mb = resident_mb(run.pid)
            assert empty.stdout is not None
            empty_ms = float(empty.stdout.readline())
    lateness_ms = float(np.percentile([tick.lateness_ms for tick in ticks], 99))
    compute_us = [tick.compute_us for tick in ticks]
    return [
        Bound("start to first neutral frame", start_s, "s", 1.5),
        Bound("tick compute in the process, median", float(np.median(compute_us)), "µs"),
        Bound("tick compute in the process, p99", float(np.percentile(compute_us, 99)), "µs"),
        Bound("empty timerfd loop: lateness, p99", empty_ms, "ms"),
        Bound("tick lateness, p99", lateness_ms, "ms", 2.0 * empty_ms),
        Bound("resident memory of holdfast run", rss_mb, "MB", 80.0),
    ]


def latency(duration_s: float = 20.0) -> list[Bound]:
    """Measure the relay and the way from sensor to command in `holdfast run`, engaged in the simulator."""
    wire = Wire()
    vehicle, link, ground = wire.endpoints()
    simulator = ("sim", "--udp-connect", vehicle, "--tcp", f"127.0.0.1:{free_port()}", "--no-zenoh")
    companion = (
        *("run", "--engage", "--arm", "--depth", "3"),
        *("--set", f"link.endpoint={link}", "--set", f"ground_station.endpoint={ground}"),
        *("--set", "vehicle.thrust_path=manual_control"),
        *("--set", f"telemetry.endpoint=tcp/127.0.0.1:{free_port()}"),
    )
    port = free_port(socket.SOCK_DGRAM)
    nothing = f"from lab.operations.latency import echo; echo({port})"
    with (
        running(*HOLDFAST, *simulator),
        running(sys.executable, "-c", nothing),
        running(*HOLDFAST, *companion),
    ):
        wire.run(WARM_UP_S + duration_s, WARM_UP_S, port)
    wire.close()
    bounds: list[Bound] = []
    for name, delays_s, limit in (
        ("a process that only sends back", wire.echo_s, None),
        ("relay, vehicle to ground station", wire.up_s, 1.0),
        ("relay, ground station to vehicle", wire.down_s, 1.0),
        ("sensor to command", wire.command_s, None),
    ):
        p50, p99 = percentiles_ms(delays_s)
        bounds += [Bound(f"{name}, median", p50, "ms", limit), Bound(f"{name}, p99", p99, "ms")]
    return bounds


def empty_loop(duration_s: float) -> None:
    """Print the p99 lateness (ms) of a timerfd loop that does nothing: the machine's own noise."""
    ticker = Ticker(PERIOD_NS)
    late_ms, periods = [], 0
    while periods * PERIOD_NS < duration_s * 1e9:
        select.select([ticker.fd], [], [])
        periods += ticker.read()
        late_ms.append((time.monotonic_ns() - ticker.start_ns - (periods - 1) * PERIOD_NS) / 1e6)
    sys.stdout.write(f"{np.percentile(late_ms, 99)}\n")


def start_to_neutral_s() -> float:
    """Return the time from starting `holdfast run` to its first neutral frame at a steered vehicle."""
    vehicle = mavlink.MAVLink(None, 1, 1)
    vehicle.robust_parsing = True
    heartbeat = mavlink.MAVLink_heartbeat_message(12, 3, 209, 19, 4, 3).pack(vehicle)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as wire:
        wire.bind(("127.0.0.1", 0))
        wire.settimeout(20.0)
        endpoint = f"link.endpoint=udp-connect:127.0.0.1:{wire.getsockname()[1]}"
        zenoh = f"telemetry.endpoint=tcp/127.0.0.1:{free_port()}"
        begun_s = time.monotonic()
        with running(*HOLDFAST, "run", "--set", endpoint, "--set", zenoh):
            while True:
                data, peer = wire.recvfrom(2048)
                for message in vehicle.parse_buffer(data) or ():
                    if message.get_type() == "RC_CHANNELS_OVERRIDE":
                        return time.monotonic() - begun_s
                wire.sendto(heartbeat, peer)


@contextmanager
def running(
    *command: str, output: bool = False, errors: int = subprocess.DEVNULL
) -> Iterator[subprocess.Popen[str]]:
    """Keep a child process for as long as the block lasts, and end it as a user would, with SIGINT."""
    child = subprocess.Popen(
        command,
        stdout=subprocess.PIPE if output else subprocess.DEVNULL,
        stderr=errors,
        text=True,
    )
    try:
        yield child
    finally:
        child.send_signal(2)
        try:
            child.wait(5.0)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()
        if child.stdout is not None:
            child.stdout.close()


def resident_mb(pid: int) -> float:
    """Return the memory that a process has in use."""
    status = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    line = next(line for line in status.splitlines() if line.startswith("VmRSS"))
    return float(line.split()[1]) / 1024.0
