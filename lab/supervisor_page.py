"""docs/supervisor.md from the supervisor's tables."""

import math
import re
import textwrap
from collections.abc import Iterator
from pathlib import Path

from companion.config import SupervisorLimits, load_config
from companion.core import tilt
from companion.records import ENGAGE_S, Condition, State
from companion.supervision.handover import KEEP_ALIVE_S, REFUSED_S, SETTLE_S
from companion.supervision.monitor import RECOVERS_PER_S, STEADY_S
from companion.supervision.rules import BLOCKING, FREEZES, MOST_LOST, SAMPLE_S, WARNS
from companion.supervision.supervisor import RESUME_S, transition
from companion.telemetry.glossary import COURSES, STATES, title

KEY = re.compile(rf"\b({'|'.join(SupervisorLimits.__struct_fields__)})\b")
PAGE = Path(__file__).parent.parent / "docs" / "supervisor.md"


def _deg(rad: float) -> str:
    return f"{math.degrees(rad):g}"


HEAD = f"""\
# The supervisor

<!-- Made by `holdfast lab schema --write` from companion/supervision/. -->

Every tick the supervisor tests all conditions and decides whether Holdfast may steer. Holdfast sends thrust
only in ACTIVE, in RAMP_DOWN and at the start of HAND_OVER, scaled by the *authority*, a number from 0 to 1,
which rises over `ramp_up_s` after engaging and falls over `ramp_down_s` on release. A fault, a pilot's
takeover or disarming sets it to 0 at once. The default is to refuse.

A request to engage is refused at once, with the reason, if more is missing than the flight mode, and arming
where `--arm` permits it. Else Holdfast reads FS_PILOT_INPUT and FS_PILOT_TIMEOUT again, and engages when the
autopilot has answered. A request by command or button lasts {ENGAGE_S:g} s; that of `run --engage` waits.
"""

INTERRUPTIONS = f"""\
## Short interruptions

While ACTIVE, thrust is neutral as soon as depth or attitude is older than its timeout, or a tick was later
than `late_tick_s` (INTERRUPTED). Setpoint, path and held axes stay. When telemetry and ticks are back,
Holdfast goes on from where the vehicle is, without what the compensator had learnt, with full authority
after {RESUME_S:g} s. UNSTEADY warns until {STEADY_S:g} s after the last pause.

While ACTIVE, LINK LOST, DEPTH STALE, ATTITUDE STALE and TICK LATE begin only after `link_timeout_s` (depth
and attitude {SAMPLE_S:g} s later, a sample of a slow source). INTERRUPTED OFTEN hands over as soon as
interruptions have taken more than {MOST_LOST:g} times `link_timeout_s` of full authority; each second with
full authority subtracts {RECOVERS_PER_S:g} s. So over any 10 s the mean authority is at least 0.8, or control
ends.

If only telemetry is interrupted, the vehicle gets neutral frames: it drifts, rises or sinks. If commands do
not reach it, or this process pauses, the vehicle **keeps the last command**: only the pilot-input failsafe
stops it, after FS_PILOT_TIMEOUT (3 s); RC_OVERRIDE_TIME does so only with an RC receiver.
"""

TILT = f"""\
## When it tilts

Tilt alone does not release the vehicle: its cause (a load, a tether, a dead thruster) may also sink it, and
the autopilot would disarm it 3 s later. Holdfast removes the forces that increase the tilt, and keeps those
that hold the depth:

| larger tilt of now and {tilt.AHEAD_S:g} s ahead | what Holdfast still controls |
|---|---|
| up to {_deg(tilt.LEVEL_RAD)}° | everything |
| {_deg(tilt.LEVEL_RAD)} to {_deg(tilt.STEEP_RAD)}° | all; horizontal force and setpoint speeds decrease |
| {_deg(tilt.STEEP_RAD)} to {_deg(tilt.YAW_STEEP_RAD)}° | \
heave, levelling, yaw; x and y setpoints follow the vehicle; from {_deg(tilt.YAW_LEVEL_RAD)}° yaw decreases |
| beyond `max_tilt_deg` | heave and levelling; TILTED warns, learning is frozen, engaging is refused |
| this for `off_track_s`, and 0.3 m from its depth | nothing: TILT PERSISTS hands over |

From {_deg(tilt.PART_FROM_RAD)}° on the horizontal thrusters help with heave: the force stays vertical.

The frame with six thrusters cannot produce a pitch moment: the limit of its horizontal force starts at
{tilt.UNLEVELLED_N:g} N, rises by {tilt.FAST_N_PER_S:g} N/s until the vehicle tilts by
{_deg(tilt.UNLEVELLED_ALARM_RAD)}°, and then stays below that force. The vehicle may drift; SATURATED warns.
"""

