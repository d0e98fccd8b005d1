"""MAVLink 2 signing: who holds the key may speak (https://mavlink.io/en/guide/message_signing.html).

A signed frame ends with the link's id, a timestamp and the first six bytes of SHA-256(key + all before). The
timestamp counts 10 µs since 2015 and never goes back: that is what stops a replay. It need not be the time:
whoever hears a later one, rightly signed, goes on from there, so a computer without a clock battery and one
whose clock was set back both find their way to the present. One beyond `LATEST` is a wrong clock, or wants to
leave none to come after it: it is not believed.
"""

import hashlib
import hmac
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TypeAlias

from companion.config import Config, ConfigError
from companion.records import Sender

KEY_BYTES = 32
MIN_SIGNED_BYTES = 25
EPOCH_S = 1_420_070_400
UNITS_PER_S = 100_000
MAX_TIMESTAMP = (1 << 48) - 1
LATEST = MAX_TIMESTAMP - round(10 * 365.25 * 86400 * UNITS_PER_S)
"""A time in 2094: ten years before the six bytes of a timestamp end."""
NEW_STREAM_UNITS = 60 * UNITS_PER_S
"""A sender not heard before may be this far behind our own timestamp."""

Stream: TypeAlias = tuple[int, int, int]
"""Link id, system, component."""


class Signing:
    """One key and one clock: the timestamps that we sign with, and the check of other senders'."""

    def __init__(self, key: bytes, link_id: int = 0, utc_s: float = EPOCH_S) -> None:
        self.key = key
        self.link_id = link_id
        since = max(0, round((utc_s - EPOCH_S) * UNITS_PER_S))
        self._start = self._timestamp = since if since <= LATEST else 0
        self._start_s: float | None = None
        self._seen: dict[Stream, int] = {}

    @property
    def key_name(self) -> str:
        """What tells our key from another, and does not give it away."""
        return hashlib.sha256(b"holdfast key name" + self.key).hexdigest()[:16]

    @property
    def timestamp(self) -> int:
        """The latest that was returned or believed."""
        return self._timestamp

    def seen(self) -> dict[Stream, int]:
        """Return the latest timestamp of each stream; another thread may ask."""
        return dict(self._seen)

    def recall(self, timestamp: int, seen: Mapping[Stream, int]) -> None:
        """Go on from what an earlier process returned or believed."""
        self._timestamp = max(self._timestamp, timestamp)
        self._seen.update(seen)

    def advance(self, now_s: float) -> None:
        """Let the timestamp follow the monotonic clock; a UTC clock that is set meanwhile changes nothing."""
        if self._start_s is None:
            self._start_s = now_s
        self._timestamp = max(self._timestamp, self._start + round((now_s - self._start_s) * UNITS_PER_S))

    def next_timestamp(self) -> int:
        """Return a timestamp later than all that were returned or believed before."""
        self._timestamp = min(self._timestamp + 1, MAX_TIMESTAMP)
        return self._timestamp

    def signed(self, frame: bytes) -> bytes:
        """Return a frame, whose flags tell that it is signed, with its signature and the next timestamp.

        One of the same stream that is no later is this one, or a replay: `accepts` refuses it.
        """
        timestamp = self.next_timestamp()
        self._seen[self.link_id, frame[5], frame[6]] = timestamp
        frame += bytes((self.link_id,)) + timestamp.to_bytes(6, "little")
        return frame + self._signature(frame)

    def accepts(self, frame: bytes) -> bool:
        """Tell whether a whole MAVLink 2 frame is signed with our key, and later than its sender's last.

        It is remembered: the same frame is refused next time.
        """
        if self.sender(frame) is not Sender.EXPECTED:
            return False
        stream, timestamp = _stamp(frame)
        self._seen[stream] = timestamp
        self._timestamp = max(self._timestamp, timestamp)
        return True

    def sender(self, frame: bytes) -> Sender:
        """Tell whether a frame's sender has our key. Nothing is remembered: `accepts` still finds it new."""
        signed = len(frame) >= MIN_SIGNED_BYTES and frame[2] & 1
        if not (signed and hmac.compare_digest(self._signature(frame[:-6]), frame[-6:])):
            return Sender.STRANGER
        stream, timestamp = _stamp(frame)
        new = self._seen.get(stream, self._timestamp - NEW_STREAM_UNITS) < timestamp <= LATEST
        return Sender.EXPECTED if new else Sender.BEHIND

    def _signature(self, data: bytes) -> bytes:
        return hashlib.sha256(self.key + data).digest()[:6]


def _stamp(frame: bytes) -> tuple[Stream, int]:
    """Return a signed frame's stream and its timestamp."""
    return (frame[-13], frame[5], frame[6]), int.from_bytes(frame[-12:-6], "little")


def read_key(path: Path) -> bytes:
    """Return the key in a file: 32 raw bytes, 64 hex digits, or a passphrase, whose SHA-256 is taken.

    That is what QGroundControl and MAVProxy make of a passphrase too. Raises ConfigError for a file that
    cannot be read or is empty, and for one that others may read; systemd's credentials are for their service
    alone, whatever their mode says (an ACL).
    """
    key = f"link.signing_key_file = '{path}'"
    try:
        content, mode = path.read_bytes(), path.stat().st_mode
    except OSError as error:
        raise ConfigError(f"{key}: cannot be read: {error.strerror}") from error
    if mode & 0o077 and str(path.parent) != os.environ.get("CREDENTIALS_DIRECTORY"):
        raise ConfigError(
            f"{key}: others can read or change it (its mode is {mode & 0o777:03o}): chmod 600 {path}, and "
            "make a new key if somebody else was on this machine"
        )
    text = content.strip()
    if not text:
        raise ConfigError(f"{key}: is empty; put 64 hex digits or a passphrase there")
    if len(content) == KEY_BYTES and not content.isascii():
        return content
    if re.fullmatch(rb"[0-9a-fA-F]{64}", text):
        return bytes.fromhex(text.decode())
    return hashlib.sha256(text).digest()


def signing_of(config: Config, utc_s: float) -> Signing | None:
    """Return what signs and judges frames; None without a key file."""
    file = config.link.signing_key_file
    return Signing(read_key(Path(file)), config.link.signing_link_id, utc_s) if file else None
