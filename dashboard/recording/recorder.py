"""What to keep and for how long: rotation, free space, times, status. No Zenoh, no thread and no clock.

Trouble with the disk ends a file, never the process: `said` tells it, and another file begins once it works.
"""

import math
import shutil
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import count
from pathlib import Path

import msgspec

from companion.telemetry import schemas as telemetry
from dashboard.arguments import MB
from dashboard.recording.mcap_file import Item, Recording
from holdfast import files

RESTART_S = 5.0
"""A companion whose clock goes back by more has restarted."""
MAX_CLOCK_S = 1e9
"""No companion's clock counts from its boot this far: 32 years."""
RAW_KEPT_S = 90.0
"""Raw ticks from so long ago come a second time when a companion is heard again; it keeps a minute."""
MAX_LOST_TICKS = 1_000_000
"""A number that rises by more has restarted: five hours and a half at 50 Hz."""
EVENTS_KEPT = 1000  # ten times what a companion repeats
NS_PER_S = 1e9
AGAIN_S = 5
"""Between attempts to begin a file."""
AGAIN = f"tries again every {AGAIN_S} s"


class _Times(msgspec.Struct):
    t_s: float = math.nan
    boot_s: float = math.nan
    now_s: float = math.nan
    tick: int = 0


_json_times = msgspec.json.Decoder(_Times)
_raw_times = msgspec.msgpack.Decoder(_Times)


@dataclass(frozen=True)
class FileLimits:
    """Where recordings go, when a new file begins, and what stays free on the disk."""

    directory: Path
    max_bytes: int = 250 * MB
    reserve_bytes: int = 500 * MB


