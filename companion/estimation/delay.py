"""How late the loop is: measured, because 50 ms of unknown delay each way is a full-power limit cycle.

    telemetry delay = arrival − autopilot's stamp + offset     offset = autopilot's clock − ours (clock.py)
    command delay   = lag at which the motors best repeat what we sent (echo.py);
                      before there was an echo, the configured one and TIMESYNC's way to the autopilot

An error in the offset moves delay from one to the other; their sum, which is what destabilises, stays right.
A command takes as long as TIMESYNC's question took, plus what the autopilot needs to act: at most
COMMAND_SPREAD_S.
"""

import math

from companion.core.bounds import clamped, limited
from companion.estimation.clock import AutopilotClock
from companion.estimation.echo import STALL_S, Echo
from companion.records import ZERO, Delays, Vector

TELEMETRY_MEMORY_S = 1.0
MAX_DELAY_S = 1.0
PAUSE_S = 0.1
"""What comes first after a longer pause was late with it: it counts for so long, and not for the pause."""

COMMANDS = 128
"""So many of the last are compared with what the motors did: 2.5 s of them at 50 Hz."""

SLEW = 0.05
"""Seconds of command delay a second: the law's horizon moves, it does not jump."""

COMMAND_SPREAD_S = 0.05
"""The 20 ms of the firmware's input loop (docs/ardusub.md, "RC_CHANNELS_OVERRIDE"), and 30 ms for what a
router and a tick may add."""


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
        late_s = min(late_s, MAX_DELAY_S)
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

    @property
    def delays(self) -> Delays:
        """What is known of the delays now."""
        return Delays(
            telemetry_s=self.telemetry_s,
            command_s=self._command_s,
            telemetry_known=self._telemetry_t_s is not None,
            command_known=self._echo_found,
        )
