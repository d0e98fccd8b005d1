"""Paths of TOML, GeoJSON, KML and QGroundControl: read as meant, refused with file, key and value."""

import json
import math
from pathlib import Path

import msgspec
import pytest

from companion.config import load_config
from companion.guidance.paths.shapes import build
from companion.guidance.paths.time_law import limits
from companion.telemetry.path_files import read
from companion.telemetry.plan import Lemniscate, PathPlan

ORIGIN = (47.4, 8.55)
METRE = 1.0 / 111318.84502145034


def at(north_m, east_m):
    return ORIGIN[0] + north_m * METRE, ORIGIN[1] + east_m * METRE / math.cos(math.radians(ORIGIN[0]))


def written(tmp_path, name, content):
    file = tmp_path / name
    file.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    return file


def geojson(kind, places, **properties):
    coordinates = [[*reversed(at(north, east)), -depth] for north, east, depth in places]
    geometry = {"type": kind, "coordinates": [coordinates] if kind == "Polygon" else coordinates}
    feature = {"type": "Feature", "properties": properties, "geometry": geometry}
    return {"type": "FeatureCollection", "features": [feature]}


def kml(kind, places, mode="absolute", name="", data="", begin=""):
    """Return a KML as Google Earth writes it; `places` are north, east and altitude or None."""
    numbers = [(*reversed(at(north, east)), height) for north, east, height in places]
    text = " ".join(",".join(f"{v:.9f}" for v in position if v is not None) for position in numbers)
    text = f"<coordinates>\n{text}\n</coordinates>"
    ring = f"<outerBoundaryIs><LinearRing>{text}</LinearRing></outerBoundaryIs>"
    mode = (
        f"<gx:altitudeMode>{mode}</gx:altitudeMode>"
        if "Sea" in mode
        else f"<altitudeMode>{mode}</altitudeMode>"
    )
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>{begin}<kml xmlns="http://www.opengis.net/kml/2.2" '
        'xmlns:gx="http://www.google.com/kml/ext/2.2"><Document><name>mine</name>'
        "<Placemark><name>pier</name><Point><coordinates>8.5,47.4,0</coordinates></Point></Placemark>"
        f"<Folder><Placemark><name>{name}</name><ExtendedData>{data}</ExtendedData>"
        f"<{kind}><tessellate>1</tessellate>{mode}{ring if kind == 'Polygon' else text}</{kind}>"
        "</Placemark></Folder></Document></kml>"
    )


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


def test_a_line_string_is_metres_from_the_origin_and_its_properties_are_keys(tmp_path):
    file = written(
        tmp_path, "reef.geojson", geojson("LineString", [(3, 4, 2), (10, -5, 3)], speed_mps=0.1, colour=1)
    )
    plan = read(file, ORIGIN)
    assert places(plan) == [(3.0, 4.0, 2.0), (10.0, -5.0, 3.0)]
    assert (plan.speed_mps, plan.relative, plan.closed) == (0.1, False, False)
    without = read(file)
    assert places(without) == [(0.0, 0.0, 2.0), (7.0, -9.0, 3.0)]
    assert without.relative


def test_a_polygon_is_closed(tmp_path):
    square = [(0, 0, 2), (4, 0, 2), (4, 4, 2), (0, 4, 2), (0, 0, 2)]
    plan = read(written(tmp_path, "square.json", geojson("Polygon", square)), ORIGIN)
    assert len(plan.waypoint) == 4
    assert build(plan, limits(load_config())).closed


def test_a_line_of_a_kml_is_a_path_and_its_data_are_keys(tmp_path):
    data = '<Data name="speed_mps"><value>0.1</value></Data><Data name="heading"><value>keep</value></Data>'
    file = written(
        tmp_path, "earth.kml", kml("LineString", [(3, 4, -2), (10, -5, -3)], name="the reef", data=data)
    )
    plan = read(file, ORIGIN)
    assert places(plan) == [(3.0, 4.0, 2.0), (10.0, -5.0, 3.0)]
    assert (plan.name, plan.speed_mps, plan.heading) == ("the reef", 0.1, "keep")
    assert read(file).relative


