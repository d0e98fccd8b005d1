"""What an untrusted file does to its reader ends in one line."""

import os
import signal
import sys
from pathlib import Path

import pytest

from dashboard.recording.mcap_file import Reader
from holdfast import RefusedError, child


def endless():
    while True:
        pass


def greedy():
    return bytes(child.MEMORY_BYTES)


def stumbling():
    return memoryview(b"").cast("d")[9]


def ended():
    os.kill(os.getpid(), signal.SIGSEGV)


def refusing():
    raise ValueError("is no dive")


def talking():
    sys.stdout.write("DFFormat: unsupported\n")
    return "read"


@pytest.mark.parametrize(
    ("reader", "says"),
    [
        (endless, "was not read in 1 s"),
        (greedy, "needs more than 2048 MiB"),
        (stumbling, "cannot be read: IndexError"),
        (ended, "it ended its reader"),
        (refusing, "is no dive$"),
    ],
)
def test_it_is_refused_in_words(reader, says, monkeypatch):
    monkeypatch.setattr(child, "START_S", 1)
    with pytest.raises(RefusedError, match=says):
        child.bounded(reader, [])


def test_what_is_read_comes_back_without_a_librarys_words(capfd):
    assert child.bounded(talking, []) == "read"
    assert capfd.readouterr().out == ""


@pytest.mark.parametrize("read", [lambda it: child.bounded(ended, [it]), lambda it: next(iter(Reader(it)))])
def test_a_pipe_and_a_device_which_may_never_begin_or_end_are_refused(read, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for endless in (tmp_path / "pipe", Path("/dev/zero")):
        with pytest.raises(
            (ValueError, RefusedError),
            match=f"{endless}: is a pipe or a device: save what it gives as a file",
        ):
            read(endless)


def sparse(path: Path, size: int) -> Path:
    """Make a file that is small on the disk, and says that it is large."""
    with path.open("wb") as file:
        file.write(b"\xa3\x95")
        file.truncate(size)
    return path


def test_a_file_with_holes_is_given_no_time_for_them(tmp_path, monkeypatch):
    monkeypatch.setattr(child, "START_S", 1)
    with pytest.raises(
        RefusedError, match=r"dive\.BIN: was not read in 1 s: it is damaged, or cut it into parts"
    ):
        child.bounded(endless, [sparse(tmp_path / "dive.BIN", 3 << 30)])


@pytest.mark.parametrize("read", [lambda it: child.bounded(ended, [it]), lambda it: next(iter(Reader(it)))])
def test_a_file_of_many_gigabytes_is_refused(read, tmp_path):
    with pytest.raises(RefusedError, match=r"dive\.mcap: is larger than 4096 MiB: cut it into parts"):
        read(sparse(tmp_path / "dive.mcap", 5 << 30))


def test_no_file_is_given_more_time_than_the_most(tmp_path, monkeypatch):
    monkeypatch.setattr(child, "MAX_S", 1)
    with pytest.raises(RefusedError, match="was not read in 1 s"):
        child.bounded(endless, [tmp_path])
