"""The state machine that decides who may steer, by the tables of `rules.py`.

Permission is tested before the law (`StateMachine.step`), and again last, before the bytes (`guard`). The
default is to refuse: only ACTIVE, RAMP_DOWN and the start of HAND_OVER carry authority, and a condition that
TRANSITIONS does not list changes nothing. docs/supervisor.md is made from the tables.

There are three ways of giving up. FAULT stops at once: the state estimate cannot be trusted, or the thrust
turned the vehicle over. RAMP_DOWN: the estimate is good for another second, but the autopilot has the same
sensors and could do no better. HAND_OVER: Holdfast cannot continue, but the autopilot's depth hold can.
"""

from functools import cache

from companion.records import Condition, State, Verdict
from companion.supervision.rules import BLOCKING, FREEZES, NOTHING, TRANSITIONS, WARNS, Transition
from companion.telemetry.glossary import NO_DETAILS, STATES, UNSAID, Details, awaited, detailed

C, S = Condition, State

CARRY_AUTHORITY = (S.ACTIVE, S.RAMP_DOWN, S.HAND_OVER)
LATCHED = (S.FAULT, S.PILOT)
"""States that outlast their cause."""
FREE = (S.IDLE, S.READY)
RESUME_S = 0.3
"""Time from zero to full authority after a short interruption."""
JUST_STARTED = Verdict(S.IDLE, NOTHING, 0.0, "just started")


@cache
def transition(state: State, conditions: Condition) -> Transition | None:
    """Return the first row that matches, or None: nothing changes."""
    for row in TRANSITIONS:
        if row.at is state and (not row.when or row.when & conditions) and not row.unless & conditions:
            return row
    return None


@cache
def notices(conditions: Condition) -> tuple[Condition, bool]:
    """Return the conditions that only warn, and whether any of them freezes learning."""
    return conditions & WARNS, bool(conditions & FREEZES)


def _causes(*ends: State) -> Condition:
    """Return the conditions that lead to one of these states."""
    return Condition(sum({bit for row in TRANSITIONS if row.to in ends for bit in row.when}))


FAULT_CAUSES = _causes(S.FAULT)
_RELEASING = _causes(S.FAULT, S.RAMP_DOWN, S.HAND_OVER)

_MATTERS: dict[State, Condition] = {
    S.IDLE: BLOCKING,
    S.READY: C.PILOT_TAKEOVER | C.LINK_LOST,
    S.ACTIVE: WARNS | C.LINK_LOST,
    S.RAMP_DOWN: _RELEASING,
    S.HAND_OVER: _RELEASING,
    S.PILOT: BLOCKING | C.PILOT_TAKEOVER,
    S.FAULT: FAULT_CAUSES,
}
"""For each state: the conditions whose remedies count."""


def first_remedy(conditions: Condition, details: Details = NO_DETAILS) -> str:
    """Return the remedy of the first cause among the conditions; empty where none has one."""
    remedies = (details.get(condition, ("", ""))[1] or condition.remedy for condition in conditions)
    return next(filter(None, remedies), "")


def remedy(state: State, conditions: Condition, details: Details = NO_DETAILS) -> str:
    """Return the operator's next step; log, `watch`, `tell` and dashboard all show this one.

    If several conditions hold, the first cause counts; LINK_LOST is first. A latched fault has to be
    cleared after its cause has gone, whatever else is missing.
    """
    otherwise = STATES[state].remedy
    todo = first_remedy(conditions & _MATTERS[state], details) if conditions else ""
    if state is S.FAULT and todo:
        return f"{todo}; then {otherwise}"
    return todo or otherwise


class StateMachine:
    """The state, its reason and its authority; with `ramp_up_s` 0 the authority is 1 at once."""

    def __init__(self, ramp_down_s: float, ramp_up_s: float = 0.0) -> None:
        self.ramp_down_s = ramp_down_s
        self.ramp_up_s = ramp_up_s
        self._verdict = JUST_STARTED
        self._risen, self._resumed = 0.0, 1.0
        """The authority of the time since engaging, and that of the time since the last interruption."""
        self._reason, self._cause = self._verdict.reason, NOTHING
        """Why the last transition came, and its condition."""
        self._ended = self._remedy = ""
        """Why control ended, until it begins again; what there is to do, for what was judged last."""
        self._judged: tuple[State, Condition, Details] | None = None

    def ramped_down(self, dt_s: float) -> bool:
        """Tell whether the authority has reached 0, `dt_s` after the last step."""
        return self._verdict.state is State.RAMP_DOWN and self._fallen(dt_s) == 0.0

    def _fallen(self, dt_s: float) -> float:
        return max(0.0, self._verdict.authority - dt_s / self.ramp_down_s)

    def _rise(self, dt_s: float) -> float:
        """Return the authority of a tick in ACTIVE that is not interrupted."""
        risen = self._risen if self._verdict.state is State.ACTIVE else 0.0
        self._risen = min(1.0, risen + dt_s / self.ramp_up_s) if self.ramp_up_s > 0.0 else 1.0
        self._resumed = min(1.0, self._resumed + dt_s / RESUME_S)
        return min(self._risen, self._resumed)

    def step(self, conditions: Condition, dt_s: float, details: Details = NO_DETAILS) -> Verdict:
        """Take one tick's conditions and give the verdict.

        Authority rises to 1 over `ramp_up_s` in ACTIVE, and over RESUME_S after an interruption. It falls to
        0 over `ramp_down_s` in RAMP_DOWN and HAND_OVER, and is 0 everywhere else, while INTERRUPTED, and
        outside ACTIVE where a failsafe surfaces.
        """
        previous = self._verdict
        authority = self._fallen(dt_s)
        row = transition(previous.state, conditions)
        state, reason = (row.to, row.because) if row else (previous.state, self._reason)
        if state is State.ACTIVE:
            authority = self._rise(dt_s)
        elif state not in CARRY_AUTHORITY or conditions & C.FAILSAFE_SURFACES:
            authority = 0.0
        if C.INTERRUPTED in conditions:
            authority = self._resumed = 0.0
        if row:
            self._cause = row.when if len(row.when) == 1 and not row.when & UNSAID else NOTHING
            self._reason = reason = detailed(self._cause, reason, details)
        elif state in LATCHED and self._cause and not self._cause & conditions:
            reason = f"was: {reason}; now {self._cause.ended}"
        elif state is State.IDLE and (missing := conditions & BLOCKING):
            missing = missing & C.LINK_LOST or missing  # without it all others are unknown
            reason = f"waiting for: {awaited(missing, details)}"
        if state is State.ACTIVE:
            self._ended = ""
        elif row and (previous.state is State.ACTIVE or state is State.FAULT):
            self._ended = f"; control ended: {reason}"
        elif state in FREE:
            reason += self._ended
        warnings, freeze = notices(conditions)
        judged = state, conditions, details
        if judged != self._judged:
            self._judged, self._remedy = judged, remedy(*judged)
        self._verdict = Verdict(state, conditions, authority, reason, warnings, freeze, self._remedy)
        return self._verdict
