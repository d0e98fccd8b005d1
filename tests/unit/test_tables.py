"""What other programs read: a row for each dive, and nothing where a figure is missing."""

import argparse
import csv
import json
import math
import sys

import numpy as np
import pytest

import holdfast
from lab.tables import plain, table_file, write_columns, write_json, write_table

RECORDS = [
    {"row": "law", "seed": 1000, "held": True, "recovery_s": math.nan},
    {"row": "default", "seed": 1001, "held": False, "recovery_s": 1.5, "vehicle": "a, b"},
]


def test_a_table_has_a_line_for_each_dive_and_an_empty_cell_for_what_it_has_not(tmp_path):
    write_table(tmp_path / "dives.csv", RECORDS)
    with (tmp_path / "dives.csv").open(newline="") as file:
        read = list(csv.DictReader(file))
    assert [row["recovery_s"] for row in read] == ["", "1.5"]
    assert [row["vehicle"] for row in read] == ["", "a, b"]


def test_json_has_null_for_what_is_no_number(tmp_path):
    write_json(tmp_path / "dives.json", {"dives": RECORDS, "bounds": (math.inf, 1.0)})
    read = json.loads((tmp_path / "dives.json").read_text(), parse_constant=pytest.fail)
    assert read["dives"][0]["recovery_s"] is None
    assert read["bounds"] == [None, 1.0]


def test_parquet_has_the_same_and_its_types(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet", reason="the extra `parquet`: `make docs` brings it")
    write_table(tmp_path / "dives.parquet", RECORDS)
    write_columns(tmp_path / "ticks.parquet", {"at_s": np.array([0.0, np.nan]), "state": ["ACTIVE", ""]})
    assert parquet.read_table(tmp_path / "dives.parquet").to_pylist() == [
        plain(record) | {"vehicle": record.get("vehicle")} for record in RECORDS
    ]
    assert parquet.read_table(tmp_path / "ticks.parquet")["at_s"].to_pylist() == [0.0, None]


def test_a_table_that_cannot_be_written_is_refused_before_the_first_dive(monkeypatch, capsys):
    with pytest.raises(argparse.ArgumentTypeError, match=r"must end in \.csv or \.parquet"):
        table_file("dives.xlsx")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setattr(holdfast, "requires", lambda _: ["pyarrow>=23; extra == 'parquet'"])
    assert holdfast.main(["lab", "bench", "dives", "--table", "dives.parquet"]) == 2
    assert "pip install 'holdfast-rov[parquet]'" in capsys.readouterr().err
