"""Every hostile file ends its command with one line, status 2, in bounded memory."""

import json
import resource
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable, Iterable
from pathlib import Path

import lz4.frame
import pytest
import zstandard

from companion.records import ControlSample
from companion.telemetry import samples
from companion.telemetry import schemas as telemetry
from dashboard.recording.mcap_file import FREE_BYTES, MAGIC, MAX_RATIO, Item, Reader, Recording
from lab.report.log import load
from lab.report.report import main as report

MakeSample = Callable[..., ControlSample]
ALLOWED_BYTES = 600 << 20
"""Of data; libraries and the stacks of their threads take most of it."""
DEEP = 100_000
TEXTS = {
    "dotted": ".".join("a" * 20_000) + " = 1",
    "quoted": '"a".' * 20_000 + "a = 1",
    "header": "[" + ".".join("a" * 20_000) + "]",
    "many": "\n".join(f"[{'.'.join(f'{part}{row}' for part in 'abcdefg')}]" for row in range(10_000)),
    "inline": "a = " + "{a = " * DEEP,
    "array": "a = " + "[" * DEEP,
    "whole array": "a = " + "[" * 500 + "]" * 500,
    "digits": "a = " + "9" * 10_000,
    "hexadecimal": "a = 0x" + "f" * 100_000,
    "date": "a = 0000-00-00",
    "large": "# " + "x" * 20_000_000,
    "binary": "\0\x01\x02",
    "a table for a value": "[vehicle.name]\na = 1\n[loop]\nrate_hz = [1]",
    "a value for a table": "vehicle = 1\nlink = [1]\nsurge = 'x'",
    "not finite": "[loop]\nrate_hz = nan\n[vehicle]\nname = inf",
    "surrogate": 'a = "\\ud800"',
}


def chunk(
    data: bytes, compression: str = "", size: int | None = None, packed_size: int | None = None
) -> bytes:
    pack = {"": bytes, "lz4": lz4.frame.compress, "zstd": zstandard.compress}.get(compression, bytes)
    packed = pack(data)
    size = len(data) if size is None else size
    head = struct.pack("<QQQII", 0, 0, size, zlib.crc32(data), len(compression)) + compression.encode()
    length = len(packed) if packed_size is None else packed_size
    return record(6, head + struct.pack("<Q", length) + packed)


def record(opcode: int, body: bytes, length: int | None = None) -> bytes:
    return struct.pack("<BQ", opcode, len(body) if length is None else length) + body


def channels(count: int, text: str) -> bytes:
    topic = text.encode()
    return b"".join(
        record(4, struct.pack("<HHI", n, 0, len(topic)) + topic + struct.pack("<II", 0, 0))
        for n in range(count)
    )


ZEROS = bytes(4 << 20)
RECORDINGS = {
    "lz4": chunk(ZEROS, "lz4") * 4,
    "lz4 that says nothing": chunk(ZEROS, "lz4", size=0) * 64,
    "one lz4": chunk(bytes(1 << 28), "lz4"),
    "one lz4 that lies": chunk(bytes(1 << 28), "lz4", size=100),
    "zstd": chunk(ZEROS, "zstd") * 64,
    "other compression": chunk(b"x", "br"),
    "length of a chunk": record(6, b"x" * 100, 2**64 - 1),
    "length of a chunk's data": chunk(b"x" * 100, packed_size=2**64 - 1),
    "size of a chunk": chunk(b"x" * 100, size=2**64 - 1),
    "size of a packed chunk": chunk(b"x" * 100, "zstd", size=2**64 - 1),
    "length of a record in a chunk": chunk(record(4, b"x", 2**64 - 1)),
    "length of a metadata": record(12, b"\xff" * 8, 2**63),
    "length of a name": record(12, b"\xff" * 8),
    "text of a name": record(12, struct.pack("<I", 2) + b"\xff\xff"),
    "channels": channels(60_000, "x" * 100) + chunk(channels(60_000, "x" * 1000), "zstd"),
    "records": chunk(record(5, bytes(22)) * 250_000, "zstd") * 2,
    "nothing": b"",
}


