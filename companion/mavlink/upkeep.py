"""What must be asked of the autopilot, and asked again: streams, clock, parameters, mode, arming."""

from collections import deque
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.mavlink.ardusub import Commands, DepthSource, Mode
from companion.mavlink.codec import Message
from companion.types import Event, Heartbeat, Parameter, Reboot

HEARTBEAT_S: Final = 1.0
STREAMS_S: Final = 10.0
TIMESYNC_S: Final = 0.25
PARAMETER_S: Final = 0.1
PARAMETER_AGAIN_S: Final = 2.0
COMMAND_S: Final = 1.0
CONTACT_S: Final = 5.0

RENAMED: Final = {"SYSID_MYGCS": "MAV_GCS_SYSID"}
"""Names before ArduSub 4.7 and since: either answer will do, and is known by the new name."""

PARAMETERS: Final = (
    "FS_PILOT_INPUT",
    "FS_PILOT_TIMEOUT",
    "FRAME_CONFIG",
    "JS_THR_GAIN",
    "JS_GAIN_DEFAULT",
    *(f"MOT_{motor}_DIRECTION" for motor in range(1, 9)),
    "RC_OPTIONS",
    *RENAMED.values(),
    *RENAMED.keys(),
)

_RATES_HZ: Final = {
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 50.0,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 50.0,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: 50.0,
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: 12.0,
    mavlink.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT: 2.0,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
}


def streams(depth_source: DepthSource = "relative_alt", with_position: bool = False) -> dict[int, float]:
    """Rates in Hz by message id."""
    rates_hz = dict(_RATES_HZ)
    if depth_source == "ahrs2":
        rates_hz[mavlink.MAVLINK_MSG_ID_AHRS2] = 50.0
    if depth_source == "pressure":
        rates_hz[mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE2] = 50.0
    if with_position:
        rates_hz[mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED] = 50.0
    return rates_hz


class Upkeep:
    """Keeps one autopilot talking, and doing what is wanted.

    Before the autopilot's heartbeat has come, or once it has not come for CONTACT_S, nothing goes out but our
    own. A reboot and a new contact make everything be asked anew.
    """

    def __init__(self, commands: Commands, rates_hz: Mapping[int, float] | None = None) -> None:
        self._commands = commands
        self._rates_hz = streams() if rates_hz is None else rates_hz
        self._parameters: dict[str, float] = {}
        self._last: Heartbeat | None = None
        self._heartbeat = _Timer(HEARTBEAT_S)
        self._forget()

    @property
    def parameters(self) -> Mapping[str, float]:
        """What was answered of PARAMETERS since first contact or the last reboot, by today's names."""
        return MappingProxyType(self._parameters)

    def step(
        self, now_s: float, events: Sequence[Event], *, want_mode: Mode | None, want_armed: bool
    ) -> list[Message]:
        """Take in what came and give what to send at `now_s`.

        `want_mode` None leaves the mode alone. `want_armed` False leaves arming alone: to disarm is
        somebody's decision (`Commands.arm`), and never a habit.
        """
        for event in events:
            self._take(event)
        out: list[Message] = []
        if self._heartbeat.due(now_s):
            out.append(self._commands.heartbeat())
        if self._last is None:
            return out
        if now_s - self._last.t_s > CONTACT_S:
            self._last = None
            return out
        if self._streams.due(now_s):
            out += [self._commands.message_interval(key, rate) for key, rate in self._rates_hz.items()]
        if self._timesync.due(now_s):
            out.append(self._commands.timesync(now_s))
        if want_mode is not None and self._last.mode != want_mode and self._mode.due(now_s):
            out.append(self._commands.set_mode(want_mode))
        if want_armed and not self._last.armed and self._arming.due(now_s):
            out.append(self._commands.arm(True))
        if self._missing and now_s >= self._missing[0][0] and self._reading.due(now_s):
            name = self._missing.popleft()[1]
            self._missing.append((now_s + PARAMETER_AGAIN_S, name))
            out.append(self._commands.read_parameter(name))
        return out

    def _forget(self) -> None:
        self._parameters.clear()
        self._missing = deque((float("-inf"), name) for name in PARAMETERS)
        self._streams = _Timer(STREAMS_S)
        self._timesync = _Timer(TIMESYNC_S)
        self._mode = _Timer(COMMAND_S)
        self._arming = _Timer(COMMAND_S)
        self._reading = _Timer(PARAMETER_S)

    def _take(self, event: Event) -> None:
        if isinstance(event, Reboot):
            self._forget()
        elif isinstance(event, Heartbeat):
            if self._last is None:
                self._forget()
            self._last = event
        elif isinstance(event, Parameter):
            self._answer(event.name, event.value)

    def _answer(self, name: str, value: float) -> None:
        if name in PARAMETERS:
            name = RENAMED.get(name, name)
            self._parameters[name] = value
            self._missing = deque(entry for entry in self._missing if RENAMED.get(entry[1], entry[1]) != name)


class _Timer:
    """Says yes at most once a period, and at once the first time."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._next_s = float("-inf")

    def due(self, now_s: float) -> bool:
        if now_s < self._next_s:
            return False
        self._next_s = now_s + self._period_s
        return True
