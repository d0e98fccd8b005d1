"""What was seen of the vehicle that no control loop needs: the ground on which `check` judges it."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from typing import Any

from companion.mavlink.autopilot import Autopilot
from companion.records import (
    Battery,
    Condition,
    Depth,
    EkfOrigin,
    EkfStatus,
    Event,
    Firmware,
    Heartbeat,
    PilotGain,
    PilotToggle,
    Reboot,
    ReceiverChannels,
    StatusText,
    TimeSync,
    VehicleState,
)
from companion.supervision.conditions import NOTHING
from companion.telemetry.modes import FAILSAFE

DEPTH_WINDOW_S = 2.0
YAW_ALIGNMENT = "yaw alignment complete"
"""EKF3 says so of the first yaw it finds ("initial"), and of each that it corrects while it moves."""
CLOCK_JUMP_S = 0.05
"""An offset that moves by more than its round trip explains and this is a clock that was set again."""


@dataclass(frozen=True, slots=True)
class Directions:
    """How each motor answered a small pulse, relative to what it should: 1 right, -1 the wrong way round.

    `echo` is the part of the asked demand that SERVO_OUTPUT_RAW showed, `refused` why nothing was tried.
    """

    motors: tuple[float, ...] = ()
    echo: float = 0.0
    refused: str = ""


@dataclass(frozen=True, slots=True)
class Observed:
    """All that the rows of `check` look at; None where nothing was reported yet."""

    state: VehicleState
    parameters: Mapping[str, float] = field(default_factory=dict)
    measured_hz: Mapping[str, float] = field(default_factory=dict)
    asked_hz: Mapping[str, float] = field(default_factory=dict)
    signs: bool = False
    """Whether the vehicle's frames are signed."""
    heartbeat: Heartbeat | None = None
    contact: tuple[str, str] = ("", "")
    """What arrives where no heartbeat does, and what to do."""
    firmware: Firmware | None = None
    pilot_gain: float | None = None
    toggles: Mapping[str, bool] = field(default_factory=dict)
    receiver_channels: int | None = None
    failsafe_seen: bool = False
    """Whether the autopilot said twice running that a failsafe is latched (once it says so at every boot):
    then nothing keeps the pilot's from firing."""
    origin_known: bool = False
    ekf: EkfStatus | None = None
    yaw_aligned_t_s: float = -math.inf
    """When the autopilot last said that its EKF aligned its yaw."""
    voltage_v: float | None = None
    depth_hz: float = 0.0
    syncs: int = 0
    round_trip_s: float = 0.0
    clock_jumps: int = 0
    modes: Mapping[str, bool] | None = None
    """Whether each mode that was tried came; None where none was."""
    directions: Directions | None = None
    conditions: Condition = NOTHING
    """What the supervisor finds."""


KEPT: Mapping[type, tuple[str, Callable[[Any], Any]]] = {
    Battery: ("voltage_v", attrgetter("voltage_v")),
    EkfOrigin: ("origin_known", attrgetter("known")),
    EkfStatus: ("ekf", lambda event: event),
    Firmware: ("firmware", lambda event: event),
    PilotGain: ("pilot_gain", attrgetter("gain")),
    ReceiverChannels: ("receiver_channels", attrgetter("count")),
}
"""The field of `Observed` that the newest event of a kind becomes, and its value."""


class Survey:
    """Takes in every tick's events and keeps what of them is worth knowing."""

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self._handlers: dict[type, Callable[[Any], None]] = {
            Depth: self._on_depth,
            Heartbeat: self._on_heartbeat,
            PilotToggle: self._on_toggle,
            Reboot: lambda _: self.restart(),
            StatusText: self._on_text,
            TimeSync: self._on_timesync,
        }
        self.restart()

    def restart(self) -> None:
        """Forget all: a rebooted autopilot."""
        self._seen: dict[str, Any] = {"toggles": {}}
        self._depths = 0
        self._depths_since_s: float | None = None
        self._offset_s: float | None = None

    def take(self, events: Sequence[Event]) -> None:
        """Take in one tick's events."""
        for event in events:
            kind = type(event)
            if kind in KEPT:
                name, value = KEPT[kind]
                self._seen[name] = value(event)
            elif kind in self._handlers:
                self._handlers[kind](event)

    def observed(self, state: VehicleState, **tried: Any) -> Observed:
        """Return what is known by now; `tried` are the fields of what the caller tried."""
        autopilot = self._autopilot
        return Observed(
            state=state,
            parameters=autopilot.parameters,
            measured_hz=autopilot.measured_hz,
            asked_hz=autopilot.asked_hz,
            signs=autopilot.heard.vehicle_signs,
            contact=autopilot.heard.contact(),
            **self._seen,
            **tried,
        )

    def _on_depth(self, event: Depth) -> None:
        if self._depths_since_s is None or event.t_s - self._depths_since_s >= DEPTH_WINDOW_S:
            if self._depths_since_s is not None:
                self._seen["depth_hz"] = self._depths / (event.t_s - self._depths_since_s)
            self._depths_since_s, self._depths = event.t_s, 0
        self._depths += 1

    def _on_text(self, event: StatusText) -> None:
        if YAW_ALIGNMENT in event.text:
            self._seen["yaw_aligned_t_s"] = event.t_s

    def _on_heartbeat(self, event: Heartbeat) -> None:
        previous = self._seen.get("heartbeat")
        if previous is not None and previous.system_status == event.system_status == FAILSAFE:
            self._seen["failsafe_seen"] = True
        self._seen["heartbeat"] = event

    def _on_toggle(self, event: PilotToggle) -> None:
        self._seen["toggles"][event.name] = event.on

    def _on_timesync(self, event: TimeSync) -> None:
        round_trip_s = event.t_s - event.sent_s
        offset_s = event.boot_s - 0.5 * (event.t_s + event.sent_s)
        seen = self._seen
        best_s = seen.get("round_trip_s", round_trip_s)
        unsure_s = 0.5 * (round_trip_s + best_s) + CLOCK_JUMP_S
        if self._offset_s is None or abs(offset_s - self._offset_s) > unsure_s:
            seen["clock_jumps"] = seen.get("clock_jumps", 0) + (self._offset_s is not None)
            self._offset_s = offset_s
        elif round_trip_s <= 2.0 * best_s:
            self._offset_s = offset_s
        seen["syncs"] = seen.get("syncs", 0) + 1
        seen["round_trip_s"] = min(best_s, round_trip_s)
