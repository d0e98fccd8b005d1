"""A recorded dive as columns: one array for each number of each key, over the time since it began."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from companion.telemetry import schemas as telemetry
from companion.telemetry.schemas import Event, Plan, Record, Recorder, Supervisor
from dashboard.recording.mcap_file import Reader

Array = NDArray[np.float64]
RecordT = TypeVar("RecordT", bound=Record)
GAP_S = 2.0
SAME_TICK_S = 1e-3
"""Samples of one tick have one time."""
ABSURD = 1e12
"""No number of a dive is larger: it was spoiled, and counts as absent."""
ANGLES = ("heading", "heading_desired", "roll", "pitch")


@dataclass
class Columns:
    """One key. `at_s` is since the recording began; a number that was not finite is NaN."""

    at_s: Array
    of: Mapping[str, Array]

    def __getitem__(self, name: str) -> Array:
        """Return a column."""
        return self.of[name]

    def between(self, begin_s: float, end_s: float) -> "Columns":
        """Return the rows from `begin_s` to before `end_s`."""
        rows = slice(*np.searchsorted(self.at_s, (begin_s, end_s)))
        return Columns(self.at_s[rows], {name: column[rows] for name, column in self.of.items()})


@dataclass(frozen=True)
class StateSpan:
    """From the supervisor's taking a state to its leaving it, or to a gap in the recording."""

    state: str
    begin_s: float
    end_s: float
    reason: str
    conditions: tuple[str, ...]


@dataclass
class Log:
    """A dive. `keys` by tail: state, dof/z, command, loop; `dropped` messages were lost by the recorder."""

    vehicle: str
    began_ns: int
    duration_s: float
    keys: dict[str, Columns]
    spans: list[StateSpan]
    events: list[tuple[float, Event]]
    plans: list[Plan]
    dropped: int
    metadata: dict[str, dict[str, str]]
    notes: list[str]

    def engaged(self, at_s: Array) -> NDArray[np.bool_]:
        """Tell for each time whether the supervisor's state was ACTIVE."""
        on = np.zeros(at_s.size, np.bool_)
        for span in self.spans:
            if span.state == "ACTIVE":
                on |= (at_s >= span.begin_s) & (at_s < span.end_s)
        return on

    def ticks(self) -> dict[str, Array | list[str]]:
        """Return columns with a row for each tick: `at_s`, then KEY/FIELD, angles in degrees too.

        `supervisor/state` is text; the rest are numbers, NaN where a sample or its field is missing.
        """
        state = self.keys["state"]
        states = [
            next((span.state for span in self.spans if span.begin_s <= at_s <= span.end_s), "")
            for at_s in state.at_s
        ]
        columns: dict[str, Array | list[str]] = {"at_s": state.at_s, "supervisor/state": states}
        columns |= {f"degrees/{angle}": np.degrees(state[f"{angle}_rad"]) for angle in ANGLES}
        for key, samples in self.keys.items():
            rows = np.searchsorted(samples.at_s, state.at_s - SAME_TICK_S).clip(0, samples.at_s.size - 1)
            there = np.abs(samples.at_s[rows] - state.at_s) < SAME_TICK_S
            for name, values in samples.of.items():
                columns[f"{key}/{name}"] = np.where(there, values[rows], np.nan)
        return columns


def load(files: Sequence[Path]) -> Log:
    """Read the files of one vehicle, a truncated one as far as it goes.

    Raises ValueError where there is no dive in them, OSError.
    """
    rows: dict[str, list[tuple[int, Record]]] = {}
    log = Log("", 0, 0.0, {}, [], [], [], 0, {}, [])
    for file in sorted(files):
        _read(file, log, rows)
    if lacking := [tail for tail in telemetry.EVERY_TICK if not rows.get(tail)]:
        raise ValueError(f"{', '.join(map(str, files))}: no dive in it, for there is no {lacking[0]}")
    log.began_ns = rows["state"][0][0]

    def timed(tail: str, kind: type[RecordT]) -> list[tuple[float, RecordT]]:
        samples = rows.get(tail, [])
        return [((ns - log.began_ns) / 1e9, record) for ns, record in samples if isinstance(record, kind)]

    log.keys = {
        tail: _columns(samples, log.began_ns)
        for tail, samples in rows.items()
        if tail in telemetry.EVERY_TICK and tail != "supervisor"
    }
    log.duration_s = float(log.keys["state"].at_s[-1])
    log.spans, log.events = _spans(timed("supervisor", Supervisor)), timed("event", Event)
    log.plans = [plan for _, plan in timed("plan", Plan)]
    log.dropped = max((status.dropped for _, status in timed("recorder", Recorder)), default=0)
    return log


def _read(file: Path, log: Log, rows: dict[str, list[tuple[int, Record]]]) -> None:
    """Add a file's records to `rows`, and what it says of itself to `log`."""
    reader = Reader(file)
    for item in reader:
        root, _, rest = item.key.partition("/")
        name, _, tail = rest.partition("/")
        log.vehicle = log.vehicle or name
        if name != log.vehicle or root == "sim" or "json" not in item.encoding:
            continue
        try:
            rows.setdefault(tail, []).append((item.log_ns, telemetry.decode(item.key, item.payload)))
        except (ValueError, RecursionError) as error:
            log.notes = log.notes or [f"left out what could not be read, such as {error}"]
    log.metadata = {**reader.metadata, **log.metadata}
    if not reader.whole:
        log.notes.append(f"{file.name} was cut: {reader.lost_bytes} bytes at its end are lost")


def _columns(samples: list[tuple[int, Record]], began_ns: int) -> Columns:
    """Sort samples by time and turn their numbers into arrays."""
    samples = sorted(samples, key=lambda sample: sample[0])
    first = samples[0][1]
    columns = {
        name: np.array([getattr(record, name) for _, record in samples], np.float64)
        for name in first.__struct_fields__
        if isinstance(getattr(first, name), int | float)
    }
    for row, (_, record) in enumerate(samples):
        for name in record.absent:
            if name in columns:
                columns[name][row] = np.nan
    for column in columns.values():
        column[np.abs(column) > ABSURD] = np.nan
    return Columns((np.array([stamp for stamp, _ in samples], np.int64) - began_ns) / 1e9, columns)


def _spans(samples: list[tuple[float, Supervisor]]) -> list[StateSpan]:
    spans: list[StateSpan] = []
    for at_s, record in sorted(samples, key=lambda sample: sample[0]):
        if not spans or record.state != spans[-1].state or at_s - spans[-1].end_s > GAP_S:
            spans.append(StateSpan(record.state, at_s, at_s, record.reason, ()))
        seen = dict.fromkeys((*spans[-1].conditions, *record.conditions))
        spans[-1] = replace(spans[-1], end_s=at_s, conditions=tuple(seen))
    return spans
