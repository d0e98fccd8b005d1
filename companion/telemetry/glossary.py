"""The words of every screen: states, lists of conditions, what moves the vehicle, silence.

`Condition` has those of each condition. Page, terminal, ground station, log and documents have no words of
their own for these: the page gets them by `dashboard.web.vocabulary`, docs/supervisor.md is made from them.
"""

import re
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Literal, NamedTuple

from companion.records import Condition, State
from companion.telemetry.modes import FAILSAFE, MODE_NAMES, Mode

Severity = Literal["info", "warning", "fault"]

VEHICLE, ENDPOINT = "bluerov2", "tcp/127.0.0.1:7447"
"""The usual name, and where Zenoh is looked for, and listened on where nobody does."""

BY = "(`holdfast {}`, button or dashboard)"
ENGAGE, RELEASE = (f"{what} {BY.format(what)}" for what in ("engage", "release"))
CLEAR = f"clear the fault {BY.format('tell clear_fault')}"
"""What an operator asks for, and how."""


BUTTONS = {"engage": "Engage", "release": "Release", "hold": "Hold here", "tell clear_fault": "Clear fault"}
"""The page's button by the command that does the same."""
_COMMAND = re.compile(r"`holdfast (engage|release|hold|tell)((?: clear_fault)?)`")


class StateWords(NamedTuple):
    """What a state means, how grave entering it is, and what to do where no condition says more."""

    text: str
    severity: Severity
    remedy: str


STATES: dict[str, StateWords] = {
    State.IDLE: StateWords("hands off", "info", ENGAGE),
    State.READY: StateWords("may engage", "info", ENGAGE),
    State.ACTIVE: StateWords(
        "holding",
        "info",
        "keep watch; a full stick, a mode change or disarming gives the pilot control at once",
    ),
    State.RAMP_DOWN: StateWords("releasing", "warning", "wait until the thrust is zero"),
    State.HAND_OVER: StateWords(
        "handing over to ALT_HOLD", "warning", f"wait, take over with a stick, or {RELEASE}"
    ),
    State.PILOT: StateWords("the pilot, or ALT_HOLD, has it", "warning", ENGAGE),
    State.FAULT: StateWords("latched until the operator clears it", "fault", CLEAR),
}

COURSES = {
    "hold": "holds here",
    "move": "goes to its place",
    "path": "follows the path",
    "paused": "pauses the path",
    "waiting": "waits with the path for authority, or for a position",
    "refused": "refuses the path or the move",
}
"""What Holdfast does with the vehicle, by `State.guidance`."""
HOLD_HERE = "hold here"
"""What it does on engaging where nothing else is kept."""

NOBODY = "nobody steers: the autopilot disarms in {:.0f} s unless a pilot does"
TO_DO = "to do"
NO_DATA = "NO DATA"
"""Shown in place of a state when nothing new comes from the companion."""
PAST = "nothing new for {:.1f} s; this is the past"
DEAD_MOTOR = "motor {} gives no thrust"
REVERSED_MOTOR = "motor {0} pushes the other way: change the sign of MOT_{0}_DIRECTION"
TRUSTED_MOTOR = "motor {} is trusted again"

ELSEWHERE = "To release, use the joystick or the ground station."
SERVER_SILENT = (
    "The dashboard's server is silent. The vehicle may go on as it was.",
    f"Look whether `holdfast dashboard` runs, and at the network. {ELSEWHERE}",
)
LATE = "What comes is old: the network is slow.", ELSEWHERE
NO_VEHICLE = "No vehicle is heard."
_STEERING = (State.ACTIVE, State.RAMP_DOWN, State.HAND_OVER)


UNSAID = Condition(sum(condition for condition in Condition if not condition.ended))
"""What somebody asked for, or the supervisor's own bookkeeping: reported as a command or a state; INTERRUPTED
as UNSTEADY."""

ENDED = {condition.ended: condition.text for condition in Condition if condition.ended}
"""Maps the words for the end of a condition to those for its beginning."""

BY_A_PERSON = tuple(
    condition.text
    for condition in (
        Condition.OPERATOR_STOP,
        Condition.PILOT_TAKEOVER,
        Condition.WRONG_MODE,
    )
)
"""Reasons why control ends that a person meant. An autopilot disarms by itself, too."""

Details = Mapping[Condition, tuple[str, str]]
"""What is found of a condition now, and a remedy in place of the usual one; either may be empty."""

NO_DETAILS: Details = MappingProxyType({})


