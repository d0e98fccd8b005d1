"""docs/telemetry.md, configuration.md, supervisor.md and tables of results.md, as made; and the JSON Schemas.

A page's first part, up to MARK, is written by hand; what follows is made here, and a test fails when stale.
"""

import inspect
from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path

import msgspec

from companion.config import AxisSection, Config, Section, YawModel
from companion.records import AXES
from companion.telemetry import schemas as telemetry
from companion.telemetry.fields import UNITS, Field, fields_of
from companion.telemetry.operator_commands import COMMANDS
from companion.telemetry.schemas import Choices, Raw, Record, Reply, Truth
from lab import results_page, supervisor_page

DOCS = Path(__file__).parents[1] / "docs"
MARK = "<!-- made by `holdfast lab schema --write`; write nothing below -->\n"

TOLD_BY_DEFAULT = ("string", "boolean", "array of string")
RATES = {
    "event": "when something happens",
    "recorder": "1 Hz, by `holdfast record`",
    "plan": "when it changes, and every 5 s",
}


def schemas() -> dict[str, bytes]:
    """Return every JSON Schema by file name."""
    published = {*telemetry.EVERY_TICK.values(), *telemetry.NOW_AND_THEN.values(), Raw, Truth}
    records: set[type[msgspec.Struct]] = {*published, Choices, Config, Reply}
    named: dict[str, type[msgspec.Struct]] = {record.__name__: record for record in records}
    named |= {f"command.{name}": command for name, command in COMMANDS.items()}
    return {f"{name}.json": _schema(name, struct) for name, struct in sorted(named.items())}


def pages() -> dict[str, str]:
    """Return the generated part of each page."""
    made = {"telemetry.md": _telemetry(), "configuration.md": _configuration()}
    return {name: supervisor_page.wrapped("\n".join(lines)) + "\n" for name, lines in made.items()}


def write(stamp: bool = False) -> list[Path]:
    """Write the pages into docs/, tables stamped if it is a release, and return what changed."""
    page = results_page.PAGE.read_text(encoding="utf-8")
    wanted = {results_page.PAGE: results_page.filled(page, stamp).encode()}
    wanted[supervisor_page.PAGE] = supervisor_page.page().encode()
    for name, made in pages().items():
        head, mark, _ = (DOCS / name).read_text(encoding="utf-8").partition(MARK)
        wanted[DOCS / name] = (head + mark + made).encode()
    changed = [path for path, content in wanted.items() if not path.exists() or path.read_bytes() != content]
    for path in changed:
        path.write_bytes(wanted[path])
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


def _configuration() -> Iterator[str]:
    shipped = Config()
    for section in Config.__struct_fields__:
        record = getattr(shipped, section)
        if not isinstance(record, Section) or section in AXES[1:]:
            continue
        records = [getattr(shipped, axis) for axis in AXES] if section in AXES else [record]
        heads = [f"`[{axis}]`" for axis in AXES] if section in AXES else ["default"]
        yield f"\n## {', '.join(AXES) if section in AXES else section}\n\n{_words(type(record))}\n"
        yield f"| key | {' | '.join(heads)} | what; allowed |"
        yield "|---" * (len(heads) + 2) + "|"
        for key, field in fields_of(type(record)).items():
            values = " | ".join(
                f"`{msgspec.json.encode(getattr(record, key)).decode()}`" for record in records
            )
            words = field.type.split("`")[1::2]
            told = field.type in TOLD_BY_DEFAULT or (words and all(word in field.what for word in words))
            allowed = "" if told else f"; {_kind(field).removeprefix('integer, ')}"
            yield f"| `{key}` | {values} | {field.what}{allowed} |"
    yield "\nThe model of yaw is in rad, N·m and kg·m²:\n"
    yield from _table(YawModel)


def _telemetry() -> Iterator[str]:
    yield "\n| key | what |\n|---|---|"
    keys: dict[type[msgspec.Struct], list[str]] = {}
    for tail, published in (telemetry.EVERY_TICK | telemetry.NOW_AND_THEN).items():
        keys.setdefault(published, []).append(tail)
    for struct, (tail, *more) in keys.items():
        shown = "`, `".join([tail, *more])
        rate = f"; {RATES[tail]}" if tail in RATES else ""
        yield f"| `holdfast/{{vehicle}}/{shown}` | {_link(struct)}: {_first(struct)}{rate} |"
    yield f"| `holdfast/{{vehicle}}/raw` | {_first(Raw)}; only with `telemetry.raw` |"
    yield f"| `sim/{{vehicle}}/truth` | {_link(Truth)}: {_first(Truth)}; 50 Hz, by `holdfast sim` |"
    yield "| `holdfast/{vehicle}/alive/{instance}` | a liveliness token while the companion runs |"
    yield "\nEach has these fields, all but Truth:\n"
    yield from _table(Record)
    for struct in keys | {Truth: []}:
        more_words = _words(struct).removeprefix(_first(struct)).removeprefix(".").strip()
        yield f"\n### {struct.__name__}\n" + (f"\n{more_words}\n" if more_words else "")
        yield from _table(struct, () if struct is Truth else Record.__struct_fields__)
    yield "\n## Commands\n"
    yield "Send a query to `holdfast/{vehicle}/command/{name}`. Its payload is a JSON object (`{}` for a"
    yield "command without fields), its answer a [Reply](#reply). These have no fields:\n"
    for name, command in COMMANDS.items():
        if not command.__struct_fields__:
            yield f"- `{name}`: {_words(command)}"
    for name, command in COMMANDS.items():
        if not command.__struct_fields__:
            continue
        yield f"\n### {name}\n\n{_words(command)}"
        of_axis = [key for key in fields_of(command) if key in fields_of(AxisSection)]
        if len(of_axis) > 1:
            yield f"It takes `{'`, `'.join(of_axis)}` of the [configuration](configuration.md)."
        yield ""
        yield from _table(command, of_axis if len(of_axis) > 1 else ())
    yield "\n### Reply\n\n" + _words(Reply) + "\n"
    yield from _table(Reply)


def _table(struct: type[msgspec.Struct], without: Sequence[str] = ()) -> Iterator[str]:
    """Give a row to each field, and one to neighbours of which the same is said."""
    yield "| field | what |\n|---|---|"
    fields = [(name, field) for name, field in fields_of(struct).items() if name not in without]
    for said, alike in groupby(fields, lambda named: _said(named[1])):
        yield f"| {', '.join(f'`{name}`' for name, _ in alike)} | {said} |"


def _said(field: Field) -> str:
    plain = field.type in ("number", "integer", "string", "boolean") and field.unit in ("", *UNITS.values())
    return "; ".join(filter(None, (field.what, "" if plain else _kind(field))))


def _kind(field: Field) -> str:
    """Return type or range, and unit: "0 to 1000 m"."""
    kind = field.type.removeprefix("number, ")
    return field.unit if kind == "number" and field.unit else f"{kind} {field.unit}".rstrip()


def _words(struct: type[msgspec.Struct]) -> str:
    return " ".join((struct.__doc__ or "").split())


def _first(struct: type[msgspec.Struct]) -> str:
    return (struct.__doc__ or "").partition("\n")[0].rstrip(".")


def _link(record: type[msgspec.Struct]) -> str:
    return f"[{record.__name__}](#{record.__name__.lower()})"
