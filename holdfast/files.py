"""Texts that somebody else made: a limit of size, depth and count stands in front of every reader.

A ValueError says what is wrong with a file; the reader's command adds which file, and ends with status 2.
"""

import codecs
import json
import os
import re
import tomllib
from collections import Counter
from collections.abc import Callable
from itertools import chain
from pathlib import Path
from typing import Any

from holdfast import RefusedError

MAX_BYTES = 1 << 18
"""Largest text; the largest of our own have a fifth of it."""
MAX_LOG_BYTES = 1 << 32
"""Largest log or recording: two days of raw ticks."""
MARKS = {codecs.BOM_UTF8: "utf-8-sig", codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}
"""Byte order marks, with which Windows and spreadsheets begin a text, and what they declare."""
MAX_DEPTH = 32
TOO_DEEP = f"is nested more than {MAX_DEPTH} deep: flatten it"
MAX_NUMBER = 2**63
MAX_KEY_PARTS = 8
_PART = r"""(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*\.[ \t]*"""
_HEAD = re.compile(r"\s*\[(\[?)\s*([\w.-]+)\s*\]")
_LONG_KEY = re.compile(rf"(?<![\w-])(?:{_PART}){{{MAX_KEY_PARTS}}}", re.ASCII)


def text(path: Path) -> str:
    """Return the text of a file; raise ValueError for one that is too large or no text, OSError."""
    with path.open("rb") as file:
        data = file.read(MAX_BYTES + 1)
    if len(data) > MAX_BYTES:
        raise ValueError(f"is larger than {MAX_BYTES} bytes: give a smaller file")
    return decoded(data)


def encoding(head: bytes) -> str:
    """Return the encoding that the first bytes of a text declare, UTF-8 where they do not."""
    return next((name for mark, name in MARKS.items() if head.startswith(mark)), "utf-8")


def decoded(data: bytes) -> str:
    """Return a text in UTF-8, or in what its byte order mark declares; raise ValueError for another.

    The mark, and Windows' line ends, are taken away.
    """
    declared = encoding(data)
    try:
        return data.decode(declared).replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise ValueError(f"line {line} is not {declared.upper()} text: save it as UTF-8") from error


def state_directory() -> Path:
    """Return systemd's state directory, or the user's."""
    systemd = os.environ.get("STATE_DIRECTORY", "").partition(":")[0]
    if systemd:
        return Path(systemd)
    home = Path(os.environ.get("HOME", "/")) / ".local" / "state"
    return Path(os.environ.get("XDG_STATE_HOME") or home) / "holdfast"


def refuse_endless(path: Path) -> None:
    """Raise RefusedError for a pipe or a device, which may never begin or end, and for a file of many GB."""
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise RefusedError(f"{path}: is a pipe or a device: save what it gives as a file")
    if path.is_file() and path.stat().st_size > MAX_LOG_BYTES:
        raise RefusedError(f"{path}: is larger than {MAX_LOG_BYTES >> 20} MiB: cut it into parts")


def refuse_existing(*paths: Path) -> None:
    """Raise RefusedError where a file that is to be written is there: nobody's work is written over."""
    if there := [path for path in paths if path.exists()]:
        raise RefusedError(f"{there[0]} is there already; remove it or choose another --out")


def toml(source: str) -> dict[str, Any]:
    """Return a TOML table; raise ValueError, in words, for a text that is none."""
    if _LONG_KEY.search(source):
        raise ValueError(f"a key has more than {MAX_KEY_PARTS} parts: shorten it")
    table: dict[str, Any] = _parsed(source, "TOML", tomllib.loads)
    return table


def from_json(source: str) -> Any:
    """Return a JSON value; raise ValueError, in words, for a text that is none."""

    def refuse(constant: str) -> None:
        raise ValueError(f"{constant} is no number")

    return _parsed(source, "JSON", lambda text: json.loads(text, parse_constant=refuse))


def _parsed(source: str, kind: str, parse: Callable[[str], Any]) -> Any:
    try:
        value = parse(source)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"is not {kind}: {error}") from error
    level = [value]
    for _ in range(MAX_DEPTH):
        if any(isinstance(node, int) and abs(node) > MAX_NUMBER for node in level):
            raise ValueError("a whole number has more than 64 bits: correct it")
        inner = (
            node.values() if isinstance(node, dict) else node
            for node in level
            if isinstance(node, dict | list)
        )
        level = [*chain.from_iterable(inner)]
        if not level:
            return value
    raise ValueError(TOO_DEEP)


def line_of(path: Path, key: str) -> int:
    """Return the line of a TOML file in which a key such as "waypoint[2].x_m" stands; 0 if none does."""
    section, counts = "", Counter[str]()
    for number, line in enumerate(text(path).splitlines() if path.is_file() else (), start=1):
        if head := _HEAD.match(line):
            section = head[2]
            if head[1]:
                section += f"[{counts[head[2]]}]"
                counts[head[2]] += 1
        name = section if head else f"{section}.{line.partition('=')[0].strip()}".lstrip(".")
        if name == key:
            return number
    return 0


def check_brackets(source: str) -> None:
    """Raise ValueError for a text in which more than `MAX_DEPTH` brackets are open at once."""
    depth = 0
    for char in source:
        depth += (char in "[{") - (char in "]}")
        if depth > MAX_DEPTH:
            raise ValueError(TOO_DEEP)
