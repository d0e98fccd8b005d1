"""A recording keeps what came, plots as it is, and gives back all but a cut end."""

import errno
import json
import os
import resource
import shutil
import struct
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest
from mcap.reader import make_reader
from msgspec.structs import replace

from companion.records import ControlSample
from companion.telemetry import samples
from companion.telemetry import schemas as telemetry
from dashboard.recording.mcap_file import (
    Item,
    Reader,
    Recording,
    schema_of,
)
from dashboard.recording.record import main as record_main
from dashboard.recording.recorder import AGAIN_S, DiveRecorder, FileLimits, Losses

MakeSample = Callable[..., ControlSample]
UTC_NS = 1_795_000_000_000_000_000


@pytest.fixture(scope="module")
def ticks(make_sample: MakeSample) -> list[list[tuple[str, str, bytes]]]:
    """Ten seconds of all keys."""
    return [samples.encode(make_sample(t_s=100.0 + 0.02 * i), "kelp") for i in range(500)]


@pytest.fixture
def written(tmp_path: Path, ticks: list[list[tuple[str, str, bytes]]]) -> Path:
    """A whole recording of them, put on the disk once a second."""
    path = tmp_path / "kelp.mcap"
    recording = Recording(path)
    recording.describe("config", {"heave.kappa_per_s": "11.0"})
    for i, tick in enumerate(ticks):
        for key, encoding, payload in tick:
            stamp = UTC_NS + i * 20_000_000
            recording.add(Item(key, encoding, payload, stamp, stamp + 1000))
        if i % 50 == 49:
            recording.sync()
    recording.close()
    return path


def recorder(directory: Path, **limits: Any) -> DiveRecorder:
    return DiveRecorder("kelp", FileLimits(directory, **({"reserve_bytes": 1} | limits)), {"git": "abc"})


def feed(recorder: DiveRecorder, ticks: list[list[tuple[str, str, bytes]]], begin: int = 0) -> None:
    for i, tick in enumerate(ticks, begin):
        for key, encoding, payload in tick:
            recorder.take(key, encoding, payload, UTC_NS + i * 20_000_000, 0.02 * i)


# --- What is in the file ----------------------------------------------------------------------------------


def test_all_comes_back_as_it_was(written: Path, ticks: list[list[tuple[str, str, bytes]]]) -> None:
    reader = Reader(written)
    assert [(item.key, item.encoding, item.payload) for item in reader] == [
        sample for tick in ticks for sample in tick
    ]
    assert reader.whole
    assert reader.metadata == {"config": {"heave.kappa_per_s": "11.0"}}


def test_strangers_read_it_with_its_index(written: Path) -> None:
    with written.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == 500 * 8
    assert {channel.message_encoding for channel in summary.channels.values()} == {"json"}
    assert {schema.encoding for schema in summary.schemas.values()} == {"jsonschema"}
    assert {schema.name for schema in summary.schemas.values()} == {
        f"holdfast.{name}.v1" for name in ("State", "Dof", "Command", "Supervisor", "Loop")
    }


@pytest.mark.parametrize("encoding", [*telemetry.ENCODINGS.values(), telemetry.TRUTH_ENCODING])
def test_foxglove_understands_every_schema(encoding: str) -> None:
    name, schema = schema_of(encoding) or ("", b"")
    assert name == encoding.partition(";")[2]
    if "json" in encoding:
        plotted(json.loads(schema))


def plotted(schema: dict[str, Any]) -> None:
    """Fail where the parser of Foxglove and Lichtblick does: it knows no $ref, and wants types."""
    assert schema["type"] == "object"
    for field in schema["properties"].values():
        if field["type"] == "object":
            plotted(field)
        elif field["type"] == "array":
            assert field["items"]["type"] in ("boolean", "string", "number", "integer")
        else:
            assert field["type"] in ("boolean", "string", "number", "integer")


