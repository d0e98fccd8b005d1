"""Paths of TOML: read as meant, refused with file, key and value."""

from pathlib import Path

import msgspec
import pytest

from companion.config import load_config
from companion.guidance.paths.shapes import build
from companion.guidance.paths.time_law import limits
from companion.telemetry.operator_commands import Follow, parse
from companion.telemetry.path_files import read
from companion.telemetry.plan import MAX_SEGMENTS, Lemniscate, PathPlan, Waypoint


def written(tmp_path, name, content):
    file = tmp_path / name
    file.write_text(content, encoding="utf-8")
    return file


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
        ("a.kml", "<kml/>", "is not TOML"),
    ],
)
def test_what_cannot_be_followed_is_refused_with_file_and_key(tmp_path, name, content, said):
    with pytest.raises(ValueError, match=said) as refused:
        read(written(tmp_path, name, content))
    assert str(refused.value).startswith(str(tmp_path / name))


def test_the_longest_path_is_no_command_of_too_many_values():
    waypoint = Waypoint(x_m=1.0, y_m=1.0, depth_m=2.0, heading_deg=3.0, corner_m=1.0, wait_s=1.0)
    follow = Follow(path=PathPlan(waypoint=(waypoint,) * MAX_SEGMENTS))
    assert parse("follow", msgspec.json.encode(follow)) == follow


EXAMPLES = sorted((Path(__file__).parents[2] / "docs" / "examples" / "paths").glob("*.toml"))


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_the_documents_examples_are_paths(file):
    assert build(read(file), limits(load_config())).length_m > 5.0
