"""Zenoh sessions: how each is configured, and the thread that opens one, serves it and opens it again."""

import json
import logging
import re
import threading
from abc import ABC, abstractmethod
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Self

import zenoh

from companion.telemetry.schemas import TICKS_PER_SAMPLE
from holdfast import RefusedError, files

RETRY_S = 0.2  # less than a person notices
MAX_MESSAGE_BYTES = 1 << 20
"""A larger message is dropped before it is here: a path and a raw tick, the largest, have a quarter of it."""
_MAX_MESSAGE = "transport/link/rx/max_message_size", str(MAX_MESSAGE_BYTES)
ANSWER_S = 2.0  # of a companion; on loopback it takes milliseconds
_log = logging.getLogger(__name__)
_OPEN_MS = 1000  # for the handshake: somebody who is stopped still accepts a connection


class SessionThread(ABC):
    """Keeps a Zenoh session open in the background, from `start` to `close`: one lost is opened again."""

    def __init__(self, name: str, close_s: float) -> None:
        """`name` is the thread's; `close` waits for it for `close_s` at most."""
        self._closing = threading.Event()
        self._close_s = close_s
        self.failure: Exception | None = None
        """The last error that nobody has foreseen: trouble with the network is none."""
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    @abstractmethod
    def _open(self) -> zenoh.Session | None:
        """Open a session; return None, or raise ZError, where that is not possible now."""

    @abstractmethod
    def _serve(self, session: zenoh.Session) -> None:
        """Use the session until it is lost, which may raise ZError, or until `_closing` is set."""

    def start(self) -> None:
        """Connect, as soon and as often as it takes."""
        self._thread.start()

    def close(self) -> None:
        """Leave."""
        self._closing.set()
        if self._thread.is_alive():
            self._thread.join(self._close_s)

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _run(self) -> None:
        while not self._closing.is_set():
            try:
                session = self._open()
                if session is not None:
                    with session:
                        self._serve(session)
                    continue
            except zenoh.ZError:
                pass
            except BaseException as error:  # Zenoh's PanicException is no Exception
                self._fail(error)
            self._closing.wait(RETRY_S)

    def _fail(self, error: BaseException) -> None:
        """Note an error that nobody has foreseen; a new session follows."""
        if str(error) != str(self.failure):
            _log.error("%s failed: %r", self._thread.name, error, exc_info=error)
        self.failure = error if isinstance(error, Exception) else RuntimeError(str(error))


def configuration(
    endpoint: str, *, listen: bool = False, more: Mapping[str, object] | None = None
) -> zenoh.Config:
    """Return the configuration of a session that joins `endpoint` or, with `listen`, is a peer there.

    An endpoint that is a file is a Zenoh configuration, taken as it is. Raises RefusedError for neither.
    """
    if Path(endpoint).is_file():
        try:
            files.check_brackets(files.text(Path(endpoint)))
            config = zenoh.Config.from_file(endpoint)
            config.insert_json5(*_MAX_MESSAGE)
            return config
        except (zenoh.ZError, ValueError) as error:
            said = " ".join(str(error).split())
            raise RefusedError(f"{endpoint}: is no Zenoh configuration: {said}") from error
    if not re.fullmatch(r"[a-z0-9_-]+/[^/?#]+.*", endpoint):
        raise RefusedError(
            f"'{endpoint}' is no Zenoh endpoint, such as tcp/192.168.2.2:7447, and no such file"
        )
    config = zenoh.Config()
    config.insert_json5(*_MAX_MESSAGE)
    keys: dict[str, object] = {
        "mode": "peer" if listen else "client",
        "connect/endpoints": [] if listen else [endpoint],
        "connect/timeout_ms": 0,
        "listen/endpoints": [endpoint] if listen else [],
        "listen/timeout_ms": 0,
        "transport/unicast/open_timeout": _OPEN_MS,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": False,
    }
    for name, value in {**keys, **(more or {})}.items():
        config.insert_json5(name, json.dumps(value))
    return config


def ticks_per_sample(endpoint: str) -> int:
    """Return of how many ticks a client gets one, as its configuration says: 1 but for a radio link."""
    metadata = json.loads(configuration(endpoint).get_json("metadata")) or {}
    return int(metadata.get(TICKS_PER_SAMPLE, 1))


def client_configuration(endpoint: str) -> zenoh.Config:
    """Return the configuration of a client that by itself comes back to whoever listens on `endpoint`."""
    retry = {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 2}
    return configuration(endpoint, more={"connect/retry": retry})


def asked(endpoint: str, key: str) -> bytes | None:
    """Return the answer under a key from whoever listens at `endpoint`; None where nobody does."""
    once = {"connect/timeout_ms": int(1e3 * ANSWER_S), "connect/exit_on_failure": True}
    with suppress(zenoh.ZError, OSError), zenoh.open(configuration(endpoint, more=once)) as session:
        for reply in session.get(key, timeout=ANSWER_S):
            if reply.ok is not None:
                return reply.ok.payload.to_bytes()
    return None
