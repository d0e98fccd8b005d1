"""How late the loop is: measured, because 50 ms of unknown delay each way is a full-power limit cycle.

    telemetry delay = arrival − autopilot's stamp + offset     offset = autopilot clock − ours, from TIMESYNC
    command delay   = lag at which the motors best repeat what we sent (SERVO_OUTPUT_RAW's echo);
                      before there was an echo, the configured one and TIMESYNC's way to the autopilot

Nothing arrives before it was sent. So each answer to TIMESYNC, and each stamped message, bounds the offset:

    stamp − arrival ≤ offset ≤ answer's stamp − when we asked

The offset is the middle of the narrowest bounds of the last 30 s, and never below the lower one: no telemetry
delay is negative. An error in the offset moves delay from one to the other; their sum, which is what
destabilises, stays right. Bounds that exclude each other come from a clock that was set anew, or from two.

A command that repeats itself fits its echo at several lags: then nothing is learnt. And a command takes as
long as TIMESYNC's question took, plus what the autopilot needs to act: at most COMMAND_SPREAD_S.
"""

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from companion.records import Array, Delays

SYNCS = 120
"""Answers kept, 30 s of them."""

CLOCK_JUMP_S = 0.05
"""Bounds that exclude each other by more than this contradict each other: drift and rounding make less."""

MAX_ROUND_TRIP_S = 1.0
"""An answer that took longer says nothing of the clock."""

ANSWERED_S = 5.0
"""So long after the last answer its clock may be held against a stamp; later the clocks have drifted."""

SETTLED_S = 1.0
"""So long after the last contradiction the clock is believed again."""

TELEMETRY_MEMORY_S = 1.0
MAX_DELAY_S = 1.0
ECHO_MEMORY_S = 4.0
ECHO_EVIDENCE_S = 1.5
"""How long commands must have varied before an echo is believed."""

ECHO_SLEW = 0.05
"""Seconds of delay a second: the law's horizon moves, it does not jump."""

STALL_S = 0.5
"""A longer gap in what is measured counts as this long."""

ECHO_LAGS_S = np.arange(-0.03, 0.405, 0.005)
ECHO_CONTRAST = 0.5
"""The best lag counts as found when it explains the echo this much better than the average lag does."""

ECHO_PLATEAU = 0.05
"""Commands are steps of a tick's length, so neighbouring lags can fit alike: the middle of those within this
share of the best is taken."""

QUESTIONS_S = 1.0
"""The quickest TIMESYNC question of this time tells how long commands travel now."""

COMMAND_SPREAD_S = 0.05
"""The firmware's input loop of 20 ms (ArduSub facts), and 30 ms for what a router and a tick may add."""

ECHO_EXCITATION = 0.01
"""Commands that varied less than this (axis units, RMS) tell nothing about lag."""


class Bounds(NamedTuple):
    """Between what the offset lies, seconds."""

    lower_s: float = -math.inf
    upper_s: float = math.inf

    def admits(self, other: "Bounds") -> bool:
        """Tell whether one clock can have made both."""
        least_s = max(self.lower_s, other.lower_s)
        return least_s <= min(self.upper_s, other.upper_s) + CLOCK_JUMP_S


