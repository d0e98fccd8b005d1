"""Holdfast as services, on a machine that really boots systemd: a life from installing to removing."""

import json
import os
import shutil
import sys
from pathlib import Path
from zipfile import ZipFile

import pytest
from hatchling.builders.wheel import WheelBuilder
from machine import Machine, booted, what_lacks

ROOT = Path(__file__).parents[2]
WHEELS = ROOT / "build" / "wheels"
SERVICES = ("holdfast", "holdfast-record", "holdfast-dashboard")
CONFIGURATION = "/etc/holdfast/companion.toml"
ARM = "/etc/systemd/system/holdfast.service.d/arm.conf"
DIVES = "/var/lib/holdfast-dives"
LATER = "9.9.9"


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
    lacks = what_lacks(tmp_path_factory.mktemp("try"))
    if "is not installed" in lacks and os.environ.get("CI"):
        pytest.fail(lacks)
    if lacks:
        pytest.skip(f"no machine can be booted here: {lacks}")
    if not (WHEELS / ".downloaded").exists():
        pytest.fail("make test downloads build/wheels") if os.environ.get("CI") else pytest.skip(
            "no build/wheels"
        )
    folder = tmp_path_factory.mktemp("machine")
    wheels = folder / "wheels"
    shutil.copytree(WHEELS, wheels)
    (first,) = WheelBuilder(str(ROOT)).build(directory=str(wheels), versions=["standard"])
    later(Path(first))
    with booted(folder, f"--bind-ro={wheels}:/mnt") as machine:
        yield machine


def later(wheel: Path) -> Path:
    """The same wheel with another version, and another description of a unit."""
    version = wheel.name.split("-")[1]
    changed = wheel.with_name(wheel.name.replace(version, LATER))
    info = f"holdfast_rov-{version}.dist-info/"
    with ZipFile(wheel) as old, ZipFile(changed, "w") as new:
        for name in old.namelist():
            content = old.read(name)
            if name in (f"{info}METADATA", f"{info}RECORD"):
                content = content.replace(version.encode(), LATER.encode())
            elif name.endswith("holdfast.service"):
                content = content.replace(b"Description=", b"Description=Later, ")
            new.writestr(name.replace(version, LATER), content)
    return changed


def test_a_life_of_the_services(machine: Machine, python: str) -> None:
    before = set(ours(machine))
    wheel, _ = sorted(machine.run("sh", "-c", "cd /mnt; ls holdfast_rov-*").split())
    install = (python, "-m", "holdfast", "install", "--wheels", "/mnt")
    out_of_the_wheel = {"PYTHONPATH": f"/mnt/{wheel}"}

    machine.run(*install, env=out_of_the_wheel)
    assert set(ours(machine)) == before, "without --apply nothing changes"
    machine.run(*install, "--apply", env=out_of_the_wheel)
    assert "nothing to do" in machine.run("holdfast", "install", "--apply")
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
    refused = machine.run("holdfast", "uninstall", "--apply", status=2)
    assert "steers the vehicle now" in refused

    killed(machine, "STOP", "watchdog")
    killed(machine, "KILL", "signal")
    machine.run("systemctl", "stop", "holdfast-sim@heavy")
    recording = machine.run("sh", "-c", f"ls {DIVES}/*.mcap").split()[0]
    machine.run("setpriv", "--reuid=nobody", "--clear-groups", "test", "-r", recording)
    assert '"cockpit"' in machine.run(python, "-c", FETCH.format("http://127.0.0.1:8600/register_service"))

    machine.run(
        "holdfast", "install", f"/mnt/holdfast_rov-{LATER}-py3-none-any.whl", "--wheels", "/mnt", "--apply"
    )
    runs(machine, LATER, "Later, ")
    assert machine.run("head", "-n", "1", CONFIGURATION) == "# mine"
    machine.run("holdfast", "install", "--rollback", "--apply")
    runs(machine, wheel.split("-")[1], "Holdfast")
    assert machine.run("head", "-n", "1", CONFIGURATION) == "# mine"

    machine.reboot()
    for service in SERVICES:
        assert machine.show(service, "ActiveState") == "active"
    assert machine.show("holdfast-sim@heavy", "ActiveState") == "inactive", "no vehicle is simulated unasked"

    machine.run("holdfast", "uninstall", "--apply")
    left = set(ours(machine)) - before
    assert {"/etc/holdfast", DIVES} <= left
    assert not [path for path in left if path.startswith(("/opt", "/usr"))]
    machine.run(*install[:3], "uninstall", "--purge", "--apply", env=out_of_the_wheel)
    assert set(ours(machine)) == before
    assert "holdfast" not in machine.run("cat", "/etc/passwd", "/etc/group")
    assert machine.run("systemctl", "list-units", "--all", "--plain", "--no-legend", "holdfast*") == ""


FETCH = "import urllib.request; print(urllib.request.urlopen('{}').read().decode())"


def dive(machine: Machine) -> None:
    """Engage, and hold a metre."""
    machine.wait(lambda: machine.show("holdfast", "StatusText").startswith("IDLE: waiting for: arming"))
    machine.run("holdfast", "tell", "bluerov2", "setpoint", "depth_m=1")
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


def runs(machine: Machine, version: str, description: str) -> None:
    assert machine.run("holdfast", "-V").split()[:2] == ["holdfast", version]
    assert machine.show("holdfast", "Description").startswith(description)
    for service in SERVICES:
        assert machine.show(service, "ActiveState") == "active"


def ours(machine: Machine) -> list[str]:
    """Files of the machine that carry the name, in folders where installations put any."""
    folders = ("/etc", "/opt", "/run/systemd", "/usr/local", "/usr/lib/systemd", "/var/lib")
    found = machine.run("find", *folders, "-xdev", "-name", "*holdfast*", "-prune", "-print")
    return found.split()


def write(machine: Machine, path: str, text: str) -> None:
    machine.run("sh", "-c", 'printf %s "$2" > "$1"', "sh", path, text)
