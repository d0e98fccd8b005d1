"""A recorded dive as columns: one array for each number of each key, over the time since it began."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from companion.telemetry import schemas as telemetry
from companion.telemetry.schemas import Event, Plan, Record, Recorder, Supervisor
from dashboard.recording.mcap_file import Reader

Array = NDArray[np.float64]
GAP_S = 2.0
ABSURD = 1e12
"""No number of a dive is larger: it was spoiled, and counts as absent."""


class TruthRecord(msgspec.Struct):
    """What the report wants of the simulator's truth."""

    t_s: float
    eta: tuple[float, float, float, float, float, float]
    disturbance: tuple[float, float, float, float, float, float]


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

    def at(self, name: str, at_s: Array) -> Array:
        """Return a column at other times."""
        return np.interp(at_s, self.at_s, self.of[name])


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
    """A dive. `keys` by tail: state, dof/z, command, loop; `truth` only from the simulator."""

    vehicle: str
    began_ns: int
    duration_s: float
    keys: dict[str, Columns]
    spans: list[StateSpan]
    events: list[tuple[float, Event]]
    recorder: list[Recorder]
    truth: Columns | None
    metadata: dict[str, dict[str, str]]
    notes: list[str] = field(default_factory=list)
    plans: list[Plan] = field(default_factory=list)

    def config(self, key: str, otherwise: float) -> float:
        """Return a number of the configuration that was recorded."""
        try:
            return float(self.metadata.get("config", {})[key])
        except (KeyError, ValueError):
            return otherwise


def load(files: Sequence[Path]) -> Log:
    """Read the files of one vehicle. Raises ValueError where there is no dive in them, OSError."""
    rows: dict[str, list[tuple[int, Record]]] = {}
    truths: list[tuple[int, TruthRecord]] = []
    decode_truth = msgspec.json.Decoder(TruthRecord).decode
    vehicle = ""
    metadata: dict[str, dict[str, str]] = {}
    notes: list[str] = []
    for file in sorted(files):
        reader = Reader(file)
        for item in reader:
            root, _, rest = item.key.partition("/")
            name, _, tail = rest.partition("/")
            vehicle = vehicle or name
            if name != vehicle or "json" not in item.encoding:
                continue
            try:
                if root == "sim":
                    truth = decode_truth(item.payload)
                    telemetry.check_numbers(truth)
                    truths.append((item.log_ns, truth))
                else:
                    rows.setdefault(tail, []).append((item.log_ns, telemetry.decode(item.key, item.payload)))
            except (ValueError, RecursionError) as error:
                notes = notes or [f"left out what could not be read, such as {error}"]
        metadata = {**reader.metadata, **metadata}
        if not reader.whole:
            notes.append(f"{file.name} was cut: {reader.lost_bytes} bytes at its end are lost")
    if lacking := [tail for tail in telemetry.EVERY_TICK if not rows.get(tail)]:
        raise ValueError(f"{', '.join(map(str, files))}: no dive in it, for there is no {lacking[0]}")
    began_ns = rows["state"][0][0]
    keys = {
        tail: _columns(samples, began_ns)
        for tail, samples in rows.items()
        if tail in telemetry.EVERY_TICK and tail != "supervisor"
    }
    return Log(
        vehicle=vehicle,
        began_ns=began_ns,
        duration_s=float(keys["state"].at_s[-1]),
        keys=keys,
        spans=_spans(rows["supervisor"], began_ns),
        events=[
            ((stamp - began_ns) / 1e9, event)
            for stamp, event in rows.get("event", [])
            if isinstance(event, Event)
        ],
        recorder=[status for _, status in rows.get("recorder", []) if isinstance(status, Recorder)],
        truth=_truth(truths, keys["state"]),
        metadata=metadata,
        notes=notes,
        plans=[plan for _, plan in rows.get("plan", []) if isinstance(plan, Plan)],
    )


def _columns(samples: list[tuple[int, Record]], began_ns: int) -> Columns:
    at_s = (np.array([stamp for stamp, _ in samples], np.int64) - began_ns) / 1e9
    order = np.argsort(at_s, kind="stable")
    names = samples[0][1].__struct_fields__
    values = list(zip(*(msgspec.structs.astuple(record) for _, record in samples), strict=True))
    columns = {
        name: np.array(column, float)[order]
        for name, column in zip(names, values, strict=True)
        if isinstance(column[0], int | float)
    }
    place = {int(row): i for i, row in enumerate(order)}
    for row, (_, record) in enumerate(samples):
        for name in record.absent:
            if name in columns:
                columns[name][place[row]] = np.nan
    for column in columns.values():
        column[np.abs(column) > ABSURD] = np.nan
    return Columns(at_s[order], columns)


def _truth(samples: list[tuple[int, TruthRecord]], state: Columns) -> Columns | None:
    """Lay the truth on the recording's time by the vehicle's own clock, which both carry."""
    if len(samples) < 2:
        return None
    t_s = np.array([truth.t_s for _, truth in samples])
    apart_s = float(np.median(state.at_s - state["boot_s"]))
    eta = np.array([truth.eta for _, truth in samples])
    force = np.array([truth.disturbance for _, truth in samples])
    return Columns(
        t_s + apart_s,
        {"depth_m": eta[:, 2], "heading_rad": np.unwrap(eta[:, 5]), "heave_disturbance_n": force[:, 2]},
    )


def _spans(samples: list[tuple[int, Record]], began_ns: int) -> list[StateSpan]:
    spans: list[StateSpan] = []
    state, begin_s, last_s, reason = "", 0.0, 0.0, ""
    conditions: dict[str, None] = {}
    for stamp, record in sorted(samples, key=lambda sample: sample[0]):
        if not isinstance(record, Supervisor):
            continue
        at_s = (stamp - began_ns) / 1e9
        if record.state != state or at_s - last_s > GAP_S:
            if state:
                spans.append(StateSpan(state, begin_s, max(last_s, begin_s), reason, tuple(conditions)))
            state, begin_s, reason, conditions = record.state, at_s, record.reason, {}
        conditions |= dict.fromkeys(record.conditions)
        last_s = at_s
    return [*spans, StateSpan(state, begin_s, last_s, reason, tuple(conditions))]
