"""Our stand-in and a ground station that others wrote, MAVProxy."""

import socket
from collections.abc import Iterator

import pytest
from autopilot import Autopilot, StandIn
from client_tests import test_mavproxy  # noqa: F401 - it runs here
from tools.processes import free_port


@pytest.fixture
def port() -> int:
    return free_port(socket.SOCK_DGRAM)


@pytest.fixture
def vehicle(port: int) -> Iterator[Autopilot]:
    with StandIn(port) as vehicle:
        yield vehicle
