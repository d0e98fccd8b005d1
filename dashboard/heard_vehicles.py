"""What is known of every vehicle that is heard, for the terminal and the page. No clock, no socket."""

import math
from collections import deque
from collections.abc import Callable, Iterable
from typing import Generic, TypeVar

from msgspec.structs import replace

from companion.telemetry import schemas as telemetry
from companion.telemetry.glossary import holder, silence
from companion.telemetry.schemas import EVERY_TICK, NOW_AND_THEN, Event, Loop, Schema, State, Supervisor
from dashboard.zenoh_client import Message

MOST_VEHICLES = 32  # more than an expedition has; strangers may publish names
EVENTS = 200  # twice what the page lists
MOST_TEXT = 500
"""Characters: anybody may publish."""
RESTART_S = 1.0
"""A clock that goes back by more has restarted."""
FORGET_S = 60.0  # clocks drift by 50 ppm: 3 ms
MOST_LAGS = 6000
"""Messages of `FORGET_S` that are remembered: two minutes of ticks."""

S = TypeVar("S", bound=Schema)


class Lag:
    """How much later than the fastest of the last minute something came, by its sender's clock and ours."""

    def __init__(self) -> None:
        self._fastest: deque[tuple[float, float]] = deque(maxlen=MOST_LAGS)  # (when, apart), apart rising

    def add(self, sent_s: float, now_s: float) -> float:
        """Take one message; return its lag in s."""
        apart = now_s - sent_s
        while self._fastest and self._fastest[-1][1] >= apart:
            self._fastest.pop()
        self._fastest.append((now_s, apart))
        while now_s - self._fastest[0][0] > FORGET_S:
            self._fastest.popleft()
        return apart - self._fastest[0][1]


class Vehicle:
    """The newest of what came of one vehicle. `latest` has the newest record by the tail of its key."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.latest: dict[str, Schema] = {}
        self.events: deque[Event] = deque(maxlen=EVENTS)
        self.event_count = 0
        self.t_s = self._heard_s = -math.inf
        self._lag, self._lag_s = Lag(), 0.0

    def take(self, tail: str, record: Schema, now_s: float) -> None:
        """Take a record that came at `now_s`, a monotonic clock of this machine."""
        if isinstance(record, Event):
            self.events.append(replace(record, text=record.text[:MOST_TEXT]))
            self.event_count += 1
            return
        if tail in EVERY_TICK:
            if record.t_s < self.t_s - RESTART_S:
                self.restart()
            if record.t_s > self.t_s:
                self.t_s, self._heard_s = record.t_s, now_s
                self._lag_s = self._lag.add(record.t_s, now_s)
        self.latest[tail] = record

    def restart(self) -> None:
        """Begin with a companion's new clock."""
        self.t_s = -math.inf
        self._lag = Lag()

    def age_s(self, now_s: float) -> float:
        """How old the newest tick is, what it was held up on its way too; infinite before the first."""
        return max(0.0, now_s - self._heard_s + self._lag_s)

    def get(self, kind: type[S], tail: str) -> S | None:
        """Return the newest record of a key, None if there is none of this kind."""
        record = self.latest.get(tail)
        return record if isinstance(record, kind) else None

    @property
    def state(self) -> State | None:
        """The newest."""
        return self.get(State, "state")

    @property
    def loop(self) -> Loop | None:
        """The newest."""
        return self.get(Loop, "loop")

    @property
    def supervisor(self) -> Supervisor | None:
        """The newest."""
        return self.get(Supervisor, "supervisor")

    @property
    def supervised(self) -> str:
        """The supervisor's state; empty before the first."""
        return self.supervisor.state if self.supervisor else ""

    @property
    def armed(self) -> bool | None:
        """Whether the motors may turn; None where the vehicle did not say so lately."""
        return self.state.armed if self.state and "armed" not in self.state.absent else None

    @property
    def mode(self) -> int | None:
        """ArduSub's flight mode; None where the vehicle did not say so lately."""
        return self.state.mode if self.state and "mode" not in self.state.absent else None

    @property
    def holder(self) -> str:
        """Who has it, in words."""
        return holder(
            self.supervised,
            guidance=self.state.guidance if self.state else "",
            armed=self.armed,
            mode=self.mode,
            disarms_in_s=self.supervisor.disarms_in_s if self.supervisor else 0.0,
            system_status=self.state.system_status if self.state else 0,
        )

    def silence(self, endpoint: str, *, connected: bool) -> tuple[str, str]:
        """Return what to say where nothing new comes, and the operator's next step."""
        return silence(self.name, endpoint, connected=connected, state=self.supervised, armed=self.armed)


V = TypeVar("V", bound=Vehicle)


class Fleet(Generic[V]):
    """Every vehicle that was heard, at most `MOST_VEHICLES`: a new one takes the place of one that is silent.

    What cannot be read is reported in `trouble`.
    """

    def __init__(self, make: Callable[[str], V]) -> None:
        self._make = make
        self.vehicles: dict[str, V] = {}
        self.trouble = ""

    @property
    def complete(self) -> bool:
        """Whether somebody was heard, and everybody under every key of a tick."""
        every = self.vehicles.values()
        return bool(every) and all(vehicle.latest.keys() >= EVERY_TICK.keys() for vehicle in every)

    def take(self, messages: Iterable[Message], now_s: float) -> None:
        """Take what arrived until `now_s`, a monotonic clock of this machine."""
        for message in messages:
            root, name, tail = (*message.key.split("/", 2), "", "")[:3]
            try:
                self._read(message, root, name, tail, now_s)
            except Exception as error:  # of a stranger's message; the next one may be read
                self.trouble = telemetry.printable(str(error)[:MOST_TEXT])

    def _read(self, message: Message, root: str, name: str, tail: str, now_s: float) -> None:
        """Read one message; raise ValueError where it is not what its key says."""
        if root != "holdfast" or (tail not in EVERY_TICK and tail not in NOW_AND_THEN):
            return
        record = _printable(telemetry.decode(*message))
        if name not in self.vehicles and len(self.vehicles) >= MOST_VEHICLES:
            silent = max(self.vehicles.values(), key=lambda one: one.age_s(now_s))
            if silent.age_s(now_s) < FORGET_S:
                raise ValueError(f"'{name}' is one vehicle too many: {MOST_VEHICLES} are shown")
            del self.vehicles[silent.name]
        if name not in self.vehicles:
            self.vehicles[name] = self._make(name)
        self.vehicles[name].take(tail, record, now_s)


def _printable(record: Schema) -> Schema:
    """Return the record with all texts safe for a terminal: anybody may publish under these keys."""
    changed: dict[str, object] = {}
    for name in record.__struct_fields__:
        value = getattr(record, name)
        if isinstance(value, str) and not value.isprintable():
            changed[name] = telemetry.printable(value)
        elif isinstance(value, tuple) and not all(str(part).isprintable() for part in value):
            changed[name] = tuple(map(telemetry.printable, value))
    return replace(record, **changed) if changed else record
