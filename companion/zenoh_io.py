"""ControlSamples to whoever listens. The only importer of zenoh in the companion.

The tick only offers; a thread of its own encodes, publishes and cares for the session. It joins the router
or peer that listens on the endpoint, if one is there, and otherwise listens there itself, on loopback only:
so on one host somebody always listens, whoever started first, and everybody else is a client.
"""

import json
import logging
import queue
import threading
from contextlib import suppress
from types import TracebackType
from typing import Self

import msgspec
import zenoh
from zenoh import ext

from companion import telemetry
from companion.types import ControlSample

_QUEUE = 64  # samples: 1.3 s at 50 Hz
_OPEN_MS = 1000  # for the handshake: somebody who is stopped still accepts a connection
_RETRY_S = 0.2
_ROUTER_GRACE = 25  # attempts to rejoin a router, 5 s, before we take the port that it may want back
_CLOSE_S = 0.5
_RAW_KEPT = 3000  # ticks that a recorder gets after the event: a minute

_log = logging.getLogger(__name__)
_Offered = tuple[ControlSample, telemetry.Raw | None]


class Publisher:
    """Publishes one vehicle's samples under the keys of `telemetry.keys`, and a liveliness token.

    `endpoint` is Zenoh's, such as tcp/127.0.0.1:7447. `dropped` counts the samples that nobody could take in
    time. Whoever subscribes to the raw ticks gets the last minute's as well: no recorder is there at the
    first one. Raises ValueError for a vehicle name that is no key; trouble with the network is never raised.
    """

    def __init__(self, vehicle: str, endpoint: str = telemetry.ENDPOINT) -> None:
        self.dropped = 0
        self._vehicle = vehicle
        self._keys = telemetry.keys(vehicle)
        self._endpoint = endpoint
        self._queue: queue.SimpleQueue[_Offered | None] = queue.SimpleQueue()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="zenoh", daemon=True)

    def start(self) -> None:
        """Open and publish from now on, in the background."""
        self._thread.start()

    def offer(self, sample: ControlSample, raw: telemetry.Raw | None = None) -> None:
        """Hand over what nobody may change any more. Never blocks; the oldest gives way."""
        if self._queue.qsize() >= _QUEUE:
            with suppress(queue.Empty):
                self._queue.get_nowait()
                self.dropped += 1
        self._queue.put((sample, raw))

    def close(self) -> None:
        """Leave, within half a second and from any state. Offers are ignored from here on."""
        self._closing.set()
        self._queue.put(None)
        if self._thread.is_alive():
            self._thread.join(_CLOSE_S)

    def __enter__(self) -> Self:
        """Start."""
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close."""
        self.close()

    def _run(self) -> None:
        attempts_before_listening = 0
        while not self._closing.is_set():
            session = self._join()
            joined = session is not None
            if session is None and attempts_before_listening == 0:
                session = self._listen()
            attempts_before_listening = max(0, attempts_before_listening - 1)
            if session is None:
                self._closing.wait(_RETRY_S)
                continue
            with session:
                if joined and session.info.routers_zid():
                    attempts_before_listening = _ROUTER_GRACE
                self._publish(session, joined)

    def _join(self) -> zenoh.Session | None:
        session = _open("client", connect=self._endpoint)
        if session:
            _log.info("zenoh: joined %s", self._endpoint)
        return session

    def _listen(self) -> zenoh.Session | None:
        if not _is_loopback(self._endpoint):
            return None
        session = _open("peer", listen=self._endpoint)
        if session:
            _log.info("zenoh: listening on %s", self._endpoint)
        return session

    def _publish(self, session: zenoh.Session, joined: bool) -> None:
        """Publish until closed or, where we joined somebody, until that one has gone."""
        lost = threading.Event()

        def on_transport(event: zenoh.TransportEvent) -> None:
            if joined and event.kind == zenoh.SampleKind.DELETE:
                lost.set()

        raw_publisher: ext.AdvancedPublisher | None = None
        with suppress(zenoh.ZError):
            publishers = {key: _publisher(session, key, encoding) for key, encoding in self._keys.items()}
            with (
                session.info.declare_transport_events_listener(on_transport),
                session.liveliness().declare_token(telemetry.alive_key(self._vehicle, str(session.zid()))),
            ):
                if joined and not session.info.transports():
                    lost.set()  # gone before anybody listened for it
                while not (self._closing.is_set() or lost.is_set()):
                    with suppress(queue.Empty):
                        offered = self._queue.get(timeout=_RETRY_S)
                        if offered is None:
                            continue
                        sample, raw = offered
                        for key, _, payload in telemetry.encode(sample, self._vehicle):
                            publishers[key].put(payload)
                        if raw is not None:
                            raw_publisher = raw_publisher or _raw_publisher(session, self._vehicle)
                            raw_publisher.put(msgspec.msgpack.encode(raw))
        if not self._closing.is_set():
            _log.warning("zenoh: lost %s, trying again", self._endpoint)


def _publisher(session: zenoh.Session, key: str, encoding: str) -> zenoh.Publisher:
    return session.declare_publisher(
        key,
        encoding=zenoh.Encoding(encoding),
        congestion_control=zenoh.CongestionControl.DROP,
        priority=zenoh.Priority.REAL_TIME,
        express=True,
    )


def _raw_publisher(session: zenoh.Session, vehicle: str) -> ext.AdvancedPublisher:
    key, encoding = telemetry.raw_key(vehicle)
    return ext.declare_advanced_publisher(
        session,
        key,
        encoding=zenoh.Encoding(encoding),
        congestion_control=zenoh.CongestionControl.DROP,
        priority=zenoh.Priority.REAL_TIME,
        express=True,
        cache=ext.CacheConfig(_RAW_KEPT),
        publisher_detection=True,
    )


def _open(mode: str, *, connect: str = "", listen: str = "") -> zenoh.Session | None:
    config = zenoh.Config()
    for name, value in {
        "mode": mode,
        "connect/endpoints": [connect] if connect else [],
        "connect/timeout_ms": 0,
        "listen/endpoints": [listen] if listen else [],
        "listen/timeout_ms": 0,
        "transport/unicast/open_timeout": _OPEN_MS,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "timestamping/enabled": True,
        "transport/shared_memory/enabled": False,
    }.items():
        config.insert_json5(name, json.dumps(value))
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        _log.debug("zenoh: %s", error)
        return None


def _is_loopback(endpoint: str) -> bool:
    host = endpoint.partition("/")[2].rpartition(":")[0]
    return host in ("localhost", "[::1]") or host.startswith("127.")