RUN = """
import contextlib, io, json, os, sys, traceback
import holdfast
from dashboard.recording import record, replay
record.leave = replay.leave = sys.exit
sys.stdout = io.StringIO()
for argv in json.load(sys.stdin):
    with contextlib.redirect_stderr(io.StringIO()) as said:
        try:
            status = holdfast.main(argv)
        except SystemExit as end:
            status = end.code
        except BaseException:
            status = traceback.format_exc()
    os.write(1, json.dumps([status, said.getvalue()]).encode() + b"\\n")
"""


def limited() -> None:
    resource.setrlimit(resource.RLIMIT_DATA, (ALLOWED_BYTES, ALLOWED_BYTES))


def all_refused(file: Path, contents: dict[str, bytes], *commands: tuple[str, ...]) -> None:
    """Give each command, in which FILE stands for the file, each content; each ends with one line."""
    file.parent.mkdir()
    given = [(name, command) for name in contents for command in commands]
    argvs = []
    for name, command in given:
        path = file.with_stem(f"{file.stem}{list(contents).index(name)}")
        path.write_bytes(contents[name])
        argvs.append([word.replace("FILE", str(path)) for word in command])
    before = sorted(file.parent.iterdir())
    done = subprocess.run(
        [sys.executable, "-c", RUN],
        input=json.dumps(argvs),
        capture_output=True,
        text=True,
        preexec_fn=limited,
        timeout=380,
        check=False,
    )
    ends = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(ends) == len(given), (given[len(ends)], done.returncode, done.stderr[-500:])
    for (name, command), argv, (status, said) in zip(given, argvs, ends, strict=True):
        assert (status, said.count("\n")) == (2, 1), (name, command, status, said)
        assert any(f"{word}" in said for word in argv if "hostile" in word), (name, command, said)
        assert len(said) < 1000
    assert sorted(file.parent.iterdir()) == before, "nothing is left behind"


def encoded(texts: dict[str, str]) -> dict[str, bytes]:
    return {name: text.encode() for name, text in texts.items()}


def test_hostile_toml(tmp_path: Path) -> None:
    all_refused(
        tmp_path / "in" / "hostile.toml",
        encoded(TEXTS),
        ("config", "check", "FILE"),
        ("sim", "--config", "FILE", "--tcp", "127.0.0.1:0"),
        ("follow", "kelp", "FILE"),
    )


ONE_READER = ("one lz4 that lies", "length of a chunk", "records", "nothing")
"""The commands share it: of the last two these are enough."""


@pytest.mark.parametrize(
    ("command", "names"),
    [
        ("report", RECORDINGS),
        ("lab rerun", ONE_READER),
        ("replay", ONE_READER),
    ],
)
def test_hostile_recordings(tmp_path: Path, command: str, names: Iterable[str]) -> None:
    files = {name: MAGIC + RECORDINGS[name] for name in names}
    all_refused(tmp_path / "in" / "hostile.mcap", files, (*command.split(), "FILE"))


def test_a_file_may_not_unpack_to_more_than_a_recording_does(tmp_path: Path) -> None:
    path = tmp_path / "bomb.mcap"
    path.write_bytes(MAGIC + chunk(ZEROS, "zstd") * 256)
    reader = Reader(path)
    with pytest.raises(ValueError, match=r"bomb.mcap: no sample in it can be read"):
        list(reader)
    assert reader.unpacked_bytes <= FREE_BYTES + MAX_RATIO * path.stat().st_size < 50 << 20


def test_hostile_telemetry_logs(tmp_path: Path) -> None:
    contents = (b"", b"\xfd" * 100_000, bytes(1_000_000), b"\xfe\xff" * 50_000)
    files = dict(zip("abcd", contents, strict=True))
    all_refused(tmp_path / "in" / "hostile.tlog", files, ("identify", "--from", "FILE"))


