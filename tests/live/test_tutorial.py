"""docs/tutorial.md, dived as it stands: each command says what the page shows below it."""

import socket
import subprocess
import time
from pathlib import Path

from shown import output, says
from tools.processes import HOLDFAST, free_port, running
from waiting import until

PAGE = "tutorial.md"


def test_the_dive_of_the_tutorial(tmp_path: Path) -> None:
    zenoh, port = f"tcp/127.0.0.1:{free_port()}", free_port()
    link, here = f"link.endpoint=tcp:127.0.0.1:{port}", ("--connect", zenoh)
    simulator = ("sim", "--set", "waves.enabled=true", "--live-faults", "--zenoh", zenoh)
    settings = ("--set", link, "--set", f"telemetry.endpoint={zenoh}")
    companion = ("run", "--engage", "--arm", "--depth", "3", *settings)
    log = tmp_path / "run.log"
    with running(*HOLDFAST, *simulator, "--tcp", f"127.0.0.1:{port}"):
        until(lambda: not refused(port))
        checked = said("check", "--set", link, cwd=tmp_path, status=1)  # the origin is a warning
        assert says(output(PAGE, "    good  link").replace("5760", str(port)), checked)
        with log.open("wb") as errors, running(*HOLDFAST, *companion, errors=errors):
            begun = output(PAGE, "2026-")  # a date
            until(lambda: says(f"{begun}...", log.read_text()), 60.0)
            assert says(output(PAGE, "╭─ holdfast"), said("watch", "--once", *here, cwd=tmp_path))
            told = said("goto", "--depth", "4", "--heading", "90", "--at-once", *here, cwd=tmp_path)
            assert told.startswith("done by bluerov2")
            until(lambda: log.read_text().count("(wanted 4.000)") > 1)
            stick = ("stick,axis=z,value=1,duration_s=10", "--zenoh", zenoh)
            assert said("fault", *stick, cwd=tmp_path).startswith("stick begins")
            until(lambda: "PILOT: the pilot steers" in log.read_text())
            time.sleep(0.5)  # until more than its first message is heard
            shown = said("watch", "--once", *here, cwd=tmp_path)
            assert says(output(PAGE, "│   PILOT"), shown), shown
            until(lambda: "condition: the vehicle is disarmed" in log.read_text())
            assert says(output(PAGE, "done by bluerov2: engaged"), said("engage", *here, cwd=tmp_path))
            recorder = ("record", *here, "--out", str(tmp_path / "dives"), "--reserve-mb", "1")
            with running(*HOLDFAST, *recorder):
                held = log.read_text().count("(wanted 4.000)")
                until(lambda: log.read_text().count("(wanted 4.000)") > held + 1)
                assert says(output(PAGE, "done by bluerov2: released"), said("release", *here, cwd=tmp_path))
                until(lambda: log.read_text().count("Lost manual control") > 1)  # once after the take-over
                time.sleep(1.0)  # until the recorder has it too
    (file,) = (tmp_path / "dives").glob("*.mcap")
    assert says(output(PAGE, "steered by"), said("report", f"dives/{file.name}", cwd=tmp_path))


def said(*arguments: str, cwd: Path, status: int = 0) -> str:
    done = subprocess.run(
        [*HOLDFAST, *arguments], cwd=cwd, capture_output=True, text=True, timeout=60.0, check=False
    )
    assert done.returncode == status, done.stdout + done.stderr
    return done.stdout


def refused(port: int) -> bool:
    with socket.socket() as client:
        return client.connect_ex(("127.0.0.1", port)) != 0
