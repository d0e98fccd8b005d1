"""Files that hold a path: TOML as docs/guidance.md describes it, GeoJSON, KML, and QGroundControl's plan.

The last three give latitude and longitude, which become metres north and east of an origin (`degrees`).
Without one the path begins where the vehicle is when it starts. Altitude is minus the depth.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from companion.telemetry import kml, ranges
from companion.telemetry.degrees import Degrees, metres
from companion.telemetry.plan import PathPlan
from holdfast import files

NAV_WAYPOINT, LAST_NAV, CHANGE_SPEED = 16, 95, 178
"""MAV_CMD: of NAV commands, the numbers up to LAST_NAV, only waypoints are followed; others are left out."""

TRIGGER_DISTANCE, DIGICAM_CONTROL, TRIGGER_INTERVAL = 206, 203, 214
IMAGE_START, IMAGE_STOP = 2000, 2001
"""MAV_CMD that trigger the camera: they act where the waypoint before them is."""

WGS84_FRAMES = (0, 3)
"""MAV_FRAME_GLOBAL and MAV_FRAME_GLOBAL_RELATIVE_ALT: at sea both count from the surface."""

SAME_M = 0.001


def read(path: Path, origin: Degrees | None = None) -> PathPlan:
    """Return the path of a file; `origin` is latitude and longitude where x and y are 0.

    Raises ValueError naming file, key, value and what is allowed.
    """
    try:
        text = files.text(path)
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    readers = {".toml": _toml, ".geojson": _geojson, ".json": _geojson, ".kml": _kml, ".plan": _plan}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise ValueError(f"{path}: want a file that ends in {', '.join(readers)}")
    try:
        table = reader(text, origin)
        table.setdefault("name", path.stem[:64])
        return msgspec.convert(table, PathPlan)
    except msgspec.ValidationError as error:
        raise ValueError(f"{path}: {ranges.explained(table, str(error), PathPlan)}") from error
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _toml(text: str, origin: Degrees | None) -> dict[str, Any]:
    return files.toml(text)


def _geojson(text: str, origin: Degrees | None) -> dict[str, Any]:
    """Take the one LineString or Polygon of a GeoJSON (RFC 7946); its properties are keys of a plan."""
    lines = [*_geometries(files.from_json(text), {})]
    if len(lines) != 1:
        raise ValueError(f"{len(lines)} lines or polygons: want one LineString or one Polygon")
    key, coordinates, closed, properties = lines[0]
    return _along(_places(key, coordinates), origin, properties, closed=closed)


def _kml(text: str, origin: Degrees | None) -> dict[str, Any]:
    """Take the one LineString or Polygon of a KML; its Placemark's data are keys of a plan."""
    positions, closed, mode, properties = kml.line(text)
    heights = [position[2] for position in positions if len(position) > 2]
    if mode in kml.ABOVE_SEA:
        return _along(_places("coordinates", positions), origin, properties, closed=closed)
    if mode == kml.ABOVE_FLOOR:
        if len(heights) != len(positions) or max(heights) - min(heights) > SAME_M:
            raise ValueError(f"altitudeMode = {mode}: give all coordinates the same altitude over the ground")
        properties = properties | {"altitude_m": heights[0]}
    elif mode not in kml.CLAMPED:
        known = ", ".join((*kml.ABOVE_SEA, kml.ABOVE_FLOOR, *kml.CLAMPED))
        raise ValueError(f"altitudeMode = {mode:.40}: must be one of {known}")
    elif any(heights):
        raise ValueError(
            f"altitudeMode = {mode}: altitudes do not count with it; write absolute, or no altitudes"
        )
    level = [position[:2] for position in positions]
    return _along(_places("coordinates", level), origin, properties, closed=closed)


def _places(key: str, positions: Sequence[Any]) -> list[tuple[float, float, float | None]]:
    """Return latitude, longitude and depth of longitude, latitude and, where it is given, altitude."""
    places = []
    for k, position in enumerate(positions):
        where = f"{key}[{k}]"
        if not isinstance(position, Sequence) or len(position) not in (2, 3):
            raise ValueError(f"{where} = {position!r:.80}: want longitude, latitude, or with altitude")
        depth = -_number(f"{where}[2]", position[2], -1e4, 0.0) if len(position) == 3 else None
        places.append((*_degrees(where, position[1], position[0]), depth))
    return places


def _along(
    places: list[tuple[float, float, float | None]],
    origin: Degrees | None,
    properties: Mapping[str, Any],
    *,
    closed: bool,
) -> dict[str, Any]:
    """Return the plan of a line; of its properties those count that are keys of a plan."""
    if closed and len(places) > 1 and places[0] == places[-1]:
        places = places[:-1]
    known = PathPlan.__struct_fields__
    table = {name: value for name, value in properties.items() if name in known and value is not None}
    return table | _local(places, origin) | ({"closed": True} if closed else {})


def _geometries(node: Any, properties: Mapping[str, Any], key: str = "") -> Any:
    if not isinstance(node, dict):
        raise ValueError(f"{key or 'all of it'}: want a GeoJSON object")
    kind, dot = node.get("type"), f"{key}." if key else ""
    if kind == "FeatureCollection":
        features = node.get("features") or []
        if not isinstance(features, list):
            raise ValueError(f"{dot}features: want a list")
        for k, feature in enumerate(features):
            yield from _geometries(feature, {}, f"{dot}features[{k}]")
    elif kind == "Feature":
        properties = node.get("properties") or {}
        if not isinstance(properties, dict):
            raise ValueError(f"{dot}properties: want an object")
        yield from _geometries(node.get("geometry"), properties, f"{dot}geometry")
    elif kind in ("LineString", "Polygon"):
        coordinates = node.get("coordinates")
        if kind == "Polygon":
            if not isinstance(coordinates, list) or len(coordinates) != 1:
                raise ValueError(f"{dot}coordinates: want a Polygon without holes")
            coordinates = coordinates[0]
        if not isinstance(coordinates, list):
            raise ValueError(f"{dot}coordinates: want a list of positions")
        yield f"{dot}coordinates", coordinates, kind == "Polygon", properties


