"""`holdfast run` that is killed on a path: the next one goes on where it was."""

import json
import os
import signal
import time
from pathlib import Path

import pytest

from lab.operations.bounds import HOLDFAST, running
from lab.ports import free_port

LINE = """
speed_mps = 0.3
acceleration_mps2 = 0.2
heading = "keep"
[[waypoint]]
x_m = 0.0
y_m = 0.0
[[waypoint]]
x_m = 6.0
y_m = 0.0
"""


def progress_m(file: Path) -> float:
    """Return how far along the path the file says it is; 0 where there is none."""
    if not file.exists():
        return 0.0
    return float(json.loads(file.read_bytes())["interrupted"]["along_m"])


def until(what, timeout_s: float = 60.0) -> None:
    until_s = time.monotonic() + timeout_s
    while not what():
        assert time.monotonic() < until_s, "it never came to that"
        time.sleep(0.1)


@pytest.mark.alone  # a late tick releases the vehicle, and pauses the path
def test_killed_on_a_path_it_goes_on_where_it_was(tmp_path: Path) -> None:
    os.environ["XDG_STATE_HOME"] = str(tmp_path)  # taken away again by tests/conftest.py
    path, file = tmp_path / "line.toml", tmp_path / "holdfast" / "path-kelp.json"
    path.write_text(LINE, encoding="utf-8")
    port = free_port()
    simulator = (
        *("sim", "--udp-connect", f"127.0.0.1:{port}", "--no-zenoh", "--set", "sensors.dvl=true"),
        *("--set", "initial.eta=[0,0,2,0,0,0]"),
    )
    companion = (
        *("run", "--engage", "--arm", "--depth", "2", "--name", "kelp", "--path", str(path)),
        *("--set", f"link.endpoint=udp-listen:127.0.0.1:{port}"),
        *("--set", f"telemetry.endpoint=tcp/127.0.0.1:{free_port()}"),
    )
    with running(*HOLDFAST, *simulator):
        with running(*HOLDFAST, *companion) as run:
            until(lambda: progress_m(file) > 1.0)
            run.send_signal(signal.SIGKILL)
            run.wait()
        was_m = progress_m(file)
        assert 1.0 < was_m < 4.0
        log = tmp_path / "run.log"
        with log.open("wb") as errors, running(*HOLDFAST, *companion, errors=errors.fileno()):
            until(lambda: progress_m(file) > was_m + 0.5)
            assert progress_m(file) < was_m + 3.0, "it did not jump"
            until(lambda: not file.exists())
    said = log.read_text(encoding="utf-8")
    kept = "follow the path line: kept for when it engages; the state is IDLE: line, 6.0 m a lap"
    assert f"{kept}, {6.0 - was_m:.1f} m, about" in said
