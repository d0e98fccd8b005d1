"""What the web page has of every vehicle: two minutes of rows, and the newest. No clock, no socket."""

import math
from bisect import bisect_left
from collections import deque
from typing import Any

import msgspec
from msgspec.structs import replace

from companion.telemetry import schemas as telemetry
from companion.telemetry.glossary import on_engaging, on_page
from companion.telemetry.schemas import EVERY_TICK, Choices, Dof, Event, Loop, Plan, Recorder, Schema
from dashboard.heard_vehicles import Fleet, Vehicle
from dashboard.web.rows import Ring, empty_row, fill, fill_truth
from dashboard.zenoh_client import Message

HISTORY_S = 120.0  # four windows of the page's plots; 4 MB
ROWS = round(HISTORY_S * 50.0)
RECORDER_SILENT_S = 3.0  # it tells its state every second
MODEL = tuple(name for name in Dof.__struct_fields__ if name.startswith("model_"))
"""What a Dof tells of the vehicle as found: gain and lag, in use, found, and their doubts."""
SHOWN = (
    *("dead_motor", "reversed_motor", "guidance"),
    *("path_progress_m", "path_length_m", "path_left_m", "path_left_s"),
)
"""Fields of State that are no row."""

_TRUTHS = 64  # over a second
_TRUTH_APART_S = 0.5  # else the clocks are not the same


class TrueDisturbance(msgspec.Struct, frozen=True):
    """What is used of the simulator's truth: its clock, and the disturbance (6,) in NED and body."""

    t_s: float
    disturbance: tuple[float, float, float, float, float, float]


_truth = msgspec.json.Decoder(TrueDisturbance)


class VehicleHistory(Vehicle):
    """One vehicle: the last two minutes of rows, its events, and the newest of all that is no number."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.ring = Ring(ROWS)
        self.config: dict[str, Any] | None = None
        self.choices = Choices(compensator=())
        self.config_version = 0
        self._row, self._row_t_s = empty_row(), math.nan
        self._recorder_heard_s = -math.inf
        self._truths: deque[TrueDisturbance] = deque(maxlen=_TRUTHS)

    @property
    def plan(self) -> Plan | None:
        """The newest that differs from the one before."""
        return self.get(Plan, "plan")

    def take(self, tail: str, record: Schema, now_s: float) -> None:
        """Take a record that came at `now_s`, a monotonic clock of this machine."""
        plan = self.plan
        if isinstance(record, Plan) and plan and replace(record, t_s=plan.t_s, boot_s=plan.boot_s) == plan:
            return
        super().take(tail, record, now_s)
        if isinstance(record, Recorder):
            self._recorder_heard_s = now_s
        if tail not in EVERY_TICK:
            return
        if record.t_s != self._row_t_s:
            self._flush()
            self._row_t_s = record.t_s
        fill(self._row, record)
        if isinstance(record, Loop):  # the last of a tick
            self._true(record.boot_s)
            self._flush()

    def take_truth(self, truth: TrueDisturbance) -> None:
        """Take a sample of the simulator's."""
        if self._truths and truth.t_s < self._truths[-1].t_s:
            self._truths.clear()
        self._truths.append(truth)

    def take_config(self, config: dict[str, Any], choices: Choices) -> None:
        """Take the companion's present configuration, and which names it knows."""
        if (config, choices) != (self.config, self.choices):
            self.config, self.choices = config, choices
            self.config_version += 1

    def status(self, now_s: float) -> dict[str, Any]:
        """Return what there is to say beside the rows; what is not finite becomes null in JSON."""
        state, supervisor = self.state, self.supervisor
        dofs = [record for record in self.latest.values() if isinstance(record, Dof)]
        recorder = self.get(Recorder, "recorder")
        return {
            "vehicle": self.name,
            "age_s": self.age_s(now_s),
            "t_s": self.t_s,
            "armed": self.armed,
            "mode": self.mode,
            "pending": on_engaging(state.pending) if state else "",
            "holder": self.holder,
            "advice": on_page(supervisor.remedy) if supervisor else "",
            "model": {dof.dof: _known(dof, MODEL) for dof in dofs},
            "supervisor": supervisor,
            "loop": self.loop,
            "recorder": recorder if now_s - self._recorder_heard_s < RECORDER_SILENT_S else None,
            **(_known(state, SHOWN) if state else {}),
        }

    def events_from(self, number: int) -> list[Event]:
        """Return the events from the one numbered `number` on that are still kept."""
        count = min(self.event_count - number, len(self.events))
        return list(self.events)[len(self.events) - count :] if count > 0 else []

    def _true(self, boot_s: float) -> None:
        if self._truths:
            index = bisect_left(self._truths, boot_s, key=lambda truth: truth.t_s)
            near = [self._truths[i] for i in (index - 1, index) if 0 <= i < len(self._truths)]
            nearest = min(near, key=lambda truth: abs(truth.t_s - boot_s))
            if abs(nearest.t_s - boot_s) < _TRUTH_APART_S:
                fill_truth(self._row, nearest.disturbance)

    def _flush(self) -> None:
        if not math.isnan(self._row_t_s):
            self.ring.append(self._row_t_s, self._row)
            self._row, self._row_t_s = empty_row(), math.nan

    def restart(self) -> None:
        """Forget the past: a companion's new clock begins."""
        super().restart()
        self.ring.restart()
        self.events.clear()
        self.latest.pop("plan", None)
        self._row, self._row_t_s = empty_row(), math.nan
        self.config, self.config_version = None, self.config_version + 1


class Histories(Fleet[VehicleHistory]):
    """Every vehicle that was heard, with the simulator's truth of it."""

    def __init__(self) -> None:
        super().__init__(VehicleHistory)

    def _read(self, message: Message, root: str, name: str, tail: str, now_s: float) -> None:
        super()._read(message, root, name, tail, now_s)
        if (root, tail) == ("sim", "truth") and name in self.vehicles:
            truth = _truth.decode(message.payload)
            telemetry.check_numbers(truth)
            self.vehicles[name].take_truth(truth)

    def get(self, name: str) -> VehicleHistory | None:
        """Return the vehicle of this name or, for no name, the first one."""
        return self.vehicles.get(name) if name else next(iter(self.vehicles.values()), None)

    def briefs(self, now_s: float) -> list[dict[str, Any]]:
        """Return each as it stands in a list of several."""
        return [
            {"name": one.name, "state": one.supervised, "age_s": one.age_s(now_s)}
            for one in self.vehicles.values()
        ]


def _known(record: Schema, names: tuple[str, ...]) -> dict[str, Any]:
    """Return these fields; None for what is absent."""
    return {name: None if name in record.absent else getattr(record, name) for name in names}
