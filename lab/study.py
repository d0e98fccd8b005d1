"""Whatever the lab does many times is a study: its options, dives, tables, pictures and verdict.

A study is a file in `lab/studies`. The runner gives all of them progress, processes,
continuation after a stop, CSV and JSON, and the provenance of what they write.
"""

import argparse
import json
import math
import os
import platform
import shlex
import signal
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from datetime import UTC, datetime
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any, ClassVar, Generic, Protocol, TypeVar

from rich import box
from rich.console import Console, RenderableType
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from holdfast import FAILED, RefusedError, own_version
from holdfast.command_line import command_parser
from holdfast.version import revision
from lab.loop.firmware import FirmwareError
from lab.measured_sources import PROGRAMS, digest_of, measured_code
from lab.options import find_firmware, positive
from lab.tables import add_files, plain, write_json, write_table

CODE = (*PROGRAMS, "lab/**/*.py", "lab/**/*.toml")
"""The files under ROOT on which a dive depends."""

Row = dict[str, Any]
"""One dive: the fields of its case, then its results.

`trace` serves pictures and summaries and stands in no file of results; a list or dict stands in no table.
"""


class Case(Protocol):
    """What identifies one dive: a NamedTuple of strings and numbers."""

    def __hash__(self) -> int: ...
    def _asdict(self) -> dict[str, Any]: ...


C = TypeVar("C", bound=Case)


class Study(ABC, Generic[C]):
    """One study with the options it was asked for. Workers receive it whole, so it must be picklable."""

    command: ClassVar[str]
    """What follows `holdfast`; its last word names the study's files."""
    about: ClassVar[str]
    unit: ClassVar[str] = "dives"
    recipe: ClassVar[tuple[str, ...]] = ("set", "firmware")
    """The options that change the result of a dive; rows of another recipe are not continued."""
    rows_key: ClassVar[str] = "dives"
    """Key of the rows in the JSON file."""
    steps = 1
    """Steps of progress in a case: more than one where `dive` calls `advance`."""
    advance: Callable[[int], object] = staticmethod(lambda steps: None)
    """Reports steps of progress, if the study runs in the command's own process."""

    @classmethod
    @abstractmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        """Add the study's own options, `--out` among them."""

    @abstractmethod
    def __init__(self, arguments: argparse.Namespace) -> None:
        """Read the options. Raises RefusedError for what cannot be begun."""

    @abstractmethod
    def cases(self) -> Sequence[C]:
        """Return every dive that was asked for."""

    def groups(self, cases: Sequence[C]) -> Sequence[Sequence[C]]:
        """Split cases into those that a worker dives in one call."""
        return [[case] for case in cases]

    @abstractmethod
    def dive(self, cases: Sequence[C]) -> Iterable[Row]:
        """Dive one group; return the results of each case, without the case's own fields."""

    def tables(self, rows: Sequence[Row]) -> Iterable[RenderableType]:
        """Return what to print: the table of `summary`, unless a study has another."""
        made = self.summary(rows)
        table = ruled("", *made["columns"], padding=0)
        for column in table.columns:
            column.no_wrap, column.overflow = False, "fold"
        for line in made["rows"]:
            table.add_row(*line)
        return [table]

    def draw(self, rows: Sequence[Row], folder: Path) -> Sequence[Path]:
        """Draw, or write what else the study makes, into a folder that exists; return the files."""
        return ()

    def failed(self, rows: Sequence[Row]) -> bool:
        """Return whether the exit status is 1."""
        return False

    def summary(self, rows: Sequence[Row]) -> dict[str, Any]:
        """Return what the JSON file has beside the rows."""
        return {}

    def journal(self, out: Path) -> Path:
        """Return the file that takes the rows as they come."""
        return out / f"{self.command.split()[-1]}.jsonl"


def start(kind: type[Study[Any]], argv: Sequence[str], examples: str = "") -> int:
    """Run a study's command line, whose help ends with `examples`; return the exit status."""
    arguments = parser_of(kind, examples).parse_args(argv)
    find_firmware(arguments)
    arguments.command = shlex.join(["holdfast", *kind.command.split(), *argv])
    return run(kind(arguments), arguments, Console())


def parser_of(kind: type[Study[Any]], examples: str = "") -> argparse.ArgumentParser:
    """Return the parser of a study's options and the runner's."""
    parser = command_parser(kind.command, kind.about, examples)
    kind.options(parser)
    parser.add_argument(
        "--workers", type=positive, metavar="N", help="processes on this machine; default: its cores"
    )
    add_files(parser, row=kind.unit.removesuffix("s"))
    return parser


def run(study: Study[Any], arguments: argparse.Namespace, console: Console) -> int:
    """Dive what is missing, print, draw and write; return the exit status."""
    made, cases = provenance(arguments.command), study.cases()
    path = study.journal(arguments.out)
    journal = Journal(path, cases[0]._fields, made | {"recipe": recipe(study, arguments)})
    missing = [case for case in cases if case not in journal.rows]
    if len(missing) < len(cases):
        console.print(f"{path}: {len(cases) - len(missing)} of these {study.unit} are there already")
    try:
        _dive(study, journal, missing, arguments, console)
    except FirmwareError as error:
        sys.stderr.write(f"holdfast {study.command}: {error}\n")
        return FAILED
    rows = [journal.rows[case] for case in cases]
    for shown in study.tables(rows):
        console.print(shown, soft_wrap=isinstance(shown, str))
    if files := study.draw(rows, path.parent):
        console.print(f"written: {', '.join(map(str, files))}", soft_wrap=True)
    path.unlink()
    content = {"provenance": made, **study.summary(rows)}
    write_json(path.with_name(f"{study.command.split()[-1]}.json"), content)
    if arguments.json:
        untraced = [{key: value for key, value in row.items() if key != "trace"} for row in rows]
        write_json(arguments.json, content | {study.rows_key: untraced})
    if arguments.table:
        flat = [
            {key: value for key, value in row.items() if not isinstance(value, list | dict)} for row in rows
        ]
        write_table(arguments.table, flat)
    return FAILED if study.failed(rows) else 0


