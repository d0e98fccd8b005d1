"""Paths of TOML and QGroundControl: read as meant, refused with file, key and value."""

import json
import math
from pathlib import Path

import msgspec
import pytest

from companion.config import load_config
from companion.guidance.paths.shapes import build
from companion.guidance.paths.time_law import limits
from companion.telemetry.operator_commands import Follow, parse
from companion.telemetry.path_files import read
from companion.telemetry.plan import MAX_SEGMENTS, Lemniscate, PathPlan, Waypoint

ORIGIN = (47.4, 8.55)
METRE = 1.0 / 111318.84502145034


def at(north_m, east_m):
    return ORIGIN[0] + north_m * METRE, ORIGIN[1] + east_m * METRE / math.cos(math.radians(ORIGIN[0]))


def written(tmp_path, name, content):
    file = tmp_path / name
    file.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    return file


def qgc(*items):
    return {"fileType": "Plan", "version": 1, "mission": {"items": list(items), "version": 2}}


def item(north, east, altitude, hold=0, radius=0, yaw=None, command=16, frame=3):
    latitude, longitude = at(north, east)
    params = [hold, radius, 0, yaw, latitude, longitude, altitude]
    return {"type": "SimpleItem", "command": command, "frame": frame, "params": params}


def places(plan):
    return [(round(w.x_m, 2), round(w.y_m, 2), w.depth_m) for w in plan.waypoint]


def test_toml_is_the_plan(tmp_path):
    text = """
speed_mps = 0.3
heading = "keep"
laps = 2
[lemniscate]
length_m = 4.0
width_m = 2
depth_m = 2.5
"""
    plan = read(written(tmp_path, "eight.toml", text))
    assert (plan.name, plan.speed_mps, plan.laps) == ("eight", 0.3, 2)
    assert isinstance(plan.lemniscate, Lemniscate)
    assert plan.lemniscate.width_m == 2.0
    again = msgspec.json.decode(msgspec.json.encode(plan), type=PathPlan)
    assert again == plan, "as it travels in a command"
    assert build(plan, limits(load_config())).length_m > 8.0


def test_a_plan_of_qgroundcontrol_gives_waypoints_holds_radii_headings_and_speed(tmp_path, caplog):
    speed = {"type": "SimpleItem", "command": 178, "frame": 2, "params": [1, 0.15, -1, 0, 0, 0, 0]}
    camera = {"type": "SimpleItem", "command": 206, "frame": 2, "params": [0.5, 0, 1, 0, 0, 0, 0]}
    items = [item(8, 0, -2), camera, item(8, 6, -2)]
    survey = {"type": "ComplexItem", "TransectStyleComplexItem": {"Items": items}}
    file = written(
        tmp_path, "dam.plan", qgc(speed, item(0, 0, -2, hold=4), item(5, 0, -2, radius=1.5, yaw=90), survey)
    )
    plan = read(file, ORIGIN)
    assert caplog.messages == ["mission.items: commands [206] are no waypoints, and are left out"]
    assert places(plan) == [(0.0, 0.0, 2.0), (5.0, 0.0, 2.0), (8.0, 0.0, 2.0), (8.0, 6.0, 2.0)]
    assert plan.speed_mps == 0.15
    assert (plan.waypoint[0].wait_s, plan.waypoint[1].corner_m, plan.waypoint[1].heading_deg) == (
        4.0,
        1.5,
        90.0,
    )
    assert read(file).relative
    assert places(read(file))[:2] == [(0.0, 0.0, 2.0), (5.0, 0.0, 2.0)]


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.toml", "speed_mps = 9.0\n[circle]\nradius_m = 1.0", r"speed_mps = 9: must be 0.01 to 3"),
        ("a.toml", "[circle]\nradius = 1.0", "circle.radius_m: missing|circle.radius: unknown key"),
        (
            "a.toml",
            "[[waypoint]]\nx_m = 1.0\ny_m = 99999.0",
            r"waypoint\[0\].y_m = 99999: must be -10000 to 10000",
        ),
        ("a.toml", "speed = ", "is not TOML"),
        ("a.toml", 'heading = "north"\n[circle]\nradius_m = 1.0', "heading = 'north'"),
        ("a.csv", "1,2", "want a .toml"),
        ("a.kml", "<kml/>", "want a .toml .* or a .plan, as QGroundControl saves it"),
        ("a.plan", "[1", "is not JSON"),
        ("a.plan", qgc(item(0, 0, 50)), r"mission.items\[0\].params\[6\] \(altitude; minus the depth\) = 50"),
        ("a.plan", qgc(item(0, 0, -1, command=20)), r"mission.items\[0\].command = 20: only waypoints"),
        ("a.plan", qgc(item(0, 0, -1, frame=10)), r"mission.items\[0\].frame = 10"),
        ("a.plan", qgc(), "no waypoint"),
        ("a.plan", {"mission": {}}, "fileType, mission.items"),
    ],
)
def test_what_cannot_be_followed_is_refused_with_file_and_key(tmp_path, name, content, said):
    with pytest.raises(ValueError, match=said) as refused:
        read(written(tmp_path, name, content), ORIGIN)
    assert str(refused.value).startswith(str(tmp_path / name))


def test_the_longest_path_is_no_command_of_too_many_values():
    waypoint = Waypoint(x_m=1.0, y_m=1.0, depth_m=2.0, heading_deg=3.0, corner_m=1.0, wait_s=1.0)
    follow = Follow(path=PathPlan(waypoint=(waypoint,) * MAX_SEGMENTS))
    assert parse("follow", msgspec.json.encode(follow)) == follow


EXAMPLES = sorted((Path(__file__).parents[2] / "docs" / "examples" / "paths").glob("*.toml"))


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_the_documents_examples_are_paths(file):
    assert build(read(file), limits(load_config())).length_m > 5.0
