"""ArduSub's flight modes: what each needs, and how it turns sticks and estimates into six demands."""

import math
from typing import NamedTuple

from sim_bridge.firmware import depth_hold
from sim_bridge.firmware.depth_hold import GAINS, SPEED_UP_M_S, DepthGains, clip
from sim_bridge.firmware.mixer import Demand
from sim_bridge.firmware.params import Parameters
from sim_bridge.firmware.pilot import FORWARD, LATERAL, PITCH, ROLL, THROTTLE, YAW, Pilot
from sim_bridge.physics.sensors import Estimate

STABILIZE, ACRO, ALT_HOLD, AUTO, GUIDED, CIRCLE, SURFACE, POSHOLD, MANUAL, MOTOR_DETECT, SURFTRAK = (
    0,
    1,
    2,
    3,
    4,
    7,
    9,
    16,
    19,
    20,
    21,
)


class Mode(NamedTuple):
    """A row of the table of modes."""

    name: str
    needs_position: bool
    holds_level: bool
    holds_depth: bool


MODES: dict[int, Mode] = {
    STABILIZE: Mode("STABILIZE", False, True, False),
    ACRO: Mode("ACRO", False, False, False),
    ALT_HOLD: Mode("ALT_HOLD", False, True, True),
    AUTO: Mode("AUTO", True, True, True),
    GUIDED: Mode("GUIDED", True, True, True),
    CIRCLE: Mode("CIRCLE", True, True, True),
    SURFACE: Mode("SURFACE", False, True, True),
    POSHOLD: Mode("POSHOLD", True, True, True),
    MANUAL: Mode("MANUAL", False, False, False),
    MOTOR_DETECT: Mode("MOTOR_DETECT", False, False, False),
    SURFTRAK: Mode("SURFTRAK", False, True, True),
}
GUIDED_FLAG_MODES = (AUTO, GUIDED, CIRCLE, POSHOLD)
"""Those that set the GUIDED bit of the heartbeat's base_mode."""

YAW_SETTLE_S = 0.25
STICK_DEAD_US = 30
THROTTLE_DEAD_US = 77
"""ALT_HOLD: no climb for a MANUAL_CONTROL z of 404..595 at full gain."""
MAX_LEAN_RAD = math.radians(45)
MAX_YAW_RATE = math.radians(100)
MAX_RATE = math.radians(90)
MAX_HEADING_LEAD_RAD = math.radians(20)
DIP_FROM_MANUAL = -0.8
"""Where ALT_HOLD's integrator starts after MANUAL: the dip of half a metre that the firmware shows."""


