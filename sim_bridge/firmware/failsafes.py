"""What ArduSub does when the pilot or the ground station falls silent, and when a leak detector is wet."""

import math

from sim_bridge.firmware import mode_behaviour
from sim_bridge.firmware.board import Board
from sim_bridge.firmware.result_texts import ACCEPTED, CRITICAL, WARNING

GCS_WARNING_PERIOD_S = 30.0
LEAK_WARNING_PERIOD_S = 20.0


class Failsafes:
    """Watches for a board; `check` is called with each input loop."""

    def __init__(self, board: Board) -> None:
        self._board = board
        self._params = board.params
        board.pilot_seen_s = 0.0 if board.rebooted else None
        self.leaking = False
        """Whether a leak detector is wet."""
        self._steered_s: float | None = None
        self._gcs_seen_s: float | None = None
        self._gcs_warned_s = 0.0
        self._leak_said_s = -math.inf

    def hear_pilot(self) -> None:
        """Take note of a message that steers; it is a sign of life of the ground station too."""
        self._steered_s = self._board.pilot_seen_s = self._gcs_seen_s = self._board.boot_s

    def hear_ground_station(self) -> None:
        """Take note of a heartbeat of the ground station."""
        self._gcs_seen_s = self._board.boot_s

    def check(self) -> None:
        """Act on what has been silent for too long."""
        if self._board.rc_receiver:
            self._hear_receiver()
        self._check_pilot()
        self._check_ground_station()
        self._check_leak()

    def _hear_receiver(self) -> None:
        """Take a receiver as pilot input; its resting sticks rule once an override has expired."""
        now_s, steered_s = self._board.boot_s, self._steered_s
        if steered_s is not None and now_s > steered_s + self._params["RC_OVERRIDE_TIME"]:
            self._steered_s = None
            self._board.neutralise()
        self._board.pilot_seen_s = now_s

    def _check_pilot(self) -> None:
        action, timeout_s = self._params["FS_PILOT_INPUT"], self._params["FS_PILOT_TIMEOUT"]
        board, seen_s = self._board, self._board.pilot_seen_s
        if action == 0 or (seen_s is not None and board.boot_s < seen_s + timeout_s):
            board.failing.discard("pilot")
        elif "pilot" not in board.failing:
            board.failing.add("pilot")
            board.say(CRITICAL, "Lost manual control")
            board.neutralise()
            if action == 2:
                board.disarm()

    def _check_ground_station(self) -> None:
        action, board = self._params["FS_GCS_ENABLE"], self._board
        if action == 0 or self._gcs_seen_s is None:
            return
        now_s = board.boot_s
        if now_s - self._gcs_seen_s < self._params["FS_GCS_TIMEOUT"]:
            if "ground station" in board.failing:
                board.say(WARNING, "GCS Failsafe Cleared")
            board.failing.discard("ground station")
            return
        if now_s - self._gcs_warned_s > GCS_WARNING_PERIOD_S:
            self._gcs_warned_s = now_s
            board.say(WARNING, f"MYGCS: {int(self._params['MAV_GCS_SYSID'])}, heartbeat lost")
        if "ground station" in board.failing or not board.armed:
            return
        board.failing.add("ground station")
        wanted = {3: mode_behaviour.ALT_HOLD, 4: mode_behaviour.SURFACE}.get(int(action))
        if action == 2 or (wanted is not None and board.set_mode(wanted) != ACCEPTED):
            board.disarm()

    def _check_leak(self) -> None:
        """Say it every 20 s, act once: FS_LEAK_ENABLE 1 warns, 2 surfaces, and 0 looks at no detector."""
        action, board = self._params["FS_LEAK_ENABLE"], self._board
        if not self.leaking or action == 0:
            board.failing.discard("leak")
            return
        if board.boot_s > self._leak_said_s + LEAK_WARNING_PERIOD_S:
            self._leak_said_s = board.boot_s
            board.say(CRITICAL, "Leak Detected")
        known = "leak" in board.failing
        board.failing.add("leak")
        if not known and action == 2 and board.armed:
            board.set_mode(mode_behaviour.SURFACE)
