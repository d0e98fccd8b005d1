"""What happened in a tick, in words: for the `event` key, the log and the recording."""

import math
from collections.abc import Iterator, Sequence
from itertools import chain

from companion.records import Condition, ControlSample, FrameShift, State, Verdict
from companion.telemetry.glossary import (
    DEAD_MOTOR,
    HOLD_HERE,
    REVERSED_MOTOR,
    STATES,
    TRUSTED_MOTOR,
    UNSAID,
    Severity,
    course,
    on_engaging,
)
from companion.telemetry.operator_commands import CommandResult
from companion.telemetry.repeats import Repeats, cause
from companion.telemetry.schemas import Event, Kind, printable

RESETS = Condition.YAW_RESET | Condition.POSITION_RESET | Condition.DEPTH_RESET
MAV_SEVERITY_ERROR, MAV_SEVERITY_WARNING = 3, 4

Happened = Iterator[tuple[Severity, Kind, str]]


class EventLog:
    """Compares each tick with the one before. Changes of state are always told, others while they are few."""

    def __init__(self) -> None:
        self._repeats = Repeats()
        self._state: State | None = None
        self._reason = ""
        self._conditions = Condition(0)
        self._motors = (0, 0)
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
        state = sample.state
        happened = chain(
            _told(sample, results, duplicate_instances, peer_changes),
            self._condition_changes(sample.verdict, reads=sample.reads),
            self._motor_changes(state.dead_motor, state.reversed_motor),
            self._course_changes(sample),
            self._reset(sample),
            self._state_changes(sample),
        )
        return [
            Event(t_s=state.t_s, boot_s=state.boot_s, severity=severity, kind=kind, text=text)
            for severity, kind, text in self._few(happened, state.t_s)
        ]

    def _few(self, happened: Happened, now_s: float) -> Happened:
        """Leave out what happens too often; what others say counts together, whatever they say."""
        for text in self._repeats.left_out(now_s):
            yield "info", "condition", text
        for severity, kind, text in happened:
            said = f"{kind}, {severity}" if kind in ("command", "autopilot") else cause(text)
            if kind == "state" or self._repeats.passes(said, now_s):
                yield severity, kind, text

    def _condition_changes(self, verdict: Verdict, *, reads: bool) -> Happened:
        """Tell which conditions begin and end; a row that is not read yet is no event."""
        before, now = self._conditions, verdict.conditions & ~UNSAID
        if reads:
            now &= ~Condition.PREFLIGHT_FAILURE
        self._conditions = now
        if self._state is not None and before != now:  # the first state's reason names them
            for begins in now & ~before:
                yield "warning", "condition", begins.text
            for ends in before & ~now:
                yield "info", "condition", ends.ended

    def _motor_changes(self, dead: int, turned: int) -> Happened:
        before, self._motors = self._motors, (dead, turned)
        if self._motors == before:
            return
        if dead or turned:
            yield "warning", "condition", (DEAD_MOTOR if dead else REVERSED_MOTOR).format(dead or turned)
        else:
            yield "info", "condition", TRUSTED_MOTOR.format(max(before))

    def _course_changes(self, sample: ControlSample) -> Happened:
        guided = sample.guided
        before, self._guided = self._guided, (guided.number, guided.kind)
        if before != self._guided and guided.number and guided.kind and not guided.pending:
            severity: Severity = "warning" if guided.kind == "refused" else "info"
            yield severity, "state", course(guided.kind, printable(guided.name))

    def _state_changes(self, sample: ControlSample) -> Happened:
        verdict, pending = sample.verdict, sample.guided.pending
        goes_on = verdict.state is State.HAND_OVER and verdict.reason != self._reason
        self._reason = verdict.reason
        if verdict.state is not self._state or goes_on:
            self._state = verdict.state
            yield STATES[verdict.state].severity, "state", f"{verdict.state}: {verdict.reason}"
        before, self._pending = self._pending, pending
        if pending != before and not any(sample.dofs.engaged):
            yield "info", "state", on_engaging(printable(pending) or HOLD_HERE)

    def _reset(self, sample: ControlSample) -> Happened:
        """Report the first reset of the autopilot's estimate, and their sum once they have ended."""
        shift, resets = sample.state.frame_shift, sample.verdict.conditions & RESETS
        if shift is not None and resets:
            self._resets += 1
            self._turned_rad += shift.turn_rad
            self._sunk_m += shift.down_m
            if self._resets == 1:
                yield "warning", "condition", f"the EKF was reset: {_shift_words(shift)}"
        elif self._resets and not resets:
            if self._resets > 1:
                parts = [f"yaw {math.degrees(self._turned_rad):+.1f}°"] if self._turned_rad else []
                parts += [f"depth {self._sunk_m:+.2f} m"] if self._sunk_m else []
                text = f"{self._resets} resets of the EKF, {', '.join(parts or ['position'])} in all"
                yield "warning", "condition", text
            self._resets, self._turned_rad, self._sunk_m = 0, 0.0, 0.0


def _told(
    sample: ControlSample,
    results: Sequence[CommandResult],
    duplicate_instances: Sequence[str],
    peer_changes: Sequence[str],
) -> Happened:
    """Tell what others say and do: operator, pilot's button, companions of this name, peers, autopilot."""
    for result in results:
        yield "info" if result.reply.done else "warning", "command", result.text
    if sample.refused:
        yield "warning", "command", f"engage by button: refused: {sample.refused}"
    for instance in duplicate_instances:
        yield "warning", "condition", f"another companion of this name came: instance {printable(instance)}"
    for change in peer_changes:
        yield "warning", "condition", change
    for text in sample.texts:
        bad: Severity = "fault" if text.severity <= MAV_SEVERITY_ERROR else "warning"
        yield bad if text.severity <= MAV_SEVERITY_WARNING else "info", "autopilot", text.text


def _shift_words(shift: FrameShift) -> str:
    if shift.turn_rad:
        return f"yaw {math.degrees(shift.turn_rad):+.1f}°; the heading that is held turns with it"
    if shift.down_m:
        return f"the autopilot's depth {shift.down_m:+.2f} m; the depth here counts on as before"
    moved = f"position {shift.north_m:+.2f} m north, {shift.east_m:+.2f} m east"
    return f"{moved}; the place that is held moves with it"
