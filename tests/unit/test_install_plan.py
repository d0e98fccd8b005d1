"""What `holdfast install` and `uninstall` would do to which machine."""

import re
import shutil
import tomllib
from dataclasses import replace
from importlib.metadata import PathDistribution
from pathlib import Path
from zipfile import ZipFile

import pytest

from holdfast import RefusedError
from holdfast.install import commands
from holdfast.install.machine import (
    CONFIGURATION,
    CURRENT,
    GOING_BACK,
    PREVIOUS,
    PROGRAM,
    SERIAL,
    UNITS,
    UPGRADING,
    VERSIONS,
    Found,
)
from holdfast.install.plan import ENABLED, FROM_DEBIAN, install, uninstall, version_before
from holdfast.install.release import Release, from_wheel, packed
from holdfast.install.steps import LookAgain, Remove, Run, StepError, Symlink, Write, carry_out

ROOT = Path(__file__).parents[2]
NEW = Release(
    name="2.0-aaaa",
    wheel=Path("/media/holdfast_rov-2.0-py3-none-any.whl"),
    units={name: f"# {name}\n" for name in (*ENABLED, "holdfast-sim@.service")},
    configuration='[link]\nendpoint = "udp-listen:127.0.0.1:14550"\n',
    lock="numpy==2 --hash=sha256:0\n",
)
INSTALLED = Found(
    current=NEW.name,
    versions=(NEW.name,),
    files={UNITS / name: text for name, text in NEW.units.items()},
    configuration=NEW.configuration,
    program=str(CURRENT / "bin" / "holdfast"),
    owned=(CONFIGURATION.parent, Path("/var/lib/holdfast-dives")),
    user=True,
)
OLD = replace(INSTALLED, current="1.0-bbbb", versions=("0.9-cccc", "1.0-bbbb"), previous="0.9-cccc")


def ran(steps):
    return [step.argv for step in steps if isinstance(step, Run)]


def test_an_empty_machine_gets_everything():
    steps = install(Found(), NEW, "python3")
    written = {step.path for step in steps if isinstance(step, Write)}
    assert {UNITS / name for name in NEW.units} | {CONFIGURATION} <= written
    assert Symlink(CURRENT, "versions/2.0-aaaa") in steps
    assert Symlink(PROGRAM, "/opt/holdfast/current/bin/holdfast") in steps
    assert ran(steps)[-3:] == [
        ("systemctl", "daemon-reload"),
        ("systemctl", "enable", *ENABLED),
        ("systemctl", "start", *ENABLED),
    ]


def test_nothing_is_left_to_do_after_it():
    assert install(INSTALLED, NEW, "python3") == []


def test_an_upgrade_keeps_the_configuration_and_the_version_before():
    owner = replace(OLD, configuration=NEW.configuration + "# mine\n")
    steps = install(owner, NEW, "python3")
    assert not [step for step in steps if isinstance(step, Write) and step.path == CONFIGURATION]
    assert Symlink(PREVIOUS, "versions/1.0-bbbb") in steps
    assert Remove(VERSIONS / "0.9-cccc") in steps
    assert Remove(VERSIONS / "1.0-bbbb") not in steps


def test_an_upgrade_starts_afresh_what_runs_and_enables_nothing_that_was_disabled():
    commands = ran(install(OLD, NEW, "python3"))
    assert ("systemctl", "try-restart", "holdfast*.service") in commands
    assert not [command for command in commands if "enable" in command]


def test_the_new_version_is_tried_before_anything_that_runs_is_touched():
    steps = install(replace(OLD, files={}), NEW, "python3")
    check = next(n for n, step in enumerate(steps) if isinstance(step, Run) and "check" in step.argv)
    touched = [
        n
        for n, step in enumerate(steps)
        if isinstance(step, Symlink | Write) and VERSIONS not in step.path.parents
    ]
    assert check < min(touched)


