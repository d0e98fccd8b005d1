"""TOML tables that become msgspec records: read, overridden, and what is wrong with one in words."""

import math
import re
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from msgspec import Meta, Struct

from holdfast import RefusedError, files

NO_LIMIT = (math.inf, "")


class ConfigError(RefusedError, ValueError):
    """A configuration that cannot be used; the message names file, key, value and what is allowed."""


def read(path: Path) -> dict[str, Any]:
    """Return the table of a TOML file; raise ConfigError that names the file and what is wrong."""
    try:
        return files.toml(files.text(path))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise ConfigError(f"{path}: {error}") from error


def override(table: dict[str, Any], text: str) -> None:
    """Apply `section.key=value` to a table; what is no TOML value is a word. Raises ConfigError."""
    key, equals, said = text.partition("=")
    *sections, last = key.strip().split(".")
    if not equals or not all((*sections, last)):
        raise ConfigError(f"--set {text}: write it as section.key=value")
    try:
        value = files.toml(f"value = {said}")["value"]
    except ValueError:
        value = said
    for section in sections:
        table = table.setdefault(section, {})
        if not isinstance(table, dict):
            raise ConfigError(f"--set {text}: {section} is a value, not a section")
    table[last] = value


def bounds(hint: Any) -> tuple[float, float] | None:
    """Return the least and the largest of a quantity's type; None where it has no range."""
    every = ((meta.ge, meta.le) for meta in metas(hint) if meta.ge is not None and meta.le is not None)
    return next(every, None)


def refusal(name: str, value: float, hint: Any, limit: tuple[float, str] = NO_LIMIT) -> str | None:
    """Return why `value` may not be `name`, or None where it may. NaN and infinities never may.

    `limit` is that of the configuration, below that of the type, and its key.
    """
    if (found := bounds(hint)) is None:
        return None
    lowest, most = found[0], min(found[1], limit[0])
    least, remedy = least_beside_zero(hint), _extra(hint, "remedy")
    if value == 0.0 if 0.0 <= value < least else lowest <= value <= most:
        return None
    shown = f"{value:g}" if isinstance(value, float) else str(value)[:20]
    allowed = (f"0, or {least:g}" if least else f"{lowest:g}") + f" to {most:g}"
    of_limit = f" ({limit[1]})" if limit[0] < found[1] else ""
    return f"{name} = {shown}: must be {allowed}{of_limit}{f'; {remedy}' if remedy else ''}"


def least_beside_zero(hint: Any) -> float:
    """Return the least that a quantity may be where it is not 0; 0 where it may be any."""
    return float(_extra(hint, "least") or 0.0)


def _extra(hint: Any, key: str) -> Any:
    every = ({**(meta.extra or {}), **(meta.extra_json_schema or {})} for meta in metas(hint))
    return next((more[key] for more in every if key in more), None)


def check_beside_zero(record: Struct) -> None:
    """Raise ValueError for a quantity that is neither 0 nor enough: msgspec itself knows one range alone."""
    for name, hint in _beside_zero(type(record)).items():
        value = getattr(record, name)
        if isinstance(value, float) and (refused := refusal(name, value, hint)):
            raise ValueError(refused)


@cache
def _beside_zero(kind: type[Struct]) -> dict[str, Any]:
    hints = get_type_hints(kind, include_extras=True)
    return {name: hint for name, hint in hints.items() if least_beside_zero(hint)}


def explained(
    table: Any, error: str, kind: type[Struct], limits: Mapping[str, tuple[float, str]] = MappingProxyType({})
) -> str:
    """Turn msgspec's "Expected … - at `$.heave.mass`" into key, value and what is allowed.

    `table` is what was to become a `kind`; `limits` are those of the configuration by key.
    """
    message, _, where = error.partition(" - at `$")
    place = where.strip("`").lstrip(".")
    if ": must be 0, or " in message:  # of `check_beside_zero`
        return f"{place}.{message}".lstrip(".")
    parts = [part for part in re.split(r"[.\[\]]", where.strip("`")) if part]
    hint = _hint_at(kind, parts)
    if field := re.search(r"(unknown|required) field `(.+)`", message):
        name = f"{place}.{field[2]}" if place else field[2]
        known = ", ".join((*getattr(hint, "also_known", ()), *getattr(hint, "__struct_fields__", ())))
        return f"{name}: unknown key; known here: {known}" if field[1] == "unknown" else f"{name}: missing"
    value: Any = table
    for part in parts:
        if isinstance(value, dict):
            value = value.get(part)
        else:
            value = value[int(part)] if isinstance(value, list) and part.isdigit() else None
    name = place or "all of it"
    if type(value) in (int, float) and (refused := refusal(name, value, hint, limits.get(name, NO_LIMIT))):
        return refused
    allowed = choices(hint) if "enum" in message else ()
    said = "must be one of " + ", ".join(allowed) if allowed else message[0].lower() + message[1:]
    return f"{name} = {value!r:.80}: {said}"


def choices(hint: Any) -> tuple[str, ...]:
    """Return the words that a quantity can be; none where it is no choice."""
    if get_origin(hint) is Annotated:
        hint = get_args(hint)[0]
    return get_args(hint) if get_origin(hint) is Literal else ()


def metas(hint: Any) -> Iterator[Meta]:
    """Go through what annotates a type, and each part of a union."""
    if isinstance(hint, Meta):
        yield hint
    for part in (*getattr(hint, "__metadata__", ()), *get_args(hint)):
        yield from metas(part)


def _hint_at(hint: Any, parts: list[str]) -> Any:
    for part in parts:
        kinds = (hint, *get_args(hint))
        if part.isdigit():
            hint = next(iter(kinds[1:]), None)
        else:
            struct = next(
                (kind for kind in kinds if isinstance(kind, type) and issubclass(kind, Struct)), Struct
            )
            hint = get_type_hints(struct, include_extras=True).get(part)
    return hint
