"""The autopilot's clock, seen from ours: bounded by every message that has a stamp.

Nothing arrives before it was sent. So each answer to TIMESYNC, and each stamped message, bounds the offset:

    stamp − arrival ≤ offset ≤ answer's stamp − when we asked          offset = autopilot's clock − ours

The offset is the middle of the narrowest bounds of the last 30 s, and never below the lower one: no telemetry
delay is negative. Bounds that exclude each other come from a clock that was set again, or from two clocks.
"""

import math
from collections import deque
from typing import NamedTuple

ANSWERS = 120
"""Kept, 30 s of them."""

CLOCK_JUMP_S = 0.05
"""Bounds that exclude each other by more than this contradict each other: drift and rounding make less."""

MAX_ROUND_TRIP_S = 1.0
"""An answer that took longer says nothing of the clock."""

ANSWERED_S = 5.0
"""A stamp may be compared with the clock for this time after an answer; later the clocks have drifted."""

SETTLED_S = 1.0
"""After this time without a contradiction the clock is believed again."""

QUESTIONS_S = 1.0
"""The quickest TIMESYNC question of this time tells how long a message travels to the autopilot now."""


class OffsetBounds(NamedTuple):
    """Between what the offset lies, seconds."""

    lower_s: float = -math.inf
    upper_s: float = math.inf

    def admits(self, other: "OffsetBounds") -> bool:
        """Tell whether one clock can have made both."""
        least_s = max(self.lower_s, other.lower_s)
        return least_s <= min(self.upper_s, other.upper_s) + CLOCK_JUMP_S


class AutopilotClock:
    """Knows `offset_s`, the autopilot's clock minus ours; NaN before any message had a stamp."""

    def __init__(self, telemetry_s: float) -> None:
        """Take the telemetry delay that is believed until the first answer to TIMESYNC."""
        self._telemetry_s = telemetry_s
        self._answers: deque[OffsetBounds] = deque(maxlen=ANSWERS)
        self._bounds = OffsetBounds()
        self.offset_s = math.nan
        self._stamped_s = -math.inf
        """The lower bound from messages since the newest answer."""
        self._odd: OffsetBounds | None = None
        """The newest answer, if it contradicted those before."""
        self._former = (OffsetBounds(math.inf, -math.inf), 0.0)
        """The clock before it was set again, and how long it had been in doubt."""
        self._doubted_s = (math.inf, -math.inf)
        """Since when contradictions have come, and when the newest came."""
        self._answered_s = -math.inf
        self._taken_s: deque[float] = deque(maxlen=ANSWERS)
        """When the questions were asked that were answered."""
        self._questions: deque[tuple[float, float]] = deque()
        """When the newest answers arrived, and the upper bounds that they gave."""

    def answered(self, sent_s: float, arrived_s: float, boot_s: float) -> bool:
        """Take one TIMESYNC answer: sent and arrived on our clock, `boot_s` on the autopilot's in between.

        Return whether it is believed. One that contradicts the clock is not; a second one in a row that
        agrees with the first sets the clock again. A second answer to one question can only contradict.
        """
        if not 0.0 <= arrived_s - sent_s <= MAX_ROUND_TRIP_S:
            return False
        answer = OffsetBounds(boot_s - arrived_s, boot_s - sent_s)
        agrees = self._bounds.admits(answer)
        if agrees and sent_s in self._taken_s:
            return False
        self._taken_s.append(sent_s)
        odd, self._odd = self._odd, None
        if not agrees:
            former, doubted_s = self._former
            self._contradicted(arrived_s, arrived_s - (doubted_s if former.admits(answer) else 0.0))
            if odd is None or not odd.admits(answer):
                self._odd = answer
                return False
            self._former = (self._bounds, self.doubt_s(arrived_s))
            self._doubted_s = (math.inf, -math.inf)
            self._answers.clear()
            self._answers.append(odd)
            self._questions.clear()
            self._stamped_s = -math.inf
        self._answers.append(OffsetBounds(max(answer.lower_s, self._stamped_s), answer.upper_s))
        self._answered_s, self._stamped_s = arrived_s, -math.inf
        lower, upper = zip(*self._answers, strict=True)
        self._bound(max(lower), min(upper))
        self._questions.append((arrived_s, answer.upper_s))
        return True

    def stamped(self, arrived_s: float, boot_s: float) -> float | None:
        """Take one stamped message's arrival; return how late it was, None where that is not known.

        One that contradicts the clock as it is known tells nothing.
        """
        bound_s, (lower_s, upper_s) = boot_s - arrived_s, self._bounds
        if not bound_s <= upper_s + CLOCK_JUMP_S and arrived_s - self._answered_s <= ANSWERED_S:
            self._contradicted(arrived_s, arrived_s)
            return None
        self._stamped_s = max(self._stamped_s, bound_s)
        if bound_s > lower_s:
            self._bound(bound_s, upper_s)
        return self.offset_s - bound_s if self._answers else None

    def local(self, boot_s: float) -> float:
        """Return when, on our clock, the autopilot's clock read `boot_s`."""
        return boot_s - self.offset_s

    def question_s(self, now_s: float) -> float | None:
        """Return how long the quickest TIMESYNC question of late travelled; None where none was answered."""
        while self._questions and now_s - self._questions[0][0] > QUESTIONS_S:
            self._questions.popleft()
        if not self._questions:
            return None
        return max(min(upper_s for _, upper_s in self._questions) - self.offset_s, 0.0)

    def doubt_s(self, now_s: float) -> float:
        """Return how long stamps and answers have kept contradicting each other; zero where they do not.

        A clock that was set again is not in doubt, unless the former one goes on: then there are two.
        """
        first_s, newest_s = self._doubted_s
        return max(now_s - first_s, math.ulp(0.0)) if now_s - newest_s <= SETTLED_S else 0.0

    def _bound(self, lower_s: float, upper_s: float) -> None:
        self._bounds = OffsetBounds(lower_s, upper_s)
        if self._answers:
            self.offset_s = max(lower_s, 0.5 * (lower_s + upper_s))
        else:
            self.offset_s = lower_s + self._telemetry_s

    def _contradicted(self, now_s: float, since_s: float) -> None:
        first_s, newest_s = self._doubted_s
        lasts = now_s - newest_s <= SETTLED_S
        self._doubted_s = (min(first_s, since_s) if lasts else since_s, now_s)