# --- A cut file -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kept", [0.999, 0.7, 0.31])
def test_a_cut_file_gives_all_whole_chunks(written: Path, tmp_path: Path, kept: float) -> None:
    whole = list(Reader(written))
    data = written.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: int(kept * len(data))])
    reader = Reader(cut)
    items = list(reader)
    assert items == whole[: len(items)]
    assert not reader.whole
    assert len(items) > 0.9 * kept * len(whole) - 200


def test_a_recording_that_is_still_written_is_read_as_far_as_it_goes(tmp_path: Path) -> None:
    """It grows while it is read."""
    path = tmp_path / "now.mcap"
    recording = Recording(path)

    def more() -> None:
        recording.add(Item("holdfast/kelp/state", "application/json", b"{}", 1, 1))
        recording.sync()

    more()
    reader = Reader(path)
    for item in reader:
        assert item.payload == b"{}"
        more()
    assert (reader.lost_bytes, reader.broken_chunks, reader.whole) == (0, 0, False)
    recording.close()


# --- The recorder -----------------------------------------------------------------------------------------


def test_the_log_time_is_the_sample_s_own(tmp_path: Path, ticks: list[list[tuple[str, str, bytes]]]) -> None:
    kept = recorder(tmp_path)
    assert kept.start(UTC_NS)
    delay_ns = iter([0, 5, 400, 3, 2, 70] * 1000)
    for i, tick in enumerate(ticks[:100]):
        for key, encoding, payload in tick:
            late_ns = next(delay_ns) * 1_000_000 if i else 0
            kept.take(key, encoding, payload, UTC_NS + i * 20_000_000 + late_ns, 0.02 * i)
    kept.stop()
    (path,) = tmp_path.glob("*.mcap")
    times = [item.log_ns for item in Reader(path)]
    wanted = [UTC_NS + i * 20_000_000 for i in range(100) for _ in range(8)]
    assert max(abs(time - want) for time, want in zip(times, wanted, strict=True)) < 1000
    assert path.name.startswith("kelp-2026")


def test_a_companion_that_starts_anew_gets_new_times(tmp_path: Path, make_sample: MakeSample) -> None:
    kept = recorder(tmp_path)
    kept.start(UTC_NS)
    for i, t_s in enumerate((1000.0, 1000.02, 3.0, 3.02)):
        for key, encoding, payload in samples.encode(make_sample(t_s=t_s), "kelp")[:1]:
            kept.take(key, encoding, payload, UTC_NS + i * 1_000_000_000, 0.0)
    kept.stop()
    (path,) = tmp_path.glob("*.mcap")
    times = [(item.log_ns - UTC_NS) / 1e9 for item in Reader(path)]
    assert times == pytest.approx([0.0, 0.02, 2.0, 2.02], abs=1e-3)


def test_a_raw_tick_that_comes_twice_is_kept_once(tmp_path: Path) -> None:
    kept = recorder(tmp_path)
    kept.start(UTC_NS)
    key, encoding = telemetry.published("kelp", "raw")
    frame = b"\xfd\x02\x00\x00\x07\x01\x01\x00\x00\x00ab\x00\x00"
    for tick in (1, 2, 3, 1, 2, 3, 4):
        raw = telemetry.Raw(tick=tick, now_s=0.02 * tick, heard=[(tick, frame)], out=[frame])
        kept.take(key, encoding, msgspec.msgpack.encode(raw), UTC_NS + tick, 0.0)
    kept.stop()
    (path,) = tmp_path.glob("*.mcap")
    assert len(list(Reader(path))) == 4


def test_a_new_file_begins_by_size(tmp_path: Path, ticks: list[list[tuple[str, str, bytes]]]) -> None:
    kept = recorder(tmp_path, max_bytes=30_000)
    kept.describe("config", {"a": "1"})
    kept.start(UTC_NS)
    for second in range(10):
        feed(kept, ticks[50 * second : 50 * second + 50], 50 * second)
        kept.each_second(UTC_NS + second * 1_000_000_000)
    kept.stop()
    files = sorted(tmp_path.glob("*.mcap"))
    assert len(files) >= 3
    readers = [Reader(file) for file in files]
    assert sum(sum(1 for _ in reader) for reader in readers) == 4000
    assert all(reader.whole for reader in readers)
    assert all(reader.metadata["config"] == {"a": "1"} for reader in readers)
    assert all(reader.metadata["holdfast"]["git"] == "abc" for reader in readers)


