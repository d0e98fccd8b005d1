"""POSHOLD and GUIDED: where the vehicle shall be, how fast, and what forward and lateral effort that takes.

GUIDED has three ways to go, as the firmware has: to a waypoint on a planned track, at a velocity, and after a
place that moves. Its heading is a matter of its own (`Turn`). Vectors are complex: north + 1j · east.
"""

import cmath
import math
from enum import Enum, auto
from typing import NamedTuple

from sim_bridge.firmware import position_hold, track
from sim_bridge.firmware.depth_hold import MAX_JERK_M_S3
from sim_bridge.firmware.params import Parameters
from sim_bridge.firmware.pilot import FORWARD, LATERAL, Pilot
from sim_bridge.firmware.position_hold import FULL_EFFORT_RAD, GRAVITY, Limits, Wanted
from sim_bridge.physics.sensors import Estimate

TIMEOUT_S = 3.0
"""A velocity that is not repeated ends after this time."""
LEAN_THROTTLE, LEAST_LEAN_RAD = 0.8, math.radians(10.0)
"""Throttle (0..1) at which no lean, and so hardly any horizontal effort, is left; and what is always left."""
SPARE = 0.05
"""Share of its speed by which a track's time may outrun the vehicle."""
FASTEST_TURN_RAD_S = math.radians(60.0)
"""AUTO_YAW_SLEW_RATE, a constant of the firmware."""
TURNED_RAD = math.radians(5.0)
"""Within this of its heading GUIDED holds it, farther off it turns at its rate."""


LEAST = 0.01
"""No speed, acceleration (m/s, m/s²) or jerk is taken lower: a parameter can be set to anything."""


class Way(Enum):
    """How GUIDED goes."""

    WAYPOINT = auto()
    VELOCITY = auto()
    MOVING_PLACE = auto()


class Turn(NamedTuple):
    """GUIDED's heading (rad) and the rate towards it, or a rate alone (rad/s).

    As the firmware has it: without any heading asked since boot it is north, and the rate is none.
    """

    heading: float = 0.0
    rate: float = 0.0
    rate_only: bool = False

    def now(self, yaw: float) -> tuple[float, float | None]:
        """Return heading and rate that are wanted; no rate where the heading is held."""
        error = math.remainder(self.heading - yaw, math.tau)
        if self.rate_only:
            return self.heading, self.rate
        return self.heading, None if abs(error) <= TURNED_RAD else math.copysign(self.rate, error)


class Vertical(NamedTuple):
    """The vertical target: height over the EKF's origin (m), m/s and m/s², positive up."""

    height: float
    climb: float = 0.0
    rise: float = 0.0