def test_going_back_makes_no_environment():
    back = replace(NEW, name="0.9-cccc", wheel=None)
    steps = install(OLD, back, "python3", back=True)
    assert not [argv for argv in ran(steps) if "venv" in argv or "pip" in argv]
    assert {Symlink(CURRENT, "versions/0.9-cccc"), Symlink(PREVIOUS, "versions/1.0-bbbb")} <= set(steps)
    assert not [step for step in steps if isinstance(step, Remove) and VERSIONS in step.path.parents]


class CutError(Exception):
    """The power goes."""


class Machine:
    """A machine in a folder, with real links and files; `runs` is the version that the services run."""

    def __init__(self, root, patch, *, current="", previous=""):
        self.root, self.runs, self.enabled, self.status, self.left = (
            root,
            current,
            bool(current),
            "READY",
            10**6,
        )
        for path in (VERSIONS, CONFIGURATION.parent):
            self.at(path).mkdir(parents=True)
        for link, name in ((CURRENT, current), (PREVIOUS, previous)):
            if name:
                (self.at(VERSIONS) / name).mkdir()
                self.complete(name).touch()
                self.at(link).symlink_to(f"versions/{name}")
        for owner, name in ((Path, "replace"), (Path, "symlink_to"), (Path, "unlink"), (Path, "mkdir")):
            patch.setattr(owner, name, self.counted(getattr(owner, name)))
        patch.setattr("shutil.rmtree", self.counted(shutil.rmtree))
        patch.setattr("holdfast.install.steps.service_status", lambda: self.status)
        patch.setattr(Run, "carry_out", self.counted(lambda step: self.run(step.argv)))

    def at(self, path):
        return self.root / path.relative_to("/")

    def complete(self, name):
        return self.at(VERSIONS) / name / "complete"

    def counted(self, operation):
        def count(*arguments, **options):
            done = operation(*arguments, **options)
            self.left -= 1
            if self.left == 0:
                raise CutError
            return done

        return count

    def run(self, argv):
        folder = next((Path(word) for word in argv if word.startswith(f"{VERSIONS}/")), VERSIONS)
        if "venv" in argv:
            (self.at(folder)).mkdir()
        elif "-c" in argv:
            self.complete(folder.parent.parent.name).touch()
        elif argv[1:3] == ("config", "check"):
            assert self.complete(Path(argv[0]).parent.parent.name).exists()
        elif argv[1] == "enable":
            self.enabled = True
        elif argv[1] in ("start", "try-restart"):
            self.runs = self.link(CURRENT)

    def link(self, path):
        return self.at(path).readlink().name if self.at(path).exists() else ""

    def found(self):
        folder = self.at(UNITS)
        return Found(
            current=self.link(CURRENT),
            previous=self.link(PREVIOUS),
            upgrading=self.link(UPGRADING),
            going_back=self.link(GOING_BACK),
            versions=tuple(path.name for path in self.at(VERSIONS).iterdir()),
            files={UNITS / path.name: path.read_text() for path in folder.glob("*.service")},
            configuration=NEW.configuration,
            program=str(CURRENT / "bin" / "holdfast"),
            user=True,
            status=self.status,
        )

    def change(self, release=None):
        """Install a release, or go back."""
        found = self.found()
        back = release is None
        wanted = (
            replace(NEW, name=version_before(found), units={"holdfast.service": "old"}) if back else release
        )
        for step in install(found, wanted, "python3", back=back):
            (
                step if isinstance(step, Run | LookAgain) else replace(step, path=self.at(step.path))
            ).carry_out()

    def cut_after(self, operations, release=None):
        """Do it, and cut it after so many operations; tell whether there were so many."""
        self.left = operations
        try:
            self.change(release)
        except CutError:
            return True
        finally:
            self.left = 10**6
        return False


