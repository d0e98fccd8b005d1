"""What `holdfast install` does to a machine in a folder, whose systemd only notes what it is told."""

import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

import pytest

import holdfast
from companion.config import DEFAULT_FILE
from holdfast import install as installing

SERIAL = '[link]\nendpoint = "serial:/dev/ttyAMA0:921600"\n'
ROOTS = ("UNITS", "CONFIGURATION", "BEGUN", "LINK", "RUNNING")


@dataclass
class Machine:
    root: Path
    status: str = "READY"
    users: set[str] = field(default_factory=set)
    told: list[tuple[str, ...]] = field(default_factory=list)
    fails: str = ""

    def run(self, *argv: str) -> str:
        if self.fails and self.fails in argv:
            raise subprocess.CalledProcessError(1, argv, "", "no room\n")
        if argv[1] == "show":
            return self.status
        self.told.append(argv)
        if argv[0] == "useradd":
            self.users.add(argv[-1])
        elif argv[0] == "userdel":
            self.users.remove(argv[-1])
        return ""

    def files(self) -> set[str]:
        return {str(path.relative_to(self.root)) for path in self.root.rglob("*") if not path.is_dir()}


@pytest.fixture
def machine(tmp_path, monkeypatch):
    machine = Machine(tmp_path)
    for name in ROOTS:
        monkeypatch.setattr(installing, name, tmp_path / getattr(installing, name).relative_to("/"))
    for folder in (installing.RUNNING, installing.LINK.parent, installing.CONFIGURATION.parent):
        folder.mkdir(parents=True)
    monkeypatch.setattr(installing, "HIDDEN", ())
    monkeypatch.setattr(installing, "_run", machine.run)
    monkeypatch.setattr(installing, "_is_user", machine.users.__contains__)
    monkeypatch.setattr("os.geteuid", lambda: 0)
    monkeypatch.setattr("shutil.which", lambda name: f"/bin/{name}")
    return machine


def install(*argv: str) -> int:
    return holdfast.main(["install", *argv])


def test_an_empty_machine_gets_everything_and_what_to_do_next(machine, capsys):
    assert install() == 0
    units = {f"usr/local/lib/systemd/system/{name}" for name in installing.ENABLED}
    units |= {"usr/local/lib/systemd/system/holdfast-sim@.service"}
    assert machine.files() == units | {"etc/holdfast/companion.toml", "usr/local/bin/holdfast"}
    assert installing.CONFIGURATION.read_text() == DEFAULT_FILE.read_text()
    unit = (installing.UNITS / "holdfast.service").read_text()
    assert f"ExecStart={sys.prefix}/bin/holdfast run --config " in unit
    assert all(path.stat().st_mode & 0o777 == 0o644 for path in installing.UNITS.iterdir())
    assert machine.users == {"holdfast-record"}
    assert machine.told[1:] == [
        ("systemctl", "daemon-reload"),
        ("systemctl", "enable", *installing.ENABLED),
        ("systemctl", "start", *installing.ENABLED),
    ]
    said = capsys.readouterr().out
    assert f"upgrade: `{sys.prefix}/bin/pip install -U WHEEL`" in said
    assert "holdfast engage" in said


def test_again_it_keeps_the_configuration_and_what_was_disabled_and_starts_afresh_what_runs(machine):
    install()
    mine = "# mine\n" + installing.CONFIGURATION.read_text()
    installing.CONFIGURATION.write_text(mine)
    (installing.UNITS / "holdfast.service").write_text("of another version")
    machine.told.clear()
    assert install() == 0
    assert installing.CONFIGURATION.read_text() == mine
    assert "ExecStart" in (installing.UNITS / "holdfast.service").read_text()
    assert machine.told == [("systemctl", "daemon-reload"), ("systemctl", "try-restart", "holdfast*.service")]


@pytest.mark.parametrize("fails", ["useradd", "daemon-reload", "enable", "start"])
def test_an_installation_that_was_cut_off_says_why_and_is_finished_by_repeating_it(machine, capsys, fails):
    machine.fails = fails
    assert install() == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("holdfast install: `")
    assert fails in line
    assert line.endswith("no room / ; repeat this command")
    machine.fails = ""
    machine.told.clear()
    assert install() == 0
    assert ("systemctl", "enable", *installing.ENABLED) in machine.told
    assert ("systemctl", "start", *installing.ENABLED) in machine.told
    assert not installing.BEGUN.exists()


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("[heave]\nkappa_per_s = -1\n", "heave.kappa_per_s"),
        ('[compensators.mine]\nmodule = "leaves"\n', "compensators.mine.module"),
        ('[laws.mine]\nmodule = "odd"\n[heave]\nlaw = "mine"\n', "TypeError"),
    ],
)
def test_a_configuration_that_cannot_be_is_refused_before_anything_changes(
    machine, capsys, monkeypatch, tmp_path_factory, text, named
):
    modules = tmp_path_factory.mktemp("modules")
    (modules / "leaves.py").write_text("raise SystemExit(0)")
    (modules / "odd.py").write_text("Parameters = State = initial = step = 1")
    monkeypatch.syspath_prepend(modules)
    installing.CONFIGURATION.write_text(text)
    assert install() == 2
    said = capsys.readouterr().err
    assert "companion.toml" in said
    assert named in said
    assert (machine.files(), machine.told) == ({"etc/holdfast/companion.toml"}, [])


