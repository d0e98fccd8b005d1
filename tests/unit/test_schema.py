"""docs/telemetry.md and docs/schemas say what the code does."""

import json
from collections.abc import Callable

from companion.commands import schema as command
from companion.records import ControlSample
from companion.telemetry import documents as schema
from companion.telemetry import samples
from companion.telemetry import schemas as telemetry


def test_the_page_is_not_stale() -> None:
    _, mark, generated = schema.PAGE.read_text(encoding="utf-8").partition(schema.MARK)
    assert mark
    assert generated == schema.page(), "stale: run `holdfast schema --write`"


def test_the_schemas_are_not_stale() -> None:
    there = {path.name: path.read_bytes() for path in (schema.DOCS / "schemas").iterdir()}
    assert there == schema.schemas(), "stale: run `holdfast schema --write`"


def test_every_field_that_is_published_is_described() -> None:
    for record in {*telemetry.EVERY_TICK.values(), *telemetry.NOW_AND_THEN.values(), telemetry.Reply}:
        fields = json.loads(schema.schemas()[f"{record.__name__}.json"])["$defs"][record.__name__]
        assert set(fields["properties"]) == set(record.__struct_fields__)
        for name, field in fields["properties"].items():
            assert field.get("description"), f"{record.__name__}.{name}"


def test_what_is_published_follows_its_schema(make_sample: Callable[..., ControlSample]) -> None:
    types = {"string": str, "boolean": bool, "integer": int, "number": float, "array": list}
    for key, encoding, payload in samples.encode(make_sample(), "kelp"):
        name = encoding.split(".")[1]
        properties = json.loads(schema.schemas()[f"{name}.json"])["$defs"][name]["properties"]
        published = json.loads(payload)
        assert published.keys() == properties.keys(), key
        for field, value in published.items():
            assert type(value) is types[properties[field]["type"]], f"{key}: {field}"


def test_it_is_printed(capsys: object) -> None:
    assert command([]) == 0
