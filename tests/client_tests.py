"""Dialogues with ground stations that others wrote, for the `vehicle` and `port` of the importing file."""

from pathlib import Path

import dialogue_mavproxy
import dialogue_mavutil
import pytest
from autopilot import Autopilot
from clients import mavproxy, mavsdk, needs_clients


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
