"""Real sockets, real clock, real Zenoh: the shell around the vehicle."""

import contextlib
import json
import os
import signal
import socket
import struct
import subprocess
import sys
import time
from typing import Any

import pytest
import zenoh
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from tools.processes import free_port

from sim_bridge.app import MAX_CATCH_UP_STEPS
from sim_bridge.fault_kinds import Fault
from sim_bridge.zenoh_link import inject

START_S = 15.0


@contextlib.contextmanager
def simulator(*arguments):
    process = subprocess.Popen(
        [sys.executable, "-m", "holdfast", "sim", *arguments],
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ,
    )
    try:
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        try:
            _, errors = process.communicate(timeout=10)
        finally:
            process.kill()
    assert process.returncode == 0, errors
    assert "Traceback" not in errors


def connect(port):
    deadline = time.monotonic() + START_S
    while True:
        try:
            return socket.create_connection(("127.0.0.1", port), timeout=5)
        except OSError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.05)


def listen(read, seconds=1.5):
    parser = mavlink.MAVLink(None)
    heard: list[Any] = []
    parser.robust_parsing = True
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        heard += parser.parse_buffer(read()) or []
    return heard


def peer(endpoint):
    config = zenoh.Config()
    config.insert_json5("mode", '"peer"')
    config.insert_json5("listen/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("transport/shared_memory/enabled", "false")
    return zenoh.open(config)


def count(heard, name):
    return sum(message.get_type() == name for message in heard)


def test_tcp_and_udp_clients_at_once_and_a_clean_end():
    port = free_port()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as called:
        called.bind(("127.0.0.1", 0))
        called.settimeout(START_S)
        endpoints = (f"--tcp=127.0.0.1:{port}", f"--udp-connect=127.0.0.1:{called.getsockname()[1]}")
        with simulator(*endpoints, "--no-zenoh"), connect(port) as first, connect(port) as second:
            data, vehicle_address = called.recvfrom(2048)
            assert data[0] == 0xFD
            heard = listen(lambda: first.recv(65536))
            assert count(heard, "ATTITUDE") == pytest.approx(15, abs=6)
            assert count(listen(lambda: second.recv(65536), 1.2), "HEARTBEAT") >= 1

            packer = mavlink.MAVLink(None, 255, 190)
            ask = mavlink.MAVLink_timesync_message(0, 4711).pack(packer)
            called.sendto(ask, vehicle_address)
            answers = listen(lambda: called.recvfrom(2048)[0], 5.0)
            assert 4711 in [m.ts1 for m in answers if m.get_type() == "TIMESYNC"]

            first.close()
            assert count(listen(lambda: second.recv(65536), 1.0), "ATTITUDE") > 5


def test_time_runs_as_the_clock_does():
    port = free_port()
    with simulator(f"--tcp=127.0.0.1:{port}", "--no-zenoh"), connect(port) as client:
        heard = listen(lambda: client.recv(65536), 2.0)
    boots = [m.time_boot_ms for m in heard if m.get_type() == "ATTITUDE"]
    assert (boots[-1] - boots[0]) / 1000 == pytest.approx(2.0, rel=0.2)
    assert MAX_CATCH_UP_STEPS * 0.005 <= 0.2


def test_truth_on_zenoh_whoever_starts_first():
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    samples = []
    with simulator(
        f"--udp-connect=127.0.0.1:{free_port(socket.SOCK_DGRAM)}", f"--zenoh={endpoint}", "--name=v7"
    ):
        time.sleep(1.0)
        with peer(endpoint) as session:
            session.declare_subscriber("sim/v7/truth", lambda sample: samples.append(sample))
            deadline = time.monotonic() + START_S
            while len(samples) < 60 and time.monotonic() < deadline:
                time.sleep(0.05)
            times = [json.loads(sample.payload.to_string())["t_s"] for sample in samples]
            encoding = str(samples[0].encoding)
            truth = json.loads(samples[-1].payload.to_string())
    assert len(times) >= 60
    assert times[-1] - times[0] == pytest.approx((len(times) - 1) / 50, rel=0.3)
    assert encoding == "application/json;holdfast.sim.Truth.v1"
    assert None not in truth.values()
    assert [len(truth[key]) for key in ("eta", "nu", "tau", "disturbance", "thrust_n")] == [6, 6, 6, 6, 8]


def test_faults_are_taken_live_only_where_that_is_allowed():
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    unheard = inject(endpoint, "v8", Fault("leak"))
    assert not unheard.done
    assert "start `holdfast run`" in unheard.said
    port, deaf_port = free_port(), free_port()
    allowed = (f"--tcp=127.0.0.1:{port}", f"--zenoh={endpoint}", "--name=v8", "--live-faults")
    deaf = (f"--tcp=127.0.0.1:{deaf_port}", f"--zenoh={endpoint}", "--name=v9")
    with peer(endpoint), simulator(*allowed), simulator(*deaf), connect(port) as client:
        connect(deaf_port).close()
        deadline = time.monotonic() + START_S
        while not (reply := inject(endpoint, "v8", Fault("leak"))).done and time.monotonic() < deadline:
            time.sleep(0.2)
        assert reply.done, reply.said
        texts = [m.text for m in listen(lambda: client.recv(65536)) if m.get_type() == "STATUSTEXT"]
        assert "Leak Detected" in texts
        refused = inject(endpoint, "v9", Fault("leak"))
        assert not refused.done
        assert "--live-faults" in refused.said


def test_physics_only_answers_the_frames_of_the_real_firmware_and_nothing_else():
    port = free_port()
    with (
        simulator("--physics-only", f"127.0.0.1:{port}", "--no-zenoh"),
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as firmware,
    ):
        firmware.settimeout(0.2)
        frame = struct.pack("<HHI16H", 18458, 400, 0, *(1500,) * 16)
        deadline = time.monotonic() + START_S
        reply: dict[str, Any] = {}
        while not reply and time.monotonic() < deadline:
            with contextlib.suppress(OSError):
                firmware.sendto(b"junk", ("127.0.0.1", port))
                firmware.sendto(frame, ("127.0.0.1", port))
                reply = json.loads(firmware.recv(2000))
        assert reply["timestamp"] == pytest.approx(0.0025)
        assert reply["imu"]["accel_body"][2] == pytest.approx(-9.8, abs=0.2)
