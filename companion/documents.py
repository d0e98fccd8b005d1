"""docs/telemetry.md and docs/schemas/*.json from the code: every key, field, unit, rate and command.

The page's first part, up to MARK, is written by hand; what follows is made here, and a test fails when stale.
"""

import inspect
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec

from companion.config import Config
from companion.telemetry import schemas as telemetry
from companion.telemetry.commands import COMMANDS, RECORDER_COMMANDS
from companion.telemetry.schemas import Choices, Raw, Reply, Truth

DOCS = Path(__file__).parents[1] / "docs"
PAGE = DOCS / "telemetry.md"
MARK = "<!-- made by `holdfast schema --write`; write nothing below -->\n"

RATES = {
    "event": "when something happens",
    "recorder": "1 Hz, by `holdfast record`",
    "plan": "when it changes, and every 5 s",
}
ENCODINGS: dict[type[msgspec.Struct], str] = {
    Raw: "application/msgpack;holdfast.Raw.v1",
    Truth: telemetry.TRUTH_ENCODING,
}
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


def schemas() -> dict[str, bytes]:
    """Return every JSON Schema by file name."""
    published = {*telemetry.EVERY_TICK.values(), *telemetry.NOW_AND_THEN.values(), Raw, Truth}
    records: set[type[msgspec.Struct]] = {*published, Choices, Config, Reply}
    named: dict[str, type[msgspec.Struct]] = {record.__name__: record for record in records}
    named |= {f"command.{name}": command for name, command in (COMMANDS | RECORDER_COMMANDS).items()}
    return {f"{name}.json": _schema(name, struct) for name, struct in sorted(named.items())}


def page() -> str:
    """Return the generated part of docs/telemetry.md."""
    return "\n".join(_lines()) + "\n"


def write() -> list[Path]:
    """Write page and schemas into docs/ and return what changed."""
    head, mark, _ = PAGE.read_text(encoding="utf-8").partition(MARK)
    wanted = {PAGE: (head + mark + page()).encode()}
    wanted |= {DOCS / "schemas" / name: content for name, content in schemas().items()}
    changed = [path for path, content in wanted.items() if not path.exists() or path.read_bytes() != content]
    for path in changed:
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(wanted[path])
    for path in (DOCS / "schemas").glob("*.json"):
        if path not in wanted:
            path.unlink()
            changed.append(path)
    return changed


def _schema(name: str, struct: type[msgspec.Struct]) -> bytes:
    schema = msgspec.json.schema(struct)
    for part in schema["$defs"].values():
        if "description" in part:  # a docstring: Python 3.13 and newer have stripped its indentation
            part["description"] = inspect.cleandoc(part["description"])
        for field in part.get("properties", {}).values():
            if field.get("type") == "number":  # typing keeps one of two equal types: its 0 may be ours
                field.update((key, float(field[key])) for key in ("minimum", "maximum") if key in field)
    root = {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": f"holdfast.{name}.v1"}
    return msgspec.json.format(msgspec.json.encode(root | schema)) + b"\n"


def _lines() -> Iterator[str]:
    yield "\n## Published\n"
    yield "| key | schema | rate | what |"
    yield "|---|---|---|---|"
    for tail, record in (telemetry.EVERY_TICK | telemetry.NOW_AND_THEN).items():
        rate = RATES.get(tail, "every tick, `loop.rate_hz`: 50 Hz")
        yield f"| `holdfast/{{vehicle}}/{tail}` | {_link(record)} | {rate} | {_first(record)} |"
    raw = "every tick, only with `telemetry.raw`"
    yield f"| `holdfast/{{vehicle}}/raw` | {_link(Raw)} | {raw} | {_first(Raw)} |"
    truth = "50 Hz, by `holdfast sim`"
    yield f"| `sim/{{vehicle}}/truth` | {_link(Truth)} | {truth} | {_first(Truth)} |"
    alive = "`holdfast/{vehicle}/alive/{instance}`"
    yield f"| {alive} | liveliness token | | exists while the companion runs |"
    every: list[type[msgspec.Struct]] = [
        *telemetry.EVERY_TICK.values(),
        *telemetry.NOW_AND_THEN.values(),
        Raw,
        Truth,
    ]
    structs: dict[type[msgspec.Struct], None] = dict.fromkeys(every)
    for struct in structs:
        yield f"\n### {struct.__name__}\n"
        what = ENCODINGS.get(struct) or telemetry.encoding(struct)
        yield f"{_words(struct)}\n\nEncoding `{what}`.\n"
        yield from _table(struct)
    yield "\n## Answered\n"
    yield "A query for `holdfast/{vehicle}/config` returns the configuration in force, a JSON object with the"
    yield "sections of `config/companion.toml` ([schema](schemas/Config.json)); a query for"
    yield "`holdfast/{vehicle}/choices` returns Choices; a query for a published key returns its last sample."
    yield f"\n### Choices\n\n{_words(Choices)}\n"
    yield from _table(Choices)
    yield "\n## Commands\n"
    yield "Send a query to `holdfast/{vehicle}/command/{name}`. Its payload is a JSON object (`{}` for a"
    yield "command without fields), its answer a Reply. `holdfast record` answers `command/record`."
    for name, command in (COMMANDS | RECORDER_COMMANDS).items():
        yield f"\n### {name}\n\n{_words(command)}\n"
        if command.__struct_fields__:
            yield from _table(command)
    yield "\n### Reply\n\n" + _words(Reply) + "\n"
    yield from _table(Reply)


def _table(struct: type[msgspec.Struct]) -> Iterator[str]:
    fields: dict[str, dict[str, Any]] = msgspec.json.schema(struct)["$defs"][struct.__name__]["properties"]
    yield "| field | type | unit | what |"
    yield "|---|---|---|---|"
    for name, field in fields.items():
        yield f"| `{name}` | {_type(field)} | {_unit(name, field)} | {field.get('description', '')} |"


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
    signs = (("minimum", "≥"), ("exclusiveMinimum", ">"), ("maximum", "≤"), ("exclusiveMaximum", "<"))
    limits = ", ".join(f"{sign} {field[key]:g}" for key, sign in signs if key in field)
    return f"{kind}, {limits}" if limits else kind


def _unit(name: str, field: Mapping[str, Any]) -> str:
    if field.get("type") not in ("number", "integer"):
        return ""
    if name.endswith("_per_s"):
        return "1/s"
    return UNITS.get(name.rpartition("_")[2], "") if "_" in name else ""


def _words(struct: type[msgspec.Struct]) -> str:
    return " ".join((struct.__doc__ or "").split())


def _first(struct: type[msgspec.Struct]) -> str:
    return (struct.__doc__ or "").partition("\n")[0].rstrip(".")


def _link(record: type[msgspec.Struct]) -> str:
    return f"[{record.__name__}](#{record.__name__.lower()})"
