"""What is known of every vehicle that is heard, for the web page. No clock, no socket."""

import math
from bisect import bisect_left
from collections import deque
from collections.abc import Iterable
from typing import Any, TypeVar

import msgspec
from msgspec.structs import replace

from companion.telemetry import schemas as telemetry
from companion.telemetry.glossary import holder, on_engaging, on_page
from companion.telemetry.schemas import Choices, Dof, Event, Loop, Plan, Recorder, Schema, State, Supervisor
from dashboard.lag import Lag
from dashboard.web.columns import COLUMNS, empty_row, fill, fill_truth
from dashboard.web.ring import Ring
from dashboard.zenoh_client import Message

HISTORY_S = 120.0
ROWS = round(HISTORY_S * 50.0)
EVENTS = 200
MOST_VEHICLES = 32
RECORDER_SILENT_S = 3.0
DIVING_M = 0.5
"""Time that is spent deeper than this is dive time."""
MODEL = tuple(name for name in Dof.__struct_fields__ if name.startswith("model_"))
"""What a Dof tells of the vehicle as found: gain and lag, in use, found, and their doubts."""

_RESTART_S = 1.0
_TRUTHS = 64
_TRUTH_APART_S = 0.5


S = TypeVar("S", bound=Schema)


class TrueDisturbance(msgspec.Struct, frozen=True):
    """What is used of the simulator's truth: its clock, and the disturbance (6,) in NED and body."""

    t_s: float
    disturbance: tuple[float, float, float, float, float, float]


_truth = msgspec.json.Decoder(TrueDisturbance)


class VehicleHistory:
    """One vehicle: the last two minutes of rows, its events, and the newest of all that is no number."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.ring = Ring(ROWS, len(COLUMNS))
        self.events: deque[dict[str, Any]] = deque(maxlen=EVENTS)
        self.event_count = 0
        self.config: dict[str, Any] | None = None
        self.choices = Choices(compensator=())
        self.config_version = 0
        self._row = empty_row()
        self._row_t_s = math.nan
        self._t_s = -math.inf
        self._heard_s = -math.inf
        self._lag = Lag()
        self._lag_s = 0.0
        self._latest: dict[type[object], Schema] = {}
        self._model: dict[str, dict[str, float | None]] = {}
        self.plan: Plan | None = None
        self._recorder_heard_s = -math.inf
        self.deepest_m = self.dive_s = 0.0
        """Since the companion started, or the page's server if that came later."""
        self._truths: deque[TrueDisturbance] = deque(maxlen=_TRUTHS)

    def take(self, record: Schema, now_s: float) -> None:
        """Take a record that came at `now_s`, this machine's clock."""
        if isinstance(record, Recorder):
            self._latest[Recorder], self._recorder_heard_s = record, now_s
            return
        if isinstance(record, Event):
            self.events.append(
                {
                    "t_s": record.t_s,
                    "severity": record.severity,
                    "kind": record.kind,
                    "text": record.text[:500],
                }
            )
            self.event_count += 1
            return
        if isinstance(record, Plan):
            previous = self.plan
            if previous is None or replace(record, t_s=previous.t_s, boot_s=previous.boot_s) != previous:
                self.plan = record
            return
        if record.t_s < self._t_s - _RESTART_S:
            self._restart()
        self._t_s = max(self._t_s, record.t_s)
        self._heard_s = now_s
        if isinstance(record, State) and "depth_m" not in record.absent:
            self._dive(record)
        if record.t_s != self._row_t_s:
            self._flush()
            self._row_t_s = record.t_s
        fill(self._row, record)
        self._latest[type(record)] = record
        if isinstance(record, Dof):
            self._model[record.dof] = {
                name: None if name in record.absent else getattr(record, name) for name in MODEL
            }
        elif isinstance(record, Loop):  # the last of a tick
            self._true(record.boot_s)
            self._flush()
            self._lag_s = self._lag.add(record.t_s, now_s)

    def _dive(self, state: State) -> None:
        before = self.get(State)
        self.deepest_m = max(self.deepest_m, state.depth_m)
        if before is not None and state.depth_m > DIVING_M:
            self.dive_s += min(max(state.t_s - before.t_s, 0.0), _RESTART_S)

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

    def age_s(self, now_s: float) -> float:
        """How old the newest tick is; infinite before the first."""
        return now_s - self._heard_s

    def brief(self, now_s: float) -> dict[str, Any]:
        """Return the vehicle as it stands in a list of several."""
        return {"name": self.name, "state": self.state, "age_s": _finite(self.age_s(now_s))}

    def get(self, kind: type[S]) -> S | None:
        """Return the newest record of a kind."""
        record = self._latest.get(kind)
        return record if isinstance(record, kind) else None

    @property
    def state(self) -> str:
        """The supervisor's; empty before the first."""
        supervisor = self.get(Supervisor)
        return supervisor.state if supervisor else ""

    @property
    def armed(self) -> bool | None:
        """Whether the motors may turn; None where the vehicle did not say so lately."""
        state = self.get(State)
        return state.armed if state and "armed" not in state.absent else None

    def status(self, now_s: float) -> dict[str, Any]:
        """Return what there is to say beside the rows."""
        state = self.get(State)
        mode = state.mode if state and "mode" not in state.absent else None
        guidance = state.guidance if state else ""
        supervisor = self.get(Supervisor)
        disarms_in_s = supervisor.disarms_in_s if supervisor else 0.0
        return {
            "vehicle": self.name,
            "age_s": _finite(self.age_s(now_s)),
            "lag_s": self._lag_s,
            "t_s": _finite(self._t_s),
            "armed": self.armed,
            "mode": mode,
            "pending": on_engaging(state.pending) if state else "",
            "holder": holder(
                self.state,
                guidance=guidance,
                armed=self.armed,
                mode=mode,
                disarms_in_s=disarms_in_s,
                system_status=state.system_status if state else 0,
            ),
            "advice": on_page(supervisor.remedy) if supervisor else "",
            "pilot_gain": state.pilot_gain if state else None,
            "deepest_m": self.deepest_m,
            "dive_s": self.dive_s,
            "dead_motor": state.dead_motor if state else 0,
            "guidance": guidance,
            "path_progress_m": state.path_progress_m if state else 0.0,
            "path_length_m": state.path_length_m if state else 0.0,
            "path_left_m": _left(state, "path_left_m"),
            "path_left_s": _left(state, "path_left_s"),
            "model": self._model,
            "supervisor": supervisor,
            "loop": self.get(Loop),
            "recorder": self.get(Recorder) if now_s - self._recorder_heard_s < RECORDER_SILENT_S else None,
        }

    def events_from(self, number: int) -> list[dict[str, Any]]:
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
            self._row = empty_row()
            self._row_t_s = math.nan

    def _restart(self) -> None:
        self.ring.restart()
        self.events.clear()
        self._row, self._row_t_s = empty_row(), math.nan
        self._t_s = -math.inf
        self._lag, self._lag_s = Lag(), 0.0
        self._model, self.plan = {}, None
        self.deepest_m = self.dive_s = 0.0
        self.config, self.config_version = None, self.config_version + 1


