"""A CSV as programs and spreadsheets save it: docs/identify.md has its columns.

It is known by its header, the first line that has a column t_s. Before it may stand comments (#), empty lines
and a spreadsheet's `sep=;`. Commas, semicolons, tabs or spaces part the columns; where no comma does, it may
be the decimal sign. Times are seconds, milliseconds, microseconds or nanoseconds, since whenever.
"""

import csv
import math
from array import array
from collections import Counter
from collections.abc import Mapping
from itertools import chain
from pathlib import Path
from typing import Any, Final

import numpy as np

from companion.arrays import Array
from companion.identify.sample_table import ABSURD, NoDiveError, Streams
from holdfast.files import encoding
from lab.identify.telemetry import not_read

TIME: Final = "t_s"
STICKS: Final = ("surge", "sway", "heave", "yaw", "roll", "pitch")
MEASURED: Final = {
    "depth": ("z_m",),
    "attitude": ("phi_rad", "theta_rad", "psi_rad"),
    "body": ("u_mps", "v_mps", "w_mps"),
    "rates": ("p_radps", "q_radps", "r_radps"),
}
"""Columns by the stream that they fill."""
COLUMNS: Final = (TIME, *STICKS, *chain.from_iterable(MEASURED.values()))
SEPARATORS: Final = (";", "\t", ",", " ")
UNITS: Final = ((2e6, 1e-9, "nanoseconds"), (2e3, 1e-6, "microseconds"), (2.0, 1e-3, "milliseconds"))
"""Units by the least step between two rows: s, and name. No vehicle is known by a row in 2 s."""
MAX_ROWS: Final = 1_000_000
MAX_BACKWARDS: Final = 0.01
"""Share of rows that may be out of order, as where two tables were joined."""
MAX_LINE, MAX_QUOTED, MAX_BEFORE = 4096, 200, 100


def header(head: bytes) -> str:
    """Return the header in the first bytes of a file, empty where it has none."""
    lines = head.decode(encoding(head), errors="replace").splitlines()
    return next((line for line in lines[:MAX_BEFORE] if TIME in _names(line, _separator(line))), "")


def quoted(head: bytes) -> str:
    """Return what a refusal quotes of a text: its first line; nothing of what is no text."""
    line = next(iter(head.decode(encoding(head), errors="replace").splitlines()), "")
    return f"; it begins with: {line[:MAX_QUOTED]}" if line.isprintable() and "\ufffd" not in line else ""


def read(path: Path) -> Streams:
    """Read it; a row has commands or measurements, or both. Raises NoDiveError, OSError."""
    values, unread = array("d"), Counter[str]()
    with path.open("rb") as binary:
        declared = encoding(binary.read(4))
    with path.open(encoding=declared, errors="replace", newline="") as file:
        lines = (line[:MAX_LINE] for line in iter(lambda: file.readline(MAX_LINE), ""))
        head = next(line for line in lines if TIME in _names(line, _separator(line)))
        separator = _separator(head)
        names = _names(head, separator)
        if not {*names} & {*STICKS} or not {*names} & {*COLUMNS[1 + len(STICKS) :]}:
            raise NoDiveError(
                f"has no columns of commands ({', '.join(STICKS)}) or of measurements (z_m, u_mps, ...); "
                f"its header is: {head.strip()[:MAX_QUOTED]}"
            )
        number, rows = 0, csv.reader(lines, delimiter=separator, skipinitialspace=True)
        try:
            for number, cells in enumerate(rows):
                if number > MAX_ROWS:
                    raise NoDiveError(f"has more than {MAX_ROWS} rows: cut it into parts")
                row = dict(zip(names, cells, strict=False))
                values.extend(_number(row, column, unread, comma=separator != ",") for column in COLUMNS)
        except csv.Error as error:
            raise NoDiveError(f"row {number + 2} cannot be read: {error}") from error
    table = np.array(values).reshape(-1, len(COLUMNS))
    table = table[np.isfinite(table[:, 0])]
    if (backwards := int(np.sum(np.diff(table[:, 0]) < 0.0))) > MAX_BACKWARDS * number + 1:
        raise NoDiveError(f"has {backwards} rows whose {TIME} is before the row above: sort or correct them")
    unit = _count_in_seconds(table[:, 0])
    return _streams(table)._replace(notes=(*unit, *not_read(unread)))


def _separator(line: str) -> str:
    return max(SEPARATORS, key=line.count)


def _names(line: str, separator: str) -> list[str]:
    return [name.strip().strip('"').strip().lower() for name in line.strip().split(separator)]


def _number(row: Mapping[str, str], column: str, unread: Counter[str], *, comma: bool) -> float:
    """Return a cell's number, NaN for an empty one and, counted, for one that holds none."""
    text = row.get(column, "").strip()
    try:
        return float(text.replace(",", ".") if comma else text) if text else math.nan
    except ValueError:
        unread[f"cells of {column}"] += 1
        return math.nan


def _count_in_seconds(times: Array) -> tuple[str, ...]:
    """Let the times begin at 0, in seconds; say so where they were in another unit."""
    steps = np.diff(np.unique(times))
    step = float(np.median(steps)) if steps.size else 0.0
    scale, unit = next(((scale, unit) for least, scale, unit in UNITS if step >= least), (1.0, ""))
    times[:] = (times - times.min(initial=math.inf)) * scale
    return (f"{TIME} counts {unit}",) if unit else ()


def _streams(table: Array) -> Streams:
    """Return each stream's columns, in the rows in which it has a number."""
    found, at = dict[str, Any](), 1
    for name, columns in {"sticks": STICKS, **MEASURED}.items():
        values, at = table[:, at : at + len(columns)], at + len(columns)
        sane = np.abs(values) < ABSURD
        known = np.isfinite(values).any(axis=1) if name == "sticks" else sane.any(axis=1)
        values = np.where(sane, values, 0.0) if name == "sticks" else values
        found[name] = np.column_stack((table[:, 0], values))[known]
    return Streams(**found)
