"""What happened in a tick, in words: for the `event` key, the log and the recording."""

import math
from collections.abc import Sequence
from typing import Literal

from companion.records import Condition, ControlSample, FrameShift, Guided, State
from companion.telemetry.commands import CommandResult
from companion.telemetry.conditions import UNSAID
from companion.telemetry.glossary import (
    DEAD_MOTOR,
    HOLD_HERE,
    STATES,
    TRUSTED_MOTOR,
    Severity,
    course,
    on_engaging,
)
from companion.telemetry.schemas import Event, printable

RESETS = Condition.YAW_RESET | Condition.POSITION_RESET | Condition.DEPTH_RESET
MAV_SEVERITY_ERROR, MAV_SEVERITY_WARNING = 3, 4


class EventLog:
    """Compares each tick with the one before."""

    def __init__(self) -> None:
        self._state: State | None = None
        self._reason = ""
        self._conditions = Condition(0)
        self._dead_motor = 0
        self._guided = (0, "")
        self._pending = ""
        self._resets = 0
        self._turned_rad = self._sunk_m = 0.0

    def step(
        self,
        sample: ControlSample,
        results: Sequence[CommandResult] = (),
        duplicate_instances: Sequence[str] = (),
        peer_changes: Sequence[str] = (),
    ) -> list[Event]:
        """Return what happened in this tick.

        `results` are the commands that were answered, `duplicate_instances` the other companions of this
        vehicle's name that came, `peer_changes` which link got another peer.
        """
        verdict = sample.verdict
        conditions = verdict.conditions & ~UNSAID
        happened: list[tuple[Severity, Literal["state", "command", "autopilot", "condition"], str]] = [
            ("info" if result.reply.done else "warning", "command", result.text) for result in results
        ]
        if sample.refused:
            happened.append(("warning", "command", f"engage by button: refused: {sample.refused}"))
        happened += [
            ("warning", "condition", f"another companion of this name came: instance {printable(instance)}")
            for instance in duplicate_instances
        ]
        happened += [("warning", "condition", change) for change in peer_changes]
        for text in sample.texts:
            severity: Severity = "info"
            if text.severity <= MAV_SEVERITY_WARNING:
                severity = "fault" if text.severity <= MAV_SEVERITY_ERROR else "warning"
            happened.append((severity, "autopilot", text.text))
        if self._state is None:
            self._conditions = conditions  # the first state's reason names them
        elif conditions != self._conditions:
            begun, ended = conditions & ~self._conditions, self._conditions & ~conditions
            happened += [("warning", "condition", begins.text) for begins in begun]
            happened += [("info", "condition", ends.ended) for ends in ended]
            self._conditions = conditions
        if sample.state.dead_motor != self._dead_motor:
            happened.append(_motor(self._dead_motor, sample.state.dead_motor))
            self._dead_motor = sample.state.dead_motor
        guided = sample.guided
        if (guided.number, guided.kind) != self._guided:
            self._guided = guided.number, guided.kind
            if guided.number and guided.kind and not guided.pending:
                happened.append(_course(guided))
        happened += self._reset(sample)
        goes_on = verdict.state is State.HAND_OVER and verdict.reason != self._reason
        self._reason = verdict.reason
        if verdict.state is not self._state or goes_on:
            self._state = verdict.state
            severity = STATES[verdict.state].severity
            happened.append((severity, "state", f"{verdict.state}: {verdict.reason}"))
        if guided.pending != self._pending:
            self._pending = guided.pending
            if not any(sample.dofs.engaged):
                happened.append(("info", "state", on_engaging(printable(guided.pending) or HOLD_HERE)))
        if not happened:
            return []
        state = sample.state
        return [
            Event(t_s=state.t_s, boot_s=state.boot_s, severity=severity, kind=kind, text=text)
            for severity, kind, text in happened
        ]

    def _reset(self, sample: ControlSample) -> list[tuple[Severity, Literal["condition"], str]]:
        """Report the first reset of the autopilot's estimate, and their sum once they have ended."""
        shift, happened = sample.state.frame_shift, list[tuple[Severity, Literal["condition"], str]]()
        if shift is not None and sample.verdict.conditions & RESETS:
            self._resets += 1
            self._turned_rad += shift.turn_rad
            self._sunk_m += shift.down_m
            if self._resets == 1:
                happened.append(("warning", "condition", f"the EKF was reset: {_shift_words(shift)}"))
        elif self._resets and not sample.verdict.conditions & RESETS:
            if self._resets > 1:
                parts = [f"yaw {math.degrees(self._turned_rad):+.1f}°"] if self._turned_rad else []
                parts += [f"depth {self._sunk_m:+.2f} m"] if self._sunk_m else []
                text = f"{self._resets} resets of the EKF, {', '.join(parts or ['position'])} in all"
                happened.append(("warning", "condition", text))
            self._resets, self._turned_rad, self._sunk_m = 0, 0.0, 0.0
        return happened


def _course(guided: Guided) -> tuple[Severity, Literal["state"], str]:
    """Tell what moves the vehicle now."""
    text = course(guided.kind, printable(guided.name))
    return "warning" if guided.kind == "refused" else "info", "state", text


def _motor(previous: int, now: int) -> tuple[Severity, Literal["condition"], str]:
    if now:
        return "warning", "condition", DEAD_MOTOR.format(now)
    return "info", "condition", TRUSTED_MOTOR.format(previous)


def _shift_words(shift: FrameShift) -> str:
    if shift.turn_rad:
        return f"yaw {math.degrees(shift.turn_rad):+.1f}°; the heading that is held turns with it"
    if shift.down_m:
        return f"the autopilot's depth {shift.down_m:+.2f} m; the depth here counts on as before"
    moved = f"position {shift.north_m:+.2f} m north, {shift.east_m:+.2f} m east"
    return f"{moved}; the place that is held moves with it"