@pytest.mark.parametrize(
    "statuses", [("ACTIVE: held",), ("HAND_OVER: lost",), ("READY", "RAMP_DOWN: released")]
)
@pytest.mark.parametrize("what", [(), ("--remove",)])
def test_a_vehicle_that_is_steered_or_was_engaged_meanwhile_is_not_let_go(
    machine, monkeypatch, statuses, what
):
    install()
    machine.told.clear()
    answers, before = iter(statuses), machine.files()
    monkeypatch.setattr(
        installing, "_run", lambda *argv: next(answers) if argv[1] == "show" else machine.run(*argv)
    )
    assert install(*what) == 2
    assert not [argv for argv in machine.told if {"try-restart", "stop"} & set(argv)]
    assert machine.files() == before


BY_PATH = "/dev/serial/by-path/pci-0000:00:14.0-usb-0:2:1.0-port0"


@pytest.mark.parametrize(
    ("text", "allowed"),
    [
        (f'[link]\nendpoint = "serial:{BY_PATH}:115200"\n', [BY_PATH]),
        ('[link]\nendpoint = "serial:/dev/by-50%:57600"\n', ["/dev/by-50%%"]),
        (
            '[ground_station]\nendpoint = "serial:/dev/ttyUSB0:57600"\n'
            '[vehicle]\nthrust_path = "manual_control"\n'
            f'[link]\nendpoint = "serial:{BY_PATH}:115200"\n',
            [BY_PATH, "/dev/ttyUSB0"],
        ),
    ],
)
def test_the_service_may_use_each_device_that_an_endpoint_names(machine, text, allowed):
    installing.CONFIGURATION.write_text(text)
    assert install() == 0
    lines = (installing.UNITS / installing.SERIAL).read_text().splitlines()
    assert [line for line in lines if "DeviceAllow" in line] == [f"DeviceAllow={one} rw" for one in allowed]
    assert {"PrivateDevices=no", "SupplementaryGroups=dialout"} <= set(lines)


def test_a_serial_line_gets_its_drop_in_and_loses_it_again(machine):
    installing.CONFIGURATION.write_text(SERIAL)
    install()
    drop_in = installing.UNITS / installing.SERIAL
    assert "DeviceAllow=/dev/ttyAMA0 rw\n" in drop_in.read_text()
    installing.CONFIGURATION.write_text(DEFAULT_FILE.read_text())
    install()
    assert not drop_in.exists()


def test_an_image_without_a_running_systemd_gets_services_that_start_at_boot(machine):
    installing.RUNNING.rmdir()
    assert install() == 0
    assert machine.told[1:] == [("systemctl", "enable", *installing.ENABLED)]


def test_removing_leaves_what_is_the_owners_and_can_be_repeated(machine, capsys):
    installing.CONFIGURATION.write_text(SERIAL)
    installing.LINK.write_text("another program")
    install()
    assert install("--remove") == 0
    assert machine.files() == {"etc/holdfast/companion.toml", "usr/local/bin/holdfast"}
    assert installing.LINK.read_text() == "another program"
    assert machine.users == set()
    assert ("systemctl", "stop", "holdfast*.service") in machine.told
    assert "Left are " in capsys.readouterr().out
    installing.LINK.unlink()
    assert install() == install("--remove") == install("--remove") == 0
    assert machine.files() == {"etc/holdfast/companion.toml"}


def test_where_it_cannot_be_it_says_why(machine, monkeypatch, capsys):
    for name, value, says in (
        ("os.geteuid", lambda: 1000, "type sudo before it"),
        ("holdfast.install.HIDDEN", (f"{sys.prefix}/",), "venv /opt/holdfast"),
        ("shutil.which", lambda name: None, "On BlueOS use the extension"),
    ):
        monkeypatch.setattr(name, value)
        assert install() == 2
        assert says in capsys.readouterr().err
    assert machine.files() == set()