def test_hostile_configurations_of_zenoh(tmp_path: Path) -> None:
    texts = ("{a:" + "[" * 200_000, " " * 20_000_000, "", "{", "\0", "{mode:7}")
    all_refused(
        tmp_path / "in" / "hostile.json5",
        encoded(dict(zip("abcdef", texts, strict=True))),
        ("watch", "--once", "--connect", "FILE"),
        ("record", "--connect", "FILE"),
    )


@pytest.fixture
def dive(make_sample: MakeSample) -> list[Item]:
    """Two seconds of a dive."""
    stamp = 1_795_000_000_000_000_000
    ticks = (samples.encode(make_sample(t_s=100.0 + 0.02 * i), "kelp") for i in range(100))
    return [
        Item(*one, stamp + i * 20_000_000, stamp + i * 20_000_000)
        for i, tick in enumerate(ticks)
        for one in tick
    ]


@pytest.mark.parametrize("compression", ["NONE", "LZ4", "ZSTD"])
def test_sound_recordings_of_every_compression_are_read(
    tmp_path: Path, dive: list[Item], compression: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dashboard.recording.mcap_file.COMPRESSION", compression)
    recording = Recording(tmp_path / "dive.mcap")
    for item in dive:
        recording.add(item)
    recording.close()
    reader = Reader(tmp_path / "dive.mcap")
    assert list(reader) == dive
    assert (reader.whole, reader.broken_chunks) == (True, 0)


def test_what_a_stranger_put_into_a_dive_does_not_end_a_report(tmp_path: Path, dive: list[Item]) -> None:
    path = tmp_path / "dive.mcap"
    recording = Recording(path)
    for item in dive:
        recording.add(item)
    last = dive[-1].log_ns
    truth = b'{"t_s":%s,"eta":[%s,0,0,0,0,0],"disturbance":[1e300,0,0,0,0,0]}'
    odd = [("sim/kelp/truth", telemetry.TRUTH_ENCODING, truth % (n, n)) for n in (b"1e300", b"-1e300", b"1")]
    odd += [(f"holdfast/kelp/{tail}", "application/json", b"[" * 100_000) for tail in telemetry.EVERY_TICK]
    odd += [("sim/kelp/truth", "application/json", b'{"x":' + b"[" * 100_000)]
    odd += [("holdfast//x*/y", "application/json", b"{}"), ("", "", b""), ("holdfast/kelp/dof/a", "", b"")]
    for key, encoding, payload in odd:
        for stamp in (last + 1, 0, 2**63 - 1):
            recording.add(Item(key, encoding, payload, stamp, stamp))
    recording.close()
    assert report([str(path)]) == 0


def numbers_of(record: dict[str, object]) -> list[str]:
    return [name for name, value in record.items() if isinstance(value, float) and name != "t_s"]


def test_a_recording_in_which_no_number_is_known_is_reported_without_a_warning(
    tmp_path: Path, dive: list[Item]
) -> None:
    path = tmp_path / "dive.mcap"
    recording = Recording(path)
    for item in dive:
        record = json.loads(item.payload)
        if item.key.endswith("supervisor"):
            record["state"] = "ACTIVE"
        else:
            record |= {"absent": numbers_of(record), "engaged": True, "saturated": True}
        recording.add(item._replace(payload=json.dumps(record).encode()))
    recording.close()
    assert report([str(path)]) == 0
    page = path.with_suffix(".html").read_text(encoding="utf-8")
    assert "nan" not in page.partition("<img")[0]


def test_a_sample_that_came_twice_counts_once(tmp_path: Path, dive: list[Item]) -> None:
    paths = tmp_path / "once.mcap", tmp_path / "twice.mcap"
    for path, copies in zip(paths, (1, 2), strict=True):
        recording = Recording(path)
        for item in dive:
            for _ in range(copies):
                recording.add(item)
        recording.close()
    once, twice = (load([path]) for path in paths)
    assert {key: rows.size for key, rows in twice.keys.items()} == {
        key: rows.size for key, rows in once.keys.items()
    }
