"""The demo as people run it: real processes, real UDP, real Zenoh; and nothing of it stays behind."""

import os
import signal
import socket
import subprocess
import sys
import time
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import pytest
from waiting import until

from lab.demo import demo
from lab.demo.story import Story
from lab.ports import free_port

MARK = "HOLDFAST_TEST_DEMO"
SHORT = Story(
    depth_m=2.0, wave_height_m=0.1, waves_s=3.0, path_s=6.0, load_on_s=10.0, load_off_s=12.0, end_s=14.0
)
PATIENCE_S = 15.0

Start = Callable[[], subprocess.Popen[str]]


@pytest.fixture
def mark(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """What every process of the demo has in its environment, by which those left behind are found."""
    name = uuid.uuid4().hex
    monkeypatch.setenv(MARK, name)
    yield name
    for pid in _alive(name):
        os.kill(pid, signal.SIGKILL)


@pytest.fixture
def start(mark: str, tmp_path: Path) -> Start:
    """Start the demo in a process of its own, as a shell does."""

    def run() -> subprocess.Popen[str]:
        program = "import sys, holdfast; sys.exit(holdfast.main(['demo', '--out', sys.argv[1]]))"
        return subprocess.Popen(
            [sys.executable, "-c", program, str(tmp_path)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    return run


@pytest.mark.alone  # a dive in real time
def test_the_whole_story(tmp_path: Path, mark: str, capsys: pytest.CaptureFixture[str]) -> None:
    png, json = tmp_path / "demo.png", tmp_path / "figures" / "demo.json"
    assert demo.perform(SHORT, png, json) == 0, capsys.readouterr().err
    assert _alive(mark) == []
    content = msgspec.json.decode(json.read_bytes())
    for name in ("alt_hold", "law", "observer", "holdfast", "live"):
        result = content[name]
        assert 0.0 < result["depth_rms_mm"] < result["depth_peak_mm"] < 500.0
        assert list(result["phase_rms_mm"]) == ["waves", "path", "load hung on", "load dropped"]
        assert 0.0 < result["heading_rms_deg"] < 5.0
        assert 0.0 < result["thrust_rms_n"] < 100.0
        assert 0.0 < result["chatter_n"] < 20.0
    # On a machine that does nothing else both are alike; here others may delay its ticks.
    live, alt_hold = (content[name]["depth_rms_mm"] for name in ("live", "alt_hold"))
    assert live < alt_hold
    assert png.read_bytes().startswith(b"\x89PNG")
    said = capsys.readouterr().out
    for words in (
        "path, in virtual time",
        "arming",
        "path, in real time",
        "depth, load hung on",
        "The observer ",
        "The network ",
    ):
        assert words in said
    assert all(sentence in " ".join(said.split()) for sentence in content["worth"])


@pytest.mark.parametrize(
    ("number", "after_s"),
    [(signal.SIGINT, 0.0), (signal.SIGTERM, 1.1), (signal.SIGINT, 3.7)],
)
def test_a_signal_leaves_nothing_behind(start: Start, mark: str, number: int, after_s: float) -> None:
    process = start()
    assert process.stdout is not None
    process.stdout.readline()  # from here on it handles signals
    time.sleep(after_s)
    process.send_signal(number)
    out, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 128 + number, err
    assert "nothing runs any more" in out
    assert "Traceback" not in err
    assert _alive(mark) == []


def test_the_kernel_clears_up_after_a_demo_that_was_killed(start: Start, mark: str) -> None:
    process = start()
    until(lambda: len(_alive(mark)) == 3)
    process.kill()
    process.communicate()
    until(lambda: not _alive(mark))


@pytest.mark.alone
@pytest.mark.parametrize("command", ["sim", "run"])
def test_a_child_that_dies_is_reported_with_its_last_words(start: Start, mark: str, command: str) -> None:
    process = start()
    until(lambda: len(_alive(mark)) == 3)
    time.sleep(1.0)
    children = [pid for pid in _alive(mark) if command in _arguments(pid)]
    assert len(children) == 1
    os.kill(children[0], signal.SIGKILL)
    _, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 1
    assert f"`holdfast {command}` ended by SIGKILL." in err
    assert f"`holdfast {command}` last said:\n" in err
    assert _alive(mark) == []


def test_zenoh_that_cannot_start_is_reported(
    mark: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(demo, "PATIENCE_S", 6.0)
    with socket.create_server(("127.0.0.1", 0)) as mute:
        taken: int = mute.getsockname()[1]
        monkeypatch.setattr(
            demo,
            "free_port",
            lambda kind=socket.SOCK_STREAM: taken if kind == socket.SOCK_STREAM else free_port(kind),
        )
        assert demo.perform(SHORT, tmp_path / "demo.png", tmp_path / "demo.json") == 1
    assert f"refused to start: somebody holds tcp/127.0.0.1:{taken}" in capsys.readouterr().err
    assert _alive(mark) == []


def _alive(mark: str) -> list[int]:
    """Processes, other than this one, that have the mark in their environment and are no zombies."""
    found: list[int] = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit() and int(entry.name) != os.getpid():
            try:
                marked = f"{MARK}={mark}".encode() in (entry / "environ").read_bytes()
            except OSError:
                continue
            if marked:
                found.append(int(entry.name))
    return found


def _arguments(pid: int) -> list[str]:
    return Path(f"/proc/{pid}/cmdline").read_text().split("\0")
