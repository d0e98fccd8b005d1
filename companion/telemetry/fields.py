"""The fields of a schema: how each is described, and what people read of it."""

from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple

import msgspec

UNITS = {
    "per_s": "1/s",
    "mps2": "m/s²",
    "degps": "°/s",
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


def unit_of(name: str) -> tuple[str, str]:
    """Return a field's name without its unit, and the unit that its end says."""
    found = next((end for end in UNITS if name.endswith(f"_{end}")), "")
    return name.removesuffix(f"_{found}"), UNITS.get(found, "")


class Field(NamedTuple):
    """What people read of a field; `least` and `most` are None where it has no range."""

    type: str
    unit: str
    what: str
    title: str
    choices: tuple[str, ...]
    least: float | None
    most: float | None


@cache
def fields_of(struct: type[msgspec.Struct]) -> dict[str, Field]:
    """Return the fields of a record by their names, in order."""
    fields: dict[str, dict[str, Any]] = msgspec.json.schema(struct)["$defs"][struct.__name__]["properties"]
    return {
        name: Field(
            type=_type(field),
            unit=_unit(name, field),
            what=field.get("description", ""),
            title=field.get("title", name),
            choices=tuple(field.get("enum", ())),
            least=field.get("minimum"),
            most=field.get("maximum"),
        )
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
    numbers = (part.get("type") in ("number", "integer") for part in (field, *field.get("prefixItems", ())))
    return unit_of(name)[1] if any(numbers) else ""
