"""The companion's process: sockets, the tick, signals, systemd. Its only asyncio and its only clock.

A datagram's arrival is stamped and it waits in a bounded inbox; the tick, a timerfd because an asyncio sleep
is over a millisecond late, hands the inbox to the engine and sends its answer. A late tick first reads what
waits in the sockets; one tick that fails is tolerated, two within RIDE_OUT_TICKS end the process. What takes
longer than a tick may is done between ticks, in steps. Every way out leaves neutral what we steer.
"""

import asyncio
import gc
import logging
import time
from collections import deque
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import msgspec

from companion import registry
from companion.config import Config
from companion.endpoint import Endpoint
from companion.engine import Engine
from companion.guidance.drawing import drawing
from companion.io.beside import Beside
from companion.io.command_queue import COST, CommandQueue, EngineInput
from companion.io.links import Admission, MavlinkLink
from companion.io.process import Ticker, notify, on_ending_signal
from companion.io.zenoh_publisher import NameTakenError, Publisher
from companion.mavlink.ardusub import NS_PER_S
from companion.mavlink.inbox import MAX_LOOKS, Inbox
from companion.mavlink.relay import Relay
from companion.mavlink.signing import signing_of
from companion.mavlink.timestamps import timestamps_of
from companion.predive.table import as_json
from companion.records import ZERO, Condition, ControlSample, DiveTotals, LoopHealth, Request, Setpoint
from companion.steps import Task
from companion.telemetry.event_log import EventLog
from companion.telemetry.glossary import advised, on_engaging, whole
from companion.telemetry.operator_commands import CommandResult, SetPath
from companion.telemetry.schemas import Choices, Event, Plan, Raw, Start
from companion.telemetry.status_line import status_line
from holdfast import own_version, version

if TYPE_CHECKING:
    from companion.identify.manoeuvre import Manoeuvre  # no part of `holdfast run`

SHUTDOWN_REPEATS = 5  # on a link that loses one in five all are lost once in 3000
STATUS_PERIOD_S = 5.0  # of the log
SETTLED_S = 1.0
"""Words that change within a state are said after they have stayed for this time."""
PLAN_PERIOD_S = 5.0  # for who came late
WATCHDOG_PERIOD_S = 0.5  # a quarter of WatchdogSec in systemd/holdfast.service
NAME_PATIENCE_S = 3.0  # joining takes 1 s, asking 1 s
RIDE_OUT_TICKS = 5  # 0.1 s at 50 Hz
TICK_PATIENCE_S = 1.0
"""Without a tick for this time the process ends."""

log = logging.getLogger("holdfast")


