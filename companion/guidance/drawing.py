"""What a map shows beside the vehicle: path and fence, as the telemetry's `Plan`."""

from collections.abc import Callable

from companion.config import Config
from companion.guidance.paths.shapes import Path
from companion.records import Vector, VehicleState, X, Y, Z
from companion.steps import Steps
from companion.telemetry.schemas import Plan

POINTS = 400
"""Of a path about this many points are shown, and the ends of its lines."""


def drawing(
    path: tuple[Path, Callable[[Vector], Vector]] | None, number: int, config: Config, state: VehicleState
) -> Steps[Plan]:
    """Return the path that is followed, and the fence."""
    places: list[Vector] = []
    name = ""
    if path is not None:
        shape, placed = path
        name = shape.plan.name
        for place in shape.polyline(shape.length_m / POINTS):
            yield 1
            if place is not None:
                places.append(placed((*place, 0.0)))
    x_m, y_m, depth_m = (tuple(round(place[i], 3) for place in places) for i in (X, Y, Z))
    fence = config.fence
    return Plan(
        t_s=state.t_s,
        boot_s=state.boot_s,
        number=number,
        name=name,
        x_m=x_m,
        y_m=y_m,
        depth_m=depth_m,
        fenced=fence.enabled,
        fence_north_m=fence.north_m,
        fence_east_m=fence.east_m,
        fence_depth_m=fence.depth_m,
    )
