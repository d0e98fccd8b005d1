"""What ArduSub does when the pilot or the ground station falls silent, and when a leak detector is wet."""

import math
from typing import TYPE_CHECKING

from sim_bridge.firmware import modes
from sim_bridge.firmware.answers import ACCEPTED, CRITICAL, WARNING

if TYPE_CHECKING:
    from sim_bridge.firmware.autopilot import Autopilot

GCS_WARNING_PERIOD_S = 30.0
LEAK_WARNING_PERIOD_S = 20.0


class Failsafes:
    """Watches for an autopilot; `check` is called with each input loop."""

    def __init__(self, autopilot: "Autopilot", rc_receiver: bool, *, rebooted: bool) -> None:
        self._autopilot = autopilot
        self._params = autopilot.params
        self._rc_receiver = rc_receiver
        self.pilot_seen_s: float | None = 0.0 if rebooted else None
        self.leaking = False
        """Whether a leak detector is wet."""
        self._steered_s: float | None = None
        self._pilot_lost = True
        self._gcs_lost = False
        self._gcs_seen_s: float | None = None
        self._gcs_warned_s = 0.0
        self._leak = False
        self._leak_said_s = -math.inf

    @property
    def active(self) -> bool:
        """Whether any of them holds."""
        return self._pilot_lost or self._gcs_lost or self._leak

    def hear_pilot(self) -> None:
        """Take note of a message that steers; it is a sign of life of the ground station too."""
        self._steered_s = self.pilot_seen_s = self._gcs_seen_s = self._autopilot.boot_s

    def hear_ground_station(self) -> None:
        """Take note of a heartbeat of the ground station."""
        self._gcs_seen_s = self._autopilot.boot_s

    def check(self) -> None:
        """Act on what has been silent for too long."""
        if self._rc_receiver:
            self._hear_receiver()
        self._check_pilot()
        self._check_ground_station()
        self._check_leak()

    def _hear_receiver(self) -> None:
        """Take a receiver as pilot input; its resting sticks rule once an override has expired."""
        now_s, steered_s = self._autopilot.boot_s, self._steered_s
        if steered_s is not None and now_s > steered_s + self._params["RC_OVERRIDE_TIME"]:
            self._steered_s = None
            self._autopilot.neutralise()
        self.pilot_seen_s = now_s

    def _check_pilot(self) -> None:
        action, timeout_s = self._params["FS_PILOT_INPUT"], self._params["FS_PILOT_TIMEOUT"]
        seen_s = self.pilot_seen_s
        if action == 0 or (seen_s is not None and self._autopilot.boot_s < seen_s + timeout_s):
            self._pilot_lost = False
        elif not self._pilot_lost:
            self._pilot_lost = True
            self._autopilot.say(CRITICAL, "Lost manual control")
            self._autopilot.neutralise()
            if action == 2:
                self._autopilot.disarm()

    def _check_ground_station(self) -> None:
        action, autopilot = self._params["FS_GCS_ENABLE"], self._autopilot
        if action == 0 or self._gcs_seen_s is None:
            return
        now_s = autopilot.boot_s
        if now_s - self._gcs_seen_s < self._params["FS_GCS_TIMEOUT"]:
            if self._gcs_lost:
                autopilot.say(WARNING, "GCS Failsafe Cleared")
            self._gcs_lost = False
            return
        if now_s - self._gcs_warned_s > GCS_WARNING_PERIOD_S:
            self._gcs_warned_s = now_s
            autopilot.say(WARNING, f"MYGCS: {int(self._params['MAV_GCS_SYSID'])}, heartbeat lost")
        if self._gcs_lost or not autopilot.armed:
            return
        self._gcs_lost = True
        wanted = {3: modes.ALT_HOLD, 4: modes.SURFACE}.get(int(action))
        if action == 2 or (wanted is not None and autopilot.set_mode(wanted) != ACCEPTED):
            autopilot.disarm()

    def _check_leak(self) -> None:
        """Say it every 20 s, act once: FS_LEAK_ENABLE 1 warns, 2 surfaces, and 0 looks at no detector."""
        action, autopilot = self._params["FS_LEAK_ENABLE"], self._autopilot
        if not self.leaking or action == 0:
            self._leak = False
            return
        if autopilot.boot_s > self._leak_said_s + LEAK_WARNING_PERIOD_S:
            self._leak_said_s = autopilot.boot_s
            autopilot.say(CRITICAL, "Leak Detected")
        known, self._leak = self._leak, True
        if not known and action == 2 and autopilot.armed:
            autopilot.set_mode(modes.SURFACE)