class FlightControl:
    """The controllers behind the modes: attitude P-PI, depth P-P-PI, a simple position hold."""

    def __init__(self, params: Parameters) -> None:
        self._params = params
        self.mode = MANUAL
        self.depth_target = 0.0
        self._heading = 0.0
        self._yaw_moved_s = 0.0
        self._rate_integral = [0.0, 0.0, 0.0]
        self._depth_hold = depth_hold.AT_REST
        self._climbing = False
        self._position: tuple[float, float] | None = None
        self._position_integral = (0.0, 0.0)

    def enter(self, mode: int, estimate: Estimate, t_s: float) -> None:
        """Start a mode at the present attitude, depth and place."""
        came_from, self.mode = self.mode, mode
        self.reset(estimate, t_s)
        if came_from == MANUAL and MODES[mode].holds_depth and mode != SURFACE:
            self._depth_hold = depth_hold.State(0.0, 0.0, DIP_FROM_MANUAL, 0.0)

    def reset(self, estimate: Estimate, t_s: float) -> None:
        """Targets to where the vehicle is, integrators to zero; also done all the time while disarmed."""
        self.depth_target = estimate.depth_m
        self._heading = estimate.yaw
        self._yaw_moved_s = t_s
        self._rate_integral = [0.0, 0.0, 0.0]
        self._depth_hold = depth_hold.AT_REST
        self._climbing = False
        self._position = None

    def yaw_was_reset(self, turn_rad: float) -> None:
        """Go on holding the same true heading; a place is held anew."""
        self._heading += turn_rad
        self._position = None

    def demand(self, pilot: Pilot, estimate: Estimate | None, t_s: float, dt: float) -> Demand:
        """Six demands in -1..1. `estimate` may be None in MANUAL, which looks at no sensor."""
        forward, lateral = pilot.stick(FORWARD), pilot.stick(LATERAL)
        throttle = pilot.stick(THROTTLE)
        if self.mode == MOTOR_DETECT:
            return (0.0,) * 6
        if self.mode == MANUAL or estimate is None:
            return pilot.stick(ROLL), pilot.stick(PITCH), pilot.stick(YAW), throttle, forward, lateral
        yaw_rate = _outside(pilot.channels[YAW], STICK_DEAD_US) * MAX_YAW_RATE
        if self.mode == ACRO:
            rates = (
                _outside(pilot.channels[ROLL], STICK_DEAD_US) * MAX_RATE,
                _outside(pilot.channels[PITCH], STICK_DEAD_US) * MAX_RATE,
                yaw_rate,
            )
            throttle = 2.0 * max(0.0, throttle) - 1.0
        else:
            rates = self._level(pilot, estimate, yaw_rate, t_s, dt)
        if MODES[self.mode].holds_depth:
            throttle = self._depth(pilot, estimate, dt)
        if MODES[self.mode].needs_position:
            forward, lateral = self._place(estimate, forward, lateral, dt)
        roll, pitch, yaw = self._rates(rates, estimate, dt)
        return roll, pitch, yaw, throttle, forward, lateral

    def _level(
        self, pilot: Pilot, estimate: Estimate, yaw_rate: float, t_s: float, dt: float
    ) -> tuple[float, float, float]:
        """Body rates that hold roll and pitch, and the heading once the yaw stick has rested for 250 ms."""
        roll = _outside(pilot.channels[ROLL], STICK_DEAD_US) * MAX_LEAN_RAD
        pitch = _outside(pilot.channels[PITCH], STICK_DEAD_US) * MAX_LEAN_RAD
        ahead = _wrap(self._heading - estimate.yaw)
        if yaw_rate:
            self._yaw_moved_s = t_s
            self._heading = estimate.yaw + clip(ahead + yaw_rate * dt, MAX_HEADING_LEAD_RAD)
        elif t_s < self._yaw_moved_s + YAW_SETTLE_S:
            self._heading, ahead = estimate.yaw, 0.0
        yaw_rate += self._params["ATC_ANG_YAW_P"] * ahead
        phi_rate = self._params["ATC_ANG_RLL_P"] * _wrap(roll - estimate.roll)
        theta_rate = self._params["ATC_ANG_PIT_P"] * (pitch - estimate.pitch)
        return clip(phi_rate, MAX_RATE), clip(theta_rate, MAX_RATE), clip(yaw_rate, MAX_YAW_RATE)

    def _rates(self, target: tuple[float, float, float], estimate: Estimate, dt: float) -> list[float]:
        measured = (estimate.rollspeed, estimate.pitchspeed, estimate.yawspeed)
        outputs = []
        for axis, name in enumerate(("RLL", "PIT", "YAW")):
            error = target[axis] - measured[axis]
            gain_p, gain_i = self._params[f"ATC_RAT_{name}_P"], self._params[f"ATC_RAT_{name}_I"]
            self._rate_integral[axis] = clip(self._rate_integral[axis] + gain_i * error * dt, 0.44)
            outputs.append(clip(gain_p * error + self._rate_integral[axis], 1.0))
        return outputs

    def _depth(self, pilot: Pilot, estimate: Estimate, dt: float) -> float:
        if self.mode == SURFACE:
            climb = SPEED_UP_M_S
        else:
            up = self._params["PILOT_SPEED_UP"] / 100.0
            down = self._params["PILOT_SPEED_DN"] / 100.0 or up
            stick = _outside(pilot.channels[THROTTLE], THROTTLE_DEAD_US)
            climb = stick * (up if stick > 0 else down)
        if climb:
            self.depth_target -= climb * dt
            self.depth_target = max(
                0.0, min(estimate.depth_m + 0.5, max(estimate.depth_m - 0.5, self.depth_target))
            )
        elif self._climbing:
            self.depth_target = estimate.depth_m - 0.15 * estimate.climb_m_s
        self._climbing = climb != 0.0
        gains = DepthGains(*(self._params[name] for name in GAINS))
        too_deep_m = estimate.depth_m - self.depth_target
        self._depth_hold = depth_hold.step(
            gains, self._depth_hold, too_deep_m, climb, estimate.climb_m_s, estimate.rise_m_s2, dt
        )
        return self._depth_hold.throttle

    def _place(self, estimate: Estimate, forward: float, lateral: float, dt: float) -> tuple[float, float]:
        """Hold x and y while the sticks rest."""
        x, y, vx, vy = estimate.position
        if self._position is None or abs(forward) > 0.05 or abs(lateral) > 0.05:
            self._position, self._position_integral = (x, y), (0.0, 0.0)
            return forward, lateral
        ex, ey = self._position[0] - x, self._position[1] - y
        ix, iy = self._position_integral
        ix, iy = clip(ix + 0.1 * ex * dt, 0.5), clip(iy + 0.1 * ey * dt, 0.5)
        self._position_integral = ix, iy
        north, east = 0.6 * ex - 0.6 * vx + ix, 0.6 * ey - 0.6 * vy + iy
        c, s = math.cos(estimate.yaw), math.sin(estimate.yaw)
        return clip(c * north + s * east, 1.0), clip(c * east - s * north, 1.0)


def _outside(pwm: int, dead_us: int) -> float:
    """-1..1 outside a dead band around 1500."""
    offset = max(-400, min(400, pwm - 1500))
    beyond = max(0, abs(offset) - dead_us)
    return math.copysign(beyond / (400 - dead_us), offset)


def _wrap(angle: float) -> float:
    return (angle + math.pi) % (2 * math.pi) - math.pi
