"""Holdfast as services, on a machine that really boots systemd: a life from installing to removing."""

import json
import os
import shutil
import sys
from pathlib import Path
from sysconfig import get_path

import pytest
from hatchling.builders.wheel import WheelBuilder
from machine import Machine, booted, what_lacks

ROOT = Path(__file__).parents[2]
SERVICES = ("holdfast", "holdfast-record", "holdfast-dashboard")
CONFIGURATION = "/etc/holdfast/companion.toml"
ARM = "/etc/systemd/system/holdfast.service.d/arm.conf"
DIVES = "/var/lib/holdfast-dives"


@pytest.fixture(scope="module")
def python() -> str:
    """A Python of this version that services can read: .venv's own may be in somebody's home."""
    name = f"python3.{sys.version_info.minor}"
    path = f"/usr/bin:/usr/local/bin:{Path(sys.base_prefix) / 'bin'}"
    found = shutil.which(name, path=path)
    if found is None or found.startswith(("/root", "/home")):
        pytest.skip(f"there is no {name} outside /root and /home")
    return found


@pytest.fixture
def machine(tmp_path_factory: pytest.TempPathFactory):
    """A machine with a wheel of Holdfast, and what it needs, in /mnt."""
    lacks = what_lacks(tmp_path_factory.mktemp("try"))
    if "is not installed" in lacks and os.environ.get("CI"):
        pytest.fail(lacks)
    if lacks:
        pytest.skip(f"no machine can be booted here: {lacks}")
    folder = tmp_path_factory.mktemp("machine")
    for _ in WheelBuilder(str(ROOT)).build(directory=str(folder), versions=["standard"]):
        pass
    binds = (f"--bind-ro={folder}:/mnt/wheel", f"--bind-ro={get_path('platlib')}:/mnt/needs")
    with booted(folder, *binds) as machine:
        yield machine


def test_a_life_of_the_services(machine: Machine, python: str) -> None:
    before = set(ours(machine))
    machine.run(python, "-m", "venv", "/opt/holdfast")
    site = f"/opt/holdfast/lib/{Path(python).name}/site-packages"
    machine.run(
        "sh",
        "-c",
        "/opt/holdfast/bin/pip install --no-index --no-deps /mnt/wheel/*.whl; "
        f"echo /mnt/needs > {site}/needs.pth",
    )
    holdfast = "/opt/holdfast/bin/holdfast"
    said = machine.run(holdfast, "install")
    assert "/opt/holdfast/bin/pip install -U" in said
    for service in SERVICES:
        assert machine.show(service, "ActiveState") == "active"

    machine.run("mkdir", "-p", Path(ARM).parent.as_posix())
    command = machine.run("systemctl", "cat", "holdfast").partition("ExecStart=")[2].partition("\n")[0]
    write(machine, ARM, f"[Service]\nExecStart=\nExecStart={command} --arm\n")
    machine.run("sed", "-i", "1i # mine", CONFIGURATION)
    machine.run("systemctl", "daemon-reload")
    machine.run("systemctl", "restart", "holdfast")
    machine.run("systemctl", "start", "holdfast-sim@heavy")
    dive(machine)
    for what in ((), ("--remove",)):
        refused = machine.run("holdfast", "install", *what, status=2)
        assert "steers the vehicle now" in refused

    killed(machine, "STOP", "watchdog")
    killed(machine, "KILL", "signal")
    machine.run("systemctl", "stop", "holdfast-sim@heavy")
    recording = machine.run("sh", "-c", f"ls {DIVES}/*.mcap").split()[0]
    machine.run("setpriv", "--reuid=nobody", "--clear-groups", "test", "-r", recording)
    assert '"cockpit"' in machine.run(python, "-c", FETCH.format("http://127.0.0.1:8600/register_service"))

    process = machine.show("holdfast", "MainPID")
    machine.run("systemctl", "disable", "--now", "holdfast-record")
    assert "restarted" in machine.run("holdfast", "install")  # as after an upgrade
    assert machine.show("holdfast", "MainPID") != process
    assert machine.show("holdfast-record", "ActiveState") == "inactive", "who disabled it keeps it so"
    assert machine.run("head", "-n", "1", CONFIGURATION) == "# mine"
    machine.run("systemctl", "enable", "holdfast-record")

    machine.reboot()
    for service in SERVICES:
        assert machine.show(service, "ActiveState") == "active"
    assert machine.show("holdfast-sim@heavy", "ActiveState") == "inactive", "no vehicle is simulated unasked"

    machine.run("holdfast", "install", "--remove")
    left = set(ours(machine)) - before
    assert {"/etc/holdfast", DIVES, "/opt/holdfast"} <= left
    assert not [path for path in left if path.startswith("/usr")]
    assert "holdfast" not in machine.run("cat", "/etc/passwd", "/etc/group")
    assert machine.run("systemctl", "list-units", "--all", "--plain", "--no-legend", "holdfast*") == ""


FETCH = "import urllib.request; print(urllib.request.urlopen('{}').read().decode())"


def dive(machine: Machine) -> None:
    """Engage, and hold a metre."""
    machine.wait(lambda: machine.show("holdfast", "StatusText").startswith("IDLE: waiting for: arming"))
    machine.run("holdfast", "tell", "bluerov2", "goto", "depth_m=1")
    machine.run("holdfast", "tell", "bluerov2", "engage")
    machine.wait(lambda: machine.show("holdfast", "StatusText").startswith("ACTIVE"))
    machine.wait(lambda: abs(depth_m(machine) - 1.0) < 0.1, within_s=60.0)


def depth_m(machine: Machine) -> float:
    shown = json.loads(machine.run("holdfast", "watch", "--once", "--json"))
    return float(shown["state"]["depth_m"])


def killed(machine: Machine, signal: str, reason: str) -> None:
    """Stop or kill the controller: it comes back by itself, and holds nothing until it is told again."""
    count, process = int(machine.show("holdfast", "NRestarts")), machine.show("holdfast", "MainPID")
    machine.run("systemctl", "kill", "--kill-whom=main", f"--signal={signal}", "holdfast")
    machine.wait(lambda: int(machine.show("holdfast", "NRestarts")) == count + 1)
    machine.wait(lambda: machine.show("holdfast", "ActiveState") == "active")
    assert machine.show("holdfast", "MainPID") != process
    assert f"Failed with result '{reason}'" in machine.run("journalctl", "-u", "holdfast", "-n", "30")
    assert not machine.show("holdfast", "StatusText").startswith("ACTIVE")


def ours(machine: Machine) -> list[str]:
    """Files of the machine that carry the name, in folders where installations put any."""
    folders = ("/etc", "/opt", "/run/systemd", "/usr/local", "/usr/lib/systemd", "/var/lib")
    found = machine.run("find", *folders, "-xdev", "-name", "*holdfast*", "-prune", "-print")
    return found.split()


def write(machine: Machine, path: str, text: str) -> None:
    machine.run("sh", "-c", 'printf %s "$2" > "$1"', "sh", path, text)
