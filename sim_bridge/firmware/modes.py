"""ArduSub's flight modes: what each needs, and how it turns sticks and estimates into six demands."""

import math
from typing import NamedTuple

from sim_bridge.firmware import attitude, depth_hold
from sim_bridge.firmware.depth_hold import GAINS, DepthGains, clip
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
THROTTLE_MIDDLE = 0.5
INPUT_ANGLE = math.radians(45.0)
"""Full deflection of an angle stick."""
AXES = ("RLL", "PIT", "YAW")


class FlightControl:
    """The controllers behind the modes: attitude, depth, a simple position hold."""

    def __init__(self, params: Parameters) -> None:
        self._params = params
        self.mode = MANUAL
        self.depth_target = 0.0
        self._heading = 0.0
        self._yaw_moved_s = 0.0
        self._attitude = [attitude.relaxed(0.0, 0.0) for _ in AXES]
        self._depth_hold = depth_hold.AT_REST
        self._wanted = depth_hold.STILL
        self._throttle_in = 0.0
        """0..1: what the attitude controller was last given; MANUAL leaves it as it was."""
        self._integral_limit = params["PSC_ACCZ_IMAX"] / 500.0
        self._position: tuple[float, float] | None = None
        self._position_integral = (0.0, 0.0)

    def enter(self, mode: int, estimate: Estimate, throttle: float) -> None:
        """Start a mode at the present depth and place; `throttle` (-1..1) is what the motors have now.

        The integral of the depth loop starts from the attitude controller's throttle: after arming in MANUAL
        that is full down, and ALT_HOLD dips; less in the first dive, before the loop has widened its limit.
        """
        self.mode = mode
        self.depth_target = estimate.depth_m
        self._heading = estimate.yaw
        self._wanted = depth_hold.Wanted(
            estimate.climb_m_s, clip(estimate.rise_m_s2, depth_hold.MAX_ACCELERATION_M_S2)
        )
        integral = clip(2.0 * (self._throttle_in - THROTTLE_MIDDLE), self._integral_limit)
        self._depth_hold = depth_hold.State(0.0, 0.0, integral, throttle)
        self._position = None

    def rest(self, estimate: Estimate, t_s: float) -> None:
        """Put targets to where the vehicle is, integrals to zero: done all the time while disarmed."""
        self.depth_target = estimate.depth_m
        self._heading = estimate.yaw
        self._yaw_moved_s = t_s - YAW_SETTLE_S
        angles = (estimate.roll, estimate.pitch, estimate.yaw)
        rates = (estimate.rollspeed, estimate.pitchspeed, estimate.yawspeed)
        self._attitude = [attitude.relaxed(*both) for both in zip(angles, rates, strict=True)]
        holds_depth = MODES[self.mode].holds_depth and self.mode != SURFACE
        self._throttle_in = THROTTLE_MIDDLE if holds_depth else 0.0
        self._depth_hold = depth_hold.AT_REST
        self._wanted = depth_hold.STILL
        self._position = None

    def yaw_was_reset(self, turn_rad: float) -> None:
        """Go on holding the same true heading; a place is held anew."""
        self._heading += turn_rad
        yaw = self._attitude[2]
        self._attitude[2] = yaw._replace(angle=yaw.angle + turn_rad)
        self._position = None

    def demand(self, pilot: Pilot, estimate: Estimate | None, t_s: float, dt: float) -> Demand:
        """Six demands in -1..1. `estimate` may be None in MANUAL, which looks at no sensor."""
        forward, lateral = pilot.stick(FORWARD), pilot.stick(LATERAL)
        throttle = pilot.stick(THROTTLE)
        if self.mode == MOTOR_DETECT:
            return (0.0,) * 6
        if self.mode == MANUAL or estimate is None:
            return pilot.stick(ROLL), pilot.stick(PITCH), pilot.stick(YAW), throttle, forward, lateral
        if self.mode == ACRO:
            throttle = 2.0 * max(0.0, throttle) - 1.0
            roll, pitch, yaw = self._turn(pilot, estimate, dt)
        else:
            roll, pitch, yaw = self._level(pilot, estimate, t_s, dt)
        if MODES[self.mode].holds_depth:
            throttle = self._depth(pilot, estimate, dt)
        self._throttle_in = 0.5 * (throttle + 1.0)
        if MODES[self.mode].needs_position:
            forward, lateral = self._place(estimate, forward, lateral, dt)
        return roll, pitch, yaw, throttle, forward, lateral

    def _turn(self, pilot: Pilot, estimate: Estimate, dt: float) -> tuple[float, float, float]:
        """Demands of ACRO: the sticks are body rates."""
        params = self._params
        rates = (
            pilot.angle_stick(ROLL) * INPUT_ANGLE * params["ACRO_RP_P"],
            pilot.angle_stick(PITCH) * INPUT_ANGLE * params["ACRO_RP_P"],
            pilot.angle_stick(YAW) * INPUT_ANGLE * params["ACRO_YAW_P"],
        )
        motions = _motions(estimate)
        self._attitude = [
            attitude.follow_rate(attitude.gains(params, name), axis, rate, *motion, dt)
            for name, axis, rate, motion in zip(AXES, self._attitude, rates, motions, strict=True)
        ]
        roll, pitch, yaw = self._attitude
        return roll.demand, pitch.demand, yaw.demand

    def _level(self, pilot: Pilot, estimate: Estimate, t_s: float, dt: float) -> tuple[float, float, float]:
        """Demands that hold roll and pitch, and the heading once the yaw stick has rested for 250 ms."""
        params = self._params
        gains = [attitude.gains(params, name) for name in AXES]
        lean = math.radians(params["ANGLE_MAX"] / 100.0)
        roll, pitch, yaw = self._attitude
        roll = attitude.toward_angle(gains[0], roll, pilot.angle_stick(ROLL) * lean, math.inf, dt)
        pitch = attitude.toward_angle(gains[1], pitch, pilot.angle_stick(PITCH) * lean, math.inf, dt)
        yaw_rate = pilot.yaw_stick() * INPUT_ANGLE * params["ACRO_YAW_P"]
        if yaw_rate:
            self._yaw_moved_s = t_s
        if yaw_rate or self.mode == SURFACE or t_s < self._yaw_moved_s + YAW_SETTLE_S:
            self._heading = estimate.yaw
            yaw = attitude.toward_rate(yaw, yaw_rate, dt)
        else:
            slew = math.radians(params["ATC_SLEW_YAW"] / 100.0)
            yaw = attitude.toward_angle(gains[2], yaw, self._heading, slew, dt)
        self._attitude = [
            attitude.follow(one, axis, *motion, dt)
            for one, axis, motion in zip(gains, (roll, pitch, yaw), _motions(estimate), strict=True)
        ]
        roll, pitch, yaw = self._attitude
        return roll.demand, pitch.demand, yaw.demand

    def _depth(self, pilot: Pilot, estimate: Estimate, dt: float) -> float:
        params = self._params
        up = params["PILOT_SPEED_UP"] / 100.0
        down = params["PILOT_SPEED_DN"] / 100.0 or up
        climb = (
            min(params["WPNAV_SPEED_UP"] / 100.0, up)
            if self.mode == SURFACE
            else pilot.climb_stick(params["THR_DZ"], up, down)
        )
        self._integral_limit = 1.0
        surface_m = -params["SURFACE_DEPTH"] / 100.0
        if not climb and estimate.depth_m < surface_m:
            self.depth_target = max(self.depth_target, surface_m)
        if abs(self._depth_hold.throttle) < 1.0:
            self.depth_target -= self._wanted.climb_m_s * dt
        self._wanted = depth_hold.toward_climb(self._wanted, climb, dt)
        self._depth_hold = depth_hold.step(
            DepthGains(*(params[name] for name in GAINS)),
            self._depth_hold,
            estimate.depth_m - self.depth_target,
            self._wanted,
            up,
            estimate.climb_m_s,
            estimate.rise_m_s2,
            dt,
        )
        near_surface = clip(max(0.0, estimate.depth_m - surface_m), 1.0)
        least = params["SURFACE_MAX_THR"]
        return clip(self._depth_hold.throttle, least + (1.0 - least) * near_surface)

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


def _motions(estimate: Estimate) -> tuple[tuple[float, float], tuple[float, float], tuple[float, float]]:
    """Return angle and rate of roll, pitch and yaw."""
    e = estimate
    return (e.roll, e.rollspeed), (e.pitch, e.pitchspeed), (e.yaw, e.yawspeed)
