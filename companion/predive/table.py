"""The pre-dive list for people and for scripts: `holdfast check` alone prints it, the controller never."""

import json
import sys
from collections.abc import Sequence

from companion.predive.check import CheckRow, Grade

MARKS = {Grade.GOOD: "good", Grade.WARNING: "warning", Grade.REFUSED: "REFUSED"}
COLOURS = {Grade.GOOD: "green", Grade.WARNING: "yellow", Grade.REFUSED: "bold red"}


def as_json(rows: Sequence[CheckRow], notes: Sequence[str]) -> str:
    """Return {"grade", "rows": [{name, grade, found, why, fix}], "notes"}."""
    listed = [
        {"name": row.name, "grade": row.grade.name, "found": row.found, "why": row.why, "fix": row.fix}
        for row in rows
    ]
    return json.dumps({"grade": worst(rows).name, "rows": listed, "notes": list(notes)}, indent=1)


def from_json(text: bytes) -> list[CheckRow]:
    """Return the rows of `as_json`. Raises ValueError for anything else."""
    try:
        listed = json.loads(text)["rows"]
        return [
            CheckRow(row["name"], Grade[row["grade"]], row["found"], row["why"], row["fix"]) for row in listed
        ]
    except (KeyError, TypeError) as error:
        raise ValueError(f"no pre-dive list: {error!r}") from error


def show(rows: Sequence[CheckRow], notes: Sequence[str]) -> None:
    """Print the list: a table where rich is there, lines where it is not (a vehicle needs no rich)."""
    try:
        from rich import box
        from rich.console import Console
        from rich.table import Table
        from rich.text import Text
    except ImportError:
        for row in rows:
            sys.stdout.write(f"{MARKS[row.grade]:>8}  {row.name}: {row.found}\n")
            if row.grade is not Grade.GOOD:
                sys.stdout.write(f"          {row.why}. Fix: {row.fix}\n")
    else:
        table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
        for column in ("", "row", "found", "why it matters", "how to fix it"):
            table.add_column(column, overflow="fold")
        for row in rows:
            mark = Text(MARKS[row.grade], COLOURS[row.grade])
            fix = "" if row.grade is Grade.GOOD else row.fix
            table.add_row(mark, *(Text(text) for text in (row.name, row.found, row.why, fix)))
        Console(width=None if sys.stdout.isatty() else 140).print(table)
    for note in notes:
        sys.stdout.write(f"{note}\n")


def worst(rows: Sequence[CheckRow]) -> Grade:
    """Return the worst grade, which is the exit status."""
    return max((row.grade for row in rows), default=Grade.REFUSED)