def test_a_polygon_of_a_kml_is_closed(tmp_path):
    square = [(0, 0, -2), (4, 0, -2), (4, 4, -2), (0, 4, -2), (0, 0, -2)]
    plan = read(written(tmp_path, "square.kml", kml("Polygon", square, name="square")), ORIGIN)
    assert len(plan.waypoint) == 4
    assert build(plan, limits(load_config())).closed


@pytest.mark.parametrize("height", [None, 0.0])
def test_a_kml_on_the_ground_has_no_depths(tmp_path, height):
    line = [(0, 0, height), (4, 0, height)]
    plan = read(written(tmp_path, "a.kml", kml("LineString", line, mode="clampToGround")), ORIGIN)
    assert places(plan) == [(0.0, 0.0, msgspec.UNSET), (4.0, 0.0, msgspec.UNSET)]
    assert plan.name == "a"


def test_a_kml_over_the_sea_floor_keeps_an_altitude(tmp_path):
    line = [(0, 0, 1.5), (4, 0, 1.5)]
    plan = read(written(tmp_path, "a.kml", kml("LineString", line, mode="relativeToSeaFloor")), ORIGIN)
    assert (plan.altitude_m, places(plan)[0]) == (1.5, (0.0, 0.0, msgspec.UNSET))


LAUGHS = "".join(f'<!ENTITY l{i + 1} "{f"&l{i};" * 10}">' for i in range(9))


def test_a_plan_of_qgroundcontrol_gives_waypoints_holds_radii_headings_and_speed(tmp_path):
    speed = {"type": "SimpleItem", "command": 178, "frame": 2, "params": [1, 0.15, -1, 0, 0, 0, 0]}
    survey = {"type": "ComplexItem", "TransectStyleComplexItem": {"Items": [item(8, 0, -2), item(8, 6, -2)]}}
    file = written(
        tmp_path, "dam.plan", qgc(speed, item(0, 0, -2, hold=4), item(5, 0, -2, radius=1.5, yaw=90), survey)
    )
    plan = read(file, ORIGIN)
    assert places(plan) == [(0.0, 0.0, 2.0), (5.0, 0.0, 2.0), (8.0, 0.0, 2.0), (8.0, 6.0, 2.0)]
    assert plan.speed_mps == 0.15
    assert (plan.waypoint[0].wait_s, plan.waypoint[1].corner_m, plan.waypoint[1].heading_deg) == (
        4.0,
        1.5,
        90.0,
    )


def command(number, *params):
    return {
        "type": "SimpleItem",
        "command": number,
        "frame": 2,
        "params": [*params, *[0] * (7 - len(params))],
    }


def test_the_camera_of_a_plan_triggers_at_the_waypoint_before_it_and_from_it_on(tmp_path):
    survey = {
        "type": "ComplexItem",
        "TransectStyleComplexItem": {
            "Items": [
                item(0, 0, -2),
                item(2, 0, -2),
                command(206, 0.5, 0, 1),
                item(8, 0, -2),
                command(206, 0.0, 0, 0),
                item(8, 6, -2, hold=3),
                command(2000, 0, 0, 1),
                item(9, 6, -2),
                command(203, 0, 0, 0, 0, 1),
            ]
        },
    }
    plan = read(written(tmp_path, "survey.plan", qgc(survey)), ORIGIN)
    unset = msgspec.UNSET
    assert [waypoint.trigger_every_m for waypoint in plan.waypoint] == [unset, 0.5, 0.0, unset, unset]
    assert [waypoint.trigger for waypoint in plan.waypoint] == [False, False, False, True, True]
    built = build(plan, limits(load_config()))
    assert len(built.triggers) == 12 + 2, "the corner passes the end of the line before 6 m"
    assert built.triggers[0] == pytest.approx(2.0)