def test_a_full_disk_ends_the_recording_and_nothing_else(
    tmp_path: Path, ticks: list[list[tuple[str, str, bytes]]]
) -> None:
    """A limit of a file's size stands for the disk."""
    kept = recorder(tmp_path)
    kept.start(UTC_NS)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (40_000, hard))
    try:
        for second in range(10):
            feed(kept, ticks[50 * second : 50 * second + 50], 50 * second)
            kept.each_second(0)
            if not kept.status(10.0, 0).recording:
                break
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert "File too large" in kept.said
    assert "can be read" in kept.said
    assert not kept.status(10.0, 0).recording
    kept.stop()
    (path,) = tmp_path.glob("*.mcap")
    reader = Reader(path)
    assert 400 <= len(list(reader)) < 4000
    assert reader.lost_bytes == 0


def test_a_reserve_stays_free(
    tmp_path: Path, ticks: list[list[tuple[str, str, bytes]]], monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = SimpleNamespace(free=1_000_000_000)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: disk)
    kept = recorder(tmp_path, reserve_bytes=500_000_000)
    assert kept.start(UTC_NS)
    feed(kept, ticks)
    disk.free = 499_000_000
    kept.each_second(UTC_NS)
    assert "499 MB free, and 500 MB stay free" in kept.said
    (path,) = tmp_path.glob("*.mcap")
    reader = Reader(path)
    assert len(list(reader)) == 4000
    assert reader.whole  # there was room for its index
    assert not kept.start(UTC_NS)
    assert "not recording" in kept.said


Break = Callable[[pytest.MonkeyPatch, Path], Callable[[], None]]


def nearly_full(monkeypatch: pytest.MonkeyPatch, directory: Path) -> Callable[[], None]:
    disk = SimpleNamespace(free=0)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: disk)
    return lambda: setattr(disk, "free", 1_000_000_000)