class DiveRecorder:
    """Keeps one vehicle's samples in files. `utc_ns` and `now_s` are this machine's clocks when asked."""

    def __init__(
        self,
        vehicle: str,
        limits: FileLimits,
        about: Mapping[str, str],
        ticks_per_sample: int = 1,
    ) -> None:
        self.vehicle = vehicle
        self.said = "not recording"
        self._limits = limits
        self._about = {**about, "vehicle": vehicle}
        self._file: Recording | None = None
        self._again_s = math.inf
        """Seconds until a file is begun, counted by `each_second`; infinite while none is wanted."""
        self._tables: dict[str, Mapping[str, str]] = {}
        self._messages = self._left_out = 0
        self._losses = Losses(ticks_per_sample)
        self._clock = _Clock()
        self._raw_s = -math.inf
        self._events: deque[int] = deque(maxlen=EVENTS_KEPT)
        self._event_key = telemetry.key(vehicle, "event")
        self._raw_key = telemetry.key(vehicle, "raw")
        self._own = f"holdfast/{vehicle}/"
        self._channels = _channels(vehicle)

    def stop(self) -> None:
        """Finish the file; begin no other one."""
        self._again_s = math.inf
        self._finish("stopped when asked")

    def _finish(self, why: str) -> None:
        if self._file is None:
            return
        name = self._file.path.name
        try:
            self._file.close()
        except OSError as error:
            self._give_up(error)
            return
        self._file = None
        left_out = f", but for {self._left_out} bad samples left out" if self._left_out else ""
        self.said = f"{why}; {name} is complete{left_out}"

    def describe(self, name: str, table: Mapping[str, str]) -> None:
        """Keep a table about the vehicle, in this file and in every later one."""
        self._tables[name] = table
        if self._file is not None:
            try:
                self._file.describe(name, table)
            except OSError as error:
                self._give_up(error)

    def take(self, key: str, encoding: str, payload: bytes, publish_ns: int, now_s: float) -> None:
        """Keep a sample that was published at `publish_ns` (UTC) and came at `now_s`.

        One that no file can hold, or of a time that cannot be, is counted and left out: anybody may publish.
        """
        try:
            t_s, boot_s, tick = self._times(key, encoding, payload)
            if key.startswith(self._own):
                self._losses.take(key.removeprefix(self._own), tick)
            log_ns = self._clock.log_ns(t_s, boot_s, publish_ns, now_s)
            if self._file is None or self._came_before(key, t_s, payload):
                return
            self._file.add(Item(key, encoding, payload, log_ns, publish_ns))
            self._messages += 1
        except OSError as error:
            self._give_up(error)
        except ValueError as error:
            self._left_out += 1
            if self._file is not None:
                self.said = f"recording to {self._file.path.name}; left out: {error}"

    def each_second(self, utc_ns: int) -> None:
        """Put all on the disk, begin a new file where it is time, and stop where the disk is nearly full."""
        if self._file is None:
            self._again_s -= 1
            if self._again_s <= 0:
                self.start(utc_ns)
            return
        try:
            self._file.sync()
        except OSError as error:
            self._give_up(error)
            return
        if short := self._short_of_room():
            self._finish(f"stopped: {short}; {AGAIN}")
        elif self._file.size_bytes >= self._limits.max_bytes:
            self._finish("began another")
            self.start(utc_ns)

    def _short_of_room(self) -> str:
        """Return in words that too little is free; empty where there is enough."""
        free, reserve = _free_bytes(self._limits.directory), self._limits.reserve_bytes
        return f"{free // MB} MB free, and {reserve // MB} MB stay free" if free < reserve else ""

    def status(self, now_s: float, dropped: int) -> telemetry.Recorder:
        """Return what goes out once a second; `t_s` and `boot_s` are the vehicle's, as far as heard."""
        t_s, boot_s = self._clock.vehicle_s(now_s)
        file = self._file
        return telemetry.Recorder(
            t_s=t_s,
            boot_s=boot_s,
            recording=file is not None,
            file=str(file.path) if file else "",
            size_bytes=file.size_bytes if file else 0,
            messages=self._messages,
            dropped=dropped,
            free_bytes=_free_bytes(self._limits.directory),
            said=self.said,
            lost=self._losses.lost,
            left_out=self._left_out,
        )

    def _came_before(self, key: str, t_s: float, payload: bytes) -> bool:
        """Tell whether this sample came before, from a publisher that repeats its history."""
        if key == self._raw_key:
            if self._raw_s - RAW_KEPT_S < t_s <= self._raw_s:
                return True
            self._raw_s = t_s
        elif key == self._event_key:
            if hash(payload) in self._events:
                return True
            self._events.append(hash(payload))
        return False

    def _times(self, key: str, encoding: str, payload: bytes) -> tuple[float, float, int]:
        """Return the companion's clock, the vehicle's (NaN for what is not there) and the tick.

        Raises ValueError for clocks that cannot be. A stranger's key does not set the vehicle's clock.
        """
        times = _Times()
        try:
            if key == self._raw_key:
                times.t_s = _raw_times.decode(payload).now_s
            elif key.startswith(self._own):
                if payload.count(b"[") + payload.count(b"{") > files.MAX_DEPTH:
                    files.check_brackets(payload.decode(errors="replace"))
                times = _json_times.decode(payload)
        except msgspec.MsgspecError:
            pass
        except RecursionError as error:
            raise ValueError("nested too deeply") from error
        if any(abs(clock_s) > MAX_CLOCK_S for clock_s in (times.t_s, times.boot_s)):
            raise ValueError("a clock that cannot be")
        return times.t_s, times.boot_s if (key, encoding) in self._channels else math.nan, times.tick

    def start(self, utc_ns: int) -> bool:
        """Begin a file; tell whether one is open now, and in `said` why not: `each_second` tries again."""
        self._again_s, directory = AGAIN_S, self._limits.directory
        try:
            directory.mkdir(parents=True, exist_ok=True)
            if short := self._short_of_room():
                self.said = f"not recording: {directory} has {short}; {AGAIN}"
                return False
            path = _unused(directory, self.vehicle, utc_ns)
            self._file = Recording(path, self._channels)
            self._file.describe("holdfast", {**self._about, "began_utc": _utc(utc_ns).isoformat()})
            for name, table in self._tables.items():
                self._file.describe(name, table)
            self._file.sync()  # else a full disk would be told a second later
            self.said = f"recording to {path.name}"
        except OSError as error:
            self._give_up(error)
        return self._file is not None

    def _give_up(self, error: OSError) -> None:
        why, left = error.strerror or str(error), False
        file, self._file = self._file, None
        self.said = f"not recording: {why}: {error.filename or self._limits.directory}; {AGAIN}"
        if file is not None:
            with suppress(OSError):
                left = file.give_up()
        if file is not None and left:
            self.said = f"stopped: {why}; {file.path.name} has no end, but can be read; {AGAIN}"


