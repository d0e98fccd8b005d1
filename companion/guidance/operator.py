"""What an operator orders: a place, a path, a velocity, pause and resume.

Each order is taken whole or, with a ValueError that says why, not at all.
"""

import math

from companion.guidance.altitude import AltitudeHold
from companion.guidance.course import Course
from companion.guidance.orders import Order, angles, number_of
from companion.guidance.paths.shapes import Path
from companion.guidance.sources import Here, Sources
from companion.guidance.target import UNSET, known
from companion.records import PSI, Setpoint, X, Y, Z, chosen
from companion.telemetry.operator_commands import Goto, SetPath, SetVelocity


def take(order: Order, sources: Sources, here: Here) -> None:
    """Take an order. Raises ValueError for what is not possible."""
    match order:
        case Path():
            _follow(order, sources, here)
        case Goto():
            _go_to(order, sources, here)
        case SetVelocity():
            _move_at(order, sources, here)
        case SetPath(action="hold"):
            sources.hold_here(here)
        case _ if sources.course.done:
            raise ValueError("there is no path and no move under way")
        case SetPath(action="resume"):
            _resume(sources, here)
        case _:
            sources.course.paused = True


def _follow(path: Path, sources: Sources, here: Here) -> None:
    """Follow a path, from where it is, as soon as it may.

    One that leaves the fence is refused, with the place; one that counts from where it engages, then.
    """
    plan, bounds, altitude_m = path.plan, sources.bounds, number_of(path.plan.altitude_m)
    bounds.permit_altitude(altitude_m)
    sources.angles.permit(angles(plan))
    course = Course(bounds.limits, plan.speed_mps, plan.acceleration_mps2, path=path)
    if any(sources.held.engaged) or not any(path.relative[:PSI]):
        bounds.check(course, sources.standing_outside(here))
    sources.angles.ask(angles(plan))
    sources.altitude = AltitudeHold.of(altitude_m)
    sources.begin(course, UNSET)


def _go_to(order: Goto, sources: Sources, here: Here) -> None:
    """Go to a place in a straight line, or at once; coordinates that it does not name stay.

    In `order.frame` "local" it counts from the origin, else from where the move begins: "offset" north,
    east, down, or "body" forward, right, down. Refused are a place beyond the fence, north or east where
    there never was a position, an altitude that is too low, or beside a depth, a heading that the firmware
    keeps, and at once a step from here while nothing is held.
    """
    bounds, held, altitude_m = sources.bounds, sources.held, number_of(order.altitude_m)
    course, held_angles = Course.to(order, bounds.limits), angles(order)
    bounds.permit_altitude(altitude_m)
    sources.angles.permit(held_angles)
    start = sources.standing_outside(here)
    goal = course.goal(start)
    named = known((goal[X], goal[Y], altitude_m if math.isnan(goal[Z]) else goal[Z], goal[PSI]))
    if not math.isnan(altitude_m) and not math.isnan(goal[Z]):
        raise ValueError("depth_m and altitude_m: name one of them")
    if named[PSI] and not bounds.config.vehicle.holds_heading:
        raise ValueError("heading_deg: in STABILIZE the firmware keeps the heading")
    if order.at_once and order.frame != "local" and not any(held.engaged):
        raise ValueError("at_once: nothing is held, so there is no place to count from; engage first")
    unheld = any(held.engaged) and held.lacks_position and not held.lost
    if any(named[:Z]) and unheld and not held.has_position:
        raise ValueError(
            "there is no position: x and y are not held, and north and east mean nothing. Go by depth "
            "and heading, or connect a DVL, a USBL or vision that the autopilot uses (docs/guidance.md)"
        )
    if any(held.engaged) or order.frame == "local":
        bounds.check(course, start)
    asked = chosen(named, UNSET, sources.target.asked.eta_d)
    if any(named) and order.at_once:
        sources.aim(Setpoint(chosen(known(goal), goal, asked)), here.frame)
    elif any(named):
        sources.begin(course, asked)
    sources.angles.ask(held_angles)
    if named[Z]:
        sources.altitude = AltitudeHold.of(altitude_m)


def _move_at(order: SetVelocity, sources: Sources, here: Here) -> None:
    """Move at a velocity; where it ends, the place is held."""
    if not any(sources.held.engaged):
        raise ValueError("velocity: nothing is held; engage first")
    rate = math.radians(order.heading_rate_degps)
    velocity = (order.forward_mps, order.right_mps, order.down_mps, rate)
    sources.ask_velocity(here.t_s + order.lasts_s, velocity, here.frame, body=order.frame == "body")


def _resume(sources: Sources, here: Here) -> None:
    """Go on with what is paused, unless its places are not where they were."""
    course = sources.course
    if course.begun and course.displaced:
        raise ValueError(f"{course.displaced}; it cannot go on where it was interrupted. Follow it anew")
    if course.begun and not any(sources.held.engaged):
        raise ValueError("nothing is held, and it goes on from where it is held: engage first")
    if course.path is not None:
        plan = course.path.plan
        sources.angles.ask(angles(plan))
        sources.altitude = sources.altitude or AltitudeHold.of(number_of(plan.altitude_m))
    course.resume(course.frame.outside(sources.standing(here)))
