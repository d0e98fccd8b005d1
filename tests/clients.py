"""MAVProxy, a ground station that others wrote: where `make clients` puts it, and it as a process."""

import os
import re
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
CLIENTS = ROOT / "build" / "clients"
needs_clients = pytest.mark.skipif(
    not CLIENTS.is_dir() and not os.environ.get("CI"),
    reason="MAVProxy is not installed: `make clients`",
)
"""CI has it, or fails."""

MODULES = "log,wp,rally,fence,ftp,param,arm,mode,rc,relay,misc,cmdlong"
PATIENCE_S = 20.0


class MavProxy:
    """MAVProxy on pipes, without a screen: type a command, and wait for what it prints.

    Args:
        port: of this machine, where its vehicle calls.
        directory: for its logs and files; it runs there.

    """

    def __init__(self, port: int, directory: Path) -> None:
        self._said = ""
        self._process = subprocess.Popen(
            [
                *(sys.executable, "-u", "-m", "MAVProxy.mavproxy", f"--master=udpin:127.0.0.1:{port}"),
                *(f"--default-modules={MODULES}", f"--state-basedir={directory}", "--streamrate=-1"),
            ],
            cwd=directory,
            env=os.environ | {"PYTHONPATH": str(CLIENTS)},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self._reader = threading.Thread(target=self._listen, daemon=True)
        self._reader.start()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._said += line

    def type(self, command: str, *expected: str) -> re.Match[str] | None:
        """Type a command; wait until it has printed what is expected, and return the last one's match."""
        assert self._process.stdin is not None
        begin = len(self._said)
        self._process.stdin.write(command + "\n")
        self._process.stdin.flush()
        return self.expect(*expected, begin=begin)

    def expect(self, *expected: str, begin: int = 0) -> re.Match[str] | None:
        """Wait until it has printed these regular expressions, in any order; return the last one's match."""
        found = None
        deadline_s = time.monotonic() + PATIENCE_S
        for pattern in expected:
            while (found := re.compile(pattern).search(self._said, begin)) is None:
                assert time.monotonic() < deadline_s, f"no {pattern!r} in:\n{self._said[begin:]}"
                assert self._process.poll() is None, f"MAVProxy ended:\n{self._said}"
                time.sleep(0.02)
        return found

    def close(self) -> None:
        """End it as its user does: its input ends."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        try:
            self._process.wait(timeout=10.0)
        finally:
            self._process.kill()
            self._process.wait()
            self._reader.join()
            assert self._process.stdout is not None
            self._process.stdout.close()
        assert "Traceback" not in self._said, self._said


@contextmanager
def mavproxy(port: int, directory: Path) -> Iterator[MavProxy]:
    """Run MAVProxy."""
    client = MavProxy(port, directory)
    try:
        yield client
    finally:
        client.close()
