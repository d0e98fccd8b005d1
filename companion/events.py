"""What happened in a tick, in words: for the `event` key, whoever watches, and the record of the dive."""

from collections.abc import Sequence
from typing import Literal

from companion.operator import Taken
from companion.telemetry import Event, printable
from companion.types import Condition, ControlSample, State

ASKED = Condition.OPERATOR_STOP | Condition.ENGAGE_ASKED | Condition.CLEAR_ASKED | Condition.RAMPED_DOWN
ASKED |= Condition.HANDED_OVER | Condition.HAND_OVER_REFUSED
"""What somebody asked for or the supervisor says to itself: told as a command or a state."""

MAV_SEVERITY_ERROR, MAV_SEVERITY_WARNING = 3, 4

_Severity = Literal["info", "warning", "fault"]
_SEVERITY: dict[State, _Severity] = {
    State.FAULT: "fault",
    State.RAMP_DOWN: "warning",
    State.HAND_OVER: "warning",
    State.PILOT: "warning",
}


class Chronicle:
    """Compares each tick with the one before."""

    def __init__(self) -> None:
        self._state: State | None = None
        self._conditions = Condition(0)

    def step(
        self, sample: ControlSample, taken: Sequence[Taken] = (), rivals: Sequence[str] = ()
    ) -> list[Event]:
        """Return what happened in this tick.

        `taken` are the commands that were answered, `rivals` other companions of this vehicle's name.
        """
        verdict = sample.verdict
        conditions = verdict.conditions & ~ASKED
        happened: list[tuple[_Severity, Literal["state", "command", "autopilot", "condition"], str]] = [
            ("info" if one.reply.done else "warning", "command", one.text) for one in taken
        ]
        happened += [
            ("warning", "condition", f"another companion of this name came: instance {printable(rival)}")
            for rival in rivals
        ]
        for text in sample.texts:
            severity: _Severity = "info"
            if text.severity <= MAV_SEVERITY_WARNING:
                severity = "fault" if text.severity <= MAV_SEVERITY_ERROR else "warning"
            happened.append((severity, "autopilot", text.text))
        if self._state is None:
            self._conditions = conditions  # the first state's reason names them
        elif conditions != self._conditions:
            happened += [("warning", "condition", _words(one)) for one in conditions & ~self._conditions]
            happened += [
                ("info", "condition", f"no longer {_words(one)}") for one in self._conditions & ~conditions
            ]
            self._conditions = conditions
        if verdict.state is not self._state:
            self._state = verdict.state
            severity = _SEVERITY.get(verdict.state, "info")
            happened.append((severity, "state", f"{verdict.state}: {verdict.reason}"))
        if not happened:
            return []
        state = sample.state
        return [
            Event(t_s=state.t_s, boot_s=state.boot_s, severity=severity, kind=kind, text=text)
            for severity, kind, text in happened
        ]


def _words(condition: Condition) -> str:
    return (condition.name or "").lower().replace("_", " ")
