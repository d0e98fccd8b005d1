"""Publishes samples and events over Zenoh, and takes commands. The only zenoh of the companion.

The tick only offers; a thread of its own encodes, publishes, replies and cares for the session. As "peer" it
joins the router or peer that listens on the endpoint; if there is none, it listens there itself, on loopback
only: the first process of a host listens, and all others are clients.
As "client" it only joins: a router that starts after us finds its port free. As "file" it opens what a Zenoh
configuration file says, such as those of docs/examples/zenoh.
"""

import logging
import queue
import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from ipaddress import ip_address
from pathlib import Path
from typing import Literal

import msgspec
import zenoh
from zenoh import ext

from companion.io.beside import Beside
from companion.io.command_queue import ReceivedCommand
from companion.records import ControlSample
from companion.telemetry import schemas as telemetry
from companion.telemetry.operator_commands import COMMANDS
from companion.telemetry.samples import encode
from companion.telemetry.session import RETRY_S, SessionThread, configuration
from holdfast import RefusedError

_QUEUE = 64  # samples: 1.3 s at 50 Hz
_MAIL = 256  # events, and as many answers
_ROUTER_GRACE = 25  # attempts to rejoin a router, 5 s, before we take the port that it may want back
_CLOSE_S = 0.5
_ASK_S = 1.0  # for the network to name the companions there are
_GIVE_WAY_S = 0.5  # to one that started at the same moment
_RAW_KEPT = 3000  # ticks that a recorder gets after the event: a minute
_EVENTS_KEPT = 100  # for those who come later
MOST_UTC_S = 2.0**32 - 86400.0  # in 2106: Zenoh's time stamps end there, and it panics

_log = logging.getLogger(__name__)
_Offered = tuple[ControlSample, telemetry.Raw | None]
_Answer = tuple[zenoh.Query, telemetry.Reply]
_Sample = tuple[bytes, zenoh.Timestamp | None]
_NowAndThen = dict[type[telemetry.Schema], zenoh.Publisher | ext.AdvancedPublisher]


class NameTakenError(Exception):
    """Another companion has this vehicle's name, or may have it."""


