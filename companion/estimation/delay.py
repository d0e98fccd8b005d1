"""How late the loop is: measured, because 50 ms of unknown delay each way is a full-power limit cycle.

    telemetry delay = arrival − autopilot's stamp + offset     offset = autopilot's clock − ours (clock.py)
    command delay   = lag at which SERVO_OUTPUT_RAW best repeats what we sent;
                      before there was an echo, the configured one and TIMESYNC's way to the autopilot
    misfit(lag)     = mean over ECHO_MEMORY_S of  Σ (sent(t − lag) − echo(t))² / its mean over all lags

An error in the offset moves delay from one to the other; their sum, which is what destabilises, stays right.
A command takes as long as TIMESYNC's question took, plus at most COMMAND_SPREAD_S. One that repeats itself
fits its echo at several lags: then nothing is learnt.
"""

import math
from bisect import bisect_right
from collections.abc import Sequence
from itertools import chain, repeat
from operator import mul, sub

from companion.core.bounds import clamped, limited
from companion.estimation.clock import MAX_ROUND_TRIP_S, AutopilotClock
from companion.records import ZERO, Delays, Vector, vector

TELEMETRY_MEMORY_S = 1.0
"""Chosen: a mean over 50 stamps at 50 Hz."""

PAUSE_S = 0.1
"""The first sample after a longer pause was late with it: it counts for this time, not for the pause."""

COMMANDS = 128
"""Number of the last commands that are compared with the motors: 2.5 s at 50 Hz."""

SLEW = 0.05
"""Seconds of command delay a second: the law's horizon moves, it does not jump."""

COMMAND_SPREAD_S = 0.05
"""The 20 ms of the firmware's input loop (docs/ardusub.md, "RC_CHANNELS_OVERRIDE"), and 30 ms for what a
router and a tick may add."""

ECHO_MEMORY_S = 4.0
"""Chosen: a mean over 48 echoes, which come at 12 Hz (decision 4)."""

EVIDENCE_S = 1.5
"""An echo is believed after commands have varied for this time."""

STALL_S = 0.5
"""A longer gap between echoes counts as this long."""

STEP_S = 0.005
LAGS_S = tuple(STEP_S * k for k in range(-6, 82))
"""-0.03 to 0.405 s: below zero for the error of the clock."""

CONTRAST = 0.5
"""The best lag counts as found when it explains the echo this much better than the average lag does, and than
that the echo keeps its mean: one that does not move, or of other motors, is none."""

PLATEAU = 0.05
"""Commands are steps of a tick's length, so neighbouring lags can fit equally well: the middle of those
within this share of the best is taken."""

EXCITATION = 0.01
"""Commands that varied less than this (axis units, RMS) tell nothing about lag."""


class DelayMeter:
    """Measures both delays from events' times; starts from the configured values."""

    def __init__(self, telemetry_s: float, command_s: float) -> None:
        self.clock = AutopilotClock(telemetry_s)
        self._echo = Echo()
        self._start_command_s = command_s
        self.telemetry_s = telemetry_s
        self._telemetry_t_s: float | None = None
        self._last_echo: tuple[float, Vector] | None = None
        self._echo_found = False
        self._command_s = command_s
        self._moved_s = -math.inf
        self._sent_t_s = [-1e6]
        self._sent_axes = [ZERO]

    def timesync(self, sent_s: float, arrived_s: float, boot_s: float) -> None:
        """Take one TIMESYNC answer: sent and arrived on our clock, `boot_s` on the autopilot's in between."""
        if not self.clock.answered(sent_s, arrived_s, boot_s):
            return
        if self._echo_found:
            self._approach(self._command_s, arrived_s)
        else:
            self._command_s = self._start_command_s + (self.clock.question_s(arrived_s) or 0.0)

    def stamped(self, arrived_s: float, boot_s: float) -> None:
        """Take one stamped message's arrival."""
        late_s = self.clock.stamped(arrived_s, boot_s)
        if late_s is None:
            return
        late_s = min(late_s, MAX_ROUND_TRIP_S)
        if self._telemetry_t_s is None:
            self.telemetry_s = late_s
        else:
            passed_s = clamped(arrived_s - self._telemetry_t_s, 0.0, PAUSE_S)
            self.telemetry_s += (late_s - self.telemetry_s) * passed_s / (passed_s + TELEMETRY_MEMORY_S)
        self._telemetry_t_s = arrived_s

    def sent(self, t_s: float, axes: Vector) -> None:
        """Take the axes that were sent, later than all before."""
        self._sent_t_s.append(t_s)
        self._sent_axes.append(axes)
        if len(self._sent_t_s) > COMMANDS:
            del self._sent_t_s[0], self._sent_axes[0]

    def echo(self, boot_s: float, axes: Vector) -> None:
        """Take what the motors did at `boot_s`; compare what they did the time before with what was sent.

        By now all is known that was sent around then.
        """
        last, self._last_echo = self._last_echo, (boot_s, axes)
        if last is None:
            return
        at_s = self.clock.local(last[0])
        lag_s = self._echo.step(at_s, last[1], self._sent_t_s, self._sent_axes)
        if lag_s is not None:
            self._echo_found = True
            self._approach(lag_s, at_s)

    def _approach(self, found_s: float, now_s: float) -> None:
        """Move the command delay towards what was found, within what TIMESYNC allows."""
        question_s = self.clock.question_s(now_s)
        if question_s is not None:
            found_s = clamped(found_s, question_s, question_s + COMMAND_SPREAD_S)
        slew_s = SLEW * min(max(now_s - self._moved_s, 0.0), STALL_S)
        self._moved_s = max(now_s, self._moved_s)
        self._command_s += limited(found_s - self._command_s, slew_s)

    def delays(self, hidden_s: float = 0.0) -> Delays:
        """Return what is known of the delays now, beside what no stamp shows."""
        return Delays(
            telemetry_s=self.telemetry_s,
            command_s=self._command_s,
            telemetry_known=self._telemetry_t_s is not None,
            command_known=self._echo_found,
            hidden_s=hidden_s,
        )


