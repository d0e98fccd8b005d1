"""What other programs read: a row for each dive, and nothing where a figure is missing."""

import csv
import json
import math

import pytest

import holdfast
from lab.tables import write_json, write_table

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


def test_a_table_that_cannot_be_written_is_refused_before_the_first_dive(capsys):
    with pytest.raises(SystemExit):
        holdfast.main(["lab", "bench", "dives", "--table", "dives.parquet"])
    assert "must end in .csv; pandas or pyarrow" in capsys.readouterr().err
