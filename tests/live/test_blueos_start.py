"""What the BlueOS extension starts, with a program that stands in for `holdfast`."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from waiting import until

START = Path(__file__).parents[2] / "blueos" / "start.py"
HOLDFAST = f"""#!{sys.executable}
import os, signal, socket, sys, time
with open(os.environ["CALLS"], "a") as file:
    state = os.environ.get("STATE_DIRECTORY", "")
    file.write(f"{{os.getpid()}} {{' '.join(sys.argv[1:])}} {{state}}\\n")
if sys.argv[1] == "init":
    open(sys.argv[-1], "w").write("# settings")
    sys.exit()
address = os.environ.get("NOTIFY_SOCKET", "")
words = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
while True:
    if address:
        words.sendto(b"WATCHDOG=1", "\\0" + address[1:])
    time.sleep(0.2)
"""


class Extension:
    """The entry point, and what it called."""

    def __init__(self, folder: Path, data: Path) -> None:
        program = folder / "holdfast"
        program.write_text(HOLDFAST)
        program.chmod(0o755)
        self._calls = folder / "calls"
        env = {**os.environ, "PATH": f"{folder}:{os.environ['PATH']}", "CALLS": str(self._calls)}
        begin = f"import start, pathlib; start.MEMORY = pathlib.Path({str(folder / 'memory')!r})"
        begin += f"; start.main(pathlib.Path({str(data)!r}))"
        self.process = subprocess.Popen([sys.executable, "-c", begin], env=env, cwd=START.parent)

    def of(self, command: str) -> list[int]:
        """Return the processes that were started for a command, in order."""
        with suppress(FileNotFoundError):
            calls = [line.split() for line in self._calls.read_text().splitlines()]
            return [int(process) for process, name, *_ in calls if name == command]
        return []

    def words(self, command: str) -> str:
        return next(line for line in self._calls.read_text().splitlines() if f" {command} " in line)


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[[], Extension]]:
    (tmp_path / "bin").mkdir()
    data = tmp_path / "data"
    started: list[Extension] = []

    def begin(data: Path = data) -> Extension:
        started.append(Extension(tmp_path / "bin", data))
        until(lambda: all(started[-1].of(name) for name in ("run", "record", "dashboard")))
        return started[-1]

    yield begin
    for extension in started:
        extension.process.terminate()
        extension.process.wait()


def test_it_keeps_settings_and_token_in_its_volume(start: Callable[[], Extension], tmp_path: Path) -> None:
    first = start()
    token = tmp_path / "data" / "dashboard.token"
    assert (token.stat().st_mode & 0o777, len(token.read_text().strip())) == (0o600, 32)
    assert "--where extension" in first.words("init")
    assert f"--token-file {token}" in first.words("dashboard")
    assert first.words("run").endswith(f" {tmp_path}/data/state"), "not in the container"
    before = token.read_text()
    first.process.terminate()
    assert first.process.wait(10.0) == 0
    for name in ("run", "record", "dashboard"):
        assert not Path(f"/proc/{first.of(name)[-1]}").exists()
    second = start()
    assert len(second.of("init")) == 1, "the settings were there"
    assert token.read_text() == before


def test_a_first_start_that_was_cut_off_is_made_good(start: Callable[[], Extension], tmp_path: Path) -> None:
    """An empty token and half a configuration: the dashboard was restarted for ever."""
    data = tmp_path / "data"
    data.mkdir()
    for name in ("dashboard.token", "first.token", "first.toml"):
        (data / name).touch()
    start()
    token = data / "dashboard.token"
    assert (token.stat().st_mode & 0o777, len(token.read_text().strip())) == (0o600, 32)
    assert not (data / "first.toml").exists()


def test_a_disk_that_takes_nothing_keeps_the_controller_from_nothing(
    start: Callable[..., Extension], tmp_path: Path
) -> None:
    """On a full disk nothing was started. What is in the volume already is used."""
    (tmp_path / "broken").touch()
    extension = start(tmp_path / "broken" / "data")
    memory = tmp_path / "bin" / "memory"
    assert f"--config {memory}/companion.toml" in extension.words("run")
    assert f"--token-file {memory}/dashboard.token" in extension.words("dashboard")
    assert len((memory / "dashboard.token").read_text().strip()) == 32


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_controller_that_ends_or_hangs_is_started_again(
    start: Callable[[], Extension], number: signal.Signals
) -> None:
    extension = start()
    os.kill(extension.of("run")[0], number)
    until(lambda: len(extension.of("run")) == 2)
    assert len(extension.of("record")) == len(extension.of("dashboard")) == 1
