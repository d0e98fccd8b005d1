"""The pre-dive list for people and for scripts: `holdfast check` alone prints it, the controller never."""

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict

from companion.predive.check import CheckRow, Grade


def as_json(rows: Sequence[CheckRow], notes: Sequence[str]) -> str:
    """Return {"grade", "verdict", "rows": [{name, grade, found, why, fix}], "notes"}."""
    listed = [asdict(row) | {"grade": row.grade.name} for row in rows]
    found = {"grade": worst(rows).name, "verdict": verdict(rows), "rows": listed, "notes": list(notes)}
    return json.dumps(found, indent=1)


def from_json(text: bytes) -> list[CheckRow]:
    """Return the rows of `as_json`. Raises ValueError for anything else."""
    try:
        return [CheckRow(**row | {"grade": Grade[row["grade"]]}) for row in json.loads(text)["rows"]]
    except (KeyError, TypeError) as error:
        raise ValueError(f"no pre-dive list: {error!r}") from error


def show(rows: Sequence[CheckRow], notes: Sequence[str]) -> None:
    """Print the list; a row that is not good says why it matters and how to fix it."""
    for row in rows:
        mark = "REFUSED" if row.grade is Grade.REFUSED else row.grade.name.lower()
        sys.stdout.write(f"{mark:>8}  {row.name}: {row.found}\n")
        if row.grade is not Grade.GOOD:
            sys.stdout.write(f"          {row.why}. Fix: {row.fix}\n")
    for note in (*notes, verdict(rows)):
        sys.stdout.write(f"{note}\n")


def verdict(rows: Sequence[CheckRow]) -> str:
    """Return whether Holdfast may engage, and what speaks against it."""
    refused = "; ".join(f"{row.name}: {row.found}" for row in rows if row.grade is Grade.REFUSED)
    if refused or not rows:
        return f"NOT ready: {refused or 'nothing is known'}"
    doubtful = ", ".join(row.name for row in rows if row.grade is Grade.WARNING)
    return f"ready: it may engage as soon as it is armed{f'; look at {doubtful}' if doubtful else ''}"


def worst(rows: Sequence[CheckRow]) -> Grade:
    """Return the worst grade, which is the exit status."""
    return max((row.grade for row in rows), default=Grade.REFUSED)