def full(monkeypatch: pytest.MonkeyPatch, directory: Path) -> Callable[[], None]:
    """As a quota does it: there is room by statvfs, and nothing can be written."""
    before = os.fdatasync

    def fails(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fdatasync", fails)
    return lambda: monkeypatch.setattr(os, "fdatasync", before)


def gone(monkeypatch: pytest.MonkeyPatch, directory: Path) -> Callable[[], None]:
    """As where a stick is not plugged in: no folder can be made."""
    away = directory.rename(directory.with_name("away"))
    directory.write_text("")

    def back() -> None:
        directory.unlink()
        away.rename(directory)

    return back


@pytest.mark.parametrize(
    ("trouble", "at_start"),
    [(nearly_full, True), (nearly_full, False), (full, True), (full, False), (gone, True)],
)
def test_the_recorder_goes_on_once_the_disk_does(
    tmp_path: Path,
    ticks: list[list[tuple[str, str, bytes]]],
    monkeypatch: pytest.MonkeyPatch,
    trouble: Break,
    at_start: bool,
) -> None:
    """It stopped for ever, though somebody made room: its process lives, so that nothing starts it again."""
    (folder := tmp_path / "dives").mkdir()
    kept, second = recorder(folder, reserve_bytes=500_000_000), iter(range(1000))

    def record(seconds: int) -> None:
        for _ in range(seconds):
            feed(kept, ticks[:50])
            kept.each_second(UTC_NS + next(second) * 1_000_000_000)

    if not at_start:
        kept.start(UTC_NS)
        record(3)
    mend = trouble(monkeypatch, folder)
    if at_start:
        kept.start(UTC_NS)
    record(30)
    assert not kept.status(10.0, 0).recording
    assert kept.said.startswith("not recording: ")
    assert kept.said.endswith("; tries again every 5 s")
    mend()
    assert len(list(folder.iterdir())) == (0 if at_start else 1), "an attempt leaves nothing"
    record(AGAIN_S)
    status = kept.status(10.0, 0)
    assert status.recording
    assert kept.said == f"recording to {Path(status.file).name}"
    feed(kept, ticks)
    kept.stop()
    assert len(list(Reader(Path(status.file)))) >= 4000
    record(20)
    assert not kept.status(10.0, 0).recording, "nobody wants it"
    assert kept.said.startswith("stopped when asked; ")


def test_a_file_that_somebody_deletes_is_followed_by_another(
    tmp_path: Path, ticks: list[list[tuple[str, str, bytes]]]
) -> None:
    """Its owner makes room: what is written into a file without a name is lost, and frees nothing."""
    kept = recorder(tmp_path)
    kept.start(UTC_NS)
    kept.each_second(UTC_NS)
    (path,) = tmp_path.glob("*.mcap")
    path.unlink()
    kept.each_second(UTC_NS)
    assert kept.said == f"not recording: somebody deleted it: {path}; tries again every 5 s"
    for _ in range(AGAIN_S):
        kept.each_second(UTC_NS)
    feed(kept, ticks)
    kept.stop()
    (path,) = tmp_path.glob("*.mcap")
    assert len(list(Reader(path))) == 4000


# --- What a stranger's file may cost ----------------------------------------------------------------------


def test_a_chunk_that_says_less_than_it_holds_is_broken_and_costs_no_other(written: Path) -> None:
    data = bytearray(written.read_bytes())
    at = data.index(b"zstd", data.index(b"zstd") + 4) - 16  # of the second chunk
    (size,) = struct.unpack_from("<Q", data, at)
    struct.pack_into("<Q", data, at, size // 2)
    written.write_bytes(data)
    reader = Reader(written)
    assert len(list(reader)) > 3000
    assert reader.broken_chunks == 1


def test_a_folder_that_takes_no_file_is_refused_before_any_vehicle_is_heard(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    taken = tmp_path / "file"
    taken.write_text("no folder")
    with pytest.raises(SystemExit):
        record_main(["--out", str(taken)])
    assert f"--out {taken}: File exists; name a folder that takes files" in capsys.readouterr().err


# --- What never came --------------------------------------------------------------------------------------

KEYS = len(telemetry.EVERY_TICK)
REPORTED = [
    pytest.param([1, 2, 3, 4], {}, 0, id="all"),
    pytest.param([900, 901, 1, 2, 3], {}, 0, id="a companion that starts anew"),
    pytest.param([1, 2**53, 1, 2**53], {}, 0, id="a number that jumps by years"),
    pytest.param([1, 2, 5], {}, 2 * KEYS, id="two whole ticks"),
    pytest.param([1, 2, 3], {2: {"dof/x", "dof/psi"}}, 2, id="two keys"),
    pytest.param([1, 2, 3], {2: {"loop"}}, 1, id="the last key"),
    pytest.param([1, 2, 3], {1: {"state", "command"}}, 0, id="what left before we were there"),
]


def test_what_a_radio_link_leaves_out_is_not_lost() -> None:
    losses = Losses(10)
    for tick in (10, 20, 31, 41, 61, 71):  # a tick came late; one was lost
        for tail in telemetry.EVERY_TICK:
            losses.take(tail, tick if tail == "loop" else 0)
    assert losses.lost == KEYS


@pytest.mark.parametrize(("ticks", "missing", "lost"), REPORTED)
def test_samples_that_never_came_are_counted(
    ticks: list[int], missing: dict[int, set[str]], lost: int, tmp_path: Path, make_sample: MakeSample
) -> None:
    kept = recorder(tmp_path)
    for tick in ticks:
        sample = make_sample()
        sample = replace(sample, loop=replace(sample.loop, tick=tick))
        for key, encoding, payload in samples.encode(sample, "kelp"):
            if key.split("/", 2)[2] not in missing.get(tick, set()):
                kept.take(key, encoding, payload, 0, 0.0)
    assert kept.status(0.0, 0).lost == lost