class Publisher(SessionThread):
    """Publishes one vehicle's samples under the keys of `telemetry.keys`, events, and a liveliness token.

    `endpoint` is Zenoh's, such as tcp/127.0.0.1:7447, or in mode "file" a path. `dropped` counts the samples
    that nobody could take in time. A query for a key, or for all of them, returns the last sample of each,
    and what `config`, `choices` and `check_list` are. `on_command` is called with each command, on a thread
    of Zenoh's. `utc_s` is this machine's clock: beyond `MOST_UTC_S` nothing is stamped. Raises RefusedError
    for an endpoint that is none; later trouble is never raised: `beside` tells it.
    """

    def __init__(
        self,
        vehicle: str,
        endpoint: str,
        mode: Literal["peer", "client", "file"] = "peer",
        on_command: Callable[[ReceivedCommand], None] | None = None,
        choices: telemetry.Choices | None = None,
        check_list: Callable[[], str] = lambda: "",
        utc_s: Callable[[], float] = lambda: 0.0,
    ) -> None:
        super().__init__("zenoh", _CLOSE_S)
        self.dropped = 0
        self.config = b"{}"
        self.duplicate_instances: deque[str] = deque(maxlen=8)
        """Companions of this vehicle's name that came after us; the reader removes them."""
        self._vehicle = vehicle
        self._keys = telemetry.keys(vehicle)
        try:
            configuration(endpoint)
        except RefusedError as error:
            raise RefusedError(f"telemetry.endpoint: {error}") from error
        if (mode == "file") != Path(endpoint).is_file():
            what = "the path of a Zenoh configuration" if mode == "file" else "one such as tcp/127.0.0.1:7447"
            raise RefusedError(f"telemetry.endpoint = '{endpoint}': telemetry.mode is {mode}, want {what}")
        self._endpoint = endpoint
        self._mode = mode
        self._on_command = on_command
        self._choices = choices or telemetry.Choices(compensator=())
        self._check_list = check_list
        self._utc_s = utc_s
        self.beside = Beside(zenoh.ZError)
        self._queue: queue.SimpleQueue[_Offered | None] = queue.SimpleQueue()
        self._last: dict[str, _Sample] = {}
        self._mail: deque[telemetry.Schema] = deque(maxlen=_MAIL)
        self._answers: deque[_Answer] = deque(maxlen=_MAIL)
        self._name_checked = threading.Event()
        self._existing_instance = ""
        self._joined = False
        self._attempts_before_listening = 0

    def claim(self, patience_s: float) -> None:
        """Wait until it is known that no other companion has this vehicle's name.

        Raises NameTakenError if one has, or if nobody can tell because whoever holds our endpoint is mute.
        Where there is no network to ask, the name is ours.
        """
        known = self._name_checked.wait(patience_s)
        if self._existing_instance:
            raise NameTakenError(
                f"another companion is '{self._vehicle}' already: instance {self._existing_instance}, at "
                f"{self._endpoint}. End that one, or give this one another vehicle.name"
            )
        if not known and self._mode == "peer" and is_loopback(self._endpoint):
            raise NameTakenError(
                f"somebody holds {self._endpoint} and does not answer: a stopped companion? "
                "End that process, or choose another telemetry.endpoint"
            )

    def offer(
        self,
        sample: ControlSample,
        raw: telemetry.Raw | None = None,
        events: Sequence[telemetry.Schema] = (),
        plan: telemetry.Plan | None = None,
    ) -> None:
        """Queue one tick, which must not change any more. Never blocks; drops the oldest when full."""
        self._mail.extend(events)
        if plan is not None:
            self._mail.append(plan)
        if self._queue.qsize() >= _QUEUE:
            with suppress(queue.Empty):
                self.dropped += self._queue.get_nowait() is not None
        self._queue.put((sample, raw))

    def close(self) -> None:
        """Leave, within half a second and from any state. Offers are ignored from here on."""
        self._closing.set()
        self._queue.put(None)
        super().close()

    def _open(self) -> zenoh.Session | None:
        if self._mode == "file":
            return self._try("open by", listen=False)
        session = self._try("joined", listen=False)
        self._joined = session is not None
        may_listen = self._mode == "peer" and is_loopback(self._endpoint)
        if session is None and may_listen and self._attempts_before_listening == 0:
            session = self._try("listening on", listen=True)
        if not self._joined:
            self._attempts_before_listening = max(0, self._attempts_before_listening - 1)
        if session is None and not may_listen:
            self._name_checked.set()  # there is nobody to ask
        return session

    def _try(self, how: str, *, listen: bool) -> zenoh.Session | None:
        more = {"timestamping/enabled": self._stamps, "transport/link/tx/queue/size": telemetry.BATCHES}
        try:
            session = zenoh.open(configuration(self._endpoint, listen=listen, more=more))
        except (zenoh.ZError, RefusedError) as error:
            level = logging.DEBUG
            if self._mode == "file":
                level = logging.DEBUG if self._name_checked.is_set() else logging.WARNING
                self._name_checked.set()
            _log.log(level, "zenoh: %s: %s", self._endpoint, error)
            return None
        _log.info("zenoh: %s %s", how, self._endpoint)
        return session

    @property
    def _stamps(self) -> bool:
        return self._utc_s() < MOST_UTC_S

    def _fail(self, error: BaseException) -> None:
        self.beside.fail("telemetry", error)
        self._name_checked.set()  # nobody can be asked

    def _serve(self, session: zenoh.Session) -> None:
        """Publish until closed or, where we joined a router or peer, until it has gone."""
        stamps = self._stamps
        joined, lost, routed = self._joined, threading.Event(), threading.Event()
        if session.info.routers_zid():
            routed.set()
            self._attempts_before_listening = _ROUTER_GRACE

        def on_transport(event: zenoh.TransportEvent) -> None:
            if event.kind == zenoh.SampleKind.PUT and event.transport.whatami == zenoh.WhatAmI.ROUTER:
                routed.set()
            if joined and event.kind == zenoh.SampleKind.DELETE:
                lost.set()

        instance = str(session.zid())
        with suppress(zenoh.ZError):
            if not self._name_checked.is_set() and self._found(self._others(session, instance)):
                return
            publishers = {key: _publisher(session, key, encoding) for key, encoding in self._keys.items()}
            now_and_then: _NowAndThen = {
                telemetry.Event: _history(
                    session, *telemetry.published(self._vehicle, "event"), _EVENTS_KEPT, counts=not stamps
                ),
                telemetry.Plan: _publisher(session, *telemetry.published(self._vehicle, "plan")),
            }
            raw = _history(
                session, *telemetry.published(self._vehicle, "raw"), _RAW_KEPT, recover=True, counts=True
            )
            with (
                session.info.declare_transport_events_listener(on_transport),
                session.liveliness().declare_token(telemetry.key(self._vehicle, "alive", instance)),
            ):
                if joined and not session.info.transports():
                    lost.set()  # gone before anybody listened for it
                if not self._name_checked.is_set() and self._gives_way(session, instance):
                    return
                self._name_checked.set()
                self._answer_from(session, routed)
                self._note_duplicates(session, instance)
                while not (self._closing.is_set() or lost.is_set()) and self._stamps is stamps:
                    with suppress(queue.Empty):
                        offered = self._queue.get(timeout=RETRY_S)
                        for waiting in (self._mail, self._answers):
                            for _ in range(len(waiting)):
                                deliver = partial(self._deliver, session, now_and_then, waiting.popleft())
                                self.beside.do("telemetry", deliver)
                        if offered is not None:
                            send = partial(self._publish, session, publishers, raw, *offered)
                            self.beside.do("telemetry", send)
        if not self._closing.is_set():
            _log.warning("zenoh: lost %s, trying again", self._endpoint)

    def _gives_way(self, session: zenoh.Session, instance: str) -> bool:
        """Tell whether another companion has our name.

        Of two that declared at the same moment the one with the greater id gives way, if it saw the other:
        who stays has not seen us.
        """
        others = self._others(session, instance)
        if others and min(others) > instance:
            self._closing.wait(_GIVE_WAY_S)
            others = self._others(session, instance)
        return self._found(others)

    def _others(self, session: zenoh.Session, instance: str) -> list[str]:
        """Return the instances of companions with our name."""
        found = session.liveliness().get(telemetry.key(self._vehicle, "alive", "*"), timeout=_ASK_S)
        keys = [str(reply.ok.key_expr) for reply in found if reply.ok is not None]
        return [key.rpartition("/")[2] for key in keys if not key.endswith(f"/{instance}")]

    def _found(self, existing_instances: Sequence[str]) -> bool:
        """Remember who has our name, and end; or return False."""
        if not existing_instances:
            return False
        self._existing_instance = existing_instances[0]
        self._closing.set()
        self._name_checked.set()
        return True

    def _note_duplicates(self, session: zenoh.Session, instance: str) -> None:
        def on_token(sample: zenoh.Sample) -> None:
            other = str(sample.key_expr).rpartition("/")[2]
            if sample.kind == zenoh.SampleKind.PUT and other != instance:
                self.duplicate_instances.append(other)

        tokens = telemetry.key(self._vehicle, "alive", "*")
        session.liveliness().declare_subscriber(tokens, on_token, history=True)

    def _answer_from(self, session: zenoh.Session, routed: threading.Event) -> None:
        """Take commands, and answer for all that can be asked, as long as the session lasts.

        A command is local where only loopback is open, and no router, once `routed`, forwards from elsewhere.
        """
        here = self._mode == "peer" and is_loopback(self._endpoint)

        def answer(key: str, encoding: str, source: Callable[[], _Sample | None]) -> None:
            def on_query(query: zenoh.Query) -> None:
                with query:
                    if (found := source()) is not None:
                        payload, stamp = found
                        query.reply(key, payload, encoding=zenoh.Encoding(encoding), timestamp=stamp)

            session.declare_queryable(key, on_query)

        def on_command(query: zenoh.Query) -> None:
            key = str(query.key_expr)
            if self._on_command is None or "*" in key:
                query.drop()  # type: ignore[no-untyped-call]
                return
            payload = query.payload.to_bytes() if query.payload is not None else b""
            name, local = key.rpartition("/")[2], here and not routed.is_set()
            self._on_command(ReceivedCommand(name, payload, partial(self._reply, query), local))

        vehicle = self._vehicle
        choices = msgspec.json.encode(self._choices), None
        for tail, encoding, source in (
            ("config", telemetry.CONFIG_ENCODING, lambda: (self.config, None)),
            ("choices", telemetry.encoding(telemetry.Choices), lambda: choices),
            ("check", telemetry.CONFIG_ENCODING, lambda: (self._check_list().encode(), None)),
        ):
            answer(telemetry.key(vehicle, tail), encoding, source)
        last = (*self._keys.items(), *(telemetry.published(vehicle, tail) for tail in ("event", "plan")))
        for key, encoding in last:
            answer(key, encoding, partial(self._last.get, key))
        for name in COMMANDS:
            session.declare_queryable(telemetry.key(vehicle, "command", name), on_command)

    def _reply(self, query: zenoh.Query, reply: telemetry.Reply) -> None:
        self._answers.append((query, reply))
        if self._queue.empty():  # else the thread wakes anyway
            self._queue.put(None)

    def _stamp(self, session: zenoh.Session) -> zenoh.Timestamp | None:
        return session.new_timestamp() if self._stamps else None

    def _publish(
        self,
        session: zenoh.Session,
        publishers: Mapping[str, zenoh.Publisher],
        raw_publisher: ext.AdvancedPublisher,
        sample: ControlSample,
        raw: telemetry.Raw | None,
    ) -> None:
        stamp = self._stamp(session)
        for key, _, payload in encode(sample, self._vehicle):
            self._last[key] = payload, stamp
            publishers[key].put(payload, timestamp=stamp)
        if raw is not None:
            raw_publisher.put(msgspec.msgpack.encode(raw))

    def _deliver(
        self, session: zenoh.Session, publishers: _NowAndThen, item: telemetry.Schema | _Answer
    ) -> None:
        if isinstance(item, tuple):
            query, reply = item
            with suppress(zenoh.ZError), query:
                encoding = zenoh.Encoding(telemetry.encoding(telemetry.Reply))
                query.reply(str(query.key_expr), msgspec.json.encode(reply), encoding=encoding)
            return
        publisher, payload = publishers[type(item)], telemetry.to_json(item)
        self._last[str(publisher.key_expr)] = payload, self._stamp(session)
        publisher.put(payload)


