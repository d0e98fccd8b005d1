"""A campaign's dives are their numbers, its rows survive a stop, its envelope is what it says."""

import csv
import json

import pytest

from lab import commands
from lab.studies import campaign
from lab.studies.campaign import Campaign
from lab.studies.campaign_cases import BLUEROV2, DISTURBANCES, VEHICLES, case
from lab.study import parser_of

CASES = [case(number) for number in range(360)]


def study(*options):
    return Campaign(parser_of(Campaign).parse_args(options))


@pytest.fixture
def brief(monkeypatch):
    """Let dives end soon after engaging; of one frame, for another takes half a minute more to compile."""
    monkeypatch.setattr(campaign, "case", lambda number: case(number)._replace(vehicle="heavy"))
    monkeypatch.setattr(campaign, "SINCE_S", 3.2)
    monkeypatch.setattr(campaign, "DURATION_S", 3.6)


def test_dives_cover_what_was_asked():
    assert {(one.vehicle, one.disturbance) for one in CASES} == {
        (v, d) for v in VEHICLES for d in DISTURBANCES
    }
    ranges = {"damping": (0.5, 1.5), "mass": (1.0, 1.3), "thrust": (0.7, 1.1), "delay_ms": (20, 150)}
    for name, (low, high) in ranges.items():
        values = [getattr(one, name) for one in CASES]
        assert low <= min(values) < low + 0.05 * (high - low)
        assert high - 0.05 * (high - low) < max(values) <= high
    for six, motors in ((True, 6), (False, 8)):
        assert {one.dead for one in CASES if (one.vehicle == BLUEROV2) is six} == set(range(motors + 1))


def test_the_envelope_leaves_out_what_turns_over():
    upright = CASES[0]._replace(vehicle="heavy", disturbance="load", dead=0)
    assert upright.inside
    assert upright._replace(dead=2).inside
    assert not upright._replace(dead=5).inside
    assert upright._replace(dead=5, disturbance="calm").inside


@pytest.mark.compiles
@pytest.mark.usefixtures("brief")
def test_the_command_continues_where_it_stopped(tmp_path, capsys):
    arguments = ["--out", str(tmp_path), "--workers", "1"]
    assert commands.campaign([*arguments, "--dives", "3"]) == 0
    files = ["--json", str(tmp_path / "summary.json"), "--table", str(tmp_path / "dives.table.csv")]
    assert commands.campaign([*arguments, "--dives", "6", *files]) == 0
    summary = json.loads((tmp_path / "summary.json").read_text())
    with (tmp_path / "dives.table.csv").open(newline="") as stream:
        table = list(csv.DictReader(stream))
    assert [int(row["number"]) for row in table] == list(range(6))
    assert [float(row["depth_rms_mm"]) for row in table] == [each["depth_rms_mm"] for each in summary["each"]]
    assert sum(int(line[2]) for line in summary["rows"][:-2]) == 6
    printed = capsys.readouterr().out
    assert "3 of these dives are there already" in " ".join(printed.split())
    assert "The envelope" in printed
