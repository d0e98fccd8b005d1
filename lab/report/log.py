"""A recorded dive as columns: one array for each number of each key, over the time since it began."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from companion.telemetry import schemas as telemetry
from companion.telemetry.modes import MODE_NAMES
from companion.telemetry.schemas import Event, Record
from dashboard.recording.mcap_file import Reader

Array = NDArray[np.float64]
Columns = NDArray[np.void]
"""A column for each number of a key, and `at_s` since the recording began; NaN where it was not finite."""
GAP_S = 2.0
ABSURD = 1e12
"""No number of a dive is larger: it was spoiled, and counts as absent."""


class StateSpan(NamedTuple):
    """Time from entering a state, or flight mode, to leaving it, or to a gap in the recording."""

    state: str
    begin_s: float
    end_s: float
    reason: str


@dataclass(frozen=True)
class Log:
    """A dive. `keys` by tail: state, dof/z, command, loop; `notes` of what could not be read."""

    vehicle: str
    software: str
    began_ns: int
    keys: dict[str, Columns]
    spans: list[StateSpan]
    modes: list[StateSpan]
    """Flight modes while armed; "" while not."""
    events: list[tuple[float, Event]]
    notes: list[str]

    @property
    def duration_s(self) -> float:
        """Time from the first tick to the last."""
        return float(self.keys["state"]["at_s"][-1])

    def engaged(self, at_s: Array) -> NDArray[np.bool_]:
        """Tell for each time whether the supervisor's state was ACTIVE."""
        active = [span for span in self.spans if span.state == "ACTIVE"]
        return np.array([any(span.begin_s <= t_s < span.end_s for span in active) for t_s in at_s], np.bool_)


def load(files: Sequence[Path]) -> Log:
    """Read the files of one vehicle, a truncated one as far as it goes.

    Raises ValueError where there is no dive in them, OSError.
    """
    rows: dict[str, list[tuple[int, Record]]] = {}
    vehicle, software, notes = "", "", list[str]()
    for file in sorted(files):
        reader = Reader(file)
        for item in reader:
            root, name, tail = [*item.key.split("/", 2), "", ""][:3]
            vehicle = vehicle or name
            if name != vehicle or root == "sim" or "json" not in item.encoding:
                continue
            try:
                rows.setdefault(tail, []).append((item.log_ns, telemetry.decode(item.key, item.payload)))
            except (ValueError, RecursionError) as error:
                notes = notes or [f"left out what could not be read, such as {error}"]
        about = reader.metadata.get("holdfast", {"holdfast": "of unknown version"})
        software = software or f"Holdfast {about.get('holdfast')}, {about.get('git', '')[:18]}"
        if not reader.whole:
            notes.append(f"{file.name} was cut: {reader.lost_bytes} bytes at its end are lost")
    if lacking := [tail for tail in telemetry.EVERY_TICK if not rows.get(tail)]:
        raise ValueError(f"{', '.join(map(str, files))}: no dive in it, for there is no {lacking[0]}")
    began_ns = rows["state"][0][0]

    timed: dict[str, list[tuple[float, Any]]] = {
        tail: [((ns - began_ns) / 1e9, record) for ns, record in samples] for tail, samples in rows.items()
    }
    dropped = max((now.dropped for _, now in timed.get("recorder", [])), default=0)
    notes += [f"{dropped} messages were dropped by the recorder"] * bool(dropped)
    keys = {tail: _columns(timed[tail]) for tail in telemetry.EVERY_TICK if tail != "supervisor"}
    spans = _spans((at_s, now.state, now.reason) for at_s, now in timed["supervisor"])
    modes = _spans(
        (at_s, MODE_NAMES.get(now.mode, f"mode {now.mode}") if now.armed else "", "")
        for at_s, now in timed["state"]
    )
    return Log(vehicle, software, began_ns, keys, spans, modes, timed.get("event", []), notes)


def _columns(samples: list[tuple[float, Record]]) -> Columns:
    first = samples[0][1]
    names = [name for name in first.__struct_fields__ if isinstance(getattr(first, name), int | float)]

    rows = [
        (at_s, *(np.nan if name in record.absent else getattr(record, name) for name in names))
        for at_s, record in samples
    ]
    columns = np.array(rows, [(name, float) for name in ("at_s", *names)])
    for name in names:
        columns[name][np.abs(columns[name]) > ABSURD] = np.nan
    _, once = np.unique(columns["at_s"], return_index=True)  # a sample may have come twice
    return np.asarray(columns[once])


def _spans(samples: Iterable[tuple[float, str, str]]) -> list[StateSpan]:
    spans: list[StateSpan] = []
    for at_s, state, reason in sorted(samples, key=lambda sample: sample[0]):
        if not spans or state != spans[-1].state or at_s - spans[-1].end_s > GAP_S:
            spans.append(StateSpan(state, at_s, at_s, reason))
        spans[-1] = spans[-1]._replace(end_s=at_s)
    return spans