class App:
    """Link, engine and publisher joined by the tick."""

    def __init__(
        self,
        config: Config,
        setpoint: Setpoint,
        *,
        arm: bool,
        requests: Sequence[Request],
        manoeuvre: "Manoeuvre | None" = None,
    ) -> None:
        self._config = config
        self._manoeuvre = manoeuvre
        signing, ground_signing = (signing_of(config, time.time()) for _ in range(2))
        self._timestamps = timestamps_of(config, vehicle=signing, ground=ground_signing)
        engine = self._engine = Engine(config, setpoint, arm=arm, signing=signing)
        endpoint = Endpoint.parse(config.link.endpoint)
        self._inbox = Inbox(endpoint.is_stream)
        admission = Admission(engine.sender, engine.hello, config.link.allow, engine.heard.barred)
        self._link = MavlinkLink(endpoint, "vehicle", self._from_vehicle, admission)
        self._ground: MavlinkLink | None = None
        if config.ground_station.endpoint:
            self._relay = Relay(config, ground_signing)
            endpoint = Endpoint.parse(config.ground_station.endpoint)
            admission = Admission(self._relay.sender, engine.hello, config.ground_station.allow)
            self._ground = MavlinkLink(endpoint, "ground station", self._from_ground, admission)
        self._links = [link for link in (self._link, self._ground) if link is not None]
        self._peer_changes = 0
        self._dive = DiveTotals()
        self._beside = Beside()
        self._commands = CommandQueue(config)
        self._event_log = EventLog()
        self._publisher = Publisher(
            config.vehicle.name,
            config.telemetry.endpoint,
            config.telemetry.mode,
            on_command=self._commands.put,
            choices=Choices(compensator=registry.choices(config.compensators)),
            check_list=lambda: as_json(self._engine.check_list, []),
            utc_s=time.time,
        )
        self._publisher.config = msgspec.json.encode(config)
        self._requests = list(requests)
        self._excitation = ZERO
        self._start = _start(config, setpoint, arm) if config.telemetry.raw else None
        self._period_ns = round(NS_PER_S / config.loop.rate_hz)
        self._periods = self._ticks = self._late_ticks = self._compute_ns = 0
        self._failed_tick = -RIDE_OUT_TICKS
        self._said = self._saying = ("", "", "", "")
        """State, reason, remedy and what is pending: what was said last, and what is to be."""
        self._said_ns = self._saying_ns = self._fed_ns = self._drawn_ns = 0
        self._drawn = (-1, "")
        self._drawing: Task[Plan] | None = None
        self._works_between = False
        self._silent = True
        self._failure: BaseException | None = None
        self._stop = asyncio.Event()

    async def run(self) -> int:
        """Run until a signal or an exception ends it; leave neutral what we steer; return the exit status."""
        loop = asyncio.get_running_loop()
        log.info("holdfast %s", version.running())
        self._publisher.start()
        try:
            self._publisher.claim(NAME_PATIENCE_S)
        except NameTakenError as error:
            log.error("refused to start: %s", error)
            return 1
        on_ending_signal(loop, self._stop.set)
        if self._timestamps is not None:
            self._timestamps.start()
        running = [loop.create_task(link.run()) for link in self._links]
        for task in running:
            task.add_done_callback(self._link_ended)
        gc.collect()
        gc.freeze()
        ticker = Ticker(self._period_ns)
        loop.add_reader(ticker.fd, self._on_tick, ticker)
        loop.call_later(TICK_PATIENCE_S, self._expect_tick, self._periods)
        notify("READY=1")
        try:
            await self._stop.wait()
        finally:
            notify("STOPPING=1")
            loop.remove_reader(ticker.fd)
            ticker.close()
            await self._leave(running)
        if self._failure is not None:
            of_the_system = isinstance(self._failure, OSError)
            log.error("gave up: %s", self._failure, exc_info=None if of_the_system else self._failure)
            return 1
        log.info("stopped; %s", self._parting)
        return 0

    async def _leave(self, running: Sequence[asyncio.Task[None]]) -> None:
        """Send neutral, say why, and close everything."""
        for _ in range(SHUTDOWN_REPEATS):
            if shutdown_frames := self._engine.shutdown_frames():
                self._link.send(shutdown_frames)
            await asyncio.sleep(self._period_ns / NS_PER_S)
        for task in running:
            task.cancel()
        await asyncio.gather(*running, return_exceptions=True)
        self._to_pilot(self._engine.last_words(f"ended: {self._parting}"))
        for link in self._links:
            link.close()
        if self._timestamps is not None:
            self._timestamps.close()
        self._publisher.close()

    def _from_vehicle(self, t_ns: int, data: bytes) -> None:
        if self._ground is not None:
            for piece in self._relay.to_ground(t_ns, data):
                self._ground.send(piece)
        self._inbox.add(t_ns, data)

    def _from_ground(self, t_ns: int, data: bytes) -> None:
        for piece in self._relay.to_vehicle(t_ns, data):
            self._link.send(piece)

    def _on_tick(self, ticker: Ticker) -> None:
        periods = ticker.read()
        self._periods += periods
        self._late_ticks += max(periods - 1, 0)
        if periods > 1:
            for link in self._links:
                self._beside.do("a look at a link", partial(link.read, MAX_LOOKS))
        if periods:
            self._tick(ticker)

    def _expect_tick(self, periods: int) -> None:
        """End the process where no tick came since `periods` were counted: nothing would steer, or say so."""
        if self._periods == periods:
            self._fail(RuntimeError(f"the timer of the loop has not fired for {TICK_PATIENCE_S:g} s"))
        elif not self._stop.is_set():
            asyncio.get_running_loop().call_later(TICK_PATIENCE_S, self._expect_tick, self._periods)

    def _between_ticks(self) -> None:
        """Take some steps of what a tick has no time for; come again while there is more."""
        more = self._commands.prepare()
        if self._drawing is not None and not self._drawing.done:
            more |= self._beside.do("the map", self._draws)
        self._works_between = more
        if more:
            asyncio.get_running_loop().call_soon(self._between_ticks)

    def _tick(self, ticker: Ticker) -> None:
        now_ns = time.monotonic_ns()
        now_s = now_ns / NS_PER_S
        self._ticks += 1
        peers = _drained(*(link.changes for link in self._links))
        self._peer_changes += len(peers)
        health = self._health(now_ns, ticker)
        engine, commands = self._engine, self._commands
        try:
            given = commands.before_tick(engine, now_s)
            requests = self._requests = [*self._requests, *given.requests]
            datagrams = self._inbox.take()
            ground = self._relay.take() if self._ground is not None else []
            out, sample = engine.step(now_s, datagrams, health, requests, ground, self._excitation)
            self._requests = []
            self._dive = self._dive.after(sample.state, self._period_ns / NS_PER_S)
            for data in out:
                self._link.send(data)
            if self._ground is not None:
                self._relay.withhold = engine.steering
            self._silent = Condition.LINK_LOST in sample.verdict.conditions
            results = commands.after_tick(engine, sample, now_s)
            if self._manoeuvre is not None:
                asks = self._manoeuvre.step(engine, sample)
                self._requests, self._excitation = [*asks.requests], asks.excitation
                if self._manoeuvre.done:
                    self._stop.set()
            self._compute_ns = time.monotonic_ns() - now_ns
        except Exception as error:
            self._ride_out(error)
            return
        raw = None if self._start is None else self._raw(now_s, datagrams, ground, out, requests, given)
        if given.config is not None:
            self._publisher.config = msgspec.json.encode(given.config)
        self._tell(now_ns, sample, peers, raw, results)
        if not self._works_between:
            self._between_ticks()

    def _health(self, now_ns: int, ticker: Ticker) -> LoopHealth:
        """Return how the loop and its links do."""
        lateness_ns = now_ns - (ticker.start_ns + (self._periods - 1) * self._period_ns)
        return LoopHealth(
            tick=self._ticks,
            rate_hz=self._ticks / ((now_ns - ticker.start_ns + self._period_ns) / NS_PER_S),
            lateness_ms=lateness_ns / 1e6,
            compute_us=self._compute_ns / 1e3,
            late_ticks=self._late_ticks,
            samples_dropped=self._publisher.dropped,
            strangers=sum(link.strangers for link in self._links),
            peer_changes=self._peer_changes,
            left_out_bytes=self._inbox.left_out + (self._relay.left_out if self._ground is not None else 0),
            errors=self._beside.count + self._publisher.beside.count,
            dive=self._dive,
        )

    def _tell(
        self,
        now_ns: int,
        sample: ControlSample,
        peers: list[str],
        raw: Raw | None,
        results: list[CommandResult],
    ) -> None:
        """Publish and log this tick. What fails of it is told, and disturbs neither the rest nor the tick."""
        duplicates, beside = _drained(self._publisher.duplicate_instances), self._beside.do
        told = [*peers, *_drained(self._beside.told, self._publisher.beside.told)]
        events: list[Event] = []
        beside("events", lambda: events.extend(self._event_log.step(sample, results, duplicates, told)))
        beside("telemetry", lambda: self._publisher.offer(sample, raw, events, self._plan(now_ns, sample)))
        beside("the pilot's display", lambda: self._to_pilot(self._engine.displayed(sample, events)))
        for event in events:
            if event.kind != "state":
                log.info("%s: %s", event.kind, event.text)
        self._report(now_ns, sample)

    def _draws(self) -> bool:
        """Take some steps of drawing the map; return whether there are more. One that fails is left out."""
        drawing, self._drawing = self._drawing, None
        more = drawing is not None and not drawing.advance(COST)
        self._drawing = drawing
        return more

    def _to_pilot(self, frames: Sequence[bytes]) -> None:
        for frame in frames:
            (self._ground or self._link).send(frame)

    @property
    def _parting(self) -> str:
        return parting(steering=self._engine.steering, silent=self._silent)

    def _ride_out(self, error: Exception) -> None:
        """Go on after a failed tick without what commands asked for; end where another one fails soon.

        A release is asked for again.
        """
        if self._ticks - self._failed_tick <= RIDE_OUT_TICKS or self._manoeuvre is not None:
            self._fail(error)
            return
        self._failed_tick = self._ticks
        self._beside.fail("a tick", error)
        self._requests = [one for one in self._requests if one in (Request.STOP, Request.WITHDRAW)]
        self._beside.do("holding", lambda: self._engine.guide(SetPath(action="hold")))
        self._beside.do("the old gains", lambda: self._engine.retune(self._config))

    def _fail(self, error: BaseException | None) -> None:
        self._failure = error
        self._stop.set()

    def _raw(
        self,
        now_s: float,
        datagrams: Sequence[tuple[int, bytes]],
        ground: Sequence[tuple[int, bytes]],
        out: Sequence[bytes],
        requests: Sequence[Request],
        given: EngineInput,
    ) -> Raw:
        return Raw(
            tick=self._ticks,
            now_s=now_s,
            heard=datagrams,
            ground=ground,
            out=out,
            requests=[request.name for request in requests],
            order=given.order,
            config=None if given.config is None else msgspec.to_builtins(given.config),
            start=self._start if self._ticks == 1 else None,
        )

    def _plan(self, now_ns: int, sample: ControlSample) -> Plan | None:
        """Return path and fence, drawn again where they changed and every few seconds, once that is done."""
        guided = (sample.guided.number, sample.guided.kind)
        if guided != self._drawn or now_ns - self._drawn_ns >= PLAN_PERIOD_S * NS_PER_S:
            self._drawn, self._drawn_ns = guided, now_ns
            self._drawing = Task(
                drawing(self._engine.path, sample.guided.number, self._engine.config, sample.state)
            )
        if self._drawing is None or not self._drawing.done:
            return None
        plan, self._drawing = self._drawing.result, None
        return plan

    def _report(self, now_ns: int, sample: ControlSample) -> None:
        """Feed the watchdog; say what changed, and every few seconds how it goes."""
        verdict = sample.verdict
        saying = (str(verdict.state), verdict.reason, verdict.remedy, sample.guided.pending)
        if saying != self._saying:
            self._saying, self._saying_ns = saying, now_ns
        settled = now_ns - self._saying_ns > SETTLED_S * NS_PER_S
        if saying != self._said and (settled or (saying[0] != self._said[0] and self._said[0])):
            self._said = saying
            name, endpoint = self._config.vehicle.name, self._config.telemetry.endpoint
            words = advised(f"{verdict.state}: {verdict.reason}", whole(verdict.remedy, name, endpoint))
            words = "; ".join(filter(None, (words, on_engaging(sample.guided.pending))))
            log.info("%s", words)
            notify(f"STATUS={words}")
        if now_ns - self._fed_ns > WATCHDOG_PERIOD_S * NS_PER_S:
            self._fed_ns = now_ns
            notify("WATCHDOG=1")
        if now_ns - self._said_ns > STATUS_PERIOD_S * NS_PER_S:
            self._said_ns = now_ns
            self._beside.do("the status line", lambda: log.info("%s", status_line(sample)))

    def _link_ended(self, task: asyncio.Task[None]) -> None:
        if not task.cancelled():
            self._fail(task.exception())


def parting(*, steering: bool, silent: bool) -> str:
    """Return what is known of the thrusters when the process ends."""
    if not steering:
        return "it was not steering"
    return "neutral was sent, but the vehicle was not heard" if silent else "the vehicle was left neutral"


def _drained(*queues: deque[str]) -> list[str]:
    """Return what waits in queues that others fill, and leave them empty."""
    return [queue.popleft() for queue in queues for _ in range(len(queue))]


def _start(config: Config, setpoint: Setpoint, arm: bool) -> Start:
    x, y, z, psi = setpoint.eta_d
    return Start(config=msgspec.to_builtins(config), setpoint=(x, y, z, psi), arm=arm, version=own_version())


def run(
    config: Config,
    setpoint: Setpoint,
    *,
    arm: bool,
    requests: Sequence[Request],
    manoeuvre: "Manoeuvre | None" = None,
) -> int:
    """Run the companion, until a `manoeuvre` is over; return its exit status."""
    return asyncio.run(App(config, setpoint, arm=arm, requests=requests, manoeuvre=manoeuvre).run())
