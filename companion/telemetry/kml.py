"""The one LineString or Polygon of a KML file (OGC 12-007r2, "KML 2.3"), and what its Placemark says of it.

A document type is refused before anything of it is read: its entities can expand without end.
"""

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from typing import Any, NamedTuple
from xml.parsers import expat

from holdfast import files

CLAMPED = ("clampToGround", "clampToSeaFloor")
"""With these, the first by default, altitudes do not count."""
ABOVE_SEA = ("absolute", "relativeToGround")
"""At sea both count from the surface."""
ABOVE_FLOOR = "relativeToSeaFloor"


class Line(NamedTuple):
    """A line as it stands in the file: numbers are not checked."""

    positions: list[list[float]]
    """Longitude, latitude, and altitude where one is given."""
    closed: bool
    altitude_mode: str
    properties: dict[str, Any]
    """The Placemark's name and ExtendedData."""


def line(text: str) -> Line:
    """Return the line of a KML; raise ValueError, in words, for a text that is none, or has not one line."""
    root = _parsed(text)
    if _name(root) != "kml":
        raise ValueError(f"<{_name(root)}>: want <kml>")
    found = [
        (placemark, shape)
        for placemark in _all(root, "Placemark")
        for shape in placemark.iter()
        if _name(shape) in ("LineString", "Polygon")
    ]
    if len(found) != 1:
        raise ValueError(f"{len(found)} lines or polygons: want one LineString or one Polygon")
    placemark, shape = found[0]
    closed = _name(shape) == "Polygon"
    if closed and len([*_all(shape, "LinearRing")]) != 1:
        raise ValueError("Polygon: want one without holes")
    coordinates = _text(shape, "coordinates")
    if not coordinates:
        raise ValueError(f"{_name(shape)}.coordinates: missing")
    positions = [_position(k, text) for k, text in enumerate(coordinates.split())]
    return Line(positions, closed, _text(shape, "altitudeMode") or CLAMPED[0], _properties(placemark))


def _parsed(text: str) -> ET.Element:
    builder, parser, depth = ET.TreeBuilder(), expat.ParserCreate(), 0

    def begin(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > files.MAX_DEPTH:
            raise ValueError(f"is nested more than {files.MAX_DEPTH} deep: flatten it")
        builder.start(name, attributes)

    def end(name: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(name)

    def refuse(*_: object) -> None:
        raise ValueError("has a document type (<!DOCTYPE …>): remove it, KML needs none")

    parser.StartElementHandler, parser.EndElementHandler = begin, end
    parser.CharacterDataHandler = builder.data
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        raise ValueError(f"is not XML: {error}") from error
    return builder.close()


def _position(k: int, text: str) -> list[float]:
    try:
        numbers = [float(number) for number in text.split(",")]
    except ValueError:
        numbers = [math.nan]
    if not all(map(math.isfinite, numbers)):
        said = "want longitude,latitude or with altitude, without spaces"
        raise ValueError(f"coordinates[{k}] = {text[:80]!r}: {said}")
    return numbers


def _properties(placemark: ET.Element) -> dict[str, Any]:
    given = {
        element.get("name", ""): _text(element, "value") or (element.text or "").strip()
        for kind in ("Data", "SimpleData")
        for element in _all(placemark, kind)
    }
    name = _text(placemark, "name")
    return ({"name": name[:64]} if name else {}) | {
        key: _value(value) for key, value in given.items() if value
    }


def _value(text: str) -> Any:
    try:
        return files.from_json(text)
    except ValueError:
        return text


def _all(element: ET.Element, name: str) -> Iterator[ET.Element]:
    return (inner for inner in element.iter() if _name(inner) == name)


def _text(element: ET.Element, name: str) -> str:
    """Return the text of the first element of this name, or an empty one."""
    return next(((inner.text or "").strip() for inner in _all(element, name)), "")


def _name(element: ET.Element) -> str:
    """Return an element's name without the prefix of its namespace."""
    return element.tag.rpartition(":")[2]
