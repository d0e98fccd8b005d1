"""What is requested of the autopilot, repeatedly: streams, clock, parameters, mode, arming."""

import math
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.mavlink.ardusub import DIRECTIONS, FUNCTIONS, PRESSURES, QUALITY_PARAMETER
from companion.mavlink.encode import Commands
from companion.mavlink.messages import Message
from companion.mavlink.streams import StreamRates
from companion.records import Event, FirmwareVersion, GlobalOrigin, Heartbeat, Parameter, Reboot, StatusText
from companion.records.state import CONTACT_S
from companion.telemetry.modes import Mode

HEARTBEAT_S: Final = 1.0  # MAVLink's rate of heartbeats
TIMESYNC_S: Final = 0.25  # a delay that changes is followed within seconds
VERSION_S: Final = 5.0  # for people alone
ORIGIN_S: Final = 2.0  # it is not told when it is set before we came
PARAMETER_S: Final = 0.06  # all in 3 s, with little beside the streams
PARAMETER_AGAIN_S: Final = (2.0, 60.0)
"""A parameter that was not answered is requested again at growing intervals: a firmware may not have it."""

CONFIRM_AGAIN_S: Final = 0.5  # engaging waits for it
VOLATILE_S: Final = 10.0  # as the streams are asked for
COMMAND_S: Final = 1.0  # the heartbeat confirms once a second

RENAMED: Final = {"SYSID_MYGCS": "MAV_GCS_SYSID"}
"""Names before ArduSub 4.7 and since: either answer will do, and is known by the new name."""

GROUND_PRESSURES: Final = tuple(f"BARO{number}_GND_PRESS" for number in range(1, len(PRESSURES) + 1))

PARAMETERS: Final = (
    "FS_PILOT_INPUT",
    "FS_PILOT_TIMEOUT",
    "FRAME_CONFIG",
    *RENAMED.values(),
    "RC_OVERRIDE_TIME",
    "RC_PROTOCOLS",
    "JS_THR_GAIN",
    "FS_LEAK_ENABLE",
    "SURFACE_DEPTH",
    *DIRECTIONS,
    *FUNCTIONS,
    "BARO_PRIMARY",
    "BARO_SPEC_GRAV",
    *GROUND_PRESSURES,
    "STAT_BOOTCNT",
    *RENAMED.keys(),
)

ZEROES: Final = frozenset(GROUND_PRESSURES)
"""The autopilot sets these again at the surface and on arming, without a message."""

VOLATILE: Final = ZEROES | {"FS_PILOT_INPUT", "FS_PILOT_TIMEOUT", "JS_THR_GAIN"}
"""Read again and again: safety and thrust depend on them, and the notice of a change may be lost."""