class Losses:
    """Counts the samples of every tick: whoever takes one says so, and then its number if it is a `Loop`.

    A tick number that restarts, with a companion or a replay, counts no loss. On a radio link one tick of
    `ticks_per_sample` is sent, and only of those samples can be lost.
    """

    def __init__(self, ticks_per_sample: int = 1) -> None:
        self.lost = 0
        self._ticks_per_sample = ticks_per_sample
        self._came = 0
        self._last: int | None = None

    def take(self, tail: str, tick: int) -> None:
        """Take the sample of a key's `tail`; `tick` matters with that of `loop` alone, the last of a tick."""
        self._came += tail in telemetry.EVERY_TICK
        if tail != "loop":
            return
        if self._last is not None and 0 < tick - self._last <= MAX_LOST_TICKS:
            sent = round((tick - self._last) / self._ticks_per_sample)
            self.lost += max(0, sent * len(telemetry.EVERY_TICK) - self._came)
        self._last, self._came = tick, 0


class _Clock:
    """The companion's clock, laid on UTC once, so that steps of UTC tear nothing."""

    def __init__(self) -> None:
        self._offset_ns: int | None = None
        self._last_s = self._boot_s = math.nan
        self._came_s = 0.0

    def log_ns(self, t_s: float, boot_s: float, publish_ns: int, now_s: float) -> int:
        """Return when a sample was true, in UTC: by the companion's `t_s`, or else when it was published.

        Only what has the vehicle's `boot_s` too can tell of a restart: raw ticks may come late.
        """
        if math.isfinite(t_s) and math.isfinite(boot_s):
            if self._offset_ns is None or t_s < self._last_s - RESTART_S:
                self._offset_ns = publish_ns - round(t_s * NS_PER_S)
            self._last_s, self._boot_s, self._came_s = t_s, boot_s, now_s
        if not math.isfinite(t_s) or self._offset_ns is None:
            return publish_ns
        log_ns = round(t_s * NS_PER_S) + self._offset_ns
        near = abs(log_ns - publish_ns) < RESTART_S * NS_PER_S
        return log_ns if near or math.isfinite(boot_s) else publish_ns

    def vehicle_s(self, now_s: float) -> tuple[float, float]:
        """Return what the companion's clock and the vehicle's read now, by the last that was heard."""
        if math.isnan(self._last_s):
            return now_s, 0.0
        ago_s = now_s - self._came_s
        return self._last_s + ago_s, self._boot_s + ago_s


def _channels(vehicle: str) -> frozenset[tuple[str, str]]:
    """Return key and encoding of all that a companion and a simulator publish of a vehicle."""
    truth = f"sim/{vehicle}/truth", telemetry.TRUTH_ENCODING
    return frozenset((*(telemetry.published(vehicle, tail) for tail in telemetry.ENCODINGS), truth))


def _unused(directory: Path, vehicle: str, utc_ns: int) -> Path:
    stem = f"{vehicle}-{_utc(utc_ns):%Y%m%dT%H%M%SZ}"
    paths = (directory / f"{stem}{f'-{number}' if number > 1 else ''}.mcap" for number in count(1))
    return next(path for path in paths if not path.exists())


def _utc(utc_ns: int) -> datetime:
    return datetime.fromtimestamp(utc_ns / NS_PER_S, UTC)


def _free_bytes(directory: Path) -> int:
    try:
        return shutil.disk_usage(directory).free
    except OSError:
        return 0
