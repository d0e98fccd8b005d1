"""The file that outlasts a companion: what was under way, whole or not at all."""

import msgspec
import pytest

from companion.io.unfinished_path import UnfinishedPath, unfinished_path
from companion.telemetry.commands import MAX_VALUES, Follow, parse
from companion.telemetry.interruption import Datum, Interruption
from companion.telemetry.plan import MAX_SEGMENTS, Circle, PathPlan, Waypoint

HERE = Interruption(
    leg=3,
    along_m=1.25,
    start=(1.0, 2.0, 0.0, 0.0),
    frame=(0.1, -1.0, 2.0),
    datum=Datum(boot_s=100.5, boots=12, origin_deg=(47.4, 8.55), surface_pa=101_325.0),
)
LEFT = Follow(path=PathPlan(name="reef", circle=Circle(radius_m=2.0)), interrupted=HERE)


@pytest.fixture
def file(tmp_path):
    return tmp_path / "deep" / "path-kelp.json"


def kept(file, follow):
    keeps = UnfinishedPath(file)
    keeps.offer(follow)
    keeps.write()


def test_what_was_under_way_is_there_again_for_the_next_process(file):
    kept(file, LEFT)
    assert UnfinishedPath(file).recall() == LEFT
    assert [path.name for path in file.parent.iterdir()] == [file.name]


def test_a_path_that_has_ended_leaves_no_file_and_one_that_was_not_taken_up_yet_stays(file):
    kept(file, LEFT)
    waits = UnfinishedPath(file)
    waits.offer(None)
    waits.write()
    assert waits.recall() == LEFT
    waits.offer(LEFT)
    waits.write()
    waits.offer(None)
    waits.write()
    assert waits.recall() is None
    assert not file.exists()


def test_a_thread_writes_what_is_offered_last(file):
    keeps = UnfinishedPath(file)
    keeps.start()
    keeps.offer(LEFT)
    keeps.close()
    assert UnfinishedPath(file).recall() == LEFT


@pytest.mark.parametrize(
    "content", [b"", b"{", b"[" * 100_000, b"\xff", b'{"path":{"speed_mps":99}}', b" " * (1 << 19)]
)
def test_a_file_that_cannot_be_used_is_said_in_one_line_and_left_out(file, content, caplog):
    file.parent.mkdir()
    file.write_bytes(content)
    assert UnfinishedPath(file).recall() is None
    (record,) = caplog.records
    assert "has to be followed anew" in record.message
    assert str(file) in record.message
    assert "\n" not in record.message


def test_a_folder_that_takes_no_file_is_said_once(tmp_path, caplog):
    blocked = tmp_path / "blocked"
    blocked.write_text("", encoding="utf-8")
    keeps = UnfinishedPath(blocked / "path-kelp.json")
    keeps.offer(LEFT)
    keeps.write()
    keeps.write()
    (record,) = caplog.records
    assert "the path under way cannot be kept" in record.message


def test_each_vehicle_has_a_file_in_the_state_directory(tmp_path, monkeypatch):
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path))
    keeps = unfinished_path("kelp")
    keeps.offer(LEFT)
    keeps.write()
    assert (tmp_path / "path-kelp.json").exists()


def test_the_longest_path_can_be_taken_up():
    waypoints = tuple(
        Waypoint(
            x_m=float(i),
            y_m=1.0,
            depth_m=2.0,
            heading_deg=3.0,
            corner_m=1.0,
            wait_s=1.0,
            trigger=True,
            trigger_every_m=1.0,
        )
        for i in range(MAX_SEGMENTS)
    )
    payload = msgspec.json.encode(Follow(path=PathPlan(waypoint=waypoints), interrupted=HERE))
    assert sum(map(payload.count, b",[{")) <= MAX_VALUES
    again = parse("follow", payload)
    assert isinstance(again, Follow)
    assert again.interrupted == HERE
