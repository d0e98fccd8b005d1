"""The request to engage, from commands and the pilot's buttons, and how long it is valid."""

import math
from collections.abc import Sequence

from companion.records import ENGAGE_S, Condition, Request, State, Verdict
from companion.supervision.supervisor import BLOCKING, FAULT_CAUSES

BLOCKING_ARMED = BLOCKING & ~Condition.DISARMED
"""What forbids engaging an armed vehicle."""


class Engagement:
    """Whether engaging is requested; a request by button is dropped after ENGAGE_S if not permitted."""

    def __init__(self, *, arm: bool) -> None:
        self._arm = arm
        self._until_s = math.inf
        self.asked = False

    def with_buttons(
        self, requests: Sequence[Request], verdict: Verdict, now_s: float, *, engage: bool, release: bool
    ) -> list[Request]:
        """Return `requests` with those of the pilot's buttons.

        The engage button clears a fault first, but not while its cause holds.
        """
        if Request.ENGAGE in requests:
            self._until_s = math.inf
        if release:
            return [*requests, Request.STOP]
        faulty = verdict.state is State.FAULT
        if not engage or (faulty and verdict.conditions & FAULT_CAUSES):
            return [*requests]
        self._until_s = now_s + ENGAGE_S
        return [*requests, *([Request.CLEAR_FAULT] if faulty else []), Request.ENGAGE]

    def step(self, requests: Sequence[Request], now_s: float) -> None:
        """Take this tick's requests."""
        if Request.ENGAGE in requests:
            self.asked = True
        if Request.STOP in requests or now_s > self._until_s:
            self.asked = False

    def update(self, before: Verdict, verdict: Verdict) -> None:
        """Drop the request after a fault, or when ACTIVE was left."""
        left = before.state is State.ACTIVE and verdict.state is not State.ACTIVE
        if verdict.state is State.FAULT or left:
            self.asked = False

    def asks_arming(self, verdict: Verdict) -> bool:
        """Tell whether to request arming: when only arming is missing for engaging."""
        return self._arm and self.asked and not verdict.conditions & BLOCKING_ARMED
