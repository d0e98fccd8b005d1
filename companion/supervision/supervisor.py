"""The state machine that decides who may steer: a table of transitions and a table of warnings.

Permission is tested before the law (`StateMachine.step`), and again last, before the bytes (`guard`). The
default is to refuse: only ACTIVE, RAMP_DOWN and the start of HAND_OVER carry authority, and a condition that
TRANSITIONS does not list changes nothing. `conditions.py` tests them; docs/supervisor.md is made from both.

There are three ways of giving up. FAULT stops at once: the state estimate cannot be trusted. RAMP_DOWN: the
estimate is good for another second, but the autopilot has the same sensors and could do no better. HAND_OVER:
Holdfast cannot continue, but the autopilot's depth hold can. Tilt alone does not end control: `control.tilt`
removes the forces that make it worse, heave and levelling stay, and only a lasting tilt causes a HAND_OVER.
"""

from functools import cache
from typing import NamedTuple

from companion.records import Condition, State, Verdict
from companion.telemetry.conditions import SPECS, awaited

C, S = Condition, State

BLIND = C.LINK_LOST | C.DEPTH_STALE | C.ATTITUDE_STALE
SICK = (
    C.EKF_UNHEALTHY
    | C.DEPTH_JUMPED
    | C.DEPTH_OUT_OF_BOUNDS
    | C.INNOVATION_LARGE
    | C.DELAY_TOO_LONG
    | C.TILTED
)
SICK |= C.CLOCK_INCONSISTENT
BLOCKING = BLIND | SICK | C.DISARMED | C.WRONG_MODE | C.FAILSAFE_UNSAFE | C.NON_FINITE | C.TICK_LATE
BLOCKING |= C.THRUSTER_MISSED | C.PREFLIGHT_FAILURE | C.LEAK | C.BATTERY_LOW | C.REBOOTED | C.PILOT_LOST
NOTHING = Condition(0)


class Transition(NamedTuple):
    """In state `at`: go `to` if any bit of `when` is set (or `when` is empty) and no bit of `unless` is."""

    at: State
    when: Condition
    unless: Condition
    to: State
    because: str


T = Transition

