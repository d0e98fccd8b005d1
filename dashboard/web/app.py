"""The web application: one Zenoh client for any number of browsers."""

import asyncio
import socket
import time
from collections.abc import Awaitable, Callable, Collection, Coroutine, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar, cast

import msgspec
from aiohttp import WSCloseCode, web

from companion.telemetry import schemas as telemetry
from companion.telemetry.operator_commands import MAX_BYTES, parse
from companion.telemetry.schemas import Plan
from dashboard.heard_vehicles import MOST_VEHICLES, Vehicle
from dashboard.web import cockpit, connections, gate, vocabulary
from dashboard.web.connections import Connection, most_crowded
from dashboard.web.fleet import Histories, VehicleHistory
from dashboard.web.rows import COLUMNS
from dashboard.zenoh_client import Subscription
from holdfast import own_version

BEAT_S = 0.025  # 40 frames a second, for plots
STATUS_S = 0.15  # a third of STALE_S of the page
CONFIG_S = 10.0  # between questions: others may tune too
CONFIG_ANSWER_S = 2.0  # of a companion under load
MOST_BROWSERS = 32  # at about 40 kB/s each
CLOSE_S = 1.0  # for a browser to say goodbye
MOST_BEHIND = 150
"""Rows: a browser that is 3 s behind gets the present instead; no frame has more of them."""
SEND_BUFFER = 65536

PANELS = {
    "depth": "Depth and its reference",
    "heading": "Heading and its reference",
    "error": "Error within its bound",
    "eps": "Combined error",
    "thrust": "Thrust and its parts",
    "disturbance": "Disturbance, as learnt",
    "weights": "Weight norm, when it learns",
    "loop": "Loop lateness",
    "phase": "Phase portrait",
    "attitude": "Horizon and compass",
    "map": "Map: trail, path and fence",
    "model": "The vehicle, as found",
    "ages": "Telemetry ages",
    "battery": "Battery",
    "events": "Events",
    "status": "State, and what to do",
}
NOBODY = Vehicle("")
_STATIC = Path(__file__).parent / "static"
_READ_ONLY = "this dashboard is read-only: it was started without --allow-control"

