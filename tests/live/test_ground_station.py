"""A ground station that others wrote, MAVProxy, behind `holdfast run`, before `holdfast sim`."""

import socket

from clients import mavproxy, needs_clients
from tools.processes import HOLDFAST, free_port, running
from waiting import PATIENT


@needs_clients
def test_mavproxy_prints_what_holdfast_says_and_its_user_commands_it(tmp_path):
    ground, link = free_port(socket.SOCK_DGRAM), f"127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
    run = (
        *("run", "--arm", "--set", f"link.endpoint=udp-listen:{link}"),
        *("--set", f"ground_station.endpoint=udp-connect:127.0.0.1:{ground}"),
        *("--set", "vehicle.thrust_path=manual_control"),
        *("--set", f"telemetry.endpoint=tcp/127.0.0.1:{free_port()}"),
        *(f"--set={setting}" for setting in PATIENT),
    )
    with (
        mavproxy(ground, tmp_path) as station,
        running(*HOLDFAST, "sim", "--udp-connect", link, "--no-zenoh", "--set", "initial.eta=[0,0,2,0,0,0]"),
        running(*HOLDFAST, *run),
    ):
        station.expect(r"Detected vehicle 1:1", r"Received (\d+) parameters")
        station.type("set target_component 25")
        station.type("long MAV_CMD_USER_1 1", r"Holdfast ACTIVE: engaged")
        station.type("long MAV_CMD_USER_1 2", r"Holdfast PILOT: ")
