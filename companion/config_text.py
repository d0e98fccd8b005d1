"""A configuration as text: values in a commented TOML file, and a table of all keys."""

import json
import re
from collections.abc import Iterator, Mapping
from functools import partial

import msgspec

from companion.config import Config, Section
from companion.telemetry.fields import fields_of


def with_values(text: str, values: Mapping[str, float | str]) -> str:
    """Return `text` with values such as {"heave.kappa_per_s": 8.0} in place of its own; comments stay.

    A key that the text does not have is added to its section.
    """
    for key, value in values.items():
        section, name = key.split(".")
        shown = json.dumps(value) if isinstance(value, str) else repr(value)
        line = re.compile(rf"(^\[{section}\][^\n]*\n(?:(?!\[).*\n)*?{name} = )([^#\n]*)(.*$)", re.MULTILINE)
        text, count = line.subn(partial(_replaced, shown), text)
        if not count:
            if f"\n[{section}]" not in f"\n{text}":
                text = f"{text.rstrip()}\n\n[{section}]\n"
            head = re.compile(rf"(^\[{section}\][^\n]*\n)", re.MULTILINE)
            text = head.sub(partial(_followed, f"{name} = {shown}\n"), text, count=1)
    return text


def _replaced(shown: str, line: re.Match[str]) -> str:
    """Return a line with another value; what follows stays in its column where there is room."""
    value = shown.ljust(len(line[2]) - 1) + " " if line[3] else shown
    return line[1] + value + line[3]


def _followed(line: str, head: re.Match[str]) -> str:
    return head[0] + line


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
