"""COMMAND_LONG and COMMAND_INT: what each MAV_CMD does."""

import math
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_bridge.firmware import mode_behaviour, reports
from sim_bridge.firmware.board import Board
from sim_bridge.firmware.reports import STREAMED
from sim_bridge.firmware.result_texts import ACCEPTED, DENIED, FAILED, INFO, UNSUPPORTED, WARNING
from sim_bridge.firmware.stream_schedule import FASTEST_INTERVAL_US

FORCE_ARMING, FORCE_REBOOT = (2989, 21196), 20190226
"""Numbers in a parameter that switch off the checks."""


class CommandHandler:
    """Carries out commands for a board: `_nav_land` takes MAV_CMD_NAV_LAND, a link and seven parameters."""

    def __init__(self, board: Board) -> None:
        self._board = board

    def obey(self, link: int, command: int, p: list[float]) -> int:
        """Carry out a command; the MAV_RESULT."""
        known = mavlink.enums["MAV_CMD"].get(command)
        name = known.name.removeprefix("MAV_CMD").lower() if known else ""
        handler: Callable[[int, list[float]], int] | None = getattr(self, name, None)
        return handler(link, p) if handler else UNSUPPORTED

    def request(self, link: int, number: int) -> int:
        """Send a message once; the MAV_RESULT. One without anything to tell is accepted, and not sent."""
        if number not in STREAMED:
            return FAILED
        for message in reports.build(number, self._board):
            self._board.send(link, message)
        return ACCEPTED

    def _nav_loiter_unlim(self, _: int, __: list[float]) -> int:
        return self._board.set_mode(mode_behaviour.POSHOLD)

    def _nav_land(self, _: int, __: list[float]) -> int:
        return self._board.set_mode(mode_behaviour.SURFACE)

    def _request_message(self, link: int, p: list[float]) -> int:
        return self.request(link, _whole(p[0]))

    def _component_arm_disarm(self, _: int, p: list[float]) -> int:
        board = self._board
        if p[0] == 1:
            return board.arm(forced=p[1] in FORCE_ARMING)
        return board.disarm() if p[0] == 0 else UNSUPPORTED

    def _do_set_mode(self, _: int, p: list[float]) -> int:
        return self._board.set_mode(_whole(p[1])) if _whole(p[0]) & 1 else DENIED

    def _set_message_interval(self, link: int, p: list[float]) -> int:
        board, number, interval_us = self._board, _whole(p[0]), p[1]
        if number not in STREAMED:
            board.say(INFO, f"No ap_message for mavlink id ({number})")
            return DENIED
        if not math.isfinite(interval_us):
            return DENIED
        if 0.0 < interval_us < FASTEST_INTERVAL_US:
            board.say(INFO, f"Requested rate for message ID {number} too fast. Increase SCHED_LOOP_RATE")
        taken = board.links[link].streams.set_interval(number, interval_us, board.boot_s)
        return ACCEPTED if taken else DENIED

    def _get_message_interval(self, link: int, p: list[float]) -> int:
        number = _whole(p[0]) & 0xFFFF
        interval_us = self._board.links[link].streams.interval_us(number)
        self._board.send(link, mavlink.MAVLink_message_interval_message(number, interval_us))
        return ACCEPTED

    def _request_autopilot_capabilities(self, link: int, p: list[float]) -> int:
        return self.request(link, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION) if p[0] == 1 else FAILED

    def _do_motor_test(self, _: int, __: list[float]) -> int:
        """Refuse: which motor turns which way is asked of the real ArduSub."""
        if not self._board.armed:
            self._board.say(WARNING, "Arm motors before testing motors.")
        self._board.say(WARNING, "motor test initialization failed!")
        return FAILED

    def _do_send_banner(self, link: int, _: list[float]) -> int:
        self._board.say_banner(link)
        return ACCEPTED

    def _do_flighttermination(self, _: int, p: list[float]) -> int:
        return self._board.disarm() if p[0] > 0.5 else FAILED

    def _preflight_reboot_shutdown(self, _: int, p: list[float]) -> int:
        if self._board.armed and p[5] != FORCE_REBOOT:
            return FAILED
        self._board.reboot_requested = p[0] in (1, 3)
        return ACCEPTED if self._board.reboot_requested else UNSUPPORTED

    def _preflight_calibration(self, _: int, p: list[float]) -> int:
        """Calibrate the barometer; gyro and level trim are accepted and change nothing."""
        if self._board.armed:
            return FAILED
        if p[2] == 1:
            self._board.sensors.rezero()
            for text in ("Calibrating barometer", *(f"Barometer {n} calibration complete" for n in (1, 2))):
                self._board.say(INFO, text)
            return ACCEPTED
        return ACCEPTED if p[0] == 1 or p[4] in (1, 2, 4) else UNSUPPORTED


def _whole(value: float) -> int:
    """Return a parameter as an integer; 0 for one that is none."""
    return int(value) if math.isfinite(value) and abs(value) < 2**31 else 0
