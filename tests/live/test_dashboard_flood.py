"""Clients that finish no request, or talk no HTTP: the dashboard serves the others meanwhile."""

import contextlib
import http.client
import resource
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from itertools import cycle
from pathlib import Path

import pytest
from waiting import until

from dashboard.web.connections import PATIENCE_S
from lab.ports import free_port

FLOOD = 1140
"""Connections that stopped the dashboard when it took all that came: more than the files it may open."""
FILES = 1024
LOG_BYTES = 10_000
PROGRAM = (
    "import resource, sys, holdfast;"
    " resource.setrlimit(resource.RLIMIT_NOFILE, (int(sys.argv[1]),) * 2);"
    " sys.exit(holdfast.main(sys.argv[2:]))"
)
HALF = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: "
NO_BODY = b"POST /api/token HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 4000\r\n\r\n"
UNREAD = 40 * b"GET /static/uplot/uPlot.iife.min.js HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"


class Served:
    """A dashboard as a process that may open `files` files."""

    def __init__(self, folder: Path, files: int) -> None:
        self.port = free_port()
        self.log = folder / "log"
        arguments = ["dashboard", "--listen", f"127.0.0.1:{self.port}"]
        arguments += ["--connect", f"tcp/127.0.0.1:{free_port()}"]
        with self.log.open("wb") as log:
            line = [sys.executable, "-c", PROGRAM, str(files), *arguments]
            self.process = subprocess.Popen(line, stdin=subprocess.DEVNULL, stdout=log, stderr=log)

    def answers(self) -> bool:
        """Fetch the page as a browser does; raise nothing."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=5)
        try:
            connection.request("GET", "/")
            return connection.getresponse().status == 200
        except OSError:
            return False
        finally:
            connection.close()


@contextmanager
def served(folder: Path, files: int = FILES) -> Iterator[Served]:
    dashboard = Served(folder, files)
    try:
        until(dashboard.answers)
        yield dashboard
    finally:
        dashboard.process.terminate()
        dashboard.process.wait(10.0)


@pytest.fixture(autouse=True)
def files_for_the_flood() -> Iterator[None]:
    """Let this process open as many as it may: each end of a connection is one."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    yield
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def opened(stack: ExitStack, port: int, words: tuple[bytes, ...], count: int) -> list[socket.socket]:
    lines = [stack.enter_context(socket.create_connection(("127.0.0.1", port), 10.0)) for _ in range(count)]
    for line, said in zip(lines, cycle(words), strict=False):
        with contextlib.suppress(ConnectionError):
            line.sendall(said)
    return lines


def is_closed(line: socket.socket) -> bool:
    """Tell whether the other end is gone, whatever it said before."""
    line.setblocking(False)
    try:
        while line.recv(65536):
            pass
    except BlockingIOError:
        return False
    except ConnectionError:
        return True
    return True


def test_half_finished_requests_and_what_is_no_http_keep_nobody_out_and_fill_no_log(tmp_path: Path) -> None:
    with served(tmp_path) as dashboard, ExitStack() as stack:
        lines = opened(stack, dashboard.port, (b"", HALF, NO_BODY, UNREAD), FLOOD)
        for _ in range(10):
            assert dashboard.answers()
        until(lambda: all(map(is_closed, lines)), PATIENCE_S + 8.0)
        for _ in range(300):
            with socket.create_connection(("127.0.0.1", dashboard.port), 10.0) as line:
                line.sendall(b"GET / HTTP/1.1\r\nno header\r\n\r\n")
                with contextlib.suppress(ConnectionError):
                    line.recv(1024)
        assert dashboard.answers()
        assert dashboard.log.stat().st_size < LOG_BYTES
