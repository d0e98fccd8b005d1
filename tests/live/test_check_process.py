"""`holdfast check` as a process against `holdfast sim`, over TCP: its list and its exit status."""

import json
import signal
import socket
import subprocess

import pytest
from tools.processes import HOLDFAST, free_port, running


def check(port, *arguments):
    endpoint = f"link.endpoint=tcp:127.0.0.1:{port}"
    return subprocess.run(
        [*HOLDFAST, "check", "--set", endpoint, *arguments], capture_output=True, text=True, timeout=60
    )


@pytest.fixture
def port():
    port = free_port()
    with running(*HOLDFAST, "sim", "--tcp", f"127.0.0.1:{port}", "--no-zenoh"):
        yield port


def test_warnings_then_all_good_then_a_refusal(port):
    """The origin is not set; set it; steer under an id that the vehicle does not obey."""
    done = check(port)
    assert done.returncode == 1, done.stdout + done.stderr
    assert "EKF origin" in done.stdout
    assert "--set-origin" in done.stdout
    done = check(port, "--json", "--set-origin", "47.4,8.5")
    assert done.returncode == 0, done.stdout + done.stderr
    assert json.loads(done.stdout)["grade"] == "GOOD"
    done = check(port, "--json", "--set", "link.system=254")
    assert done.returncode == 2
    (row,) = [row for row in json.loads(done.stdout)["rows"] if row["grade"] == "REFUSED"]
    assert row["name"] == "steering id"
    assert "255" in row["found"]


def test_a_signal_breaks_it_off_in_order():
    """Killed without a word it could leave a thruster of `--thrusters` running."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        vehicle.bind(("127.0.0.1", 0))
        vehicle.settimeout(30.0)
        endpoint = f"link.endpoint=udp-connect:127.0.0.1:{vehicle.getsockname()[1]}"
        with running(*HOLDFAST, "check", "--set", endpoint) as looking:
            vehicle.recv(4096)
            looking.send_signal(signal.SIGHUP)
            assert looking.wait(5.0) == 130


def test_a_wrong_configuration_is_said_and_refused():
    done = check(1, "--set", "vehicle.frame=submarine")
    assert done.returncode == 2
    assert "vehicle.frame" in done.stderr
    done = check(1, "--set-origin", "north")
    assert done.returncode == 2
    assert "LAT,LON" in done.stderr