class Navigation:
    """The horizontal loop and its targets. `vertical` and `turn` are GUIDED's."""

    def __init__(self, params: Parameters) -> None:
        self._params = params
        self._gains = position_hold.gains(params)
        self._limits = Limits(1.0, 1.0, 1.0)
        self._state = position_hold.State(Wanted(0j))
        self._lean_max = 0.5 * math.pi
        self._way = Way.WAYPOINT
        self._track: track.Track | None = None
        self._progress = track.Progress()
        self._pace = 1.0
        self._origin = self._destination = (0j, 0.0)
        self._moving = (Wanted(0j), Vertical(0.0))
        self._until_s = math.inf
        self._last: Estimate | None = None
        self.vertical = Vertical(0.0)
        self.turn = Turn()

    def enter(self, estimate: Estimate, *, guided: bool) -> None:
        """Start POSHOLD or GUIDED where the vehicle will come to rest."""
        self._gains = position_hold.gains(self._params)
        self._last = estimate
        if guided:
            self.turn = self.turn._replace(rate_only=False)
            self._head_for_waypoints(estimate)
        else:
            self._limits = self._limits_of("PILOT_SPEED", "PILOT_ACCEL_Z")
            self._state = position_hold.stopping(self._gains, self._limits, *_motion(estimate))

    def shift(self, north_m: float, east_m: float) -> None:
        """Let the target follow a position that the EKF has reset."""
        wanted = self._state.wanted
        self._state = self._state._replace(
            wanted=wanted._replace(place=wanted.place + complex(north_m, east_m))
        )

    def settle_lean(self, throttle: float) -> None:
        """Take the bound of horizontal effort that a lasting throttle (0..1) leads to."""
        self._lean_max = _lean(throttle)

    def follow_throttle(self, throttle: float, dt: float) -> None:
        """Let the bound of horizontal effort follow the throttle (0..1), as a copter's that must not fall."""
        part = dt / (dt + max(0.0, self._params["ATC_ANG_LIM_TC"]))
        self._lean_max += part * (_lean(throttle) - self._lean_max)

    def hold(self, pilot: Pilot, estimate: Estimate, located: bool, dt: float) -> tuple[float, float]:
        """Return forward and lateral effort of POSHOLD: sticks are velocities; at rest it holds the place.

        Without a position the sticks are efforts.
        """
        fastest = self._params["PILOT_SPEED"] / 100.0
        dead = self._params["THR_DZ"]
        velocity = complex(*(pilot.horizontal_rate(axis, dead, fastest) for axis in (FORWARD, LATERAL)))
        if not located:
            self._state = position_hold.stopping(self._gains, self._limits, *_motion(estimate))
            return (velocity.real / fastest, velocity.imag / fastest) if fastest else (0.0, 0.0)
        over_ground = velocity * cmath.exp(1j * estimate.yaw)
        self._state = position_hold.toward_velocity(self._limits, self._state, over_ground, dt)
        return self._efforts(estimate, dt)

    def go_to(self, place: complex, height: float) -> None:
        """Let GUIDED go to a waypoint: m from the EKF's origin, height positive up."""
        assert self._last is not None
        arrived = self._track is None or self._progress.time_s >= track.duration_s(self._track)
        if self._way is not Way.WAYPOINT or not arrived:
            self._head_for_waypoints(self._last)
        self._origin, self._destination = self._destination, (place, height)
        (start, low), params = self._origin, self._params
        across, up = abs(place - start), height - low
        length = math.hypot(across, up)
        if not length:
            self._track = None
            return
        climb, rise = "WPNAV_SPEED_UP" if up > 0.0 else "WPNAV_SPEED_DN", "WPNAV_ACCEL_Z"
        jerk = max(LEAST, params["WPNAV_JERK"])
        snap = 0.25 * jerk * math.pi / max(0.1, params["ATC_INPUT_TC"])
        self._track = track.plan(
            length,
            _along(across / length, up / length, self._limits.speed, self._metres(climb)),
            _along(across / length, up / length, self._limits.acceleration, self._metres(rise)),
            jerk,
            snap,
        )
        self._progress = track.Progress()

    def go_at(self, velocity: complex, climb: float, t_s: float) -> None:
        """Let GUIDED go at a velocity (m/s) for TIMEOUT_S."""
        assert self._last is not None
        if self._way is not Way.VELOCITY:
            self._way, self._track = Way.VELOCITY, None
            self._restart(Wanted(_motion(self._last)[0]))
            self.vertical = Vertical(self._last.altitude_m)
        self._state = self._state._replace(wanted=self._state.wanted._replace(velocity=velocity))
        self.vertical = self.vertical._replace(climb=climb)
        self._until_s = t_s + TIMEOUT_S

    def follow(self, place: complex, height: float, velocity: complex, climb: float, t_s: float) -> None:
        """Let GUIDED follow a place that moves at a velocity for TIMEOUT_S."""
        assert self._last is not None
        if self._way is not Way.MOVING_PLACE:
            self._way, self._track = Way.MOVING_PLACE, None
            self._restart(Wanted(*_motion(self._last)))
            self.vertical = Vertical(self._last.altitude_m, self._last.climb_m_s)
        self._moving = Wanted(place, velocity), Vertical(height, climb)
        self._until_s = t_s + TIMEOUT_S

    def guide(self, estimate: Estimate, t_s: float, dt: float) -> tuple[float, float]:
        """Return forward and lateral effort of GUIDED, and move `vertical`."""
        self._last = estimate
        if self._way is Way.WAYPOINT:
            self._advance_track(estimate, dt)
        elif self._way is Way.VELOCITY:
            if t_s > self._until_s:
                self._state = self._state._replace(wanted=self._state.wanted._replace(velocity=0j))
                self.vertical = self.vertical._replace(climb=0.0)
            here = self._state.wanted._replace(place=_motion(estimate)[0])
            self._state = self._state._replace(wanted=here)
            height, climb, _ = self.vertical
            self.vertical = Vertical(height + climb * dt, climb)
        else:
            self._advance_place(t_s, dt)
        return self._efforts(estimate, dt)

    def _head_for_waypoints(self, estimate: Estimate) -> None:
        self._way, self._track, self._pace = Way.WAYPOINT, None, 1.0
        self._limits = self._limits_of("WPNAV_SPEED", "WPNAV_ACCEL")
        self._restart(position_hold.stopping(self._gains, self._limits, *_motion(estimate)).wanted)
        self._origin = self._destination = (self._state.wanted.place, estimate.altitude_m)
        self.vertical = Vertical(estimate.altitude_m)

    def _restart(self, wanted: Wanted) -> None:
        """Go after another target without a step in effort."""
        asked = self._state.acceleration
        self._state = position_hold.State(wanted, integral=asked, acceleration=asked)

    def _advance_track(self, estimate: Estimate, dt: float) -> None:
        """Move the target along its track, whose time runs no faster than the vehicle can follow."""
        (start, low), (end, high), way = self._origin, self._destination, self._track
        if way is None:
            self._state = self._state._replace(wanted=Wanted(end))
            self.vertical = Vertical(high)
            return
        north_east, up = (end - start) / way.length, (high - low) / way.length
        pace = 1.0
        if speed := self._progress.speed:
            place, velocity = _motion(estimate)
            error = _dot(self._state.wanted.place - place, north_east) + up * (
                self.vertical.height - estimate.altitude_m
            )
            made_good = _dot(velocity, north_east) + up * estimate.climb_m_s
            pace = max(0.0, min(1.0, SPARE + (made_good - self._gains.place_p * error) / speed))
        self._pace += (pace - self._pace) * dt * self._params["WPNAV_JERK"] / self._limits.acceleration
        self._progress = track.advance(way, self._progress, self._pace * dt)
        _, far, speed, rise = self._progress
        self._state = self._state._replace(
            wanted=Wanted(start + north_east * far, north_east * speed, north_east * rise)
        )
        self.vertical = Vertical(low + up * far, up * speed, up * rise)

    def _advance_place(self, t_s: float, dt: float) -> None:
        """Move the target; a place goes twice as fast as asked, as the firmware adds its velocity twice."""
        place, vertical = self._moving
        if t_s > self._until_s:
            place, vertical = place._replace(velocity=0j), vertical._replace(climb=0.0)
        place = place._replace(place=place.place + 2.0 * place.velocity * dt)
        vertical = vertical._replace(height=vertical.height + 2.0 * vertical.climb * dt)
        self._moving = place, vertical
        self._state = position_hold.toward_place(self._limits, self._state, place.place, place.velocity, dt)
        limits = Limits(self._metres("WPNAV_SPEED_UP"), self._metres("WPNAV_ACCEL_Z"), MAX_JERK_M_S3)
        upwards = position_hold.State(Wanted(*map(complex, self.vertical)))
        moved = position_hold.toward_place(
            limits, upwards, complex(vertical.height), complex(vertical.climb), dt
        )
        self.vertical = Vertical(*(part.real for part in moved.wanted))

    def _efforts(self, estimate: Estimate, dt: float) -> tuple[float, float]:
        most = GRAVITY * math.tan(min(FULL_EFFORT_RAD, self._lean_max))
        place, velocity = _motion(estimate)
        self._state = position_hold.step(self._gains, self._limits, self._state, place, velocity, most, dt)
        return position_hold.efforts(self._state.acceleration, estimate.yaw)

    def _limits_of(self, speed: str, acceleration: str) -> Limits:
        jerk = max(LEAST, self._params["PSC_JERK_XY"])
        return Limits(self._metres(speed), self._metres(acceleration), jerk)

    def _metres(self, name: str) -> float:
        """Return a parameter in cm as m, and at least LEAST."""
        return max(LEAST, self._params[name] / 100.0)


def _motion(estimate: Estimate) -> tuple[complex, complex]:
    north, east, v_north, v_east = estimate.position
    return complex(north, east), complex(v_north, v_east)


def _lean(throttle: float) -> float:
    return max(LEAST_LEAN_RAD, math.acos(max(0.0, min(1.0, throttle / LEAN_THROTTLE))))


def _along(across: float, up: float, most_across: float, most_up: float) -> float:
    """Return the limit along a direction, whose parts are limited each."""
    limits = [most / abs(part) for part, most in ((across, most_across), (up, most_up)) if part]
    return min(limits)


def _dot(a: complex, b: complex) -> float:
    return a.real * b.real + a.imag * b.imag
