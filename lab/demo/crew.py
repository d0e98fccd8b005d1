"""The child processes of the demo: started in a session of their own, never left behind."""

import os
import signal
import subprocess
import sys
from collections import Counter
from contextlib import suppress
from pathlib import Path
from typing import Self

GRACE_S = 4.0
LOG_LINES = 15

# The kernel ends a child whose parent is gone, however it went: PR_SET_PDEATHSIG is 1.
_PROGRAM = """\
import ctypes, os, signal, sys
ctypes.CDLL(None).prctl(1, signal.SIGTERM)
if os.getppid() != int(sys.argv[1]):
    sys.exit(1)
import holdfast
sys.exit(holdfast.main(sys.argv[2:]))
"""


class ChildError(Exception):
    """A child died; the message holds the last lines of its log."""


class Crew:
    """Runs `holdfast` commands; leaving the context ends all of them, the one started last first."""

    def __init__(self, log_dir: Path) -> None:
        self._log_dir = log_dir
        self._children: list[tuple[str, subprocess.Popen[bytes]]] = []

    def start(self, command: str, *arguments: str) -> None:
        """Start `holdfast COMMAND ARGUMENTS`; what it says goes to a log."""
        self.run(command, [sys.executable, "-P", "-c", _PROGRAM, str(os.getpid()), command, *arguments])

    def run(self, name: str, line: list[str]) -> None:
        """Start a program; what it says goes to a log."""
        with self._log(name).open("wb") as log:
            child = subprocess.Popen(
                line,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
        self._children.append((name, child))

    def check(self) -> None:
        """Raise ChildError if one has ended."""
        for command, child in self._children:
            status = child.poll()
            if status is not None:
                how = f"with status {status}" if status >= 0 else f"by {signal.Signals(-status).name}"
                raise ChildError(f"`holdfast {command}` ended {how}.\n{self.last_lines(command)}")

    def pids(self) -> dict[str, int]:
        """Return the process of each child by its name."""
        return {name: child.pid for name, child in self._children}

    def count(self, word: str) -> Counter[str]:
        """Count a word in the log of each child, also of those that have ended."""
        found = {log.stem: log.read_text(errors="replace").count(word) for log in self._log_dir.glob("*.log")}
        return Counter({name: count for name, count in found.items() if count})

    def last_lines(self, only: str = "") -> str:
        """Return the end of each child's log, or of one child's, for people to read."""
        texts: list[str] = []
        for command, _ in self._children:
            if command == (only or command):
                lines = self._log(command).read_text(errors="replace").splitlines()[-LOG_LINES:]
                said = "\n".join(f"  {line}" for line in lines) or "  (nothing)"
                texts.append(f"`holdfast {command}` last said:\n{said}")
        return "\n".join(texts)

    def close(self) -> None:
        """Ask all to end, wait, and kill what does not."""
        for _, child in reversed(self._children):
            _send(child, signal.SIGTERM)
        for _, child in reversed(self._children):
            try:
                child.wait(GRACE_S)
            except subprocess.TimeoutExpired:
                _send(child, signal.SIGKILL)
                child.wait()
        self._children.clear()

    def __enter__(self) -> Self:
        """Start none yet."""
        return self

    def __exit__(self, *_: object) -> None:
        """End all."""
        self.close()

    def _log(self, command: str) -> Path:
        return self._log_dir / f"{command}.log"


def _send(child: subprocess.Popen[bytes], number: signal.Signals) -> None:
    """Signal a child's whole session."""
    if child.poll() is None:
        with suppress(ProcessLookupError):
            os.killpg(child.pid, number)