def _dive(
    study: Study[C], journal: "Journal", cases: Sequence[C], arguments: argparse.Namespace, console: Console
) -> None:
    """Dive the cases and note their rows."""
    if not cases:
        return
    groups, done = study.groups(cases), 0
    columns = BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn()
    with (
        workforce(1 if len(groups) == 1 else arguments.workers) as (executor, workers),
        Progress(TextColumn(study.unit), *columns, console=console) as progress,
    ):
        task = progress.add_task("", total=study.steps * len(cases))
        if executor is None:
            study.advance = partial(progress.advance, task)
        for group, found in dived(study, groups, executor, workers):
            journal.append(case._asdict() | row for case, row in zip(group, found, strict=True))
            done += len(group)
            progress.update(task, completed=study.steps * done)


def dived(
    study: Study[C], groups: Sequence[Sequence[C]], executor: Executor | None, workers: int
) -> Iterator[tuple[Sequence[C], list[Row]]]:
    """Dive groups; give each with its results as it comes back.

    Without an executor they dive here, one after the other; otherwise two a worker are on their way.
    """
    if executor is None:
        for group in groups:
            yield group, _rows(study, group)
        return
    waiting = list(reversed(groups))
    flying: dict[Future[list[Row]], Sequence[C]] = {}
    while waiting or flying:
        while waiting and len(flying) < 2 * workers:
            group = waiting.pop()
            flying[executor.submit(_rows, study, group)] = group
        for future in wait(flying, return_when=FIRST_COMPLETED).done:
            yield flying.pop(future), future.result()


def _rows(study: Study[C], cases: Sequence[C]) -> list[Row]:
    return list(study.dive(cases))


@contextmanager
def workforce(workers: int | None) -> Iterator[tuple[Executor | None, int]]:
    """Give an executor and how many dive at once; one worker needs none."""
    count = workers or os.cpu_count() or 1
    if count == 1:
        yield None, 1
        return
    # The terminal sends Ctrl-C to every process: workers die of it, and the command says the rest.
    ends = signal.SIGINT, signal.SIG_DFL
    with ProcessPoolExecutor(count, get_context("spawn"), signal.signal, ends) as pool:
        yield pool, count


class Journal:
    """Rows on disk as they come: JSON lines, of which the first says what made them."""

    def __init__(self, path: Path, fields: Sequence[str], made: Mapping[str, str]) -> None:
        """Open, or begin where another recipe made what is there; `fields` of a row identify it."""
        self._path, self._fields = path, fields
        self.rows: dict[tuple[Any, ...], Row] = {}
        path.parent.mkdir(parents=True, exist_ok=True)
        lines = path.read_bytes().splitlines(keepends=True) if path.exists() else []
        if lines and not lines[-1].endswith(b"\n"):
            lines.pop()  # it was torn by the end of a run
        if lines and json.loads(lines[0]).get("recipe") == made["recipe"]:
            path.write_bytes(b"".join(lines))
            for line in lines[1:]:
                self._add(json.loads(line, object_hook=_with_nan))
        else:
            path.write_text(json.dumps(made) + "\n", encoding="utf-8")

    def append(self, rows: Iterable[Row]) -> None:
        """Add rows; they are on disk when this returns."""
        with self._path.open("a", encoding="utf-8") as file:
            for row in rows:
                self._add(row)
                file.write(json.dumps(plain(row), allow_nan=False) + "\n")

    def _add(self, row: Row) -> None:
        self.rows[tuple(row[field] for field in self._fields)] = row


def _with_nan(record: Row) -> Row:
    return {key: math.nan if value is None else value for key, value in record.items()}


def recipe(study: Study[Any], arguments: argparse.Namespace) -> str:
    """Return a digest of the code, and of the options that change a dive."""
    digest = digest_of(CODE)
    options = {name: getattr(arguments, name, None) for name in study.recipe}
    for value in options.values():
        if isinstance(value, Path):
            digest.update(value.read_bytes())
    digest.update(json.dumps([study.command, options], default=str).encode())
    return digest.hexdigest()[:16]


def provenance(command: str) -> dict[str, str]:
    """Return what a result's reader needs to repeat it, and a digest of the code that was measured."""
    return {
        "command": command,
        "version": own_version(),
        "commit": revision(),
        "code": measured_code(),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}",
    }


def ruled(title: str, *columns: str, left: int = 1, caption: str | None = None, padding: int = 1) -> Table:
    """Return an empty table; all but the `left` first columns are set to the right."""
    table = Table(
        title=title,
        title_justify="left",
        title_style="bold",
        box=box.SIMPLE_HEAD,
        padding=(0, padding),
        caption=caption,
    )
    for i, column in enumerate(columns):
        table.add_column(column, justify="left" if i < left else "right", no_wrap=i >= left)
    return table


def by(rows: Iterable[Row], *keys: str) -> dict[tuple[Any, ...], list[Row]]:
    """Group rows by the values of `keys`, in the order in which they first come."""
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row[key] for key in keys), []).append(row)
    return groups


def known(names: Sequence[str], choices: Iterable[str], what: str) -> None:
    """Raise RefusedError if a name is none of `choices`."""
    choices = list(choices)
    if unknown := set(names).difference(choices):
        raise RefusedError(f"no such {what}: {min(unknown)}; there are {', '.join(choices)}")