@pytest.fixture
def machines(tmp_path, monkeypatch):
    """Machines, each of which is cut after one operation more."""

    def make(release=None, **versions):
        for operations in range(1, 100):
            with monkeypatch.context() as patch:
                machine = Machine(tmp_path / str(operations), patch, **versions)
                if not machine.cut_after(operations, release):
                    assert operations > 5
                    return
                yield machine

    return make


def test_going_back_that_is_cut_anywhere_goes_on_and_deletes_nothing(machines):
    for machine in machines(current="2", previous="1"):
        assert machine.link(CURRENT) in ("1", "2")
        assert machine.complete("1").exists()
        assert machine.complete("2").exists()
        if machine.found().going_back or machine.link(CURRENT) == "2":
            machine.change()
        found = machine.found()
        assert (found.current, found.previous, machine.runs) == ("1", "2", "1")
        assert machine.complete("1").exists()
        assert machine.complete("2").exists()
        machine.change()
        assert (machine.link(CURRENT), machine.link(PREVIOUS), machine.runs) == ("2", "1", "2")


@pytest.mark.parametrize(("current", "previous"), [("2", "1"), ("", "")])
def test_an_upgrade_that_is_cut_anywhere_goes_on(machines, current, previous):
    for machine in machines(NEW, current=current, previous=previous):
        in_use = machine.link(CURRENT)
        assert in_use in (current, NEW.name)
        assert not in_use or machine.complete(in_use).exists()
        assert not current or machine.complete(current).exists()
        machine.change(NEW)
        found = machine.found()
        assert (found.current, found.previous, machine.runs) == (NEW.name, current, NEW.name)
        assert machine.enabled
        assert set(found.versions) <= {NEW.name, current, previous}
        assert not current or machine.complete(current).exists()
        assert install(found, NEW, "python3") == []


def test_going_back_after_an_upgrade_that_was_cut_leaves_what_is_in_use(machines):
    for machine in machines(NEW, current="2", previous="1"):
        in_use, before = machine.link(CURRENT), machine.link(PREVIOUS)
        if in_use == before:
            with pytest.raises(RefusedError, match="was cut off: repeat it"):
                machine.change()
        else:
            machine.change()
            assert (machine.link(CURRENT), machine.runs) == (before, before)
        assert machine.complete(machine.link(CURRENT)).exists()
        assert machine.complete("2").exists()


def test_a_vehicle_that_was_engaged_meanwhile_is_not_restarted(tmp_path, monkeypatch):
    machine = Machine(tmp_path / "m", monkeypatch, current="2", previous="1")
    steps = install(machine.found(), replace(NEW, name="1"), "python3", back=True)
    restart = next(n for n, step in enumerate(steps) if isinstance(step, Run) and "try-restart" in step.argv)
    assert steps[restart - 1] == LookAgain()
    LookAgain().carry_out()
    machine.status = "ACTIVE: held"
    with pytest.raises(StepError, match="repeat this command"):
        LookAgain().carry_out()


def test_a_version_that_was_begun_and_not_finished_is_made_afresh():
    steps = install(replace(OLD, versions=(*OLD.versions, NEW.name)), NEW, "python3")
    assert steps.index(Remove(VERSIONS / NEW.name)) < steps.index(
        Run(("python3", "-m", "venv", str(VERSIONS / NEW.name)), "make a virtual environment")
    )
    assert steps.count(Remove(VERSIONS / NEW.name)) == 1


def test_with_wheels_no_index_is_asked():
    for argv in ran(install(Found(), NEW, "python3", Path("/media/wheels"))):
        assert "pip" not in argv or "--no-index" in argv


def test_every_file_that_comes_from_an_index_is_known_by_its_hash():
    (pip,) = [
        argv for argv in ran(install(Found(), NEW, "python3")) if "pip" in argv and "--no-index" not in argv
    ]
    assert "--require-hashes" in pip