class DelayMeter:
    """Measures both delays from events' times; starts from the configured values."""

    def __init__(self, telemetry_s: float, command_s: float) -> None:
        self._start = Delays(telemetry_s, command_s, telemetry_known=False, command_known=False)
        self._answers: deque[Bounds] = deque(maxlen=SYNCS)
        self._bounds = Bounds()
        self._stamped_s = -math.inf
        """The lower bound from messages since the newest answer."""
        self._odd: Bounds | None = None
        """The newest answer, if it contradicted those before."""
        self._former = (Bounds(math.inf, -math.inf), 0.0)
        """The clock before it was set anew, and how long it had been in doubt."""
        self._doubted_s = (math.inf, -math.inf)
        """Since when contradictions have come, and when the newest came."""
        self._answered_s = -math.inf
        self._questions: deque[tuple[float, float]] = deque()
        """When the newest answers arrived, and the upper bounds that they gave."""
        self._telemetry_s = telemetry_s
        self._telemetry_t_s: float | None = None
        self._echo = np.zeros(len(ECHO_LAGS_S))
        self._last_echo: tuple[float, Array] | None = None
        self._echo_t_s = -np.inf
        self._echo_seen_s = 0.0
        self._echo_found = False
        self._command_s = command_s
        self._moved_s = -math.inf

    def timesync(self, sent_s: float, arrived_s: float, boot_s: float) -> None:
        """Take one TIMESYNC answer: sent and arrived on our clock, `boot_s` on the autopilot's in between.

        One that contradicts the clock as it is known is not believed. A second one that agrees with it, with
        none in between that does not, sets the clock anew.
        """
        if not 0.0 <= arrived_s - sent_s <= MAX_ROUND_TRIP_S:
            return
        answer = Bounds(boot_s - arrived_s, boot_s - sent_s)
        odd, self._odd = self._odd, None
        agrees = self._bounds.admits(answer)
        if not agrees:
            former, doubted_s = self._former
            self._contradicted(arrived_s, arrived_s - (doubted_s if former.admits(answer) else 0.0))
            if odd is None or not odd.admits(answer):
                self._odd = answer
                return
            self._former = (self._bounds, self.doubt_s(arrived_s))
            self._doubted_s = (math.inf, -math.inf)
            self._answers.clear()
            self._answers.append(odd)
            self._stamped_s = -math.inf
        self._answers.append(Bounds(max(answer.lower_s, self._stamped_s), answer.upper_s))
        self._answered_s, self._stamped_s = arrived_s, -math.inf
        lower, upper = zip(*self._answers, strict=True)
        self._bounds = Bounds(max(lower), min(upper))
        if not agrees:
            self._questions.clear()
        self._questions.append((arrived_s, answer.upper_s))
        if self._echo_found:
            self._approach(self._command_s, arrived_s)
        else:
            self._command_s = self._start.command_s + self._command_bounds(arrived_s)[0]

    def stamped(self, arrived_s: float, boot_s: float) -> None:
        """Take one stamped message's arrival; one that contradicts the clock as it is known tells nothing."""
        bound_s, known = boot_s - arrived_s, self._bounds
        agrees = bound_s <= known.upper_s + CLOCK_JUMP_S
        if not agrees and arrived_s - self._answered_s <= ANSWERED_S:
            self._contradicted(arrived_s, arrived_s)
            return
        self._stamped_s = max(self._stamped_s, bound_s)
        self._bounds = Bounds(max(known.lower_s, bound_s), known.upper_s)
        if not self._answers:
            return
        late_s = min(self.offset_s - bound_s, MAX_DELAY_S)
        if self._telemetry_t_s is None:
            self._telemetry_s = late_s
        else:
            passed = max(arrived_s - self._telemetry_t_s, 0.0)
            self._telemetry_s += (late_s - self._telemetry_s) * passed / (passed + TELEMETRY_MEMORY_S)
        self._telemetry_t_s = arrived_s

    def echo(self, boot_s: float, axes: Array, sent_t_s: Array, sent_axes: Array) -> None:
        """Compare what the motors did at `boot_s` with what was sent: times ascending, axes (n, 4)."""
        last, self._last_echo = self._last_echo, (boot_s, axes)
        if last is None:
            return
        boot_s, axes = last  # by now all that was sent around then is known
        at_s = self.local(boot_s)
        when_s = at_s - ECHO_LAGS_S
        if not len(sent_t_s) or not sent_t_s[0] <= when_s[-1] or when_s[0] > sent_t_s[-1]:
            return
        sent = sent_axes[np.searchsorted(sent_t_s, when_s, side="right") - 1]
        if sent.std(0).max() < ECHO_EXCITATION:
            return
        ours = sent.any(0)  # an axis that we never move is somebody else's: in STABILIZE the firmware's yaw
        miss = ((sent - axes)[:, ours] ** 2).sum(1)
        passed = min(max(at_s - self._echo_t_s, 0.0), ECHO_MEMORY_S)
        self._echo += (miss / miss.mean() - self._echo) * passed / (passed + ECHO_MEMORY_S)
        self._echo_t_s = at_s
        self._echo_seen_s += min(passed, STALL_S)
        least, mean = self._echo.min(), self._echo.mean()
        alike = np.flatnonzero(self._echo < ECHO_CONTRAST * mean)
        unique = len(alike) > 0 and alike[-1] - alike[0] + 1 == len(alike)
        if self._echo_seen_s >= ECHO_EVIDENCE_S and unique:
            self._echo_found = True
            fits = self._echo <= least + ECHO_PLATEAU * (mean - least)
            self._approach(float(ECHO_LAGS_S[fits].mean()), at_s)

    def _command_bounds(self, now_s: float) -> tuple[float, float]:
        """Return the shortest and the longest command delay that TIMESYNC allows now."""
        while self._questions and now_s - self._questions[0][0] > QUESTIONS_S:
            self._questions.popleft()
        if not self._questions:
            return -math.inf, math.inf
        least_s = max(min(upper_s for _, upper_s in self._questions) - self.offset_s, 0.0)
        return least_s, least_s + COMMAND_SPREAD_S

    def _approach(self, found_s: float, now_s: float) -> None:
        """Move the command delay towards what was found, within what TIMESYNC allows."""
        least_s, most_s = self._command_bounds(now_s)
        slew_s = ECHO_SLEW * min(max(now_s - self._moved_s, 0.0), STALL_S)
        self._moved_s = max(now_s, self._moved_s)
        change_s = min(max(found_s, least_s), most_s) - self._command_s
        self._command_s += min(max(change_s, -slew_s), slew_s)

    def _contradicted(self, now_s: float, since_s: float) -> None:
        first_s, newest_s = self._doubted_s
        lasts = now_s - newest_s <= SETTLED_S
        self._doubted_s = (min(first_s, since_s) if lasts else since_s, now_s)

    def doubt_s(self, now_s: float) -> float:
        """Return how long stamps and answers have kept contradicting each other; zero where they do not.

        A clock that was set anew is not in doubt, unless the former one goes on: then there are two.
        """
        first_s, newest_s = self._doubted_s
        return max(now_s - first_s, math.ulp(0.0)) if now_s - newest_s <= SETTLED_S else 0.0

    def local(self, boot_s: float) -> float:
        """Return when, on our clock, the autopilot's clock read `boot_s`."""
        return boot_s - self.offset_s

    @property
    def offset_s(self) -> float:
        """Autopilot clock minus ours; before the first TIMESYNC from the quickest message so far, or NaN."""
        lower_s, upper_s = self._bounds
        if self._answers:
            return max(lower_s, 0.5 * (lower_s + upper_s))
        return lower_s + self._start.telemetry_s if lower_s > -math.inf else math.nan

    @property
    def delays(self) -> Delays:
        """What is known of the delays now."""
        return Delays(
            telemetry_s=self._telemetry_s,
            command_s=self._command_s,
            telemetry_known=self._telemetry_t_s is not None,
            command_known=self._echo_found,
        )
