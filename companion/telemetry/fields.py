"""The fields of a schema in words: type and range, unit, meaning."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import msgspec

UNITS = {
    "m": "m",
    "mps": "m/s",
    "rad": "rad",
    "radps": "rad/s",
    "deg": "°",
    "s": "s",
    "ms": "ms",
    "us": "µs",
    "hz": "Hz",
    "v": "V",
    "n": "N",
    "nm": "N·m",
    "bytes": "B",
}


class Field(NamedTuple):
    """What people read of a field."""

    type: str
    unit: str
    what: str


def fields_of(struct: type[msgspec.Struct]) -> dict[str, Field]:
    """Return the fields of a record by their names, in order."""
    fields: dict[str, dict[str, Any]] = msgspec.json.schema(struct)["$defs"][struct.__name__]["properties"]
    return {
        name: Field(_type(field), _unit(name, field), field.get("description", ""))
        for name, field in fields.items()
    }


def _type(field: Mapping[str, Any]) -> str:
    if "enum" in field:
        return ", ".join(f"`{choice}`" for choice in field["enum"])
    if "anyOf" in field:
        return " or ".join(_type(choice) for choice in field["anyOf"])
    if "$ref" in field:
        return str(field["$ref"]).rpartition("/")[2]
    kind = str(field.get("type", "any"))
    if kind == "array" and isinstance(field.get("items"), dict):
        kind = f"array of {_type(field['items'])}"
    each = [_type(item) for item in field.get("prefixItems", ())]
    if len(set(each)) == 1:
        kind = f"array of {len(each)} {each[0]}"
    least = f"0 or {field['least']:g}" if "least" in field else f"{field.get('minimum', 0.0):g}"
    return f"{kind}, {least} to {field['maximum']:g}" if "minimum" in field else kind


def _unit(name: str, field: Mapping[str, Any]) -> str:
    if "unit" in field:
        return str(field["unit"])
    numbers = ("number", "integer")
    if field.get("type") not in numbers and not any(
        item.get("type") in numbers for item in field.get("prefixItems", ())
    ):
        return ""
    if name.endswith("_per_s"):
        return "1/s"
    return UNITS.get(name.rpartition("_")[2], "") if "_" in name else ""
