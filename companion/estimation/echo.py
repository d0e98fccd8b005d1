"""The lag of the motors behind what was sent: where SERVO_OUTPUT_RAW best repeats the commands.

    misfit(lag) = mean over ECHO_MEMORY_S of  Σ (sent(t − lag) − echo(t))² / its mean over all lags

A command that repeats itself fits its echo at several lags: then nothing is learnt.
"""

import math
from bisect import bisect_right
from collections.abc import Sequence
from itertools import chain, repeat
from operator import mul, sub

from companion.records import Vector

MEMORY_S = 4.0
EVIDENCE_S = 1.5
"""How long commands must have varied before an echo is believed."""

STALL_S = 0.5
"""A longer gap between echoes counts as this long."""

STEP_S = 0.005
LAGS_S = tuple(STEP_S * k for k in range(-6, 82))
CONTRAST = 0.5
"""The best lag counts as found when it explains the echo this much better than the average lag does."""

PLATEAU = 0.05
"""Commands are steps of a tick's length, so neighbouring lags can fit equally well: the middle of those
within this share of the best is taken."""

EXCITATION = 0.01
"""Commands that varied less than this (axis units, RMS) tell nothing about lag."""


class Echo:
    """Compares what the motors did with what was sent."""

    def __init__(self) -> None:
        self._misfit = [0.0] * len(LAGS_S)
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
        misses = _misses(at_s, axes, sent_t_s, sent)
        if misses is None:
            return None
        passed_s = min(max(at_s - self._t_s, 0.0), MEMORY_S)
        new, mean = passed_s / (passed_s + MEMORY_S), sum(misses) / len(misses)
        misfit = [old + new * (miss / mean - old) for old, miss in zip(self._misfit, misses, strict=True)]
        self._misfit = misfit
        self._t_s = at_s
        self._seen_s += min(passed_s, STALL_S)
        if self._seen_s < EVIDENCE_S:
            return None
        least, mean = min(misfit), sum(misfit) / len(misfit)
        matching = [k for k, error in enumerate(misfit) if error < CONTRAST * mean]
        if not matching or matching[-1] - matching[0] + 1 != len(matching):
            return None
        most = least + PLATEAU * (mean - least)
        fits = [lag_s for lag_s, error in zip(LAGS_S, misfit, strict=True) if error <= most]
        return sum(fits) / len(fits)


def _misses(
    at_s: float, axes: Vector, sent_t_s: Sequence[float], sent: Sequence[Vector]
) -> list[float] | None:
    """Return by how much, squared, `axes` differ from what was sent each of LAGS_S before.

    None where that did not vary. An axis that we never move is somebody else's: in STABILIZE the firmware's
    yaw.
    """
    newest = bisect_right(sent_t_s, at_s - LAGS_S[0]) - 1
    oldest = bisect_right(sent_t_s, at_s - LAGS_S[-1]) - 1
    # How many of the lags fall on each command, newest first.
    reached = [bisect_right(LAGS_S, at_s - t_s) for t_s in sent_t_s[newest:oldest:-1]]
    counts = list(map(sub, (*reached, len(LAGS_S)), (0, *reached)))
    commands = [sent[i] for i in range(newest, oldest - 1, -1)]
    by_command = [0.0] * len(commands)
    varies = False
    for echo, column in zip(axes, zip(*commands, strict=True), strict=True):
        if any(column):
            varies = varies or _rms(counts, column) >= EXCITATION
            by_command = [miss + (x - echo) * (x - echo) for miss, x in zip(by_command, column, strict=True)]
    return list(chain.from_iterable(map(repeat, by_command, counts))) if varies else None


def _rms(counts: Sequence[int], values: Sequence[float]) -> float:
    """Return the standard deviation of values of which each comes `counts` times."""
    total = sum(counts)
    mean = sum(map(mul, counts, values)) / total
    return math.sqrt(sum([n * (x - mean) * (x - mean) for n, x in zip(counts, values, strict=True)]) / total)
