"""Our stand-in and ground stations that others wrote: MAVProxy, MAVSDK, pymavlink's mavutil."""

import socket
from collections.abc import Iterator

import pytest
from autopilot import Autopilot, StandIn
from client_tests import test_mavproxy, test_mavsdk, test_mavutil  # noqa: F401 - they run here

from lab.ports import free_port


@pytest.fixture
def port() -> int:
    return free_port(socket.SOCK_DGRAM)


@pytest.fixture
def vehicle(port: int) -> Iterator[Autopilot]:
    with StandIn(port) as vehicle:
        yield vehicle
