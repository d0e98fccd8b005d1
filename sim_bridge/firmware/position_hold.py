"""ArduSub's horizontal position loop: place to velocity to acceleration to effort; P-PI.

Vectors are complex numbers, north + 1j · east, in m, m/s, m/s².

| name        | meaning                                            | parameter      |
|-------------|----------------------------------------------------|----------------|
| place_p     | velocity wanted by an error of place, 1/s          | PSC_POSXY_P    |
| velocity_p  | acceleration wanted by an error of velocity, 1/s   | PSC_VELXY_P    |
| velocity_i  | its integral, 1/s²                                 | PSC_VELXY_I    |
| integral    | bound of the integral, m/s²                        | PSC_VELXY_IMAX |
| filter_hz   | low-pass of the error of velocity                  | PSC_VELXY_FLTE |
"""

import cmath
import math
from typing import NamedTuple

from sim_bridge.firmware.params import Parameters
from sim_bridge.firmware.shaping import braking, clip, smoothing

GRAVITY = 9.80665
FULL_EFFORT_RAD = math.radians(45.0)
"""ANGLE_MAX: the lean that a copter would need counts as full effort, although this vehicle does not lean."""


class Gains(NamedTuple):
    """Parameters of the loop, as in the table above."""

    place_p: float
    velocity_p: float
    velocity_i: float
    integral: float
    filter_hz: float


class Limits(NamedTuple):
    """How the target moves, and how fast the loop goes after it: m/s, m/s², m/s³."""

    speed: float
    acceleration: float
    jerk: float


class Wanted(NamedTuple):
    """Place, velocity and acceleration of the target."""

    place: complex
    velocity: complex = 0j
    acceleration: complex = 0j


class State(NamedTuple):
    """What the loop remembers.

    `velocity_error` is None until the first step; `held_back` is the acceleration that could not be had.
    """

    wanted: Wanted
    place_error: complex = 0j
    velocity_error: complex | None = None
    integral: complex = 0j
    acceleration: complex = 0j
    held_back: complex = 0j


def gains(params: Parameters) -> Gains:
    """Return the loop's parameters."""
    return Gains(
        params["PSC_POSXY_P"],
        params["PSC_VELXY_P"],
        params["PSC_VELXY_I"],
        params["PSC_VELXY_IMAX"] / 100.0,
        params["PSC_VELXY_FLTE"],
    )


def stopping(gains: Gains, limits: Limits, place: complex, velocity: complex) -> State:
    """Return a loop at rest whose target lies where the vehicle would come to rest."""
    speed = abs(velocity)
    if not speed:
        return State(Wanted(place))
    return State(
        Wanted(place + velocity / speed * _braking_m(min(speed, limits.speed), gains.place_p, limits))
    )


def toward_velocity(limits: Limits, state: State, velocity: complex, dt: float) -> State:
    """Move the target by `dt` (s), on its way to a velocity."""
    moved = _moved(state, dt)
    return state._replace(wanted=_hastened(limits, moved, velocity, dt))


def toward_place(limits: Limits, state: State, place: complex, velocity: complex, dt: float) -> State:
    """Move the target by `dt` (s), on its way to a place that itself moves at `velocity`."""
    moved = _moved(state, dt)
    p = 0.5 * limits.jerk / limits.acceleration
    approach = _toward(place - moved.place, p, 0.5 * limits.acceleration, dt)
    return state._replace(wanted=_hastened(limits, moved, bounded(approach, limits.speed) + velocity, dt))


def step(
    gains: Gains, limits: Limits, state: State, place: complex, velocity: complex, most_m_s2: float, dt: float
) -> State:
    """Advance the loop by `dt` (s): `acceleration` of the result is what is asked, `most_m_s2` at most."""
    wanted = state.wanted
    farthest = _braking_m(limits.speed, gains.place_p, limits)
    place_error = bounded(wanted.place - place, farthest)
    lacking = _toward(place_error, gains.place_p, limits.acceleration, dt) + wanted.velocity - velocity
    error = lacking
    if state.velocity_error is not None:
        error = state.velocity_error + smoothing(gains.filter_hz, dt) * (lacking - state.velocity_error)
    growth = gains.velocity_i * error * dt
    integral = state.integral + growth
    if _along(growth, state.held_back) > 0.0:
        integral = bounded(integral, abs(state.integral))
    integral = bounded(integral, gains.integral)
    asked = gains.velocity_p * error + integral + wanted.acceleration
    acceleration = bounded(asked, most_m_s2)
    return State(
        wanted._replace(place=place + place_error),
        place_error,
        error,
        integral,
        acceleration,
        0j if acceleration == asked else asked,
    )


def efforts(acceleration: complex, yaw: float) -> tuple[float, float]:
    """Return forward and lateral effort, -1..1: leans that would accelerate a copter so, over ANGLE_MAX."""
    ahead = acceleration * cmath.exp(-1j * yaw)
    pitch = math.atan(ahead.real / GRAVITY)
    roll = math.atan(ahead.imag * math.cos(pitch) / GRAVITY)
    return clip(pitch / FULL_EFFORT_RAD, 1.0), clip(roll / FULL_EFFORT_RAD, 1.0)


def bounded(vector: complex, length: float) -> complex:
    """Return the vector, shortened to a length where it is longer."""
    size = abs(vector)
    return vector * (length / size) if size > length else vector


def _moved(state: State, dt: float) -> Wanted:
    """Return the target `dt` later; where effort is lacking it does not run further away."""
    place, velocity, acceleration = state.wanted
    held_back, slip = state.held_back, state.velocity_error or 0j
    way = velocity * dt + 0.5 * acceleration * dt * dt
    if _along(way, held_back) > 0.0 and _along(state.place_error, held_back) > 0.0:
        way = 0j
    gain = acceleration * dt
    if min(_along(gain, held_back), _along(slip, held_back)) > 0.0 and _along(velocity, held_back) >= 0.0:
        gain = 0j
    return Wanted(place + way, velocity + gain, acceleration)


def _hastened(limits: Limits, moved: Wanted, velocity: complex, dt: float) -> Wanted:
    hasten = _toward(velocity - moved.velocity, limits.jerk / limits.acceleration, limits.jerk, dt)
    change = bounded(hasten, limits.acceleration) - moved.acceleration
    return moved._replace(acceleration=moved.acceleration + bounded(change, limits.jerk * dt))


def _toward(error: complex, p: float, most: float, dt: float) -> complex:
    size = abs(error)
    return error * (braking(size, p, most, dt) / size) if size else 0j


def _braking_m(speed: float, p: float, limits: Limits) -> float:
    """Return how far away `braking` asks for a speed."""
    if p <= 0.0:
        return speed * speed / (2.0 * limits.acceleration)
    linear = limits.acceleration / p
    if speed <= linear:
        return speed / p
    return speed * speed / (2.0 * limits.acceleration) + 0.5 * linear / p


def _along(a: complex, b: complex) -> float:
    return a.real * b.real + a.imag * b.imag
