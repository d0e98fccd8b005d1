"""Ground stations that others wrote, mavutil and MAVProxy, behind `holdfast run`, before `holdfast sim`."""

import contextlib
import hashlib
import socket
import time

import pytest
from clients import mavproxy, needs_clients
from pymavlink import mavutil

from lab.operations.processes import HOLDFAST, running
from lab.ports import free_port

TIMEOUT_S = 20.0


@contextlib.contextmanager
def flying(ground, *companion, plant=()):
    """Simulator, and a companion that calls a ground station at port `ground`: its process."""
    link = free_port(socket.SOCK_DGRAM)
    simulator = (
        *("sim", "--udp-connect", f"127.0.0.1:{link}", "--no-zenoh", "--set", "current.enabled=false"),
        *("--set", "initial.eta=[0,0,2,0,0,0.3]", *plant),
    )
    run = (
        *("run", "--set", f"link.endpoint=udp-listen:127.0.0.1:{link}"),
        *("--set", f"ground_station.endpoint=udp-connect:127.0.0.1:{ground}"),
        *("--set", "vehicle.thrust_path=manual_control"),
        *("--set", f"telemetry.endpoint=tcp/127.0.0.1:{free_port()}", *companion),
    )
    with running(*HOLDFAST, *simulator), running(*HOLDFAST, *run) as process:
        yield process


@contextlib.contextmanager
def station(*companion, plant=()):
    """A connected ground station, and the companion's process before it."""
    ground = free_port(socket.SOCK_DGRAM)
    pilot = mavutil.mavlink_connection(f"udpin:127.0.0.1:{ground}", source_system=255, source_component=190)
    try:
        with flying(ground, *companion, plant=plant) as process:
            assert pilot.wait_heartbeat(timeout=TIMEOUT_S) is not None
            yield pilot, process
    finally:
        pilot.close()


class Flight:
    """Heartbeats at 1 Hz and sticks at 25 Hz, as QGroundControl sends them; what is heard meanwhile."""

    def __init__(self, pilot):
        self.pilot, self.sticks, self._next_s, self._count = pilot, None, 0.0, 0

    def until(self, true, seconds=TIMEOUT_S):
        """Fly until `true(message)` of a message; return that message."""
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s:
            if time.monotonic() >= self._next_s:
                self._next_s = time.monotonic() + 0.04
                if self._count % 25 == 0:
                    self.pilot.mav.heartbeat_send(6, 8, 0, 0, 4)
                if self.sticks is not None:
                    self.pilot.mav.manual_control_send(1, *self.sticks, 0)
                self._count += 1
            message = self.pilot.recv_match(blocking=True, timeout=0.01)
            if message is not None and message.get_srcComponent() == 1 and true(message):
                return message
        raise AssertionError("it never came")

    def drain(self):
        """Forget what has come and was not read."""
        while self.pilot.recv_match(blocking=False) is not None:
            pass


def depth(message):
    return -message.relative_alt / 1e3 if message.get_type() == "GLOBAL_POSITION_INT" else None


def test_a_foreign_ground_station_reads_arms_and_moves_the_depth_that_is_held():
    with station("--engage") as (pilot, process):
        flight = Flight(pilot)
        pilot.mav.param_request_list_send(1, 1)
        flight.until(lambda m: m.get_type() == "PARAM_VALUE" and m.param_id == "FS_PILOT_INPUT")
        flight.until(lambda m: m.get_type() == "ATTITUDE" and m.time_boot_ms > 3000)  # it refuses before 2 s
        pilot.arducopter_arm()
        flight.until(lambda m: m.get_type() == "HEARTBEAT" and m.base_mode & 128)
        # Engaged: the companion's own override of heave is in force, and the pilot's surge passes.
        flight.sticks = (150, 0, 500, 0)
        flight.until(lambda m: m.get_type() == "RC_CHANNELS" and m.chan5_raw == 1530 and m.chan3_raw != 1500)
        flight.sticks = (0, 0, 250, 0)
        flight.until(lambda m: (depth(m) or 0.0) > 2.6)
        flight.sticks = (0, 0, 500, 0)
        with contextlib.suppress(AssertionError):
            flight.until(lambda m: False, seconds=2.0)
        settled = depth(flight.until(depth))
        for _ in range(20):
            assert depth(flight.until(depth)) == pytest.approx(settled, abs=0.1)
        assert process.poll() is None
        process.kill()
        process.wait()
        flight.drain()
        with pytest.raises(AssertionError, match="never came"):
            flight.until(lambda m: True, seconds=1.0)


def test_signed_from_end_to_end_with_a_foreign_ground_station(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    key_file = tmp_path / "mavlink.key"
    key_file.write_text("kelp\n")
    key_file.chmod(0o600)
    with station(
        *("--engage", "--arm", "--set", f"link.signing_key_file={key_file}"),
        plant=("--set", 'signing_passphrase="kelp"'),
    ) as (pilot, _):
        pilot.setup_signing(hashlib.sha256(b"kelp").digest(), sign_outgoing=True)
        flight = Flight(pilot)
        flight.until(lambda m: m.get_type() == "HEARTBEAT" and m.base_mode & 128)
        flight.sticks = (150, 0, 500, 0)
        flight.until(lambda m: m.get_type() == "RC_CHANNELS" and m.chan5_raw == 1530)
        pilot.mav.param_request_read_send(1, 1, b"FS_PILOT_TIMEOUT", -1)
        flight.until(lambda m: m.get_type() == "PARAM_VALUE" and m.param_id == "FS_PILOT_TIMEOUT")
        assert pilot.mav.signing.badsig_count == 0


@pytest.mark.alone
@needs_clients
def test_mavproxy_prints_what_holdfast_says_and_its_user_commands_it(tmp_path):
    ground = free_port(socket.SOCK_DGRAM)
    with mavproxy(ground, tmp_path) as station, flying(ground, "--arm"):
        station.expect(r"Detected vehicle 1:1", r"Received (\d+) parameters")
        station.type("set target_component 25")
        station.type("long MAV_CMD_USER_1 1", r"Holdfast ACTIVE: engaged")
        station.type("long MAV_CMD_USER_1 2", r"Holdfast PILOT: ")