class Fleet:
    """Every vehicle that was heard, at most `MOST_VEHICLES`. What cannot be read is reported in `trouble`."""

    def __init__(self) -> None:
        self.vehicles: dict[str, VehicleHistory] = {}
        self.trouble = ""

    def take(self, messages: Iterable[Message], now_s: float) -> None:
        """Take what arrived until `now_s`, a monotonic clock of this machine."""
        for key, payload in messages:
            root, name, tail = (*key.split("/", 2), "", "")[:3]
            try:
                if root == "sim":
                    if tail == "truth" and name in self.vehicles:
                        truth = _truth.decode(payload)
                        telemetry.check_numbers(truth)
                        self.vehicles[name].take_truth(truth)
                    continue
                if tail not in telemetry.EVERY_TICK and tail not in telemetry.NOW_AND_THEN:
                    continue
                record = telemetry.decode(key, payload)
            except (ValueError, RecursionError) as error:
                self.trouble = str(error)[:500]
                continue
            vehicle = self._vehicle(name)
            if vehicle is not None:
                vehicle.take(record, now_s)

    def get(self, name: str) -> VehicleHistory | None:
        """Return the vehicle of this name or, for no name, the first one."""
        return self.vehicles.get(name) if name else next(iter(self.vehicles.values()), None)

    def status(self, now_s: float) -> dict[str, Any]:
        """Return what there is to say of all."""
        return {
            "vehicles": [vehicle.brief(now_s) for vehicle in self.vehicles.values()],
            "trouble": self.trouble,
        }

    def _vehicle(self, name: str) -> VehicleHistory | None:
        if name not in self.vehicles:
            if len(self.vehicles) >= MOST_VEHICLES:
                self.trouble = f"'{name}' is one vehicle too many: {MOST_VEHICLES} are shown"
                return None
            self.vehicles[name] = VehicleHistory(name)
        return self.vehicles[name]


def _left(state: State | None, name: str) -> float | None:
    """Return what is left of a path or a move; None where it has no end."""
    if state is None:
        return 0.0
    value: float = getattr(state, name)
    return None if name in state.absent else value


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
