"""What was seen of the vehicle that no control loop needs: the ground on which `check` judges it."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from typing import Any

from companion.mavlink.autopilot import Autopilot
from companion.records import (
    SAMPLES,
    Battery,
    Condition,
    EkfOrigin,
    EkfStatus,
    Event,
    FirmwareVersion,
    Heartbeat,
    PilotGain,
    PilotToggle,
    Reboot,
    ReceiverChannels,
    StatusText,
    VehicleState,
)
from companion.supervision.rules import NOTHING
from companion.telemetry.modes import FAILSAFE

YAW_ALIGNMENT = "yaw alignment complete"
"""EKF3 says so of the first yaw it finds ("initial"), and of each that it corrects while it moves."""


@dataclass(frozen=True, slots=True)
class Directions:
    """How each motor answered a small pulse, relative to what it should: 1 right, -1 the wrong way round.

    `refused` says why nothing was tried.
    """

    motors: tuple[float, ...] = ()
    refused: str = ""


class NotReportedError(Exception):
    """What a row needs was not reported yet."""


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
    contact: Callable[[float], tuple[str, str]] = lambda _: ("", "")
    """Gives what arrives now where no heartbeat does, and what to do."""
    firmware: FirmwareVersion | None = None
    pilot_gain: float | None = None
    toggles: Mapping[str, bool] = field(default_factory=dict)
    receiver_channels: int | None = None
    failsafe_seen: bool = False
    """Whether the autopilot reported twice running that a failsafe is latched (it does once at every boot):
    then nothing keeps the pilot's from firing."""
    origin_known: bool = False
    ekf: EkfStatus | None = None
    yaw_aligned_t_s: float = -math.inf
    """When the autopilot last reported that its EKF aligned its yaw."""
    voltage_v: float | None = None
    directions: Directions | None = None
    conditions: Condition = NOTHING
    """What the supervisor finds."""

    def parameter(self, name: str) -> float:
        """Return a parameter of the autopilot; raise NotReportedError."""
        if name not in self.parameters:
            raise NotReportedError(f"{name} was not reported")
        return self.parameters[name]


KEPT: Mapping[type, tuple[str, Callable[[Any], Any]]] = {
    Battery: ("voltage_v", attrgetter("voltage_v")),
    EkfOrigin: ("origin_known", attrgetter("known")),
    EkfStatus: ("ekf", lambda event: event),
    FirmwareVersion: ("firmware", lambda event: event),
    PilotGain: ("pilot_gain", attrgetter("gain")),
    ReceiverChannels: ("receiver_channels", attrgetter("count")),
}
"""The field of `Observed` that the newest event of a kind becomes, and its value."""


class Survey:
    """Takes in every tick's events and keeps what of them is worth knowing."""

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self._seen: dict[str, Any] = {"toggles": {}}

    def take(self, events: Sequence[Event]) -> None:
        """Take in one tick's events; a reboot of the autopilot forgets all."""
        for event in events:
            kind = type(event)
            if kind in SAMPLES:
                continue
            if kind in KEPT:
                name, value = KEPT[kind]
                self._seen[name] = value(event)
            elif isinstance(event, Heartbeat):
                previous = self._seen.get("heartbeat")
                if previous is not None and previous.system_status == event.system_status == FAILSAFE:
                    self._seen["failsafe_seen"] = True
                self._seen["heartbeat"] = event
            elif isinstance(event, PilotToggle):
                self._seen["toggles"][event.name] = event.on
            elif isinstance(event, StatusText) and YAW_ALIGNMENT in event.text:
                self._seen["yaw_aligned_t_s"] = event.t_s
            elif isinstance(event, Reboot):
                self._seen = {"toggles": {}}

    def observed(
        self, state: VehicleState, conditions: Condition = NOTHING, directions: Directions | None = None
    ) -> Observed:
        """Return what is known by now."""
        autopilot = self._autopilot
        return Observed(
            state=state,
            parameters=autopilot.parameters,
            measured_hz=autopilot.measured_hz,
            asked_hz=autopilot.asked_hz,
            signs=autopilot.heard.vehicle_signs,
            contact=autopilot.heard.contact,
            conditions=conditions,
            directions=directions,
            **self._seen,
        )
