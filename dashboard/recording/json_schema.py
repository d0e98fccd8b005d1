"""JSON Schemas as Foxglove and Lichtblick read them: the root an object, no $ref, a type in every field."""

from typing import Any

import msgspec

from companion.telemetry import schemas as telemetry

MAX_BYTES = 1 << 14
"""No schema is made of a larger sample."""

_TYPES = {bool: "boolean", int: "integer", float: "number", str: "string"}
_UNTYPED = {"type": "string"}


def schema_of(encoding: str, payload: bytes) -> tuple[str, bytes]:
    """Return name and JSON Schema of what is published with `encoding`.

    That of the telemetry's own record where the encoding names one, and otherwise what the payload shows.
    Raises ValueError for a payload that is neither of these nor a JSON object of `MAX_BYTES` at most.
    """
    name = encoding.partition(";")[2]
    record = getattr(telemetry, name.rpartition(".v")[0].rpartition(".")[2], None)
    if isinstance(record, type) and issubclass(record, msgspec.Struct):
        return name, msgspec.json.encode(plain(msgspec.json.schema(record)))
    if "json" not in encoding or len(payload) > MAX_BYTES:
        raise ValueError(f"{encoding} is no JSON, or {len(payload)} bytes are too many")
    try:
        example = msgspec.json.decode(payload)
        if isinstance(example, dict):
            return name or "unnamed", msgspec.json.encode(inferred(example))
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f"no JSON: {error}") from error
    raise ValueError("JSON, but no object")


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


def inferred(example: Any) -> dict[str, Any]:
    """Return the schema that one value shows; an empty list is taken for one of numbers."""
    if isinstance(example, dict):
        return {"type": "object", "properties": {name: inferred(value) for name, value in example.items()}}
    if isinstance(example, list):
        return {"type": "array", "items": inferred(example[0] if example else 0.0)}
    return {"type": _TYPES.get(type(example), "string")}
