"""Who may steer: conditions as bits, transitions as a table, and `guard`, the last word on every command.

Permission comes before the law (`Supervisor.step`), and again last before the bytes (`guard`). The default is
to refuse: only ACTIVE and RAMP_DOWN carry authority, and what TRANSITIONS does not list changes nothing.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from companion.config import Supervisor as Limits
from companion.types import NEUTRAL, AxisCommand, Condition, State, VehicleState, Verdict

C, S = Condition, State

BLIND = C.LINK_LOST | C.DEPTH_STALE | C.ATTITUDE_STALE | C.POSITION_STALE
UNFIT = BLIND | C.DISARMED | C.WRONG_MODE | C.FAILSAFE_UNSAFE | C.NON_FINITE | C.TICK_LATE | C.TILTED
NOTHING = Condition(0)


class Row(NamedTuple):
    """In state `at`: if any bit of `when` is set, or, with `unless`, if none of those is: go `to`."""

    at: State
    when: Condition
    unless: Condition
    to: State
    because: str


# Read aloud from the top: the first row that fits is taken, one row a tick.
TRANSITIONS = (
    Row(S.IDLE, C.NON_FINITE, NOTHING, S.FAULT, "a computed value was not finite"),
    Row(S.IDLE, NOTHING, UNFIT, S.READY, "everything needed is there"),
    Row(S.READY, C.NON_FINITE, NOTHING, S.FAULT, "a computed value was not finite"),
    Row(S.READY, UNFIT, NOTHING, S.IDLE, "something needed is missing"),
    Row(S.READY, C.ENGAGE_ASKED, C.PILOT_TAKEOVER | C.OPERATOR_STOP, S.ACTIVE, "engaged"),
    Row(S.ACTIVE, C.NON_FINITE, NOTHING, S.FAULT, "a computed value was not finite"),
    Row(S.ACTIVE, C.LINK_LOST, NOTHING, S.FAULT, "the vehicle fell silent"),
    Row(S.ACTIVE, C.DEPTH_STALE, NOTHING, S.FAULT, "no fresh depth"),
    Row(S.ACTIVE, C.ATTITUDE_STALE, NOTHING, S.FAULT, "no fresh attitude"),
    Row(S.ACTIVE, C.DISARMED, NOTHING, S.IDLE, "the vehicle was disarmed"),
    Row(S.ACTIVE, C.WRONG_MODE, NOTHING, S.PILOT, "the pilot changed the mode"),
    Row(S.ACTIVE, C.PILOT_TAKEOVER, NOTHING, S.PILOT, "the pilot moved the sticks"),
    Row(S.ACTIVE, C.FAILSAFE_UNSAFE, NOTHING, S.RAMP_DOWN, "the pilot-input failsafe was switched off"),
    Row(S.ACTIVE, C.POSITION_STALE, NOTHING, S.RAMP_DOWN, "no fresh position"),
    Row(S.ACTIVE, C.TICK_LATE, NOTHING, S.RAMP_DOWN, "this process does not keep time"),
    Row(S.ACTIVE, C.TILTED, NOTHING, S.RAMP_DOWN, "it rolled or pitched too far"),
    Row(S.ACTIVE, C.OPERATOR_STOP, NOTHING, S.RAMP_DOWN, "the operator stopped it"),
    Row(S.RAMP_DOWN, C.NON_FINITE, NOTHING, S.FAULT, "a computed value was not finite"),
    Row(S.RAMP_DOWN, C.LINK_LOST, NOTHING, S.FAULT, "the vehicle fell silent"),
    Row(S.RAMP_DOWN, C.DEPTH_STALE | C.ATTITUDE_STALE, NOTHING, S.FAULT, "blind while ramping down"),
    Row(S.RAMP_DOWN, C.WRONG_MODE | C.PILOT_TAKEOVER, NOTHING, S.PILOT, "the pilot took over"),
    Row(S.RAMP_DOWN, C.DISARMED, NOTHING, S.IDLE, "the vehicle was disarmed"),
    Row(S.RAMP_DOWN, C.RAMPED_DOWN, NOTHING, S.IDLE, "ramped down to neutral"),
    Row(S.PILOT, C.NON_FINITE, NOTHING, S.FAULT, "a computed value was not finite"),
    Row(S.PILOT, C.CLEAR_ASKED | C.ENGAGE_ASKED, C.PILOT_TAKEOVER, S.IDLE, "the operator takes it back"),
    Row(S.FAULT, C.CLEAR_ASKED, C.NON_FINITE, S.IDLE, "the operator cleared the fault"),
)


# The same as plain integers by state: enum arithmetic costs a microsecond a row.
_ROWS = {
    state: tuple((int(row.when), int(row.unless), row) for row in TRANSITIONS if row.at is state)
    for state in State
}


def transition(state: State, conditions: Condition) -> Row | None:
    """Return the first row that fits, or None: nothing changes."""
    bits = int(conditions)
    for when, unless, row in _ROWS[state]:
        if (not when or when & bits) and not unless & bits:
            return row
    return None


class Supervisor:
    """The state, its reason and the authority that goes with it."""

    def __init__(self, ramp_down_s: float) -> None:
        self._ramp_down_s = ramp_down_s
        self._verdict = Verdict(State.IDLE, NOTHING, 0.0, "just started")

    def step(self, conditions: Condition, dt_s: float) -> Verdict:
        """Take one tick's conditions and give the verdict.

        Authority is 1 in ACTIVE, falls to 0 over `ramp_down_s` in RAMP_DOWN, and is 0 everywhere else.
        """
        before = self._verdict
        authority = max(0.0, before.authority - dt_s / self._ramp_down_s)
        if before.state is State.RAMP_DOWN and authority == 0.0:
            conditions |= Condition.RAMPED_DOWN
        row = transition(before.state, conditions)
        state, reason = (row.to, row.because) if row else (before.state, before.reason)
        if state is State.ACTIVE:
            authority = 1.0
        elif state is not State.RAMP_DOWN:
            authority = 0.0
        if state is before.state is State.IDLE and (missing := conditions & UNFIT):
            reason = "waiting for: " + names(missing)
        self._verdict = Verdict(state, conditions, authority, reason)
        return self._verdict


def names(conditions: Condition) -> str:
    """Return the set bits in words, for people."""
    return ", ".join((bit.name or "").lower().replace("_", " ") for bit in conditions)


@dataclass(frozen=True, slots=True)
class Envelope:
    """What may leave this machine: |axis| at most `max_axis`, moving at most `max_slew_per_s`."""

    max_axis: float
    max_slew_per_s: float


def guard(
    command: AxisCommand, verdict: Verdict, previous: AxisCommand, envelope: Envelope, dt_s: float
) -> AxisCommand:
    """Return what may be sent: finite, bounded, slew-limited, scaled by authority; neutral unless permitted.

    Losing permission is not slew-limited: neutral at once.
    """
    wanted = (command.surge, command.sway, command.heave, command.yaw)
    permitted = verdict.state in (State.ACTIVE, State.RAMP_DOWN) and 0.0 < verdict.authority <= 1.0
    if not (permitted and all(map(math.isfinite, wanted))):
        return NEUTRAL
    step = envelope.max_slew_per_s * dt_s
    last = (previous.surge, previous.sway, previous.heave, previous.yaw)
    if not all(map(math.isfinite, last)):
        last = (0.0, 0.0, 0.0, 0.0)
    bounded = (max(-envelope.max_axis, min(envelope.max_axis, verdict.authority * axis)) for axis in wanted)
    return AxisCommand(*(max(p - step, min(p + step, axis)) for p, axis in zip(last, bounded, strict=True)))


def assess(
    state: VehicleState,
    limits: Limits,
    *,
    steering_mode: int,
    parameters: Mapping[str, float],
    holds_position: bool,
    finite: bool,
    late_s: float,
    pilot_deflection: float,
    stop: bool,
    engage: bool,
    clear: bool,
) -> Condition:
    """Return the conditions that hold this tick; what is not known counts against permission."""
    ages = state.ages
    lost = not (ages.link_s <= limits.link_timeout_s and ages.heartbeat_s <= limits.heartbeat_timeout_s)
    failsafe = parameters.get("FS_PILOT_INPUT", 0.0) >= 1.0
    failsafe &= parameters.get("FS_PILOT_TIMEOUT", math.inf) <= limits.max_pilot_timeout_s
    holds = (
        (C.LINK_LOST, lost),
        (C.DEPTH_STALE, not ages.depth_s <= limits.depth_timeout_s),
        (C.ATTITUDE_STALE, not ages.attitude_s <= limits.attitude_timeout_s),
        (C.POSITION_STALE, holds_position and not ages.position_s <= limits.position_timeout_s),
        (C.DISARMED, not state.armed),
        (C.WRONG_MODE, state.mode != steering_mode),
        (C.FAILSAFE_UNSAFE, not failsafe),
        (C.NON_FINITE, not finite),
        (C.TICK_LATE, not late_s <= limits.late_tick_s),
        (C.TILTED, not max(abs(state.roll), abs(state.pitch)) <= math.radians(limits.max_tilt_deg)),
        (C.PILOT_TAKEOVER, not pilot_deflection <= limits.pilot_deflection),
        (C.OPERATOR_STOP, stop),
        (C.ENGAGE_ASKED, engage),
        (C.CLEAR_ASKED, clear),
    )
    return Condition(sum(bit.value for bit, holding in holds if holding))