def _publisher(session: zenoh.Session, key: str, encoding: str) -> zenoh.Publisher:
    return session.declare_publisher(
        key,
        encoding=zenoh.Encoding(encoding),
        congestion_control=zenoh.CongestionControl.DROP,
        priority=zenoh.Priority.REAL_TIME,
    )


def _history(
    session: zenoh.Session, key: str, encoding: str, kept: int, *, recover: bool = False, counts: bool
) -> ext.AdvancedPublisher:
    """Return a publisher whose last `kept` samples a late subscriber gets as well.

    With `recover` a subscriber can ask again for one that was dropped; such samples stay behind the others.
    It `counts` its samples, or else stamps them.
    """
    missed = ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=None)
    return ext.declare_advanced_publisher(
        session,
        key,
        encoding=zenoh.Encoding(encoding),
        congestion_control=zenoh.CongestionControl.DROP,
        priority=zenoh.Priority.DATA if recover else zenoh.Priority.REAL_TIME,
        cache=ext.CacheConfig(kept),
        sample_miss_detection=missed if counts else None,
        publisher_detection=True,
    )


def is_loopback(endpoint: str) -> bool:
    """Tell whether a Zenoh endpoint is an address of this machine alone."""
    host = endpoint.partition("/")[2].rpartition(":")[0]
    with suppress(ValueError):
        return host == "localhost" or ip_address(host.strip("[]")).is_loopback
    return False