def test_a_32_bit_system_takes_from_debian_what_the_index_has_not():
    lock = (ROOT / "requirements" / "vehicle.lock").read_text()
    steps = install(replace(Found(), bits=32), replace(NEW, lock=lock), "python3")
    (written,) = [step.text for step in steps if isinstance(step, Write) and step.path.suffix == ".lock"]
    names = [set(re.findall(r"^([a-z0-9-]+)==", text, flags=re.MULTILINE)) for text in (lock, written)]
    assert names[0] - names[1] == set(FROM_DEBIAN)
    assert set(written.splitlines()) < set(lock.splitlines())
    assert [line for line in written.splitlines() if not line.endswith("\\")][-1].startswith("    --hash=")
    venv, _, pip, *_ = ran(steps)
    assert venv == ("python3", "-m", "venv", "--system-site-packages", str(VERSIONS / NEW.name))
    assert "--require-hashes" in pip
    assert "--only-binary" not in pip


def test_a_32_bit_system_without_debians_packages_is_told_which(monkeypatch):
    monkeypatch.setattr(commands, "look", lambda: Found(bits=32))
    monkeypatch.setattr(commands, "from_wheel", lambda wheel: NEW)
    monkeypatch.setattr(commands, "HIDDEN", ())
    monkeypatch.setattr("shutil.which", lambda name: None if name == "gcc" else f"/bin/{name}")
    with pytest.raises(RefusedError, match=r"apt-get install gcc python3-dev python3-numpy"):
        commands.install([str(NEW.wheel)])


def test_the_image_and_the_installer_take_the_same_from_debian():
    dockerfile = (ROOT / "blueos" / "Dockerfile").read_text()
    (names,) = re.findall(r"'/\^\((cffi\|[^)]*)\)==/", dockerfile)
    assert set(names.split("|")) == {*FROM_DEBIAN, "pymavlink"}


def test_the_oldest_numpy_is_that_of_the_project():
    dependencies = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    assert f"numpy>={'.'.join(map(str, commands.NUMPY))}" in dependencies


def test_a_serial_line_gets_its_drop_in_and_loses_it_again():
    line = '[link]\nendpoint = "serial:/dev/ttyAMA0:921600"\n'
    steps = install(replace(INSTALLED, configuration=line), NEW, "python3")
    (drop_in,) = [step for step in steps if isinstance(step, Write)]
    assert drop_in.path == SERIAL
    assert "DeviceAllow=/dev/ttyAMA0 rw\n" in drop_in.text
    with_it = replace(INSTALLED, files={**INSTALLED.files, SERIAL: drop_in.text})
    assert Remove(SERIAL) in install(with_it, NEW, "python3")


@pytest.mark.parametrize("state", ["ACTIVE: held", "RAMP_DOWN: released", "HAND_OVER: position lost"])
def test_it_leaves_a_vehicle_alone_that_is_held(state):
    held = replace(OLD, status=state)
    for plan in (lambda: install(held, NEW, "python3"), lambda: uninstall(held, purge=False)):
        with pytest.raises(RefusedError, match="tell NAME release"):
            plan()
    assert install(replace(INSTALLED, status=state), NEW, "python3") == []


def test_an_image_without_a_running_systemd_gets_services_that_start_at_boot():
    commands = ran(install(Found(running=False), NEW, "python3"))
    assert ("systemctl", "enable", *ENABLED) in commands
    assert not {"daemon-reload", "start"} & {word for command in commands for word in command}


def test_uninstalling_leaves_what_is_the_owners():
    steps = uninstall(INSTALLED, purge=False)
    removed = {step.path for step in steps if isinstance(step, Remove)}
    assert {UNITS / name for name in NEW.units} | {Path("/opt/holdfast"), PROGRAM} == removed
    assert ("userdel", "holdfast-record") in ran(steps)
    everything = {step.path for step in uninstall(INSTALLED, purge=True) if isinstance(step, Remove)}
    assert everything == removed | set(INSTALLED.owned)


