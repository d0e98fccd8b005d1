"""What a map shows beside the vehicle: path and fence, as the telemetry's `Plan`."""

from collections.abc import Callable

from companion.config import Config
from companion.guidance.paths.shapes import Path
from companion.records import Vector, VehicleState
from companion.steps import Steps
from companion.telemetry.schemas import Plan

POINTS = 400
"""About so many of a path, and the ends of its lines."""


def drawing(
    path: tuple[Path, Callable[[Vector], Vector]] | None, number: int, config: Config, state: VehicleState
) -> Steps[Plan]:
    """Return the path that is followed, and the fence."""
    x_m: list[float] = []
    y_m: list[float] = []
    depth_m: list[float] = []
    name = ""
    if path is not None:
        shape, placed = path
        name = shape.plan.name
        for place in shape.polyline(shape.length_m / POINTS):
            yield 1
            if place is not None:
                x, y, z, _ = placed((*place, 0.0))
                x_m.append(round(x, 3))
                y_m.append(round(y, 3))
                depth_m.append(round(z, 3))
    fence = config.fence
    return Plan(
        t_s=state.t_s,
        boot_s=state.boot_s,
        number=number,
        name=name,
        x_m=tuple(x_m),
        y_m=tuple(y_m),
        depth_m=tuple(depth_m),
        fenced=fence.enabled,
        fence_north_m=fence.north_m,
        fence_east_m=fence.east_m,
        fence_depth_m=fence.depth_m,
    )
