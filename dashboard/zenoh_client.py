"""A Zenoh client that waits for its server and returns to it. A ring keeps the newest data alone."""

from collections.abc import Callable, Iterable
from contextlib import suppress
from itertools import islice
from typing import NamedTuple

import msgspec
import zenoh
from zenoh import ext

from companion.telemetry import schemas as telemetry
from companion.telemetry.session import SessionThread, client_configuration

_RING = 4096  # messages: nine seconds of one vehicle
_CLOSE_S = 3.0
_ANSWER_S = 12.0  # an engaging takes five, and as long before it just after a start
_LAST_S = 1.0  # a router answers in milliseconds
MOST_NAMED = 8  # vehicles, in one line of a terminal
_EVENTS = 100  # that happened before we came


class Message(NamedTuple):
    """What came: the key, and the bytes under it."""

    key: str
    payload: bytes


_Samples = zenoh.handlers.Handler[zenoh.Sample]


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
        self._subscriber: zenoh.Subscriber[_Samples] | None = None
        self._events: ext.AdvancedSubscriber[_Samples] | None = None

    @property
    def connected(self) -> bool:
        """Whether somebody is at the other end now. A publisher may still be missing."""
        session = self._session
        return session is not None and bool(session.info.transports())

    def take(self) -> list[Message]:
        """Return what came since the last call, oldest first. Never blocks."""
        messages: list[Message] = []
        for source in (self._events, self._subscriber):
            while source is not None and len(messages) < _RING and (sample := source.try_recv()) is not None:
                message = _message(sample)
                if source is self._events or self._events is None or not message.key.endswith("/event"):
                    messages.append(message)
        return messages

    def last(self) -> list[Message]:
        """Return the last sample of every key, as whoever publishes them still has it. Blocks."""
        return self._replies(lambda session: session.get(self._key_expression, timeout=_LAST_S))

    def companions(self) -> set[str]:
        """Return the names of the vehicles whose companions run, as their liveliness tokens say. Blocks."""
        tokens = self._replies(
            lambda session: session.liveliness().get("holdfast/*/alive/*", timeout=_LAST_S)
        )
        return {token.key.split("/")[1] for token in tokens}

    def others(self) -> str:
        """Return in words which vehicles there are. Blocks."""
        names = sorted(self.companions())[:MOST_NAMED]
        return f"these are heard: {', '.join(map(telemetry.printable, names))}" if names else "none is heard"

    def ask(self, key: str, payload: bytes = b"", timeout_s: float = _ANSWER_S) -> bytes | None:
        """Return the answer to a query; None if nobody gave one in time. Blocks."""
        answers = self._replies(lambda session: session.get(key, payload=payload, timeout=timeout_s), most=1)
        return answers[0].payload if answers else None

    def _replies(
        self, ask: Callable[[zenoh.Session], Iterable[zenoh.Reply]], most: int | None = None
    ) -> list[Message]:
        """Return what is answered; nothing where there is no session."""
        session = self._session
        if session is not None:
            with suppress(zenoh.ZError):
                samples = (reply.ok for reply in ask(session) if reply.ok is not None)
                return [_message(sample) for sample in islice(samples, most)]
        return []

    def tell(self, vehicle: str, command: str, what: object) -> telemetry.Reply:
        """Give a vehicle a command and return what came of it; `done` is false if nobody answered. Blocks."""
        answer = self.ask(telemetry.key(vehicle, "command", command), msgspec.json.encode(what))
        if answer is None:
            said = f"nobody takes '{command}' for '{vehicle}'; {self.others()}"
            return telemetry.Reply(done=False, said=said)
        try:
            return msgspec.json.decode(answer, type=telemetry.Reply)
        except (msgspec.MsgspecError, RecursionError) as error:
            said = f"'{vehicle}' answered '{command}' with no Reply: {error}"
            return telemetry.Reply(done=False, said=said)

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


def _message(sample: zenoh.Sample) -> Message:
    return Message(str(sample.key_expr), sample.payload.to_bytes())