HAND_OVER = f"""\
## Handing over to ALT_HOLD

Holdfast hands over when it cannot continue but the autopilot can still hold depth:

1. Ramp the thrust down over `ramp_down_s`.
2. Request STABILIZE until the heartbeat confirms it: from MANUAL directly the vehicle could sink.
3. Send neutral for {SETTLE_S:g} s.
4. Request ALT_HOLD until the heartbeat confirms it.

If ALT_HOLD is not confirmed {REFUSED_S:g} s after the start, Holdfast goes to FAULT and falls silent; the
pilot-input failsafe follows.

FS_PILOT_INPUT by default disarms 3 s after the last steering message. Therefore Holdfast sends a neutral
frame every {KEEP_ALIVE_S:g} s while ALT_HOLD holds depth; the state stays HAND_OVER. A moved stick, any other
steering that it sees, a mode change, a `release` or the end of `keep_alt_hold_s` ends this. Then Holdfast
is silent in state PILOT, and the autopilot's failsafes act as without Holdfast.

`keep_alt_hold_s` does not apply when the vehicle surfaces (the pilot was lost, or a failsafe of the autopilot
surfaces; at the surface the firmware changes to ALT_HOLD by itself), nor after a hand-over because of tilt:
a disarmed vehicle could sink. The neutral frames continue until somebody takes over.

EKF UNHEALTHY, DEPTH OUT OF BOUNDS, AUTOPILOT FAILSAFE and TICK LATE ramp down to neutral instead.
Without link, depth or attitude Holdfast cannot control a ramp: it sends neutral at once.
"""


def page() -> str:
    """Return the whole page."""
    parts = [HEAD, "## States\n", *_states(), "## Conditions\n", *_conditions(load_config().supervisor)]
    text = "\n".join([*parts, INTERRUPTIONS, TILT, HAND_OVER]).replace(", button or dashboard", "")
    return wrapped(text)


def wrapped(text: str) -> str:
    """Return Markdown whose lines end before column 120, but those of tables."""
    lines = text.split("\n")
    short = (
        line if line.startswith("|") else textwrap.fill(line, 119, break_long_words=False) for line in lines
    )
    return "\n".join(short)


def _states() -> Iterator[str]:
    yield (
        "Screens, log and ground station use these words. The advice is the [condition](#conditions)'s; "
        "without one, the last column's.\n"
    )
    yield "| state | what it means | on entering | what to do |\n|---|---|---|---|"
    for name, words in STATES.items():
        yield f"| {title(name)} | {words.text} | {words.severity} | {words.remedy} |"
    courses = "; ".join(f"{words} (`{kind}`)" for kind, words in COURSES.items())
    yield f"\nWhile ACTIVE, `guidance` of [State](telemetry.md#state) says what Holdfast does: {courses}.\n"


def _conditions(limits: SupervisorLimits) -> Iterator[str]:
    yield (
        "If several conditions hold, screens name first the one that is higher in this table. *Effect*: what "
        "it does alone. After a FAULT, remove the cause and [clear the "
        "fault](wiring.md#how-to-engage-release-and-clear-a-fault).\n"
    )
    yield "| condition | what is said: when | effect | what to do |\n|---|---|---|---|"
    for condition in Condition:
        when = KEY.sub(lambda key: f"`{key[0]}={getattr(limits, key[0]):g}`", condition.description)
        what = f"{condition.text}: {when}" if when else condition.text
        name, remedy = title(condition.name or ""), condition.remedy or "–"
        yield f"| {name} | {what} | {_effect(condition)} | {remedy} |"
    yield ""


def _effect(condition: Condition) -> str:
    """Return what a condition alone does: each effect with the states in which it has it."""
    states: dict[str, list[str]] = {}
    for state in State:
        row = transition(state, condition)
        if row is not None and row.when and row.when != BLOCKING:
            states.setdefault(f"→ {title(row.to)}", []).append(title(state))
    effects = [f"{', '.join(at)} {effect}" for effect, at in states.items()]
    if condition & BLOCKING and condition is not Condition.NON_FINITE:
        effects.insert(0, "no engaging")
    if condition is Condition.INTERRUPTED:
        effects.append("neutral until it ends")
    if condition & WARNS:
        effects.append("warns, freezes learning" if condition & FREEZES else "warns")
    return "; ".join(effects)