# The first row that matches is taken, one row a tick.
TRANSITIONS = (
    T(S.IDLE, C.NON_FINITE, NOTHING, S.FAULT, "a computed value was not finite"),
    T(S.IDLE, NOTHING, BLOCKING, S.READY, "all conditions for engaging are met"),
    T(S.READY, C.NON_FINITE, NOTHING, S.FAULT, "a computed value was not finite"),
    T(S.READY, BLOCKING, NOTHING, S.IDLE, "a condition for engaging is not met"),
    T(S.READY, C.ENGAGE_ASKED, C.PILOT_TAKEOVER | C.OPERATOR_STOP, S.ACTIVE, "engaged"),
    T(S.ACTIVE, C.NON_FINITE, NOTHING, S.FAULT, "a computed value was not finite"),
    T(S.ACTIVE, C.LINK_LOST, NOTHING, S.FAULT, "the vehicle fell silent"),
    T(S.ACTIVE, C.REBOOTED, NOTHING, S.FAULT, "the autopilot rebooted"),
    T(S.ACTIVE, C.DEPTH_STALE, NOTHING, S.FAULT, "no fresh depth"),
    T(S.ACTIVE, C.ATTITUDE_STALE, NOTHING, S.FAULT, "no fresh attitude"),
    T(S.ACTIVE, C.DISARMED, NOTHING, S.IDLE, "the vehicle was disarmed"),
    T(S.ACTIVE, C.FAILSAFE_SURFACES, NOTHING, S.HAND_OVER, "a failsafe of the autopilot surfaces"),
    T(S.ACTIVE, C.WRONG_MODE, NOTHING, S.PILOT, "the flight mode was changed"),
    T(S.ACTIVE, C.PILOT_TAKEOVER, NOTHING, S.PILOT, "the pilot moved the sticks"),
    T(S.ACTIVE, C.FAILSAFE_UNSAFE, NOTHING, S.RAMP_DOWN, "the pilot-input failsafe was switched off"),
    T(S.ACTIVE, C.PREFLIGHT_FAILURE, NOTHING, S.RAMP_DOWN, "a row of the pre-dive list is refused"),
    T(S.ACTIVE, C.EKF_UNHEALTHY, NOTHING, S.RAMP_DOWN, "the EKF is unhealthy"),
    T(S.ACTIVE, C.DEPTH_OUT_OF_BOUNDS, NOTHING, S.RAMP_DOWN, "the depth is out of bounds"),
    T(S.ACTIVE, C.TICK_LATE, NOTHING, S.RAMP_DOWN, "a tick was too late"),
    T(S.ACTIVE, C.LEAK, NOTHING, S.HAND_OVER, "a leak was reported"),
    T(S.ACTIVE, C.AUTOPILOT_FAILSAFE, NOTHING, S.RAMP_DOWN, "a failsafe of the autopilot is active"),
    T(S.ACTIVE, C.PILOT_LOST_SURFACE, NOTHING, S.HAND_OVER, "the ground station fell silent: surfacing"),
    T(S.ACTIVE, C.PILOT_LOST, NOTHING, S.RAMP_DOWN, "the ground station fell silent"),
    T(S.ACTIVE, C.OPERATOR_STOP, NOTHING, S.RAMP_DOWN, "the operator released the vehicle"),
    T(S.ACTIVE, C.DELAY_TOO_LONG, NOTHING, S.HAND_OVER, "the delay is too long for any gains"),
    T(S.ACTIVE, C.CLOCK_INCONSISTENT, NOTHING, S.HAND_OVER, "the autopilot's clocks contradict each other"),
    T(S.ACTIVE, C.INNOVATION_LARGE, NOTHING, S.HAND_OVER, "measurements keep missing the prediction"),
    T(S.ACTIVE, C.THRUSTER_MISSED, NOTHING, S.HAND_OVER, "a motor is dead, and no other can do its work"),
    T(S.ACTIVE, C.TILT_PERSISTS, NOTHING, S.HAND_OVER, "the vehicle stays tilted"),
    T(S.ACTIVE, C.OFF_TRACK, NOTHING, S.HAND_OVER, "the vehicle is off track"),
    T(S.RAMP_DOWN, C.NON_FINITE, NOTHING, S.FAULT, "a computed value was not finite"),
    T(S.RAMP_DOWN, C.LINK_LOST, NOTHING, S.FAULT, "the vehicle fell silent"),
    T(S.RAMP_DOWN, C.REBOOTED, NOTHING, S.FAULT, "the autopilot rebooted"),
    T(S.RAMP_DOWN, C.DEPTH_STALE | C.ATTITUDE_STALE, NOTHING, S.FAULT, "no fresh depth or attitude"),
    T(S.RAMP_DOWN, C.FAILSAFE_SURFACES, NOTHING, S.HAND_OVER, "a failsafe of the autopilot surfaces"),
    T(S.RAMP_DOWN, C.WRONG_MODE, NOTHING, S.PILOT, "the flight mode was changed"),
    T(S.RAMP_DOWN, C.PILOT_TAKEOVER, NOTHING, S.PILOT, "the pilot took over"),
    T(S.RAMP_DOWN, C.DISARMED, NOTHING, S.IDLE, "the vehicle was disarmed"),
    T(S.RAMP_DOWN, C.RAMPED_DOWN, NOTHING, S.IDLE, "ramped down to neutral"),
    T(S.HAND_OVER, C.NON_FINITE, NOTHING, S.FAULT, "a computed value was not finite"),
    T(S.HAND_OVER, C.LINK_LOST, NOTHING, S.FAULT, "the vehicle fell silent"),
    T(S.HAND_OVER, C.REBOOTED, NOTHING, S.FAULT, "the autopilot rebooted"),
    T(S.HAND_OVER, C.FAILSAFE_SURFACES, NOTHING, S.HAND_OVER, "a failsafe of the autopilot surfaces"),
    T(S.HAND_OVER, C.WRONG_MODE, NOTHING, S.PILOT, "the flight mode was changed"),
    T(S.HAND_OVER, C.PILOT_TAKEOVER, NOTHING, S.PILOT, "the pilot took over"),
    T(S.HAND_OVER, C.DISARMED, NOTHING, S.IDLE, "the vehicle was disarmed"),
    T(S.HAND_OVER, C.OPERATOR_STOP, NOTHING, S.PILOT, "the operator released the vehicle"),
    T(S.HAND_OVER, C.HAND_OVER_REFUSED, NOTHING, S.FAULT, "the autopilot did not change the mode"),
    T(S.HAND_OVER, C.HANDED_OVER, NOTHING, S.PILOT, "the autopilot holds depth"),
    T(S.HAND_OVER, C.SURFACED, NOTHING, S.HAND_OVER, "surfaced; the autopilot holds depth"),
    T(S.HAND_OVER, C.HAND_OVER_HELD, NOTHING, S.HAND_OVER, "ALT_HOLD holds the depth until somebody steers"),
    T(S.PILOT, C.NON_FINITE, NOTHING, S.FAULT, "a computed value was not finite"),
    T(S.PILOT, C.ENGAGE_ASKED, C.PILOT_TAKEOVER, S.IDLE, "the operator asks for control again"),
    T(S.FAULT, C.CLEAR_ASKED, C.NON_FINITE, S.IDLE, "the operator cleared the fault"),
)


class Notice(NamedTuple):
    """A condition that is a warning in ACTIVE; with `freeze` it also stops learning."""

    when: Condition
    freeze: bool


NOTICES = (
    Notice(C.POSITION_STALE, freeze=False),
    Notice(C.GROUND_LOST, freeze=False),
    Notice(C.DEPTH_JUMPED, freeze=True),
    Notice(C.CLOCK_JUMPED, freeze=True),
    Notice(C.TILTED, freeze=True),
    Notice(C.SATURATED, freeze=True),
    Notice(C.THRUSTER_DEAD, freeze=False),
    Notice(C.YAW_RESET, freeze=False),
    Notice(C.POSITION_RESET, freeze=False),
    Notice(C.BATTERY_LOW, freeze=False),
    Notice(C.QUEUE_FULL, freeze=False),
    Notice(C.CONFIG_CHANGED, freeze=False),
    Notice(C.PEER_CHANGED, freeze=False),
)
WARNS = NOTHING
FREEZES = NOTHING
for _notice in NOTICES:
    WARNS |= _notice.when
    FREEZES |= _notice.when if _notice.freeze else NOTHING


