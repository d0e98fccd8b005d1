"""Figures on disk: JSON, and a table with a row for each dive as CSV.

What a dive does not have (NaN) is null in JSON and an empty cell in CSV.
"""

import argparse
import csv
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from lab.options import json_file


def table_file(text: str) -> Path:
    """Read the path of a table, and make its folder.

    Raises argparse.ArgumentTypeError for another ending than .csv.
    """
    if Path(text).suffix != ".csv":
        raise argparse.ArgumentTypeError(
            f"'{text}': the name must end in .csv; pandas or pyarrow make other formats of that"
        )
    return json_file(text)


def add_files(parser: argparse.ArgumentParser, row: str) -> None:
    """Add `--json FILE` and `--table FILE`; a table's row is one `row`."""
    parser.add_argument("--json", type=json_file, metavar="FILE", help="also write the figures to FILE")
    parser.add_argument(
        "--table",
        type=table_file,
        metavar="FILE",
        help=f"also write a table with one row for each {row} to FILE.csv",
    )


def write_json(path: Path, content: Any) -> None:
    """Write what consists of dicts, sequences, strings and numbers. Raises OSError."""
    path.write_text(json.dumps(plain(content), indent=1, allow_nan=False) + "\n", encoding="utf-8")


def write_table(path: Path, records: Sequence[Mapping[str, Any]]) -> None:
    """Write flat records, which may differ in their keys, as CSV. Raises OSError."""
    names = dict.fromkeys(name for record in records for name in record)
    write_columns(path, {name: [record.get(name) for record in records] for name in names})


def write_columns(path: Path, columns: Mapping[str, Any]) -> None:
    """Write columns of one length as CSV. Raises OSError."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(map(plain, zip(*columns.values(), strict=True)))


def plain(value: Any) -> Any:
    """Return `value` with None in place of every number that is not finite."""
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
