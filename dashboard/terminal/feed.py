"""What came of a vehicle, for a terminal: the newest of each key, its age, and no control characters."""

import math
from collections import deque
from collections.abc import Iterable
from typing import TypeVar

import msgspec

from companion.telemetry import schemas as telemetry
from companion.telemetry.schemas import Event, Schema, printable
from dashboard.lag import Lag
from dashboard.zenoh_client import Message

STALE_S = 0.5
_RESTART_S = 1.0
_NOT_SHOWN = ("raw", "recorder", "config", "choices", "check")
_EVENTS = 2
_VEHICLES = 32

S = TypeVar("S", bound=Schema)


class Feed:
    """What came of one vehicle. `latest` has the newest record of each key's tail.

    `connected` and `age_s` (s, infinite before the first sample) are those of the last `look`.
    """

    def __init__(self, vehicle: str) -> None:
        self.vehicle = printable(vehicle)
        self.latest: dict[str, Schema] = {}
        self.events: deque[Event] = deque(maxlen=_EVENTS)
        self.trouble = ""
        self.connected = False
        self.age_s = math.inf
        self._t_s = self._heard_s = -math.inf
        self._lag, self._lag_s = Lag(), 0.0

    @property
    def complete(self) -> bool:
        """Whether something came under every key."""
        return self.latest.keys() >= telemetry.EVERY_TICK.keys()

    @property
    def stale(self) -> bool:
        """Whether this is the past."""
        return self.age_s > STALE_S

    @property
    def now_s(self) -> float:
        """The vehicle's clock at the last `look`."""
        return self._t_s + self.age_s

    def get(self, kind: type[S], tail: str) -> S | None:
        """Return the newest record of a key, None if there is none of this kind."""
        record = self.latest.get(tail)
        return record if isinstance(record, kind) else None

    def take(self, messages: Iterable[Message], now_s: float) -> None:
        """Take what arrived until `now_s`, a monotonic clock of this machine."""
        for key, payload in messages:
            if key.rpartition("/")[2] in _NOT_SHOWN:
                continue
            try:
                record = _printable(telemetry.decode(key, payload))
            except ValueError as error:
                self.trouble = printable(str(error))
                continue
            if isinstance(record, Event):
                self.events.append(record)
                continue
            self.latest[key.split("/", 2)[2]] = record
            self._mark_time(record.t_s, now_s)

    def look(self, now_s: float, *, connected: bool) -> None:
        """Say how old all is at `now_s`."""
        self.connected = connected
        self.age_s = max(0.0, now_s - self._heard_s + self._lag_s)

    def _mark_time(self, t_s: float, now_s: float) -> None:
        """Learn when the newest tick came and how much too late: what was held up is old."""
        if t_s < self._t_s - _RESTART_S:
            self._t_s, self._lag = -math.inf, Lag()
        if t_s > self._t_s:
            self._t_s, self._heard_s, self._lag_s = t_s, now_s, self._lag.add(t_s, now_s)


class Feeds(dict[str, Feed]):
    """A feed of each vehicle that is heard, at most `_VEHICLES`."""

    @property
    def complete(self) -> bool:
        """Whether somebody was heard, and everybody under every key."""
        return bool(self) and all(feed.complete for feed in self.values())

    def take(self, messages: Iterable[Message], now_s: float) -> None:
        """Take what arrived until `now_s`, a monotonic clock of this machine."""
        for message in messages:
            _, name, tail = (*message.key.split("/", 2), "", "")[:3]
            if tail and (name in self or len(self) < _VEHICLES):
                self.setdefault(name, Feed(name)).take([message], now_s)

    def look(self, now_s: float, *, connected: bool) -> list[Feed]:
        """Return who was heard, each with its age at `now_s`."""
        for feed in self.values():
            feed.look(now_s, connected=connected)
        return [feed for _, feed in sorted(self.items()) if feed.latest]


def _printable(record: Schema) -> Schema:
    """Return the record with all texts safe for a terminal: anybody may publish under these keys."""
    for name in record.__struct_fields__:
        value = getattr(record, name)
        if isinstance(value, str) and not value.isprintable():
            record = msgspec.structs.replace(record, **{name: printable(value)})
        elif isinstance(value, tuple) and any(
            isinstance(part, str) and not part.isprintable() for part in value
        ):
            record = msgspec.structs.replace(record, **{name: tuple(map(printable, value))})
    return record
