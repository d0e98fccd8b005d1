"""The streams that we need: their requested and measured rates, and when to request them again.

Every stream is asked for at first contact and every ASK_S from then on, because a router shares one link
with the ground station; one that was measured slow is asked for sooner, with back-off. A parameter transfer
slows all of them fourfold and asking does not help, so it does not press.

NAMED_VALUE_FLOAT is not among them: ArduSub sends it at 2 Hz and takes no interval for it. The firmware's own
simulator says to every ground station which message it has refused; that one is not asked for again.
"""

import math
import re
from collections.abc import Mapping
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.mavlink.ardusub import PRESSURES, DepthSource

ASK_S: Final = 10.0  # ten requests: one a second on average
WINDOW_S: Final = 0.4  # 20 messages at 50 Hz
SLOW_SHARE: Final = 0.7
"""A stream below this share of its rate has slowed down; a parameter transfer leaves a quarter."""

AGAIN_S: Final = (1.0, 8.0)  # first wait and longest
REFUSAL: Final = re.compile(r"No ap_message for mavlink id \((\d+)\)")
"""The firmware's text about a message that it does not stream; its COMMAND_ACK names no message."""

_RATES_HZ: Final = {
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 50.0,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 50.0,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: 50.0,
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: 12.0,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: 4.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS: 1.0,
    mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR: 10.0,
}
MAY_BE_SILENT: Final = frozenset({mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR})
"""Nothing comes of it without the instrument, or without an echo: it is never pressed for."""


def streams(depth_source: DepthSource) -> dict[int, float]:
    """Rates in Hz by message id."""
    rates_hz = dict(_RATES_HZ)
    if depth_source == "pressure":
        rates_hz |= dict.fromkeys(PRESSURES, 50.0)
    return rates_hz | {mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 50.0}


class _Stream:
    """One message's rate, measured window by window."""

    def __init__(self, rate_hz: float) -> None:
        self.rate_hz = rate_hz
        self.window_s = max(WINDOW_S, 4.0 / rate_hz)
        self.count = 0
        self.since_s = self.not_before_s = -math.inf
        self.measured_hz: float | None = None
        self.again_s = AGAIN_S[0]

    def has_slowed(self, now_s: float, *, may_be_silent: bool) -> bool:
        """Tell at the end of a window whether it came too seldom, with back-off."""
        passed_s = now_s - self.since_s
        if passed_s < self.window_s:
            return False
        if self.since_s > -math.inf:
            self.measured_hz = self.count / passed_s
        self.since_s, self.count = now_s, 0
        if self.measured_hz is None:
            return False
        if may_be_silent or self.measured_hz >= SLOW_SHARE * self.rate_hz:
            self.again_s = AGAIN_S[0]
            return False
        if now_s < self.not_before_s:
            return False
        self.not_before_s = now_s + self.again_s
        self.again_s = min(2.0 * self.again_s, AGAIN_S[1])
        return True


class StreamRates:
    """Counts what comes (`heard`) and says what to ask for (`due`)."""

    def __init__(self, rates_hz: Mapping[int, float]) -> None:
        self._rates_hz = rates_hz
        self.restart()

    def restart(self) -> None:
        """Ask for everything again: first contact, or a rebooted autopilot."""
        self._streams = {key: _Stream(rate_hz) for key, rate_hz in self._rates_hz.items()}
        self._ask_s = self._closes_s = -math.inf

    def read_refusal(self, text: str) -> None:
        """Read a text of the autopilot: a message that it refused is not requested again until `restart`."""
        if refused := REFUSAL.fullmatch(text):
            self._streams.pop(int(refused[1]), None)

    def heard(self, message_id: int) -> None:
        """Count one message."""
        if (stream := self._streams.get(message_id)) is not None:
            stream.count += 1

    def due(self, now_s: float) -> dict[int, float]:
        """Return what to ask for now: rates in Hz by message id."""
        everything = now_s >= self._ask_s
        if everything:
            self._ask_s = now_s + ASK_S
        elif now_s < self._closes_s:
            return {}
        due = {
            key: stream.rate_hz
            for key, stream in self._streams.items()
            if stream.has_slowed(now_s, may_be_silent=key in MAY_BE_SILENT) or everything
        }
        ends_s = (stream.since_s + stream.window_s for stream in self._streams.values())
        self._closes_s = min(ends_s, default=math.inf) - 1e-6  # of rounding
        return due

    @property
    def measured_hz(self) -> dict[int, float]:
        """Return how often each message comes, where that was measured."""
        return {
            key: stream.measured_hz for key, stream in self._streams.items() if stream.measured_hz is not None
        }
