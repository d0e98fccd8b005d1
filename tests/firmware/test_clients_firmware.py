"""The same dialogue with the real firmware as tests/live/test_clients.py has with our stand-in."""

import socket
from collections.abc import Iterator
from pathlib import Path

import pytest
from autopilot import Autopilot
from client_tests import test_mavproxy  # noqa: F401 - it runs here
from tools.processes import free_port


@pytest.fixture
def port() -> int:
    return free_port(socket.SOCK_DGRAM)


@pytest.fixture
def vehicle(port: int, ardusub: Path) -> Iterator[Autopilot]:
    with Autopilot(ardusub, port, LOG_BACKEND_TYPE=1) as vehicle:  # LOG_REQUEST_END crashes one without
        yield vehicle
