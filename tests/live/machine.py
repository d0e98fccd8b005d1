"""A machine of its own: this one's file system under a layer in memory, with systemd booted in it."""

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from waiting import until

_MOUNTS = """
mount -t tmpfs -o size=2g tmpfs "$1"
mkdir "$1/upper" "$1/work" "$1/root"
mount -t overlay overlay -o "lowerdir=/,upperdir=$1/upper,workdir=$1/work" "$1/root"
"""
_BOOT = (
    _MOUNTS
    + """
folder=$1; shift
trap : TERM
status=133
while [ $status = 133 ]; do  # that of a reboot
    status=0
    systemd-nspawn --quiet --register=no --keep-unit --private-network --console=pipe --boot \
        --machine=vehicle --directory="$folder/root" "$@" || status=$?
done
"""
)
_OWN_MOUNTS = ("unshare", "--mount", "--propagation", "private", "sh", "-euc")


def what_lacks(folder: Path) -> str:
    """Return why no machine can be booted here, in the words of who refused; "" if one can."""
    if os.geteuid() != 0:
        return "not root"
    if shutil.which("systemd-nspawn") is None:
        return "systemd-nspawn is not installed: .ci/apt brings it"
    tried = subprocess.run(
        [*_OWN_MOUNTS, _MOUNTS + "unshare --pid --net --ipc --uts --cgroup --fork true", "sh", str(folder)],
        capture_output=True,
        text=True,
        check=False,
    )
    return tried.stderr.strip().replace("\n", "; ") if tried.returncode else ""


class Machine:
    """Runs programs in a booted machine."""

    def __init__(self, process: int, console: Path) -> None:
        self._process = process
        self._console = console

    def run(self, *argv: str, status: int = 0, env: Mapping[str, str] | None = None) -> str:
        """Run a program as root; return what it printed. Fail if its exit status is another."""
        done = subprocess.run(
            ["nsenter", f"--target={self._leader()}", "-m", "-u", "-i", "-n", "-p", "-C", *argv],
            capture_output=True,
            text=True,
            check=False,
            env={"PATH": "/usr/local/bin:/usr/bin:/bin:/usr/sbin", **(env or {})},
        )
        assert done.returncode == status, f"{argv}: {done.returncode}\n{done.stdout}\n{done.stderr}"
        return (done.stdout + done.stderr).strip()

    def show(self, unit: str, name: str) -> str:
        """Return a property of a unit."""
        return self.run("systemctl", "show", "--property", name, "--value", unit)

    def wait(self, holds: Callable[[], object], within_s: float = 30.0) -> None:
        """Return once it holds; ask twice a second, because to ask is to start a program."""

        def rested() -> object:
            time.sleep(0.5)
            return holds()

        until(rested, within_s)

    def boots(self) -> None:
        """Wait until all that starts at boot has started."""
        try:
            self.wait(self._is_up, within_s=60.0)
        except AssertionError:
            raise AssertionError(f"it did not boot:\n{self._console.read_text()}") from None

    def reboot(self) -> None:
        """Restart it, and wait for it."""
        before = self._leader()
        self.run("systemctl", "--no-block", "reboot")
        self.wait(lambda: self._leader() not in (before, 0), within_s=60.0)
        self.boots()

    def _is_up(self) -> bool:
        leader = self._leader()
        if not leader:
            return False
        asked = subprocess.run(
            ["nsenter", f"--target={leader}", "-m", "-p", "systemctl", "is-system-running"],
            capture_output=True,
            text=True,
            check=False,
        )
        return asked.stdout.strip() in ("running", "degraded")

    def _leader(self) -> int:
        """Return the process that is number 1 inside; 0 before it is there."""
        try:
            (nspawn,) = _children(self._process)
            return next(child for child in _children(nspawn) if _name(child) == "systemd")
        except (OSError, ValueError, StopIteration):
            return 0


def _children(process: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{process}/task/{process}/children").read_text().split()]


def _name(process: int) -> str:
    return Path(f"/proc/{process}/comm").read_text().strip()


@contextmanager
def booted(folder: Path, *options: str) -> Iterator[Machine]:
    """Boot a machine; what changes in it is gone afterwards. `options` are systemd-nspawn's."""
    console = folder / "console"
    inside = folder / "machine"
    inside.mkdir()
    with console.open("wb") as log:
        process = subprocess.Popen(
            [*_OWN_MOUNTS, _BOOT, "sh", str(inside), *options],
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            start_new_session=True,
        )
    try:
        machine = Machine(process.pid, console)
        machine.boots()
        yield machine
    finally:
        os.killpg(process.pid, signal.SIGTERM)
        try:
            process.wait(20.0)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