def test_a_camera_that_is_set_before_the_first_waypoint_triggers_from_there(tmp_path):
    file = written(tmp_path, "a.plan", qgc(command(206, 1.0, 0, 1), item(0, 0, -2), item(4, 0, -2)))
    assert read(file, ORIGIN).waypoint[0].trigger_every_m == 1.0


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
        ("a.csv", "1,2", "want a file that ends in"),
        ("a.geojson", "[1", "is not JSON"),
        ("a.geojson", {"type": "Point", "coordinates": [1, 2]}, "0 lines or polygons"),
        (
            "a.geojson",
            {"type": "LineString", "coordinates": [[8.0, 91.0]]},
            r"coordinates\[0\] \(latitude\) = 91",
        ),
        (
            "a.geojson",
            geojson("LineString", [(0, 0, -5), (1, 1, 2)]),
            r"coordinates\[0\]\[2\] = 5.*: must be .* to 0",
        ),
        ("a.kml", "<kml><Placemark>", "is not XML"),
        ("a.kml", "<gpx/>", "<gpx>: want <kml>"),
        ("a.kml", "<kml>" * 40, "is nested more than 32 deep"),
        ("a.kml", "<kml/>", "0 lines or polygons"),
        ("a.kml", kml("LineString", []), r"LineString.coordinates: missing"),
        ("a.kml", kml("LineString", [(0, 0, 5), (1, 1, 5)]), r"coordinates\[0\]\[2\] = 5.0: must be"),
        ("a.kml", kml("LineString", [(0, 0, -5)], mode="clampToGround"), "altitudes do not count.*absolute"),
        ("a.kml", kml("LineString", [(0, 0, 1), (1, 0, 2)], mode="relativeToSeaFloor"), "the same altitude"),
        ("a.kml", kml("LineString", [(0, 0, -5)], mode="above"), "altitudeMode = above: must be one of"),
        (
            "a.kml",
            kml("LineString", [(0, 0, -5)], begin=f'<!DOCTYPE x [<!ENTITY l0 "ha">{LAUGHS}]>'),
            "document type",
        ),
        (
            "a.kml",
            kml("LineString", [(0, 0, -5)], begin='<!DOCTYPE x SYSTEM "file:///etc/passwd">'),
            "document type",
        ),
        ("a.kml", kml("LineString", [(0, 0, math.nan)]), r"coordinates\[0\] = .*want longitude,latitude"),
        ("a.plan", qgc(item(0, 0, 50)), r"mission.items\[0\].params\[6\] \(altitude; minus the depth\) = 50"),
        ("a.plan", qgc(item(0, 0, -1, command=20)), r"mission.items\[0\].command = 20: only waypoints"),
        ("a.plan", qgc(item(0, 0, -1, frame=10)), r"mission.items\[0\].frame = 10"),
        ("a.plan", qgc(item(0, 0, -1), command(214, 2.0)), r"items\[1\].command = 214: triggers by time"),
        ("a.plan", qgc(item(0, 0, -1), command(2000, 0, 2, 0)), r"command = 2000: triggers by time"),
        ("a.plan", qgc(item(0, 0, -1), command(206, -1)), r"params\[0\] \(distance\) = -1"),
        ("a.plan", qgc(), "no waypoint"),
        ("a.plan", {"mission": {}}, "fileType, mission.items"),
    ],
)
def test_what_cannot_be_followed_is_refused_with_file_and_key(tmp_path, name, content, said):
    with pytest.raises(ValueError, match=said) as refused:
        read(written(tmp_path, name, content), ORIGIN)
    assert str(refused.value).startswith(str(tmp_path / name))


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"none\.toml: cannot be read"):
        read(tmp_path / "none.toml")


DOCUMENT = Path(__file__).parents[2] / "docs" / "guidance.md"
EXAMPLES = DOCUMENT.read_text(encoding="utf-8").split("```toml\n")[1:]


@pytest.mark.parametrize("number", range(len(EXAMPLES)))
def test_the_documents_examples_are_paths(tmp_path, number):
    plan = read(written(tmp_path, "example.toml", EXAMPLES[number].partition("```")[0]))
    assert build(plan, limits(load_config())).length_m > 5.0
