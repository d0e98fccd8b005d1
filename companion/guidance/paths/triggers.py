"""Where along a path the camera is triggered: by distance, and at waypoints."""

from array import array
from collections.abc import Sequence

from msgspec import UnsetType

from companion.steps import Steps
from companion.telemetry.plan import PathPlan, Waypoint

APART_M = 0.01
"""Two triggers that are closer are one."""
MAX_TRIGGERS = 100_000
"""Of a lap."""

Station = tuple[float, Waypoint]
"""A waypoint, and how far along a lap it is, m."""


def triggers(plan: PathPlan, stations: Sequence[Station], length_m: float) -> Steps["array[float]"]:
    """Return how far along a lap each trigger is; raise ValueError, with the key, where there can be none.

    A distance counts from where it was given: the start of the path, or a waypoint.
    """
    given = plan.trigger
    every_m, everywhere = 0.0, False
    if not isinstance(given, UnsetType):
        every_m = 0.0 if isinstance(given.every_m, UnsetType) else given.every_m
        everywhere = given.at_waypoints
        if everywhere and not stations:
            raise ValueError("trigger.at_waypoints: this shape has no waypoints: give trigger.every_m")
        own = (waypoint.trigger or waypoint.trigger_every_m for _, waypoint in stations)
        if not (every_m or everywhere or any(own)):
            raise ValueError("trigger: give every_m, or at_waypoints = true")
    found = array("d")
    since_m, count = 0.0, 0
    for at_m, waypoint in (*stations, (length_m, None)):
        while every_m and (place_m := since_m + count * every_m) <= at_m:
            _add(found, place_m)
            count += 1
            yield 1
        if waypoint is None:
            break
        if not isinstance(waypoint.trigger_every_m, UnsetType):
            every_m, since_m, count = waypoint.trigger_every_m, at_m, 0
        if waypoint.trigger or everywhere:
            _add(found, at_m)
    return found


def _add(found: "array[float]", place_m: float) -> None:
    if not found or place_m - found[-1] >= APART_M:
        found.append(place_m)
    if len(found) > MAX_TRIGGERS:
        raise ValueError(f"trigger.every_m: makes more than {MAX_TRIGGERS} triggers: choose a larger one")
