"""Ground stations that nobody here wrote, behind `holdfast run`: what they show of it and command."""

import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from clients import mavproxy, needs_clients
from pilot_station import ENGAGE, HOLD, RELEASE, joined
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from lab.operations.processes import HOLDFAST, running
from lab.ports import free_port

PATIENCE_S = 30.0


@contextmanager
def flying(ground: int, *companion: str) -> Iterator[None]:
    """Run simulator and companion, which calls a ground station at port `ground` of this machine."""
    link = free_port(socket.SOCK_DGRAM)
    simulator = (
        *("sim", "--udp-connect", f"127.0.0.1:{link}", "--no-zenoh", "--set", "current.enabled=false"),
        *("--set", "initial.eta=[0,0,2,0,0,0.3]"),
    )
    run = (
        *("run", "--arm", "--set", f"link.endpoint=udp-listen:127.0.0.1:{link}"),
        *("--set", f"ground_station.endpoint=udp-connect:127.0.0.1:{ground}"),
        *("--set", "vehicle.thrust_path=manual_control"),
        *("--set", f"telemetry.endpoint=tcp/127.0.0.1:{free_port()}", *companion),
    )
    with running(*HOLDFAST, *simulator), running(*HOLDFAST, *run):
        yield


def test_mavutil_reads_and_commands() -> None:
    ground = free_port(socket.SOCK_DGRAM)
    pilot = mavutil.mavlink_connection(f"udpin:127.0.0.1:{ground}", source_system=255, source_component=190)
    try:
        with flying(ground):
            ours: list[Any] = []

            def hears(seconds: float, kind: str, wanted: Callable[[Any], bool]) -> bool:
                deadline_s, beat_s = time.monotonic() + seconds, 0.0
                while time.monotonic() < deadline_s:
                    if time.monotonic() > beat_s:
                        beat_s = time.monotonic() + 1.0
                        pilot.mav.heartbeat_send(6, 8, 0, 0, 4)
                    message = pilot.recv_match(blocking=True, timeout=0.05)
                    if message is not None and message.get_srcComponent() == 25:
                        ours.append(message)
                        if message.get_type() == kind and wanted(message):
                            return True
                return False

            def accepted(action: int) -> bool:
                """Command it until it is accepted: the vehicle's parameters have to be read first."""
                for _ in range(round(PATIENCE_S)):
                    pilot.mav.command_long_send(1, 25, mavlink.MAV_CMD_USER_1, 0, action, 0, 0, 0, 0, 0, 0)
                    if hears(1.0, "COMMAND_ACK", lambda m: bool(m.result == mavlink.MAV_RESULT_ACCEPTED)):
                        return True
                return False

            def becomes(state: int) -> bool:
                named = ("HfState", state)
                return hears(PATIENCE_S, "NAMED_VALUE_FLOAT", lambda m: (m.name, m.value) == named)

            assert becomes(0)
            for action, state in ((ENGAGE, 2), (HOLD, 2), (RELEASE, 5)):
                assert accepted(action), ours
                assert becomes(state), ours
            texts = [text for _, text in joined(ours)]
            assert "Holdfast ACTIVE: engaged" in texts
            assert any(text.startswith("Holdfast PILOT: ") for text in texts)
    finally:
        pilot.close()


@pytest.mark.alone
@needs_clients
def test_mavproxy_prints_what_holdfast_says_and_its_user_commands_it(tmp_path: Path) -> None:
    ground = free_port(socket.SOCK_DGRAM)
    with mavproxy(ground, tmp_path) as station, flying(ground):
        station.expect(r"Detected vehicle 1:1", r"Received (\d+) parameters")
        station.type("set target_component 25")
        station.type("long MAV_CMD_USER_1 1", r"Holdfast ACTIVE: engaged")
        station.type("long MAV_CMD_USER_1 2", r"Holdfast PILOT: ")
