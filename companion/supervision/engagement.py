"""The request to engage: whether it is refused, confirmed by the autopilot's failsafe, and still valid."""

import math
from collections.abc import Mapping, Sequence

from companion.records import ENGAGE_S, Condition, Event, Parameter, Request, State, Verdict
from companion.supervision.rules import BLOCKING
from companion.supervision.supervisor import FAULT_CAUSES, JUST_STARTED, first_remedy
from companion.telemetry.glossary import ENGAGE, NO_DETAILS, Details, advised, text
from companion.telemetry.modes import Mode

C = Condition

BLOCKING_ARMED = BLOCKING & ~C.DISARMED
"""What forbids engaging an armed vehicle."""
CONFIRMS = frozenset({"FS_PILOT_INPUT", "FS_PILOT_TIMEOUT"})
"""Read again on a request to engage: the notice of a change may be lost."""


class Engagement:
    """Whether engaging is requested; a request by button is dropped after ENGAGE_S if nothing came of it."""

    def __init__(self, *, arm: bool) -> None:
        self._arm = arm
        self._verdict, self._mode, self._details = JUST_STARTED, -1, NO_DETAILS
        """The last tick's."""
        self._wanted = False
        self._until_s = math.inf
        self.unconfirmed = frozenset[str]()
        """The parameters that have to be read before the request takes effect."""

    @property
    def asked(self) -> bool:
        """Whether engaging is requested, and the pilot-input failsafe is confirmed since."""
        return self._wanted and not self.unconfirmed

    @property
    def details(self) -> Details:
        """The remedy for a disarmed vehicle, beyond arming it."""
        todo = "wait: Holdfast arms it" if self._wanted else f"{ENGAGE}: that arms it too"
        return {C.DISARMED: ("", todo)} if self._arm else NO_DETAILS

    def refusal(self, request: Request, judged: Verdict | None = None) -> str:
        """Return why a request is refused now, or by another verdict, and what to do; empty if accepted.

        ENGAGE is accepted where nothing is missing but what follows from it: the flight mode, and arming
        where that is permitted. CLEAR_FAULT also makes a motor trusted again that was found dead or reversed.
        """
        verdict, details = judged or self._verdict, self._details
        state, held = verdict.state, verdict.conditions
        motor = held & (C.THRUSTER_DEAD | C.THRUSTER_MISSED | C.THRUSTER_REVERSED)
        if request is Request.CLEAR_FAULT and state is not State.FAULT and not motor:
            return f"no fault is latched; the state is {state}"
        if request is Request.CLEAR_FAULT:
            held &= C.NON_FINITE
        elif request is not Request.ENGAGE or state is State.ACTIVE:
            return ""
        elif state is State.FAULT:
            return advised(f"a fault is latched: {verdict.reason}", verdict.remedy)
        elif state is State.HAND_OVER:
            todo = first_remedy(held & BLOCKING) or "wait, or take over with a stick"
            return advised(
                f"the vehicle is being handed over to the autopilot: {verdict.reason}",
                f"{todo}; then release, and engage within 3 s: unsteered for longer, the autopilot disarms",
            )
        else:
            held &= (BLOCKING_ARMED if self._arm else BLOCKING) & ~C.WRONG_MODE | C.PILOT_TAKEOVER
            if self._mode == Mode.SURFACE:
                return advised("the vehicle surfaces", "choose another flight mode")
        return advised(text(held, details), first_remedy(held, details)) if held else ""

    def accepted(self, requests: Sequence[Request]) -> list[Request]:
        """Return the requests that are not refused; in IDLE an ENGAGE waits, as that of the start does."""
        kept: list[Request] = []
        for request in requests:
            waits = self._verdict.state is State.IDLE or Request.CLEAR_FAULT in kept
            if (request is Request.ENGAGE and waits) or not self.refusal(request):
                kept.append(request)
        return kept

    def with_buttons(
        self, requests: Sequence[Request], now_s: float, *, engage: bool, release: bool
    ) -> tuple[list[Request], str]:
        """Return `requests` and what the pilot's buttons ask for, and why the engage button is refused.

        The engage button also clears a fault whose cause has gone.
        """
        verdict = self._verdict
        if release:
            return [*requests, Request.STOP], ""
        if not engage:
            return [*requests], ""
        clears = verdict.state is State.FAULT and not verdict.conditions & FAULT_CAUSES
        judged = Verdict(State.IDLE, verdict.conditions, 0.0, "") if clears else verdict
        if refused := self.refusal(Request.ENGAGE, judged):
            return [*requests], refused
        self._until_s = now_s + ENGAGE_S
        return [*requests, *([Request.CLEAR_FAULT] if clears else []), Request.ENGAGE], ""

    def step(
        self,
        requests: Sequence[Request],
        events: Sequence[Event],
        parameters: Mapping[str, float],
        now_s: float,
    ) -> None:
        """Take this tick's requests, none of them refused, and what the autopilot reported."""
        self.unconfirmed -= {event.name for event in events if isinstance(event, Parameter)}
        if Request.ENGAGE in requests and not self._wanted:
            self._wanted, self.unconfirmed = True, CONFIRMS & parameters.keys()
        if Request.STOP in requests or Request.WITHDRAW in requests or now_s > self._until_s:
            self.forget()

    def forget(self) -> None:
        """Drop the request."""
        self._wanted, self.unconfirmed, self._until_s = False, frozenset(), math.inf

    def update(self, verdict: Verdict, mode: int, details: Details) -> None:
        """Take this tick's verdict; drop the request after a fault, or when ACTIVE ends."""
        ended = self._verdict.state is State.ACTIVE and verdict.state is not State.ACTIVE
        self._verdict, self._mode, self._details = verdict, mode, details
        if verdict.state is State.FAULT or ended:
            self.forget()

    @property
    def asks_arming(self) -> bool:
        """Whether to request arming: when only arming is missing for engaging."""
        return self._arm and self.asked and not self._verdict.conditions & BLOCKING_ARMED
