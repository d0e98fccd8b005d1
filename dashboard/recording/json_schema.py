"""JSON Schemas as Foxglove and Lichtblick read them: the root an object, no $ref, a type in every field."""

from typing import Any

import msgspec

from companion.telemetry import schemas as telemetry

_TYPES = {bool: "boolean", int: "integer", float: "number", str: "string"}
_UNTYPED = {"type": "string"}


def schema_of(encoding: str) -> tuple[str, bytes] | None:
    """Return name and JSON Schema of the record of ours that an encoding names; None for another one."""
    name = encoding.partition(";")[2]
    record = getattr(telemetry, name.rpartition(".v")[0].rpartition(".")[2], None)
    if isinstance(record, type) and issubclass(record, msgspec.Struct):
        return name, msgspec.json.encode(plain(msgspec.json.schema(record)))
    return None


def plain(schema: dict[str, Any]) -> dict[str, Any]:
    """Return msgspec's schema with every $ref put in its place, and a type wherever one was implied."""
    definitions = schema.get("$defs", {})

    def resolved(part: dict[str, Any]) -> dict[str, Any]:
        if "$ref" in part:
            return resolved(definitions[part["$ref"].rpartition("/")[2]])
        part = {key: value for key, value in part.items() if key not in ("$defs", "default")}
        if "properties" in part:
            part["properties"] = {name: resolved(field) for name, field in part["properties"].items()}
        if part.get("type") == "object":
            part.setdefault("properties", {})
        elif part.get("type") == "array":
            items = part.get("items") or (part.get("prefixItems") or [_UNTYPED])[0]
            part = {"type": "array", "items": resolved(items)}
        elif "type" not in part:
            part["type"] = _TYPES.get(type((part.get("enum") or [""])[0]), "string")
        return part

    return resolved(schema)
