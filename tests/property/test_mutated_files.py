"""Each format of a file, damaged at random: read, or refused in one line, in bounded time and memory."""

import struct
from typing import Any

import numpy as np
import pytest
from dive_logs import (
    dive,
    write_blueos_mcap,
    write_csv,
    write_dataflash,
    write_raw_mcap,
    write_sample_mcap,
    write_tlog,
)

from companion.config import load_config
from companion.telemetry import path_files
from holdfast import child
from lab.identify.readers import read
from lab.report.log import load as load_log
from lab.rerun.rerun import load as load_tape
from sim_bridge.sim_config import load_config as load_sim

ODD = (
    b"\xff" * 8,
    bytes(8),
    struct.pack("<d", float("nan")),
    struct.pack("<f", float("inf")),
    b"1e999",
    b"[{",
)
TOML = b'[loop]\nrate_hz = 50.0\n[vehicle]\nname = "kelp"\n[heave]\nmass = 30.0\n'


def mutants(sound, count):
    """Give a file's bytes with bits turned, pieces cut out, repeated and replaced by odd numbers."""
    for seed in range(count):
        draw, data = np.random.default_rng(seed).integers, bytearray(sound)
        for _ in range((1, 3, 30)[draw(3)]):
            at = draw(min(len(data), (200, 4000, len(data))[draw(3)]) + 1)
            change, length = draw(5), draw(60)
            if change == 0 and at < len(data):
                data[at] ^= 1 << draw(8)
            elif change == 1:
                del data[at : at + length]
            elif change == 2:
                data[at:at] = data[at : at + length] * draw(3)
            elif change == 3:
                data[at : at + 8] = ODD[draw(len(ODD))]
            elif draw(10) == 0:
                del data[at:]
        yield bytes(data)


def attempts(file, sound, readers, count):
    """Return what comes of each mutant with each reader."""
    ends = []
    for data in mutants(sound, count):
        file.write_bytes(data)
        ends += [child.answer(reader, *arguments) for reader, arguments in readers]
    return [value if kind == "error" else None for kind, value in ends]


def all_read_or_refused(ends):
    refusals = [end for end in ends if end is not None]
    assert len(refusals) < len(ends), "some are read"
    assert all(isinstance(end, OSError) or 0 < len(str(end)) < 1000 for end in refusals)
    return refusals


WRITERS: dict[str, Any] = {
    "a.BIN": write_dataflash,
    "a.tlog": write_tlog,
    "a.csv": write_csv,
    "blueos.mcap": write_blueos_mcap,
    "samples.mcap": write_sample_mcap,
    "raw.mcap": write_raw_mcap,
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_damaged_log_is_read_or_refused(name, tmp_path, monkeypatch):
    monkeypatch.setattr(child, "START_S", 100)
    file = WRITERS[name](dive(8.0), tmp_path / name)
    readers: list[tuple[Any, tuple[Any, ...]]] = [(read, (file, "vectored_6dof"))]
    if file.suffix == ".mcap":
        readers += [(load_log, ([file],)), (load_tape, ([file],))]
    all_read_or_refused(child.bounded(attempts, [file], file, file.read_bytes(), readers, 25))


@pytest.mark.parametrize(
    ("name", "sound", "reader"),
    [
        ("path.toml", b"[[waypoint]]\nx_m = 1.0\ny_m = 2.0\ndepth_m = 3.0\n", path_files.read),
        ("companion.toml", TOML, load_config),
        ("sim.toml", b"[initial]\neta = [0, 0, 1, 0, 0, 0]\n[current]\nspeed_m_s = 0.3\n", load_sim),
    ],
)
def test_a_damaged_text_is_read_or_refused(name, sound, reader, tmp_path):
    file = tmp_path / name
    refusals = all_read_or_refused(attempts(file, sound, [(reader, (file,))], 200))
    assert all(str(refusal).startswith(str(file)) for refusal in refusals), "nothing stumbled"


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_a_text_is_read_in_the_encoding_that_it_declares(encoding, tmp_path):
    file = tmp_path / "companion.toml"
    file.write_bytes(TOML.decode().replace("\n", "\r\n").encode(encoding))
    assert load_config(file).vehicle.name == "kelp"
