"""ArduSub's flight modes: what each needs, and how it turns sticks and estimates into six demands."""

import math

from sim_bridge.firmware import attitude_loop, depth_hold
from sim_bridge.firmware.depth_hold import GAINS, DepthGains
from sim_bridge.firmware.mixer import Demand
from sim_bridge.firmware.params import Parameters
from sim_bridge.firmware.pilot_input import FORWARD, LATERAL, PITCH, ROLL, THROTTLE, YAW, Pilot
from sim_bridge.firmware.shaping import clip
from sim_bridge.physics.sensors import Estimate

STABILIZE, ALT_HOLD, GUIDED, SURFACE, POSHOLD, MANUAL = 0, 2, 4, 9, 16, 19
NAMES = {
    **{0: "STABILIZE", 1: "ACRO", 2: "ALT_HOLD", 3: "AUTO", 4: "GUIDED", 7: "CIRCLE", 9: "SURFACE"},
    **{16: "POSHOLD", 19: "MANUAL", 20: "MOTOR_DETECT", 21: "SURFTRAK"},
}
NEED_POSITION, NOT_IMITATED = (3, GUIDED, 7, POSHOLD), (1, 20, 21)
"""Modes that the stand-in refuses: those that steer to a place as ArduSub does without a position."""

YAW_SETTLE_S = 0.25
THROTTLE_MIDDLE = 0.5
INPUT_ANGLE = math.radians(45.0)
"""Full deflection of an angle stick."""
AXES = ("RLL", "PIT", "YAW")


class FlightControl:
    """The controllers behind the modes: attitude and depth."""

    def __init__(self, params: Parameters) -> None:
        self._params = params
        self.mode = MANUAL
        self.depth_target = 0.0
        self._heading = 0.0
        self._yaw_moved_s = 0.0
        self._attitude = [attitude_loop.relaxed(0.0, 0.0) for _ in AXES]
        self._attitude_gains: list[attitude_loop.AttitudeGains] = []
        self._gains_as_of = -1
        self._depth_hold = depth_hold.AT_REST
        self._wanted = depth_hold.STILL
        self._throttle_in = 0.0
        """0..1: what the attitude controller was last given; MANUAL leaves it as it was."""
        self._integral_limit = params["PSC_ACCZ_IMAX"] / 500.0

    def enter(self, mode: int, estimate: Estimate, throttle: float) -> None:
        """Start a mode at the present depth; `throttle` (-1..1) is what the motors have now.

        The integral of the depth loop starts from the attitude controller's throttle: after arming in MANUAL
        that is full down, and ALT_HOLD dips; less in the first dive, before the loop has widened its limit.
        """
        self.mode = mode
        self.depth_target = estimate.depth_m
        self._heading = estimate.yaw
        self._wanted = depth_hold.ClimbTarget(
            estimate.climb_m_s, clip(estimate.rise_m_s2, depth_hold.MAX_ACCELERATION_M_S2)
        )
        integral = clip(2.0 * (self._throttle_in - THROTTLE_MIDDLE), self._integral_limit)
        self._depth_hold = depth_hold.DepthLoop(0.0, 0.0, integral, throttle)

    def rest(self, estimate: Estimate, t_s: float) -> None:
        """Put targets to where the vehicle is, integrals to zero: done all the time while disarmed."""
        self.depth_target = estimate.depth_m
        self._heading = estimate.yaw
        self._yaw_moved_s = t_s - YAW_SETTLE_S
        self._attitude = [attitude_loop.relaxed(*motion) for motion in _motions(estimate)]
        self._throttle_in = THROTTLE_MIDDLE if self.mode == ALT_HOLD else 0.0
        self._depth_hold = depth_hold.AT_REST
        self._wanted = depth_hold.STILL

    def yaw_was_reset(self, turn_rad: float) -> None:
        """Go on holding the same true heading."""
        self._heading += turn_rad
        yaw = self._attitude[2]
        self._attitude[2] = yaw._replace(angle=yaw.angle + turn_rad)

    def demand(self, pilot: Pilot, estimate: Estimate | None, t_s: float, dt: float) -> Demand:
        """Six demands in -1..1. `estimate` may be None in MANUAL, which looks at no sensor."""
        forward, lateral = pilot.stick(FORWARD), pilot.stick(LATERAL)
        throttle = pilot.stick(THROTTLE)
        if self.mode == MANUAL or estimate is None:
            return pilot.stick(ROLL), pilot.stick(PITCH), pilot.stick(YAW), throttle, forward, lateral
        roll, pitch, yaw = self._level(pilot, estimate, t_s, dt)
        if self.mode in (ALT_HOLD, SURFACE):
            throttle = self._depth(pilot, estimate, dt)
        self._throttle_in = 0.5 * (throttle + 1.0)
        return roll, pitch, yaw, throttle, forward, lateral

    def _gains(self) -> list[attitude_loop.AttitudeGains]:
        """Return the attitude loop's gains, read again where a parameter was set."""
        params = self._params
        if self._gains_as_of != params.changes:
            self._attitude_gains = [attitude_loop.gains(params, name) for name in AXES]
            self._gains_as_of = params.changes
        return self._attitude_gains

    def _level(self, pilot: Pilot, estimate: Estimate, t_s: float, dt: float) -> tuple[float, float, float]:
        """Demands that hold roll and pitch, and the heading once the yaw stick has rested for 250 ms."""
        params = self._params
        gains = self._gains()
        lean = math.radians(params["ANGLE_MAX"] / 100.0)
        roll, pitch, yaw = self._attitude
        roll = attitude_loop.toward_angle(gains[0], roll, pilot.angle_stick(ROLL) * lean, math.inf, dt)
        pitch = attitude_loop.toward_angle(gains[1], pitch, pilot.angle_stick(PITCH) * lean, math.inf, dt)
        rate = self._turning(pilot, estimate, t_s)
        if rate is not None:
            yaw = attitude_loop.toward_rate(yaw, rate, dt)
        else:
            slew = math.radians(params["ATC_SLEW_YAW"] / 100.0)
            yaw = attitude_loop.toward_angle(gains[2], yaw, self._heading, slew, dt)
        self._attitude = [
            attitude_loop.follow(loop, axis, *motion, dt)
            for loop, axis, motion in zip(gains, (roll, pitch, yaw), _motions(estimate), strict=True)
        ]
        roll, pitch, yaw = self._attitude
        return roll.demand, pitch.demand, yaw.demand

    def _turning(self, pilot: Pilot, estimate: Estimate, t_s: float) -> float | None:
        """Return the yaw rate that is wanted (rad/s); None where `_heading` is held."""
        full = INPUT_ANGLE * self._params["ACRO_YAW_P"]
        rate = pilot.yaw_stick() * full
        if rate:
            self._yaw_moved_s = t_s
        if rate or self.mode == SURFACE or t_s < self._yaw_moved_s + YAW_SETTLE_S:
            self._heading = estimate.yaw
            return rate
        return None

    def _depth(self, pilot: Pilot, estimate: Estimate, dt: float) -> float:
        """Throttle that keeps the depth, and moves it as the pilot asks."""
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


def _motions(estimate: Estimate) -> tuple[tuple[float, float], tuple[float, float], tuple[float, float]]:
    """Return angle and rate of roll, pitch and yaw."""
    e = estimate
    return (e.roll, e.rollspeed), (e.pitch, e.pitchspeed), (e.yaw, e.yawspeed)
