"""Files that hold a path: TOML as docs/guidance.md describes it, and QGroundControl's plan.

A plan gives latitude and longitude, which become metres north and east of an origin (`degrees`).
Without one the path begins where the vehicle is when it starts. Altitude is minus the depth.
"""

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from companion.telemetry.degrees import Degrees, metres
from companion.telemetry.plan import PathPlan
from holdfast import files, validation
from holdfast.command_line import located

LOG = logging.getLogger("holdfast")
NAV_WAYPOINT, LAST_NAV, CHANGE_SPEED = 16, 95, 178
"""MAV_CMD: of NAV commands, the numbers up to LAST_NAV, only waypoints are followed; others are left out."""

WGS84_FRAMES = (0, 3)
"""MAV_FRAME_GLOBAL and MAV_FRAME_GLOBAL_RELATIVE_ALT: at sea both count from the surface."""


def read(path: Path, origin: Degrees | None = None) -> PathPlan:
    """Return the path of a file; `origin` is latitude and longitude where x and y are 0.

    Raises ValueError naming file, key, value and what is allowed.
    """
    suffix = path.suffix.lower()
    if suffix not in (".toml", ".plan"):
        raise ValueError(f"{path}: want a .toml (docs/guidance.md), or a .plan, as QGroundControl saves it")
    try:
        text = files.text(path)
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    try:
        table = files.toml(text) if suffix == ".toml" else _plan(text, origin)
        table.setdefault("name", path.stem[:64])
        return msgspec.convert(table, PathPlan)
    except msgspec.ValidationError as error:
        said = validation.explained(table, str(error), PathPlan)
        raise ValueError(located(path, (), said)) from error
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _plan(text: str, origin: Degrees | None) -> dict[str, Any]:
    """Take the waypoints of QGroundControl's plan file (its user guide, "Plan File Format")."""
    table = files.from_json(text)
    mission = table.get("mission") if isinstance(table, dict) else None
    items = mission.get("items") if isinstance(mission, dict) else None
    if not isinstance(items, list) or table.get("fileType") != "Plan":
        raise ValueError('fileType, mission.items: want "Plan" and a list, as QGroundControl writes them')
    places: list[Degrees] = []
    waypoints: list[dict[str, Any]] = []
    speed = None
    left_out: set[int] = set()
    for key, item in _simple_items(items, "mission.items"):
        command, params = item.get("command"), item.get("params")
        if command == CHANGE_SPEED and isinstance(params, list) and len(params) > 1 and speed is None:
            speed = params[1]
        if command != NAV_WAYPOINT:
            if isinstance(command, int) and command < LAST_NAV:
                raise ValueError(f"{key}.command = {command}: only waypoints ({NAV_WAYPOINT}) are followed")
            if isinstance(command, int) and command != CHANGE_SPEED:
                left_out.add(command)
            continue
        if item.get("frame") not in WGS84_FRAMES:
            raise ValueError(f"{key}.frame = {item.get('frame')!r}: must be one of {WGS84_FRAMES}")
        if not isinstance(params, list) or len(params) < 7:
            raise ValueError(f"{key}.params: want seven numbers")
        hold, radius, _, yaw, latitude, longitude, altitude = params[:7]
        depth = -_number(f"{key}.params[6] (altitude; minus the depth)", altitude, -1e4, 0.0)
        places.append(_degrees(f"{key}.params[4..5]", latitude, longitude))
        waypoints.append({"depth_m": depth} | _extra(key, hold, radius, yaw))
    if not places:
        raise ValueError("there is no waypoint in it")
    for place, waypoint in zip(places, waypoints, strict=True):
        waypoint["x_m"], waypoint["y_m"] = metres(place, origin or places[0])
    if left_out:
        LOG.warning("mission.items: commands %s are no waypoints, and are left out", sorted(left_out)[:9])
    found = {"waypoint": waypoints, "relative": origin is None}
    return found | ({"speed_mps": speed} if speed else {})


def _extra(key: str, hold: Any, radius: Any, yaw: Any) -> dict[str, Any]:
    extra: dict[str, Any] = {}
    if hold:
        extra["wait_s"] = _number(f"{key}.params[0] (hold)", hold, 0.0, 3600.0)
    if radius:
        extra["corner_m"] = _number(f"{key}.params[1] (acceptance radius)", radius, 0.0, 100.0)
    if yaw is not None:
        extra["heading_deg"] = _number(f"{key}.params[3] (yaw)", yaw, -360.0, 360.0)
    return extra


def _simple_items(items: Sequence[Any], key: str) -> Any:
    for k, item in enumerate(items):
        if not isinstance(item, dict):
            raise ValueError(f"{key}[{k}]: want an object")
        survey = item.get("TransectStyleComplexItem")
        if isinstance(survey, dict) and isinstance(survey.get("Items"), list):
            yield from _simple_items(survey["Items"], f"{key}[{k}].TransectStyleComplexItem.Items")
        else:
            yield f"{key}[{k}]", item


def _degrees(key: str, latitude: Any, longitude: Any) -> Degrees:
    return (
        _number(f"{key} (latitude)", latitude, -90.0, 90.0),
        _number(f"{key} (longitude)", longitude, -180.0, 180.0),
    )


def _number(key: str, value: Any, low: float, high: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise ValueError(f"{key} = {value!r:.40}: must be {low:g} to {high:g}")
    return float(value)
