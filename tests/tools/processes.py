"""Child processes for as long as a block of code lasts, and the ports on which they meet."""

import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import IO

HOLDFAST = (sys.executable, "-m", "holdfast")
GRACE_S = 5.0


@contextmanager
def running(
    *command: str, output: bool = False, errors: int | IO[bytes] = subprocess.DEVNULL
) -> Iterator[subprocess.Popen[str]]:
    """Keep a child process for as long as the block lasts, and end it as a user would, with SIGINT."""
    child = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE if output else subprocess.DEVNULL,
        stderr=errors,
        text=True,
    )
    try:
        yield child
    finally:
        child.send_signal(2)
        try:
            child.wait(GRACE_S)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()
        if child.stdout is not None:
            child.stdout.close()


def free_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    """Return a free loopback port; somebody else may take it before it is used."""
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port
