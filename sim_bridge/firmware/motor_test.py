"""DO_MOTOR_TEST: one motor turns for as long as the request is repeated."""

import math

from sim_bridge.firmware.answers import ACCEPTED, CRITICAL, DENIED, FAILED, INFO, WARNING
from sim_bridge.firmware.board import Board

PERCENT, PWM = 0, 1
TIMEOUT_S, COOLDOWN_S = 0.5, 10.0


class MotorTest:
    """Which motor turns, how fast, and when it was asked last."""

    def __init__(self, autopilot: Board) -> None:
        self._autopilot = autopilot
        self._running = False
        self._motor = -1
        self._pwm = 0
        self._asked_s = self._refused_until_s = -math.inf

    def ask(self, motor: int, kind: float, throttle: float) -> int:
        """Start or go on; the MAV_RESULT. It is refused while disarmed, and for 10 s after a test."""
        autopilot = self._autopilot
        if not self._running:
            if autopilot.boot_s < self._refused_until_s:
                autopilot.say(CRITICAL, "10 second cooldown required after motor test")
            elif not autopilot.armed:
                autopilot.say(WARNING, "Arm motors before testing motors.")
            else:
                self._running, self._motor = True, -1
            if not self._running:
                autopilot.say(WARNING, "motor test initialization failed!")
                return FAILED
        self._asked_s = autopilot.boot_s
        if kind not in (PERCENT, PWM):
            autopilot.say(WARNING, f"bad test type {kind:.2f}")
            return FAILED
        pwm = throttle if kind == PWM else 1100.0 + 8.0 * throttle
        if not 0 <= motor < len(autopilot.idle) or not 1100.0 <= pwm <= 1900.0:
            return DENIED
        self._motor, self._pwm = motor, round(pwm)
        return ACCEPTED

    def step(self, boot_s: float) -> list[int] | None:
        """Return the motors' PWM (µs) during a test, else None; end it, and disarm, where nobody asks."""
        if not self._running:
            return None
        idle = self._autopilot.idle
        if boot_s > self._asked_s + TIMEOUT_S:
            self._running = False
            self._refused_until_s = boot_s + COOLDOWN_S
            self._autopilot.say(INFO, "Motor test timed out!")
            self._autopilot.disarm()
            return idle
        return [self._pwm if number == self._motor else at_rest for number, at_rest in enumerate(idle)]
