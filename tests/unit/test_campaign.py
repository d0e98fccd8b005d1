"""A campaign's dives are their numbers, its rows survive a stop, its envelope is what it says."""

import csv
import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace as changed

import pytest
from msgspec.structs import replace

from companion.config import load_config
from lab import commands
from lab.campaign import campaign
from lab.campaign.campaign import BLUEROV2, DISTURBANCES, VEHICLES, CampaignRow, batches, case, plant, run
from lab.campaign.file import CampaignError, CampaignFile

pytestmark = pytest.mark.timeout(400)  # whoever is first compiles the loop

CONFIG = load_config()
CASES = [case(number) for number in range(360)]


@pytest.fixture
def brief(monkeypatch):
    """Let dives end soon after engaging."""
    monkeypatch.setattr(campaign, "SINCE_S", 3.2)
    monkeypatch.setattr(campaign, "DURATION_S", 3.6)


def test_a_number_is_always_the_same_dive():
    assert case(4711) == case(4711)
    assert plant(case(4711)) == plant(case(4711))
    assert case(4711) != case(4712)


def test_dives_cover_what_was_asked():
    assert {(one.vehicle, one.disturbance) for one in CASES} == {
        (v, d) for v in VEHICLES for d in DISTURBANCES
    }
    for name, low, high in (
        ("damping", 0.5, 1.5),
        ("mass", 1.0, 1.3),
        ("thrust", 0.7, 1.1),
        ("delay_ms", 20, 150),
    ):
        values = [getattr(one, name) for one in CASES]
        assert low <= min(values) < low + 0.05 * (high - low)
        assert high - 0.05 * (high - low) < max(values) <= high
    dead = {one.dead for one in CASES if one.vehicle != BLUEROV2}
    assert dead == set(range(9))
    assert {one.dead for one in CASES if one.vehicle == BLUEROV2} == set(range(7))


def test_a_dead_thruster_does_not_push():
    one = next(one for one in CASES if one.dead)
    gain = plant(one).thrusters.gain
    assert gain[one.dead - 1] == 0.0
    assert sorted(gain)[1] == one.thrust


def test_a_batch_has_one_frame():
    parts = batches(range(40))
    assert sorted(number for part in parts for number in part) == list(range(40))
    for part in parts:
        assert len({plant(case(number)).thrusters.frame for number in part}) == 1


def test_the_envelope_leaves_out_what_turns_over():
    upright = changed(CASES[0], vehicle="heavy", disturbance="load", dead=0)
    assert upright.inside
    assert changed(upright, dead=2).inside
    assert not changed(upright, dead=5).inside
    assert changed(upright, dead=5, disturbance="calm").inside


def test_rows_survive_a_stop(tmp_path):
    rows = [CampaignRow(case(n), "held", {"depth_rms_mm": 3.5 + n, "lost_s": float("nan")}) for n in range(4)]
    file = CampaignFile(tmp_path, CONFIG)
    file.append(rows[:2])
    file.append(rows[2:])
    path = tmp_path / "dives.csv"
    path.write_text(path.read_text()[:-20])  # the last row was being written when the power went
    again = CampaignFile(tmp_path, CONFIG)
    assert [row.case for row in again.rows] == [row.case for row in rows[:3]]
    assert [row.figures["depth_rms_mm"] for row in again.rows] == [3.5, 4.5, 5.5]
    again.append(rows[3:])
    assert [row.case.number for row in CampaignFile(tmp_path, CONFIG).rows] == [0, 1, 2, 3]


def test_rows_of_two_configurations_do_not_mix(tmp_path):
    CampaignFile(tmp_path, CONFIG).append([CampaignRow(case(1), "held", {"depth_rms_mm": 1.0})])
    other = replace(CONFIG, heave=replace(CONFIG.heave, kappa_per_s=1.0))
    with pytest.raises(CampaignError, match="another configuration"):
        CampaignFile(tmp_path, other)


@pytest.mark.usefixtures("brief")
def test_every_dive_comes_back_once():
    with ThreadPoolExecutor(2) as executor:
        rows = [row for batch in run(executor, 2, CONFIG, range(9)) for row in batch.rows]
    assert sorted(row.case.number for row in rows) == list(range(9))
    assert all(row.outcome == "held" for row in rows)


@pytest.mark.usefixtures("brief")
def test_the_command_continues_where_it_stopped(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("lab.campaign.report.worker_pool", lambda count, start: ThreadPoolExecutor(count))
    arguments = ["--out", str(tmp_path), "--workers", "1"]
    assert commands.campaign([*arguments, "--dives", "3"]) == 0
    files = ["--json", str(tmp_path / "summary.json"), "--table", str(tmp_path / "dives.table.csv")]
    assert commands.campaign([*arguments, "--dives", "6", *files]) == 0
    summary = json.loads((tmp_path / "summary.json").read_text())
    with (tmp_path / "dives.table.csv").open(newline="") as stream:
        table = list(csv.DictReader(stream))
    assert [int(row["number"]) for row in table] == list(range(6))
    assert [float(row["depth_rms_mm"]) for row in table] == [each["depth_rms_mm"] for each in summary["each"]]
    outside = summary["outside"]["dives"]
    assert summary["dives"] == 6
    assert summary["speed"]["dives"] == 3
    assert (tmp_path / "worst.png").stat().st_size > 10_000
    printed = capsys.readouterr().out
    assert "The envelope" in printed
    assert "holdfast campaign --replay" in printed
    assert ("Worst outside:" in printed) == bool(outside)
