"""A configuration as text: values in a commented TOML file, and a table of all keys."""

import json
import re
from collections.abc import Iterator, Mapping

import msgspec

from companion.config import Config, Section
from companion.telemetry.fields import fields_of


def with_values(text: str, values: Mapping[str, float | str]) -> str:
    """Return `text` with values such as {"heave.kappa_per_s": 8.0} in place of its own; comments stay.

    A key that the text does not have is added to its section.
    """
    lines = text.splitlines()
    for key, value in values.items():
        section, name = key.split(".")
        shown = json.dumps(value) if isinstance(value, str) else repr(value)
        if not any(line.startswith(f"[{section}]") for line in lines):
            lines += ["", f"[{section}]"]
        at = next(i for i, line in enumerate(lines) if line.startswith(f"[{section}]")) + 1
        end = next((i for i, line in enumerate(lines) if i >= at and line.startswith("[")), len(lines))
        old = next((i for i in range(at, end) if lines[i].startswith(f"{name} = ")), None)
        if old is None:
            lines.insert(at, f"{name} = {shown}")
            continue
        found = re.fullmatch(r"([^#\n]*?)(\s*)(#.*)?", lines[old])
        assert found is not None
        line = f"{name} = {shown}"
        lines[old] = f"{line.ljust(len(found[1] + found[2]) - 1)} {found[3]}" if found[3] else line
    return "\n".join(lines) + "\n"


def listing(config: Config, origins: Mapping[str, str]) -> Iterator[str]:
    """Return a line for each key: its value, what is allowed, and where the value comes from."""
    rows = []
    for section, values in msgspec.to_builtins(config).items():
        record = getattr(config, section)
        fields = fields_of(type(record)) if isinstance(record, Section) else {}
        for key, value in values.items():
            field = fields.get(key)
            allowed = f"{field.type} {field.unit}".rstrip().replace("`", "") if field else ""
            name = f"{section}.{key}"
            rows.append((name, json.dumps(value), allowed, origins[name]))
    widths = [max(map(len, column)) for column in list(zip(*rows, strict=True))[:3]]
    for *cells, source in rows:
        yield "  ".join([*(f"{cell:{width}}" for cell, width in zip(cells, widths, strict=True)), source])
