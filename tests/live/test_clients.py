"""Our stand-in and ground stations that others wrote: MAVProxy, MAVSDK, pymavlink's mavutil."""

import socket
from collections.abc import Iterator
from pathlib import Path

import dialogue_mavproxy
import dialogue_mavutil
import pytest
from autopilot import Autopilot, StandIn
from clients import mavproxy, mavsdk, needs_clients

from lab.ports import free_port


@pytest.fixture
def port() -> int:
    return free_port(socket.SOCK_DGRAM)


@pytest.fixture
def vehicle(port: int) -> Iterator[Autopilot]:
    with StandIn(port) as vehicle:
        yield vehicle


@needs_clients
def test_mavproxy(vehicle: Autopilot, port: int, tmp_path: Path) -> None:
    with mavproxy(port, tmp_path) as station:
        dialogue_mavproxy.everything(vehicle, station, tmp_path)


@needs_clients
@pytest.mark.usefixtures("vehicle")
def test_mavsdk(port: int) -> None:
    mavsdk(port)


def test_mavutil(vehicle: Autopilot, port: int, tmp_path: Path) -> None:
    dialogue_mavutil.everything(vehicle, port, tmp_path)
