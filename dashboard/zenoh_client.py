"""A Zenoh client that waits for its server and returns to it. A ring keeps the newest data only."""

import json
import threading
from contextlib import suppress
from types import TracebackType
from typing import NamedTuple, Self

import zenoh

from companion import telemetry

_RING = 4096  # messages: nine seconds of one vehicle
_OPEN_MS = 1000  # for the handshake: somebody who is stopped still accepts a connection
_RETRY_S = 0.2
_CLOSE_S = 1.0


class Message(NamedTuple):
    """What came: the key, and the bytes under it."""

    key: str
    payload: bytes


class Subscription:
    """Everything that is published under a key expression, from whenever somebody listens on `endpoint`.

    Raises ValueError for a key expression that is none; trouble with the network is never raised.
    """

    def __init__(self, key_expression: str, endpoint: str = telemetry.ENDPOINT) -> None:
        try:
            self._key_expression = zenoh.KeyExpr(key_expression)
        except zenoh.ZError as error:
            raise ValueError(f"'{key_expression}' is no Zenoh key expression: {error}") from error
        self._endpoint = endpoint
        self._session: zenoh.Session | None = None
        self._subscriber: zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]] | None = None
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._open, name="zenoh-client", daemon=True)

    @property
    def connected(self) -> bool:
        """Whether somebody is at the other end now. A publisher may still be missing."""
        return self._session is not None and bool(self._session.info.transports())

    def take(self) -> list[Message]:
        """Return what came since the last call, oldest first. Never blocks."""
        messages: list[Message] = []
        if self._subscriber is not None:
            while len(messages) < _RING and (sample := self._subscriber.try_recv()) is not None:
                messages.append(Message(str(sample.key_expr), sample.payload.to_bytes()))
        return messages

    def start(self) -> None:
        """Connect, in the background, as soon and as often as it takes."""
        self._thread.start()

    def close(self) -> None:
        """Leave."""
        self._closing.set()
        if self._thread.is_alive():
            self._thread.join(_CLOSE_S)
        self._subscriber = None
        if self._session is not None:
            self._session.close()  # type: ignore[no-untyped-call]
            self._session = None

    def __enter__(self) -> Self:
        """Start."""
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close."""
        self.close()

    def _open(self) -> None:
        while not self._closing.is_set():
            with suppress(zenoh.ZError):
                session = zenoh.open(_config(self._endpoint))
                ring: zenoh.handlers.RingChannel[zenoh.Sample] = zenoh.handlers.RingChannel(_RING)
                self._subscriber = session.declare_subscriber(self._key_expression, ring)
                self._session = session
                return
            self._closing.wait(_RETRY_S)


def _config(endpoint: str) -> zenoh.Config:
    config = zenoh.Config()
    for name, value in {
        "mode": "client",
        "connect/endpoints": [endpoint],
        "connect/timeout_ms": 0,
        "connect/retry": {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 2},
        "listen/endpoints": [],
        "transport/unicast/open_timeout": _OPEN_MS,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": False,
    }.items():
        config.insert_json5(name, json.dumps(value))
    return config
