"""Writes docs/supervisor.md from the supervisor's own tables.

`python -m lab.supervisor_page` does.
"""

import math
from collections.abc import Iterator
from pathlib import Path

from companion.config import Supervisor as Limits
from companion.config import load_config
from companion.control.tilt import (
    AHEAD_S,
    FAST_N_PER_S,
    LEVEL_RAD,
    PART_FROM_RAD,
    STEEP_RAD,
    UNLEVELLED_ALARM_RAD,
    UNLEVELLED_N,
    YAW_LEVEL_RAD,
    YAW_STEEP_RAD,
)
from companion.records import Condition, State
from companion.supervision.conditions import CONDITIONS
from companion.supervision.handover import KEEP_ALIVE_S, REFUSED_S, SETTLE_S
from companion.supervision.supervisor import (
    BLOCKING,
    FAULT_CAUSES,
    FREEZES,
    NOTHING,
    TRANSITIONS,
    WARNS,
    transition,
)

PAGE = Path(__file__).parent.parent / "docs" / "supervisor.md"


def _deg(rad: float) -> str:
    return f"{math.degrees(rad):g}"


HEAD = """\
# The supervisor

<!-- Made by `python -m lab.supervisor_page` from companion/supervision/. -->

It looks at every condition in every tick, and says who may steer. Thrust leaves in ACTIVE, RAMP_DOWN and at
the start of HAND_OVER, scaled by the *authority*: it rises over `ramp_up_s` on engaging and falls over
`ramp_down_s` on letting go. A fault, a pilot or a disarmed vehicle ends it at once. The default is to
refuse.
"""

HAND_OVER = f"""\
## Handing over to ALT_HOLD

Where we are the ones who cannot go on, and the autopilot's own depth is good, it gets the vehicle. Entered
straight from MANUAL, ALT_HOLD dips by half a metre; so: ramp down over `ramp_down_s`, ask for STABILIZE
until the heartbeat says so, {SETTLE_S:g} s of neutral, ask for ALT_HOLD until the heartbeat says so. If
that takes longer than {REFUSED_S:g} s, we are silent and in FAULT: neutral was sent, and the pilot-input
failsafe follows.

ALT_HOLD alone would not last: FS_PILOT_INPUT acts 3 s after the last steering message, and as shipped it
disarms. So one neutral frame every {KEEP_ALIVE_S:g} s keeps it alive, for `keep_alt_hold_s`, or until
somebody else's steering is seen; then we are silent, the state is PILOT, and the autopilot's failsafes rule
as if we were not there. A stick that is moved, another mode or a stop ends it at once.

On the way up, because the pilot was lost or a failsafe of the autopilot's own surfaces, neutral goes on
without that limit. At the surface the firmware itself changes from SURFACE to ALT_HOLD: the state stays
HAND_OVER, and neutral goes on until a pilot steers.

Not handed over: what the autopilot could not do better either, because it has the same sensors (EKF, depth
out of bounds) or acts already (its failsafe); a process that does not keep time, which could not see the
sequence through. These ramp down to neutral. Without link, depth or attitude there is nothing to ramp by:
neutral at once.
"""

TILT = f"""\
## When it tilts

A vehicle is not let go because it tilts. What tilts it may also sink it: a load, a tether, a dead thruster;
and 3 s after our last frame it would be disarmed. So what makes a tilt worse goes first, and what keeps the
depth stays:

| largest tilt now and {AHEAD_S:g} s ahead | what is left |
|---|---|
| up to {_deg(LEVEL_RAD)}° | everything |
| {_deg(LEVEL_RAD)} to {_deg(STEEP_RAD)}° | \
less and less of the horizontal force and of every setpoint's speed |
| {_deg(STEEP_RAD)} to {_deg(YAW_STEEP_RAD)}° | \
x and y are let go: the place that is held goes along; from {_deg(YAW_LEVEL_RAD)}° also less and less yaw |
| beyond `max_tilt_deg` | heave and levelling alone: TILTED warns, nothing is learnt, and nobody can engage |
| the same for `off_track_s` | TILT PERSISTS: we cannot right it; STABILIZE and then ALT_HOLD get it |

From {_deg(PART_FROM_RAD)}° on the horizontal thrusters take their part of heave, so that it pushes straight
down or up.

The frame with six thrusters cannot pitch by itself. There the horizontal force begins at
{UNLEVELLED_N:g} N and rises by {FAST_N_PER_S:g} N/s until the vehicle tilts by {_deg(UNLEVELLED_ALARM_RAD)}°,
and then stays below what tilted it: rather than capsize it drifts, level, and keeps depth and heading.
SATURATED says so. Across a current it holds where it cannot head-on.

After a hand-over because of a tilt the neutral frames go on until somebody steers, changes the mode or says
stop, without the limit of `keep_alt_hold_s`: silence would disarm it, and it would sink with what tilts it.
"""


def page() -> str:
    """Return the whole page."""
    limits = load_config().supervisor
    parts = [HEAD, "## States\n", *_diagram(), "## What each condition does\n", *_matrix()]
    parts += ["## What each means\n", *_meanings(limits), TILT, HAND_OVER]
    return "\n".join(parts)


def _diagram() -> Iterator[str]:
    ways: dict[tuple[State, State], list[str]] = {}
    for row in TRANSITIONS:
        ways.setdefault((row.at, row.to), []).append(row.because)
    lines = ["```mermaid", "stateDiagram-v2", "    [*] --> IDLE"]
    for (at, to), reasons in ways.items():
        lines.append(f"    {at} --> {to}: {'<br/>'.join(dict.fromkeys(reasons))}")
    yield "\n".join([*lines, "```", ""])


def _matrix() -> Iterator[str]:
    yield (
        "The condition alone, in each state; a dot changes nothing. Of several, the first row of "
        "`TRANSITIONS` that fits counts.\n"
    )
    lines = ["| condition | " + " | ".join(State) + " |", "|---" * (len(State) + 1) + "|"]
    for condition in Condition:
        cells = (_cell(state, condition) for state in State)
        lines.append(f"| {_words(condition)} | " + " | ".join(cells) + " |")
    yield "\n".join([*lines, ""])


def _cell(state: State, condition: Condition) -> str:
    row = transition(state, condition)
    if state is State.IDLE and row is transition(State.IDLE, NOTHING):
        return "·"
    if row is not None:
        return str(row.to)
    if state is State.IDLE and condition & BLOCKING:
        return "waits"
    if state is State.ACTIVE and condition & WARNS:
        return "warns, freezes learning" if condition & FREEZES else "warns"
    return "·"


def _meanings(limits: Limits) -> Iterator[str]:
    yield (
        "Of several, an operator is told what to do about the first one of this table. What has led to FAULT "
        "is cleared afterwards, in one of [these ways](wiring.md#how-to-engage-release-and-clear-a-fault).\n"
    )
    lines = ["| condition | it means | [supervisor] | what to do |", "|---|---|---|---|"]
    for spec in CONDITIONS:
        keys = ", ".join(f"`{key}` = {getattr(limits, key):g}" for key in spec.keys) or "–"
        clears = spec.condition & FAULT_CAUSES and spec.remedy != "nothing"
        remedy = f"{spec.remedy}; then clear the fault" if clears else spec.remedy
        lines.append(f"| {_words(spec.condition)} | {spec.description} | {keys} | {remedy} |")
    yield "\n".join([*lines, ""])


def _words(condition: Condition) -> str:
    return (condition.name or "").replace("_", " ")


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