class Echo:
    """Compares what the motors did with what was sent."""

    def __init__(self) -> None:
        self._misfit = [0.0] * len(LAGS_S)
        self._centre = ZERO
        self._spread = 0.0
        """The echo's mean, and how far it goes from it, squared, in units of the misfit."""
        self._t_s = -math.inf
        self._seen_s = 0.0

    def step(
        self, at_s: float, axes: Vector, sent_t_s: Sequence[float], sent: Sequence[Vector]
    ) -> float | None:
        """Take what the motors did at `at_s` and all that was sent until then, oldest first.

        Return the lag, in seconds, where it is clear by now.
        """
        if not sent_t_s or not sent_t_s[0] <= at_s - LAGS_S[-1] or at_s - LAGS_S[0] > sent_t_s[-1]:
            return None
        centre = axes if self._t_s == -math.inf else self._centre
        misses, away = _misses(at_s, axes, centre, sent_t_s, sent)
        if not misses:
            return None
        passed_s = min(max(at_s - self._t_s, 0.0), ECHO_MEMORY_S)
        new, mean = passed_s / (passed_s + ECHO_MEMORY_S), sum(misses) / len(misses)
        self._centre = vector(was + new * (x - was) for was, x in zip(centre, axes, strict=True))
        self._spread += new * (away / mean - self._spread)
        misfit = [old + new * (miss / mean - old) for old, miss in zip(self._misfit, misses, strict=True)]
        self._misfit = misfit
        self._t_s = at_s
        self._seen_s += min(passed_s, STALL_S)
        if self._seen_s < EVIDENCE_S:
            return None
        least, mean = min(misfit), sum(misfit) / len(misfit)
        clear = CONTRAST * min(mean, self._spread)
        matching = [k for k, error in enumerate(misfit) if error < clear]
        if not matching or matching[-1] - matching[0] + 1 != len(matching):
            return None
        most = least + PLATEAU * (mean - least)
        fits = [lag_s for lag_s, error in zip(LAGS_S, misfit, strict=True) if error <= most]
        return sum(fits) / len(fits)


def _misses(
    at_s: float, axes: Vector, centre: Vector, sent_t_s: Sequence[float], sent: Sequence[Vector]
) -> tuple[list[float], float]:
    """Return by how much, squared, `axes` differ from what was sent each of LAGS_S before, and from `centre`.

    Nothing where what was sent did not vary. An axis that we never move is somebody else's: in STABILIZE the
    firmware's yaw.
    """
    newest = bisect_right(sent_t_s, at_s - LAGS_S[0]) - 1
    oldest = bisect_right(sent_t_s, at_s - LAGS_S[-1]) - 1
    # How many of the lags fall on each command, newest first.
    reached = [bisect_right(LAGS_S, at_s - t_s) for t_s in sent_t_s[newest:oldest:-1]]
    counts = list(map(sub, (*reached, len(LAGS_S)), (0, *reached)))
    commands = [sent[i] for i in range(newest, oldest - 1, -1)]
    by_command = [0.0] * len(commands)
    varies, away = False, 0.0
    for echo, mean, column in zip(axes, centre, zip(*commands, strict=True), strict=True):
        if any(column):
            away += (echo - mean) * (echo - mean)
            varies = varies or _rms(counts, column) >= EXCITATION
            by_command = [miss + (x - echo) * (x - echo) for miss, x in zip(by_command, column, strict=True)]
    return list(chain.from_iterable(map(repeat, by_command, counts))) if varies else [], away


def _rms(counts: Sequence[int], values: Sequence[float]) -> float:
    """Return the standard deviation of values of which each comes `counts` times."""
    total = sum(counts)
    mean = sum(map(mul, counts, values)) / total
    return math.sqrt(sum([n * (x - mean) * (x - mean) for n, x in zip(counts, values, strict=True)]) / total)