def test_a_program_of_somebody_else_stays():
    assert Remove(PROGRAM) not in uninstall(replace(INSTALLED, program="/usr/bin/other"), purge=True)
    upgrade = install(replace(OLD, program=""), NEW, "python3")
    assert not [step for step in upgrade if isinstance(step, Symlink) and step.path == PROGRAM]


def test_an_empty_machine_has_nothing_to_uninstall():
    assert uninstall(Found(), purge=True) == []


@pytest.mark.parametrize("name", ["holdfast_rov-1.0.whl", "holdfast-1.0.whl", "numpy-2.0.whl", "notes.txt"])
def test_what_is_no_wheel_of_ours_is_refused(name, tmp_path):
    with ZipFile(tmp_path / name, "w") as file:
        file.writestr("holdfast/__init__.py", "")
    with pytest.raises(RefusedError, match=r"(no|a) wheel of Holdfast"):
        from_wheel(tmp_path / name)


def test_two_builds_of_a_version_are_two_names(tmp_path):
    names = set()
    for unit in ("one", "two"):
        wheel = tmp_path / "holdfast_rov-1.0-py3-none-any.whl"
        with ZipFile(wheel, "w") as file:
            file.writestr("holdfast/systemd/holdfast.service", unit)
            file.writestr("holdfast/config/companion.toml", "")
            file.writestr("holdfast/requirements/vehicle.lock", "")
        release = from_wheel(wheel)
        assert release.units == {"holdfast.service": unit}
        names.add(release.name)
    assert len(names) == 2


def test_what_pip_installed_from_an_index_is_a_wheel_again(tmp_path):
    """`pipx install` keeps no wheel, and `holdfast install` needs one."""
    there, info = tmp_path / "site-packages", "holdfast_rov-2.0.dist-info"
    files = {
        "holdfast/requirements/vehicle.lock": "numpy==2\n",
        f"{info}/METADATA": "Name: holdfast-rov\nVersion: 2.0\n",
    }
    rows = "".join(f"{name},sha256=0,9\n" for name in files)
    by_pip = {"holdfast/__pycache__/a.pyc": "", f"{info}/INSTALLER": "pip", "../../bin/holdfast": "#!"}
    record = rows + "".join(f"{name},,\n" for name in by_pip) + f"{info}/RECORD,,\n"
    for name, text in (files | by_pip | {f"{info}/RECORD": record}).items():
        (there / name).parent.mkdir(parents=True, exist_ok=True)
        (there / name).write_text(text)
    made = []
    for folder in (tmp_path / "one", tmp_path / "two"):
        folder.mkdir()
        made.append(packed(PathDistribution(there / info), folder))
    assert made[0].name == "holdfast_rov-2.0-py3-none-any.whl"
    assert made[0].read_bytes() == made[1].read_bytes()
    with ZipFile(made[0]) as wheel:
        assert {name: wheel.read(name).decode() for name in wheel.namelist()} == files | {
            f"{info}/RECORD": rows + f"{info}/RECORD,,\n"
        }


def test_steps_change_files_and_can_be_repeated(tmp_path):
    file, link, folder = tmp_path / "a" / "file", tmp_path / "b" / "link", tmp_path / "c"
    folder.mkdir()
    (folder / "x").touch()
    said: list[str] = []
    for _ in range(2):
        carry_out([Write(file, "text"), Symlink(link, str(file)), Remove(folder)], said.append)
        assert (file.read_text(), link.read_text(), folder.exists()) == ("text", "text", False)
    assert file.stat().st_mode & 0o777 == 0o644
    carry_out([Remove(link), Remove(link)], said.append)
    assert file.exists()
    assert said[0] == f"write {file}\n"


def test_a_step_that_fails_says_which_and_why_in_one_line(tmp_path):
    with pytest.raises(StepError, match=r"try it: `false` failed") as failed:
        carry_out([Run(("false",), "try it")], lambda said: None)
    assert "\n" not in str(failed.value)
    with pytest.raises(StepError, match="nowhere is not there"):
        Run((str(tmp_path / "nowhere"),), "try it").carry_out()