def awaited(conditions: Condition, details: Details) -> str:
    """Return what is awaited while these conditions hold."""
    return ", ".join(detailed(condition, condition.awaited, details) for condition in conditions)


def text(conditions: Condition, details: Details = NO_DETAILS) -> str:
    """Return what is so while these conditions hold."""
    return ", ".join(detailed(condition, condition.text, details) for condition in conditions & ~UNSAID)


def detailed(condition: Condition, words: str, details: Details) -> str:
    """Return the words of a condition, and what is found of it."""
    found, _ = details.get(condition, ("", ""))
    return f"{words} ({found})" if found else words


def named(names: Iterable[str]) -> Condition:
    """Return the conditions of these published names; those of another version are left out."""
    return Condition(sum({Condition[name] for name in names if name in Condition.__members__}))


def title(name: str) -> str:
    """Return the name of a state or a condition as it is shown."""
    return name.replace("_", " ")


LINK_LOST = title(Condition.LINK_LOST.name or "")
"""Shown in place of a state when nothing comes from the vehicle."""


def whole(text: str, vehicle: str, connect: str) -> str:
    """Return a text whose commands say which vehicle, and where, unless both are the usual ones."""
    name = f" {vehicle}" if vehicle != VEHICLE else ""
    where = f" --connect {connect}" if connect != ENDPOINT else ""
    return _COMMAND.sub(lambda found: f"`holdfast {found[1]}{name}{found[2]}{where}`", text)


def on_page(text: str) -> str:
    """Return a text that names buttons of the page in place of commands."""
    named = _COMMAND.sub(lambda found: f"button {BUTTONS[found[1] + found[2]]}", text)
    return named.replace(", button or dashboard", "")


def advised(said: str, remedy: str) -> str:
    """Return words, and what to do."""
    return f"{said}; {TO_DO}: {remedy}" if remedy else said


def on_engaging(what: str) -> str:
    """Return what is kept for engaging, in words; empty where nothing is."""
    return f"when it engages: {what}" if what else ""


def course(kind: str, name: str = "") -> str:
    """Return what moves the vehicle; `name` is the path's, or why it is refused."""
    return f"{COURSES[kind]}: {name}" if name else COURSES[kind]


def holder(
    state: str,
    *,
    guidance: str,
    armed: bool | None,
    mode: int | None,
    disarms_in_s: float = 0.0,
    system_status: int = 0,
) -> str:
    """Return who has the vehicle, by the supervisor's state and the vehicle's own heartbeat.

    `armed` and `mode` are None where the vehicle did not say so lately. It disarms in `disarms_in_s`, unless
    that is 0; by `system_status`, MAV_STATE, it may be in a failsafe, which a pilot mostly ends.
    """
    if state == State.ACTIVE:
        return f"Holdfast {COURSES.get(guidance, COURSES['hold'])}"
    if state == State.RAMP_DOWN or armed is None:
        return STATES[state].text if state in STATES else ""
    if not armed:
        return "disarmed: nobody has it"
    if disarms_in_s > 0.0:
        return NOBODY.format(disarms_in_s)
    if mode == Mode.ALT_HOLD:
        return "ALT_HOLD has it"
    if state == State.HAND_OVER:
        return STATES[state].text
    name = "" if mode is None else MODE_NAMES.get(mode, f"mode {mode}")
    has = "no pilot is known (a failsafe is latched)" if system_status == FAILSAFE else "the pilot has it"
    return f"{has}, {name}" if name else has


def silence(
    vehicle: str, endpoint: str, *, connected: bool, state: str = "", armed: bool | None = None
) -> tuple[str, str]:
    """Return what to say where nothing is heard, and the operator's next step.

    `state` and `armed` are the last that were heard.
    """
    if not vehicle:
        if connected:
            return NO_VEHICLE, "Zenoh answers, but no companion publishes: start `holdfast run`."
        return f"Nobody listens on {endpoint}.", "Start `holdfast run`, or name the endpoint by --connect."
    if state in _STEERING:
        return (
            f"No news from {vehicle}. It was {title(state)}{' and armed' if armed else ''}.",
            "If its companion has died, the autopilot disarms 3 s after the last frame (FS_PILOT_TIMEOUT). "
            "Take over with the joystick or the ground station; then look at `holdfast run` and the network.",
        )
    return (
        f"No news from {vehicle}: what you see is the past. Holdfast did not steer.",
        "Look at its companion, `holdfast run`, and the network.",
    )