T = TypeVar("T")
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class Dashboard:
    """Zenoh in, web pages out."""

    def __init__(self, endpoint: str, names: Collection[str], token: str) -> None:
        """Answer to `names` besides numbers; without `token` nothing can be sent."""
        self._names = ("localhost", *names)
        self._secret = token
        self._fleet = Histories()
        self._telemetry = Subscription("holdfast/*/**", endpoint)
        self._truth = Subscription("sim/*/truth", endpoint)
        self._beat = asyncio.Event()
        self._browsers: dict[Connection, web.WebSocketResponse] = {}
        """The oldest first."""
        self._asked = ThreadPoolExecutor(connections.MOST + 2 * MOST_VEHICLES, "asked")
        """A thread for all that is asked at once: no command waits behind a vehicle that does not answer."""
        self._config_asked_s: dict[str, float] = {}
        self._tasks: set[asyncio.Task[Any]] = set()

    def application(self) -> web.Application:
        """Return the web application; it listens to Zenoh as long as it runs."""
        app = web.Application(middlewares=[self._guarded], client_max_size=MAX_BYTES)
        for path in ("/", "/engineer", "/panel/{name}"):
            app.router.add_get(path, _page)
        app.router.add_get("/ws", self._socket)
        app.router.add_post("/api/token", self._token)
        app.router.add_post("/api/{vehicle}/{command}", self._command)
        app.router.add_get("/register_service", _register)
        app.router.add_get("/cockpit_extras.json", _cockpit)
        app.router.add_get("/static/vocabulary.js", _vocabulary)
        app.router.add_static("/static", _STATIC)
        app.cleanup_ctx.append(self._run)
        return app

    async def _run(self, app: web.Application) -> Any:
        with self._telemetry, self._truth:
            pulse = asyncio.create_task(self._pulse())
            yield
            pulse.cancel()
            with suppress(asyncio.CancelledError):
                await pulse
            for browser in tuple(self._browsers.values()):
                await browser.close(code=WSCloseCode.GOING_AWAY)

    async def _pulse(self) -> None:
        """Take what Zenoh brought, and wake whoever waits for it."""
        while True:
            now_s = time.monotonic()
            self._fleet.take(self._truth.take(), now_s)
            self._fleet.take(self._telemetry.take(), now_s)
            for vehicle in self._fleet.vehicles.values():
                if now_s - self._config_asked_s.get(vehicle.name, -CONFIG_S) >= CONFIG_S:
                    self._config_asked_s[vehicle.name] = now_s
                    self._begin(self._read_config(vehicle))
            self._beat.set()
            self._beat = asyncio.Event()
            await asyncio.sleep(BEAT_S)

    def _begin(self, work: Coroutine[Any, Any, Any]) -> None:
        """Do it meanwhile; asyncio itself forgets a task that nobody holds."""
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _read_config(self, vehicle: VehicleHistory) -> None:
        keys = telemetry.key(vehicle.name, "config"), telemetry.key(vehicle.name, "choices")
        config, choices = await asyncio.gather(
            *(self._ask(self._telemetry.ask, key, b"", CONFIG_ANSWER_S) for key in keys)
        )
        with suppress(ValueError, RecursionError):
            if config is not None:
                known = telemetry.Choices(compensator=())
                if choices is not None:
                    known = msgspec.json.decode(choices, type=telemetry.Choices)
                vehicle.take_config(msgspec.json.decode(config, type=dict[str, Any]), known)

    def _ask(self, what: Callable[..., T], *about: object) -> "asyncio.Future[T]":
        return asyncio.get_running_loop().run_in_executor(self._asked, what, *about)

    @web.middleware
    async def _guarded(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Refuse strangers; put the headers on every answer."""
        _connection(request).request_came()
        if not gate.host_is_ours(request.host, self._names):
            return web.Response(
                status=421,
                text=f"This dashboard is not called {request.host!r}. Call it by number, or see its --host.",
            )
        protected = request.method != "GET" or request.path == "/ws"
        if protected and not gate.same_origin(request.headers.get("Origin"), request.host):
            return web.Response(status=403, text="Only this dashboard's own pages may do that.")
        try:
            response = await handler(request)
        except web.HTTPException as error:
            error.headers.update(gate.headers(framed=False))
            raise
        if not response.prepared:
            response.headers.update(gate.headers(framed=request.path.startswith("/panel/")))
        return response

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        """Feed one browser until it leaves; nothing that it says is listened to."""
        if len(self._browsers) >= MOST_BROWSERS:
            self._make_room()
        socket_ = web.WebSocketResponse(heartbeat=5.0, compress=False, max_msg_size=1024, timeout=CLOSE_S)
        await socket_.prepare(request)
        connection = _connection(request)
        connection.stay()
        if raw := request.get_extra_info("socket"):
            raw.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
        self._browsers[connection] = socket_
        feeding = asyncio.create_task(self._feed(socket_, request.query.get("vehicle", "")))
        try:
            async for _ in socket_:
                pass
        finally:
            self._browsers.pop(connection, None)
            connection.ends_within(CLOSE_S)
            feeding.cancel()
            with suppress(asyncio.CancelledError, ConnectionError):
                await feeding
        return socket_

    def _make_room(self) -> None:
        """Close one browser, and drop it if it does not read that."""
        oldest = most_crowded(self._browsers)
        oldest.ends_within(CLOSE_S)
        self._begin(self._browsers.pop(oldest).close(code=WSCloseCode.TRY_AGAIN_LATER))

    async def _feed(self, socket_: web.WebSocketResponse, name: str) -> None:
        """Send what is new, as fast as the browser takes it: what it missed for too long it never gets."""
        hello = {"columns": COLUMNS, "control": bool(self._secret)}
        await socket_.send_str(message_text(hello=hello))
        news: News | None = None
        status_s, said = 0.0, ""
        while True:
            if news is None and (found := self._fleet.get(name)) is not None:
                news = News(found)
            vehicle = news.vehicle if news else None
            if news is not None:
                for frame in news.frames():
                    await socket_.send_bytes(frame)
                for text in news.texts():
                    await socket_.send_str(text)
            now_s, state = time.monotonic(), vehicle.supervised if vehicle else ""
            if now_s - status_s >= STATUS_S or state != said:
                status_s, said = now_s, state
                await socket_.send_str(self._status(vehicle, now_s))
            await self._beat.wait()

    def _status(self, vehicle: VehicleHistory | None, now_s: float) -> str:
        """Return what is said of the fleet and the vehicle, and what to show if nothing new comes."""
        endpoint = self._telemetry.endpoint
        status = {"now_s": now_s, "endpoint": endpoint, "vehicles": self._fleet.briefs(now_s)}
        status["silence"] = (vehicle or NOBODY).silence(endpoint, connected=self._telemetry.connected)
        return message_text(status=status | (vehicle.status(now_s) if vehicle else {"vehicle": None}))

    def _refusal(self, request: web.Request) -> web.Response | None:
        if not self._secret:
            return _reply(403, _READ_ONLY)
        if not gate.token_is_right(request.headers.get("Authorization"), self._secret):
            return _reply(401, "the token is not the one that `holdfast dashboard` was started with")
        return None

    async def _token(self, request: web.Request) -> web.Response:
        return self._refusal(request) or _reply(200, "the token is right", done=True)

    async def _command(self, request: web.Request) -> web.Response:
        """Pass a command on to the companion, and its answer back."""
        refusal = self._refusal(request)
        if refusal is not None:
            return refusal
        name, command = request.match_info["vehicle"], request.match_info["command"]
        if name not in self._fleet.vehicles:
            return _reply(404, f"nothing is heard of '{name}'")
        try:
            wanted = parse(command, await request.read() or b"{}")
        except ValueError as error:
            return _reply(400, str(error))
        reply = await self._ask(self._telemetry.tell, name, command, wanted)
        self._config_asked_s.pop(name, None)
        return _reply_as(200, reply)


class News:
    """What one browser has not got of its vehicle yet."""

    def __init__(self, vehicle: VehicleHistory) -> None:
        self.vehicle = vehicle
        self._row = self._event = 0
        self._epoch = self._config = -1
        self._plan: Plan | None = None

    def frames(self) -> Iterator[bytes]:
        """Give the new rows; asked after each is sent, and the vehicle may have restarted meanwhile."""
        ring = self.vehicle.ring
        if ring.epoch != self._epoch:
            self._epoch, self._row, self._event = ring.epoch, 0, 0
        elif ring.end - self._row > MOST_BEHIND and self._row:
            self._row = ring.end - 1
        while ring.epoch == self._epoch and (frame := ring.frame(self._row, MOST_BEHIND)):
            data, self._row = frame
            yield data

    def texts(self) -> Iterator[str]:
        """Give what else is new, as JSON."""
        vehicle = self.vehicle
        if vehicle.event_count != self._event:
            events, self._event = vehicle.events_from(self._event), vehicle.event_count
            yield message_text(events=events)
        if vehicle.plan is not self._plan:
            self._plan = vehicle.plan
            yield message_text(plan=self._plan)
        if vehicle.config_version != self._config:
            self._config = vehicle.config_version
            yield message_text(choices=vehicle.choices)
            yield message_text(config=vehicle.config)


def _connection(request: web.Request) -> Connection:
    return cast(Connection, request.protocol)


async def _page(request: web.Request) -> web.StreamResponse:
    if request.match_info.get("name", "map") not in PANELS:
        raise web.HTTPNotFound(text=f"There are {', '.join(PANELS)}.")
    return web.FileResponse(_STATIC / "index.html")


async def _vocabulary(request: web.Request) -> web.StreamResponse:
    return web.Response(text=vocabulary.module(), content_type="text/javascript")


async def _register(request: web.Request) -> web.StreamResponse:
    """Tell BlueOS what this is: https://blueos.cloud/docs, service registration."""
    return _public(
        {
            "name": "Holdfast",
            "description": "What the station-keeping controller is doing, live.",
            "icon": "mdi-anchor",
            "company": "Holdfast",
            "version": own_version(),
            "new_page": True,
            "webpage": "/",
            "api": "",
            "extras": {"cockpit": "/cockpit_extras.json"},
        }
    )


async def _cockpit(request: web.Request) -> web.StreamResponse:
    """Offer panels and commands to Cockpit, at the address by which it asks."""
    return _public(cockpit.extras(PANELS, str(request.url.origin()), own_version()))


def _public(content: dict[str, Any]) -> web.Response:
    return web.json_response(content, headers={"Access-Control-Allow-Origin": "*"})


def message_text(**message: Any) -> str:
    """Return what a page is sent, as JSON."""
    return msgspec.json.encode(message).decode()


def _reply(status: int, said: str, *, done: bool = False) -> web.Response:
    return _reply_as(status, telemetry.Reply(done=done, said=said))


def _reply_as(status: int, reply: telemetry.Reply) -> web.Response:
    return web.Response(status=status, body=msgspec.json.encode(reply), content_type="application/json")
