"""The fields of a schema: how each is described, and what people read of it."""

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


def means(text: str, title: str | None = None, unit: str | None = None) -> msgspec.Meta:
    """Describe a field; `title` is what a form calls it, `unit` is for a name that does not end with one."""
    return msgspec.Meta(title=title, description=text, extra_json_schema={"unit": unit} if unit else None)


def within(
    least: float,
    most: float,
    what: str | None = None,
    unit: str | None = None,
    *,
    title: str | None = None,
    beside_zero: float | None = None,
    remedy: str | None = None,
) -> msgspec.Meta:
    """Describe a number and its range.

    Where 0 means that there is none, `beside_zero` is the least that it may be otherwise: a number nearly 0
    is a mistake in its unit, and what divides by it may be infinite. `remedy` helps where one is refused.
    """
    more = {"unit": unit, "least": beside_zero}
    return msgspec.Meta(
        ge=least,
        le=most,
        title=title,
        description=what,
        extra={"remedy": remedy} if remedy else None,
        extra_json_schema={key: value for key, value in more.items() if value} or None,
    )


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
