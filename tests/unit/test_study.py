"""The runner of all studies: every dive once, rows that survive a stop, files that tell their origin."""

import csv
import json
import math
from argparse import ArgumentParser
from pathlib import Path
from typing import NamedTuple

import pytest

from lab.options import add_out
from lab.study import Journal, Study, ruled, start


class Roll(NamedTuple):
    """One case."""

    number: int


class Rolls(Study[Roll]):
    """A study that needs no water."""

    command = "rolls"
    about = "Squares numbers."
    dived: list[int] = []  # noqa: RUF012  # of all instances

    @classmethod
    def options(cls, parser: ArgumentParser) -> None:
        add_out(parser, "out")
        parser.add_argument("--count", type=int, default=3)

    def __init__(self, arguments):
        self.count = arguments.count

    def cases(self):
        return [Roll(number) for number in range(self.count)]

    def groups(self, cases):
        return [cases[i : i + 2] for i in range(0, len(cases), 2)]

    def dive(self, cases):
        for case in cases:
            self.dived.append(case.number)
            yield {"square": float(case.number**2), "root": math.nan, "kinds": ["a"], "trace": [1]}

    def tables(self, rows):
        table = ruled("squares", "number", "square")
        for row in rows:
            table.add_row(str(row["number"]), f"{row['square']:g}")
        return [table, "said in words"]

    def failed(self, rows):
        return sum(row["square"] for row in rows) > 5.0


@pytest.fixture(autouse=True)
def _fresh(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Rolls, "dived", [])


def test_every_dive_comes_once_and_the_files_say_what_made_them(capsys):
    assert start(Rolls, ["--workers", "1", "--json", "all.json", "--table", "all.csv"]) == 0
    assert Rolls.dived == [0, 1, 2]
    assert "said in words" in capsys.readouterr().out
    written = json.loads(Path("all.json").read_text())
    assert written["dives"][2] == {"number": 2, "square": 4.0, "root": None, "kinds": ["a"]}
    assert written["provenance"]["command"] == "holdfast rolls --workers 1 --json all.json --table all.csv"
    assert {"commit", "date", "machine", "version"} <= written["provenance"].keys()
    with Path("all.csv").open(newline="") as file:
        assert list(csv.DictReader(file))[1] == {"number": "1", "square": "1.0", "root": ""}
    assert not Path("out/rolls.jsonl").exists()
    assert start(Rolls, ["--workers", "1", "--count", "4"]) == 1
    assert len(Rolls.dived) == 7


def test_rows_survive_a_stop_and_a_torn_line_is_dived_again(capsys, monkeypatch):
    with monkeypatch.context() as broken:
        broken.setattr(Rolls, "tables", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            start(Rolls, ["--workers", "1"])
    path = Path("out/rolls.jsonl")
    path.write_text(path.read_text()[:-20])  # the last row was being written when the power went
    assert start(Rolls, ["--workers", "1", "--count", "4", "--table", "all.csv"]) == 1
    assert Rolls.dived == [0, 1, 2, 2, 3]
    assert "out/rolls.jsonl: 2 of these dives are there already" in capsys.readouterr().out
    with Path("all.csv").open(newline="") as file:
        assert [row["number"] for row in csv.DictReader(file)] == ["0", "1", "2", "3"]


def test_rows_of_two_recipes_do_not_mix(tmp_path):
    path = tmp_path / "rows.jsonl"
    Journal(path, ("number",), {"recipe": "a"}).append([{"number": 1, "rms": math.nan}])
    (row,) = Journal(path, ("number",), {"recipe": "a"}).rows.values()
    assert math.isnan(row["rms"])
    assert not Journal(path, ("number",), {"recipe": "b"}).rows
