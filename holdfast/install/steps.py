"""What changes a machine, as data: a step can be printed, and carried out."""

import os
import shutil
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from holdfast.install.machine import STEERS, service_status


class StepError(Exception):
    """A step that failed; the text says in one line which, and why."""


@dataclass(frozen=True)
class Run:
    """Run a program."""

    argv: tuple[str, ...]
    why: str

    def __str__(self) -> str:
        return f"{self.why}: {' '.join(self.argv)}"

    def carry_out(self) -> None:
        """Run it without Python's variables, which may lead to the wheel that this program runs from."""
        clean = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
        try:
            subprocess.run(self.argv, check=True, env=clean, cwd="/", capture_output=True, text=True)
        except FileNotFoundError as error:
            raise StepError(f"{self.why}: {self.argv[0]} is not there") from error
        except subprocess.CalledProcessError as error:
            said = [line for line in f"{error.stdout}\n{error.stderr}".splitlines() if line.strip()]
            raise StepError(f"{self.why}: `{' '.join(self.argv)}` failed: {' / '.join(said[-3:])}") from error


@dataclass(frozen=True)
class Write:
    """Write a file that everybody may read."""

    path: Path
    text: str

    def __str__(self) -> str:
        return f"write {self.path}"

    def carry_out(self) -> None:
        """Write it beside, then move it there: a power cut leaves the old file or the new one."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        beside = self.path.with_name(f".{self.path.name}.new")
        with beside.open("w", encoding="utf-8") as file:
            file.write(self.text)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(self.path)


@dataclass(frozen=True)
class Symlink:
    """Let a symbolic link lead to a target."""

    path: Path
    target: str

    def __str__(self) -> str:
        return f"link {self.path} -> {self.target}"

    def carry_out(self) -> None:
        """Replace the link that is there, if one is."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        beside = self.path.with_name(f".{self.path.name}.new")
        beside.unlink(missing_ok=True)
        beside.symlink_to(self.target)
        beside.replace(self.path)


@dataclass(frozen=True)
class Remove:
    """Remove a file, a link or a whole folder."""

    path: Path

    def __str__(self) -> str:
        return f"remove {self.path}"

    def carry_out(self) -> None:
        """Remove it; nothing there is as good."""
        if self.path.is_dir() and not self.path.is_symlink():
            shutil.rmtree(self.path)
        else:
            self.path.unlink(missing_ok=True)


@dataclass(frozen=True)
class LookAgain:
    """Go on only while Holdfast does not steer the vehicle: somebody may have engaged it meanwhile."""

    def __str__(self) -> str:
        return "look again that Holdfast does not steer the vehicle"

    def carry_out(self) -> None:
        """Raise StepError where it does."""
        if service_status().startswith(STEERS):
            raise StepError(
                "Holdfast steers the vehicle now, and was not restarted. First: holdfast tell NAME release; "
                "then repeat this command"
            )


Step = LookAgain | Run | Write | Symlink | Remove


def carry_out(steps: Sequence[Step], say: Callable[[str], object]) -> None:
    """Carry out all steps in order, and say each; raise StepError or OSError at the first that fails."""
    previous = os.umask(0o022)
    try:
        for step in steps:
            say(f"{step}\n")
            step.carry_out()
    finally:
        os.umask(previous)