def _plan(text: str, origin: Degrees | None) -> dict[str, Any]:
    """Take the waypoints of QGroundControl's plan file (its user guide, "Plan File Format")."""
    table = files.from_json(text)
    mission = table.get("mission") if isinstance(table, dict) else None
    items = mission.get("items") if isinstance(mission, dict) else None
    if not isinstance(items, list) or table.get("fileType") != "Plan":
        raise ValueError('fileType, mission.items: want "Plan" and a list, as QGroundControl writes them')
    places: list[tuple[float, float, float | None]] = []
    more: list[dict[str, Any]] = []
    first: dict[str, Any] = {}
    """What was said before the first waypoint is about it."""
    speed = None
    for key, item in _simple_items(items, "mission.items"):
        command, params = item.get("command"), item.get("params")
        if command == CHANGE_SPEED and isinstance(params, list) and len(params) > 1 and speed is None:
            speed = params[1]
        if triggered := _triggers(key, command, params):
            (more[-1] if more else first).update(triggered)
        if command != NAV_WAYPOINT:
            if isinstance(command, int) and command < LAST_NAV:
                raise ValueError(f"{key}.command = {command}: only waypoints ({NAV_WAYPOINT}) are followed")
            continue
        if item.get("frame") not in WGS84_FRAMES:
            raise ValueError(f"{key}.frame = {item.get('frame')!r}: must be one of {WGS84_FRAMES}")
        if not isinstance(params, list) or len(params) < 7:
            raise ValueError(f"{key}.params: want seven numbers")
        hold, radius, _, yaw, latitude, longitude, altitude = params[:7]
        depth = -_number(f"{key}.params[6] (altitude; minus the depth)", altitude, -1e4, 0.0)
        places.append((*_degrees(f"{key}.params[4..5]", latitude, longitude), depth))
        extra: dict[str, Any] = {} if more else first
        if hold:
            extra["wait_s"] = _number(f"{key}.params[0] (hold)", hold, 0.0, 3600.0)
        if radius:
            extra["corner_m"] = _number(f"{key}.params[1] (acceptance radius)", radius, 0.0, 100.0)
        if yaw is not None:
            extra["heading_deg"] = _number(f"{key}.params[3] (yaw)", yaw, -360.0, 360.0)
        more.append(extra)
    found = _local(places, origin)
    found["waypoint"] = [place | extra for place, extra in zip(found["waypoint"], more, strict=True)]
    return found | ({"speed_mps": speed} if speed else {})


def _triggers(key: str, command: Any, params: Any) -> dict[str, Any]:
    """Return what a camera's command means for the waypoint before it; empty for another command."""
    if command not in (TRIGGER_DISTANCE, DIGICAM_CONTROL, TRIGGER_INTERVAL, IMAGE_START, IMAGE_STOP):
        return {}
    if not isinstance(params, list) or len(params) < 7:
        raise ValueError(f"{key}.params: want seven numbers")
    if command == TRIGGER_DISTANCE:
        return {"trigger_every_m": _number(f"{key}.params[0] (distance)", params[0], 0.0, 1000.0)}
    if command == IMAGE_STOP:
        return {"trigger_every_m": 0.0}
    if command == TRIGGER_INTERVAL or (command == IMAGE_START and params[2] != 1):
        raise ValueError(f"{key}.command = {command}: triggers by time; plan it with a trigger distance")
    return {"trigger": True} if command == IMAGE_START or params[4] == 1 else {}


def _simple_items(items: Sequence[Any], key: str) -> Any:
    for k, item in enumerate(items):
        if not isinstance(item, dict):
            raise ValueError(f"{key}[{k}]: want an object")
        survey = item.get("TransectStyleComplexItem")
        if isinstance(survey, dict) and isinstance(survey.get("Items"), list):
            yield from _simple_items(survey["Items"], f"{key}[{k}].TransectStyleComplexItem.Items")
        else:
            yield f"{key}[{k}]", item


def _local(places: Sequence[tuple[float, float, float | None]], origin: Degrees | None) -> dict[str, Any]:
    """Return the waypoints, north and east of the origin, or else of the first of them."""
    if not places:
        raise ValueError("there is no waypoint in it")
    zero = origin or places[0][:2]
    waypoints = []
    for latitude, longitude, depth in places:
        x_m, y_m = metres((latitude, longitude), zero)
        waypoints.append({"x_m": x_m, "y_m": y_m, **({} if depth is None else {"depth_m": depth})})
    return {"waypoint": waypoints, "relative": origin is None}


def _degrees(key: str, latitude: Any, longitude: Any) -> Degrees:
    return (
        _number(f"{key} (latitude)", latitude, -90.0, 90.0),
        _number(f"{key} (longitude)", longitude, -180.0, 180.0),
    )


def _number(key: str, value: Any, low: float, high: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise ValueError(f"{key} = {value!r:.40}: must be {low:g} to {high:g}")
    return float(value)
