"""A Zenoh client that waits for its server and returns to it. A ring keeps the newest data alone."""

from collections.abc import Mapping
from contextlib import suppress
from typing import NamedTuple

import msgspec
import zenoh
from zenoh import ext

from companion.telemetry import schemas as telemetry
from companion.telemetry.session import SessionThread, client_configuration

_RING = 4096  # messages: nine seconds of one vehicle
_CLOSE_S = 3.0
_ANSWER_S = 8.0  # an engaging takes five
_LAST_S = 1.0
_NAMED = 8
_EVENTS = 100  # that happened before we came


class Message(NamedTuple):
    """What came: the key, and the bytes under it."""

    key: str
    payload: bytes


class Subscription(SessionThread):
    """Everything that is published under a key expression, from whenever somebody listens on `endpoint`.

    Of events also the last ones before that. `endpoint` is Zenoh's, such as tcp/127.0.0.1:7447, or the path
    of a Zenoh configuration, such as those of docs/examples/zenoh. Raises ValueError for a key expression
    that is none, RefusedError for such an endpoint; trouble with the network is never raised.
    """

    def __init__(self, key_expression: str, endpoint: str) -> None:
        try:
            self._key_expression = zenoh.KeyExpr(key_expression)
        except zenoh.ZError as error:
            raise ValueError(f"'{key_expression}' is no Zenoh key expression: {error}") from error
        client_configuration(endpoint)
        super().__init__("zenoh-client", _CLOSE_S)
        first, _, rest = key_expression.partition("/")
        vehicle = rest.partition("/")[0] if first == "holdfast" else "*"
        self._event_keys = zenoh.KeyExpr(f"holdfast/{vehicle if vehicle != '**' else '*'}/event")
        self.endpoint = endpoint
        self._session: zenoh.Session | None = None
        self._subscriber: zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]] | None = None
        self._events: ext.AdvancedSubscriber[zenoh.handlers.Handler[zenoh.Sample]] | None = None

    @property
    def connected(self) -> bool:
        """Whether somebody is at the other end now. A publisher may still be missing."""
        return self._session is not None and bool(self._session.info.transports())

    def take(self) -> list[Message]:
        """Return what came since the last call, oldest first. Never blocks."""
        messages: list[Message] = []
        if self._events is not None:
            while len(messages) < _RING and (sample := self._events.try_recv()) is not None:
                messages.append(Message(str(sample.key_expr), sample.payload.to_bytes()))
        if self._subscriber is not None:
            while len(messages) < _RING and (sample := self._subscriber.try_recv()) is not None:
                key = str(sample.key_expr)
                if self._events is None or not key.endswith("/event"):
                    messages.append(Message(key, sample.payload.to_bytes()))
        return messages

    def last(self) -> list[Message]:
        """Return the last sample of every key, as whoever publishes them still has it. Blocks."""
        session = self._session
        messages: list[Message] = []
        if session is not None:
            with suppress(zenoh.ZError):
                for reply in session.get(self._key_expression, timeout=_LAST_S):
                    if reply.ok is not None:
                        messages.append(Message(str(reply.ok.key_expr), reply.ok.payload.to_bytes()))
        return messages

    def companions(self) -> set[str]:
        """Return the names of the vehicles whose companions run, as their liveliness tokens say. Blocks."""
        session = self._session
        names: set[str] = set()
        if session is not None:
            with suppress(zenoh.ZError):
                for reply in session.liveliness().get("holdfast/*/alive/*", timeout=_LAST_S):
                    if reply.ok is not None:
                        names.add(str(reply.ok.key_expr).split("/")[1])
        return names

    def others(self) -> str:
        """Return in words which vehicles there are; for one that does not answer. Blocks."""
        names = sorted(self.companions())[:_NAMED]
        return f"; these are heard: {', '.join(map(telemetry.printable, names))}" if names else "; nobody is"

    def ask(self, key: str, payload: bytes = b"", timeout_s: float = _ANSWER_S) -> bytes | None:
        """Return the answer to a query; None if nobody gave one in time. Blocks."""
        session = self._session
        if session is None:
            return None
        with suppress(zenoh.ZError):
            for reply in session.get(key, payload=payload, timeout=timeout_s):
                if reply.ok is not None:
                    return reply.ok.payload.to_bytes()
        return None

    def tell(self, vehicle: str, command: str, what: Mapping[str, object]) -> telemetry.Reply:
        """Give a vehicle a command and return what came of it; `done` is false if nobody answered. Blocks."""
        answer = self.ask(telemetry.command_key(vehicle, command), msgspec.json.encode(what))
        if answer is None:
            return telemetry.Reply(
                done=False, said=f"nobody takes '{command}' for '{vehicle}'{self.others()}"
            )
        try:
            return msgspec.json.decode(answer, type=telemetry.Reply)
        except (msgspec.MsgspecError, RecursionError) as error:
            return telemetry.Reply(
                done=False, said=f"'{vehicle}' answered '{command}' with no Reply: {error}"
            )

    def _open(self) -> zenoh.Session:
        return zenoh.open(client_configuration(self.endpoint))

    def _serve(self, session: zenoh.Session) -> None:
        """Subscribe, and stay: a client comes back to its server by itself."""
        if self._event_keys.intersects(self._key_expression):
            events: zenoh.handlers.RingChannel[zenoh.Sample] = zenoh.handlers.RingChannel(_EVENTS)
            history = ext.HistoryConfig(detect_late_publishers=True, max_samples=_EVENTS)
            self._events = ext.declare_advanced_subscriber(session, self._event_keys, events, history=history)
        ring: zenoh.handlers.RingChannel[zenoh.Sample] = zenoh.handlers.RingChannel(_RING)
        self._subscriber = session.declare_subscriber(self._key_expression, ring)
        self._session = session
        self._closing.wait()
        self._session = self._subscriber = self._events = None