@cache
def notices(conditions: Condition) -> tuple[Condition, bool]:
    """Return the conditions that only warn, and whether any of them freezes learning."""
    return conditions & WARNS, bool(conditions & FREEZES)


CARRY_AUTHORITY = (S.ACTIVE, S.RAMP_DOWN, S.HAND_OVER)


@cache
def transition(state: State, conditions: Condition) -> Transition | None:
    """Return the first row that matches, or None: nothing changes."""
    for row in TRANSITIONS:
        if row.at is state and (not row.when or row.when & conditions) and not row.unless & conditions:
            return row
    return None


FAULT_CAUSES = NOTHING
for _row in TRANSITIONS:
    FAULT_CAUSES |= _row.when if _row.to is S.FAULT else NOTHING

_BY = "(`holdfast tell`, button or dashboard)"
CLEAR = f"clear the fault {_BY}"

_LETTING_GO = (
    BLOCKING & ~(WARNS | C.DISARMED | C.WRONG_MODE) | C.OFF_TRACK | C.FAILSAFE_SURFACES | C.TILT_PERSISTS
)

_REMEDIES: dict[State, tuple[Condition, str]] = {
    S.IDLE: (BLOCKING, f"engage {_BY}"),
    S.READY: (C.PILOT_TAKEOVER, f"engage {_BY}"),
    S.ACTIVE: (WARNS, "keep watch; a stick, a mode change or disarming gives the pilot control at once"),
    S.RAMP_DOWN: (_LETTING_GO, "wait until the thrust is zero"),
    S.HAND_OVER: (_LETTING_GO, f"wait, take over with a stick, or release {_BY}"),
    S.PILOT: (BLOCKING | C.PILOT_TAKEOVER, f"engage again {_BY}"),
    S.FAULT: (FAULT_CAUSES, CLEAR),
}
"""For each state: the conditions whose remedies count, and what to do if none of them holds."""


@cache
def first_remedy(conditions: Condition) -> str:
    """Return the remedy of the first cause among the conditions; empty where none has one."""
    return next((SPECS[one].remedy for one in conditions if SPECS[one].remedy), "")


@cache
def remedy(state: State, conditions: Condition) -> str:
    """Return the operator's next step; log, `watch`, `tell` and dashboard all show this one.

    If several conditions hold, the first cause counts; LINK_LOST is first. A latched fault has to be
    cleared after its cause has gone, whatever else is missing.
    """
    matters, otherwise = _REMEDIES[state]
    held = conditions & (matters | C.LINK_LOST)
    todo = first_remedy(held)
    if state is S.FAULT and todo:
        return f"{todo}; then {CLEAR}"
    return todo or otherwise


class StateMachine:
    """The state, its reason and its authority; with `ramp_up_s` 0 the authority is 1 at once."""

    def __init__(self, ramp_down_s: float, ramp_up_s: float = 0.0) -> None:
        self.ramp_down_s = ramp_down_s
        self.ramp_up_s = ramp_up_s
        self._verdict = Verdict(State.IDLE, NOTHING, 0.0, "just started")

    def ramped_down(self, dt_s: float) -> bool:
        """Tell whether the authority has reached 0, `dt_s` after the last step."""
        return self._verdict.state is State.RAMP_DOWN and self._fallen(dt_s) == 0.0

    def _fallen(self, dt_s: float) -> float:
        return max(0.0, self._verdict.authority - dt_s / self.ramp_down_s)

    def step(self, conditions: Condition, dt_s: float, preflight_failure: str = "") -> Verdict:
        """Take one tick's conditions and give the verdict; `preflight_failure` is its text.

        Authority rises to 1 over `ramp_up_s` in ACTIVE, falls to 0 over `ramp_down_s` in RAMP_DOWN and
        HAND_OVER, and is 0 everywhere else.
        """
        before = self._verdict
        authority = self._fallen(dt_s)
        row = transition(before.state, conditions)
        state, reason = (row.to, row.because) if row else (before.state, before.reason)
        if state is State.ACTIVE:
            authority = min(1.0, before.authority + dt_s / self.ramp_up_s) if self.ramp_up_s > 0.0 else 1.0
        elif state not in CARRY_AUTHORITY or conditions & C.FAILSAFE_SURFACES:
            authority = 0.0
        if state is before.state is State.IDLE and (missing := conditions & BLOCKING):
            reason = f"waiting for: {awaited(missing, preflight_failure)}"
        elif row and row.when is Condition.PREFLIGHT_FAILURE:
            reason = f"{row.because} ({preflight_failure})"
        warnings, freeze = notices(conditions)
        self._verdict = Verdict(
            state, conditions, authority, reason, warnings, freeze, remedy(state, conditions)
        )
        return self._verdict
