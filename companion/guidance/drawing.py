"""What a map shows beside the vehicle: path and fence, as the telemetry's `Plan`."""

from companion.config import Config
from companion.guidance.paths.shapes import Path
from companion.records import Vector, VehicleState
from companion.telemetry.schemas import Plan

POINTS = 400
"""About so many of a path, and the ends of its lines."""


def drawn(path: tuple[Path, Vector] | None, number: int, config: Config, state: VehicleState) -> Plan:
    """Return the path that is followed, and the fence."""
    points: list[tuple[float, float, float]] = []
    name = ""
    if path is not None:
        shape, (x_0, y_0, z_0, _) = path
        name = shape.plan.name
        spacing_m = shape.length_m / POINTS
        points = [(x + x_0, y + y_0, z + z_0) for x, y, z in shape.polyline(spacing_m)]
    fence = config.fence
    return Plan(
        t_s=state.t_s,
        boot_s=state.boot_s,
        number=number,
        name=name,
        x_m=tuple(round(x, 3) for x, _, _ in points),
        y_m=tuple(round(y, 3) for _, y, _ in points),
        depth_m=tuple(round(z, 3) for _, _, z in points),
        fenced=fence.enabled,
        fence_north_m=fence.north_m,
        fence_east_m=fence.east_m,
        fence_depth_m=fence.depth_m,
    )
