"""The targets of the ground station: SET_POSITION_TARGET_… and SET_ATTITUDE_TARGET."""

import math
from collections.abc import Sequence

from companion.core.bounds import wrap
from companion.core.positioning import jacobian, to_inertial
from companion.estimation.frame import Frame
from companion.guidance.sources import Here, Sources
from companion.guidance.target import from_here, known
from companion.records import (
    PSI,
    ZERO,
    AttitudeTarget,
    Event,
    PositionTarget,
    Setpoint,
    Vector,
    X,
    chosen,
)

VELOCITY_LASTS_S = 1.0
"""How long a velocity lasts after its message; they come at some Hz."""


def take(events: Sequence[Event], sources: Sources, here: Here) -> None:
    """Take the targets that came in this tick.

    A place replaces the target, no further than the fence; with a velocity beside it, it moves on. A velocity
    alone moves it until VELOCITY_LASTS_S after the message. Angles are held as far as they can be.
    """
    for event in events:
        if isinstance(event, AttitudeTarget):
            _take_attitude(event, sources, here.frame)
        elif isinstance(event, PositionTarget):
            _take_position(event, sources, here)


def _take_attitude(event: AttitudeTarget, sources: Sources, frame: Frame) -> None:
    if not math.isnan(event.heading):
        sources.angles.aim(event.angles)
        sources.put(Setpoint((math.nan, math.nan, math.nan, event.heading)), frame)
    if event.climb:
        w = -event.climb * sources.bounds.config.heave.max_rate
        sources.ask_velocity(event.t_s + VELOCITY_LASTS_S, (0.0, 0.0, w, 0.0), frame, body=False)


def _take_position(event: PositionTarget, sources: Sources, here: Here) -> None:
    until_s, moves = event.t_s + VELOCITY_LASTS_S, any(known(event.velocity))
    positioned = sources.held.engaged[X] or sources.held.has_position
    at = _target(event, sources.standing_outside(here), positioned=positioned)
    if any(known(at.eta_d)[:PSI]):
        sources.put(at, here.frame, until_s if moves else -math.inf)
        return
    if not math.isnan(at.eta_d[PSI]):
        sources.put(Setpoint(at.eta_d), here.frame)
    if moves:
        velocity = chosen(known(event.velocity), event.velocity, ZERO)
        sources.ask_velocity(until_s, velocity, here.frame, body=event.body)


def _target(event: PositionTarget, here: Vector, *, positioned: bool) -> Setpoint:
    """Return the target, NaN where nothing is said, with its rates; `here` is the vehicle's.

    A step north or east from here means nothing where it is not `positioned`.
    """
    x, y, z, psi = event.place
    if event.offset:
        step = (x, y, z, math.nan) if positioned else (math.nan, math.nan, z, math.nan)
        x, y, z, _ = from_here(here, step, body=event.body)
    if event.turns:
        psi = wrap(here[PSI] + psi)
    J = jacobian(here[PSI] if event.body else 0.0)
    velocity, acceleration = (
        to_inertial(J, chosen(known(rates), rates, ZERO)) for rates in (event.velocity, event.acceleration)
    )
    return Setpoint((x, y, z, psi), velocity, acceleration)