class LinkMaintenance:
    """Keeps the streams of one autopilot alive, and its mode and arming as wanted.

    Before the autopilot's heartbeat has come, or once it has not come for CONTACT_S, nothing goes out but our
    own. After a reboot or a new contact everything is asked again.
    """

    def __init__(self, commands: Commands, rates_hz: Mapping[int, float]) -> None:
        self._commands = commands
        self.streams = StreamRates(rates_hz)
        self._parameters: dict[str, float] = {}
        self.parameters: Mapping[str, float] = MappingProxyType(self._parameters)
        """What was answered of PARAMETERS since first contact or the last reboot, by today's names."""
        self._last: Heartbeat | None = None
        self._wanted_mode: Mode | None = None
        self._confirming = frozenset[str]()
        self._heartbeat_s = -math.inf
        self._forget()

    @property
    def all_parameters_known(self) -> bool:
        """Whether every one of PARAMETERS was answered."""
        return {RENAMED.get(name, name) for name in PARAMETERS} <= self._parameters.keys()

    def heard(self, message_id: int) -> None:
        """Count one message; what a rangefinder needs is asked once there is one: 4.1 does not have it."""
        self.streams.heard(message_id)
        if message_id == mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR and QUALITY_PARAMETER not in self._parameters:
            self._missing.setdefault(QUALITY_PARAMETER, (-math.inf, PARAMETER_AGAIN_S[0]))

    def step(
        self,
        now_s: float,
        events: Sequence[Event],
        *,
        want_mode: Mode | None,
        want_armed: bool,
        confirm: frozenset[str] = frozenset(),
    ) -> list[Message]:
        """Take in what came and give what to send at `now_s`.

        `want_mode` None leaves the mode alone. `want_armed` False leaves arming alone: to disarm is
        somebody's decision (`Commands.arm`), and never a habit. The parameters in `confirm` are read again
        at once, and again after CONFIRM_AGAIN_S where no answer came.
        """
        for event in events:
            self._take(event)
        out: list[Message] = []
        commands = self._commands
        if now_s >= self._heartbeat_s:
            self._heartbeat_s = now_s + HEARTBEAT_S
            out.append(commands.heartbeat())
        if self._last is None:
            return out
        if now_s - self._last.t_s > CONTACT_S:
            self._last = None
            return out
        asked = self.streams.due(now_s)
        out += [commands.message_interval(key, rate) for key, rate in asked.items()]
        for known, message_id, period_s in (
            (self.firmware, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, VERSION_S),
            (self.origin, mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN, ORIGIN_S),
        ):
            if known is None and self._is_due(message_id, period_s, now_s):
                out.append(commands.request_message(message_id))
        if self._is_due("timesync", TIMESYNC_S, now_s):
            out.append(commands.timesync(now_s))
        return [*out, *self._orders(now_s, self._last, want_mode, want_armed), *self._reads(now_s, confirm)]

    def _orders(
        self, now_s: float, last: Heartbeat, want_mode: Mode | None, want_armed: bool
    ) -> Iterator[Message]:
        """Ask for the mode and for arming until the heartbeat confirms them; for a new mode at once."""
        if want_mode != self._wanted_mode:
            self._wanted_mode = want_mode
            self._next_s.pop("mode", None)
        if want_mode is not None and last.mode != want_mode and self._is_due("mode", COMMAND_S, now_s):
            yield self._commands.set_mode(want_mode)
        if want_armed and not last.armed and self._is_due("arming", COMMAND_S, now_s):
            yield self._commands.arm(True)

    def _reads(self, now_s: float, confirm: frozenset[str]) -> list[Message]:
        """Read the parameter that has waited longest, one every PARAMETER_S."""
        for name in sorted(confirm - self._confirming):
            self._missing[name] = now_s, CONFIRM_AGAIN_S
        self._confirming = confirm
        due = [name for name, (due_s, _) in self._missing.items() if now_s >= due_s]
        if not (due and self._is_due("reading", PARAMETER_S, now_s)):
            return []
        name = min(due, key=lambda name: self._missing[name][0])
        wait_s = self._missing[name][1]
        self._missing[name] = (now_s + wait_s, min(2.0 * wait_s, PARAMETER_AGAIN_S[1]))
        return [self._commands.read_parameter(name)]

    def _is_due(self, what: int | str, period_s: float, now_s: float) -> bool:
        """Say yes at most once a period, and at once the first time."""
        if now_s < self._next_s.get(what, -math.inf):
            return False
        self._next_s[what] = now_s + period_s
        return True

    def _forget(self) -> None:
        self._parameters.clear()
        self._missing = dict.fromkeys(PARAMETERS, (-math.inf, PARAMETER_AGAIN_S[0]))
        self.streams.restart()
        self.firmware: FirmwareVersion | None = None
        """The autopilot's version, once it has reported it."""
        self.origin: GlobalOrigin | None = None
        """Where on earth the EKF's origin is, once it has reported one."""
        self._next_s: dict[int | str, float] = {}

    def _take(self, event: Event) -> None:
        if isinstance(event, Reboot):
            self._forget()
        elif isinstance(event, Heartbeat):
            if self._last is None:
                self._forget()
            elif event.armed and not self._last.armed:  # arming sets the zeroes again
                zeroes = ZEROES & self._parameters.keys()
                self._missing |= dict.fromkeys(zeroes, (event.t_s, PARAMETER_AGAIN_S[0]))
            self._last = event
        elif isinstance(event, Parameter) and event.name in (*PARAMETERS, QUALITY_PARAMETER):
            known = RENAMED.get(event.name, event.name)
            self._parameters[known] = event.value
            for name in (known, *(old for old, new in RENAMED.items() if new == known)):
                self._missing.pop(name, None)
            if known in VOLATILE:
                self._missing[known] = (event.t_s + VOLATILE_S, PARAMETER_AGAIN_S[0])
        elif isinstance(event, FirmwareVersion):
            self.firmware = event
        elif isinstance(event, GlobalOrigin):
            self.origin = event
        elif isinstance(event, StatusText):
            self.streams.read_refusal(event.text)
