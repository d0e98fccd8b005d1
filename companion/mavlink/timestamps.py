"""Signing timestamps that outlast the process: what was believed before a restart is a replay after it.

A thread writes them once a second, so that no disk holds up the tick. What it writes is ahead of what was
believed by then: after a crash nothing can be replayed that was believed since the last write.
"""

import logging
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import msgspec

from companion.config import Config
from companion.mavlink.signing import LATEST, UNITS_PER_S, Signing, Stream
from holdfast.files import state_directory

PERIOD_S = 1.0
AHEAD = round(2.0 * UNITS_PER_S)
"""Written on top, unless the process ends in order. After a crash it takes about as long to start again."""

LAST_WRITE_S = 0.5  # as the log's and Zenoh's last words

Timestamp = Annotated[int, msgspec.Meta(ge=0, le=LATEST)]

log = logging.getLogger("holdfast")


class Stamp(msgspec.Struct, forbid_unknown_fields=True):
    """The last timestamp of one stream on one of our links."""

    link: str
    stream: Stream
    timestamp: Timestamp


class Content(msgspec.Struct, forbid_unknown_fields=True):
    """What the file holds. `key` tells one key from another, `timestamp` is our own last."""

    key: str
    timestamp: Timestamp
    seen: list[Stamp]


class TimestampFile:
    """Brings the timestamps of `signings`, by link, back from `path`, and keeps them there from `start` on.

    Trouble with the file is logged, once, and never raised.
    """

    def __init__(self, path: Path, signings: Mapping[str, Signing]) -> None:
        self._path = path
        self._signings = signings
        self._key = next(iter(signings.values())).key_name
        self._others: list[Stamp] = []
        """Those of other links, which are kept: `holdfast check` has no ground station."""
        self._said = ""
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._keep, name="timestamps", daemon=True)
        self._recall()

    def start(self) -> None:
        """Write once a second from now on."""
        self._thread.start()

    def close(self) -> None:
        """Write the last ones as they are, if the disk takes them in time."""
        self._closing.set()
        self._thread.join(LAST_WRITE_S)

    def _keep(self) -> None:
        while not self._closing.wait(PERIOD_S):
            self.write(AHEAD)
        self.write(0)

    def _recall(self) -> None:
        without = "a signed frame less than a minute old could be replayed now"
        try:
            content = msgspec.json.decode(self._path.read_bytes(), type=Content)
        except FileNotFoundError:
            log.info("signing: %s is not there, as at the first start: %s", self._path, without)
        except (OSError, msgspec.MsgspecError) as error:
            log.warning("signing: %s cannot be used (%s) and is made anew: %s", self._path, error, without)
        else:
            if content.key != self._key:
                log.info("signing: %s is of another key and is made anew", self._path)
                return
            self._others = [stamp for stamp in content.seen if stamp.link not in self._signings]
            for link, signing in self._signings.items():
                seen = {stamp.stream: stamp.timestamp for stamp in content.seen if stamp.link == link}
                signing.recall(content.timestamp, seen)

    def write(self, ahead: int) -> None:
        """Put a whole file in the place of the old one; not synced, as that wears a memory card out."""
        ours = [
            Stamp(link, stream, _later(timestamp, ahead))
            for link, signing in self._signings.items()
            for stream, timestamp in signing.seen().items()
        ]
        latest = max(signing.timestamp for signing in self._signings.values())
        content = Content(key=self._key, timestamp=_later(latest, ahead), seen=self._others + ours)
        new = self._path.with_suffix(".new")
        try:
            self._path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            new.write_bytes(msgspec.json.encode(content))
            new.replace(self._path)
        except OSError as error:
            if str(error) != self._said:
                self._said = str(error)
                log.warning(
                    "signing: timestamps cannot be kept: %s; signed frames less than a minute old could be "
                    "replayed after a restart. Make the folder writable; a service: StateDirectory=holdfast",
                    error,
                )


def _later(timestamp: int, ahead: int) -> int:
    return min(timestamp + ahead, LATEST)


def timestamps_of(config: Config, **signings: Signing | None) -> TimestampFile | None:
    """Return what keeps the timestamps of `signings` over restarts, by link; None without a key."""
    signed = {link: signing for link, signing in signings.items() if signing is not None}
    return (
        TimestampFile(state_directory() / f"signing-{config.vehicle.name}.json", signed) if signed else None
    )
