"""A program that `lab.loop.firmware` takes for ArduSub for sitl: options, frames, serial links and reboot.

Its autopilot is our stand-in's, its sensors read the physics' replies. FAKE_ARDUSUB names what it does wrong:
"twice" sends every 50th frame twice at once, "late" repeats it before it reads the answer, "dies" exits at
frame 300, "mute" sends no heartbeat.
"""

import argparse
import json
import os
import select
import socket
import struct
import sys
from pathlib import Path

import numpy as np

from sim_bridge.firmware.input_loop import Autopilot
from sim_bridge.firmware.link import KeyStore, Link
from sim_bridge.firmware.params import Parameters
from sim_bridge.physics.plant import GRAVITY, rotation
from sim_bridge.physics.sensors import Sensors
from sim_bridge.sim_config import SensorConfig

STEP_S = 0.0025
WRONG = os.environ.get("FAKE_ARDUSUB", "")


def main():
    parser = argparse.ArgumentParser()
    for name in ("model", "sim-port-out", "rc-in-port", "home", "start-time", "defaults", "serial5"):
        parser.add_argument(f"--{name}")
    for number in range(3):
        parser.add_argument(f"--serial{number}", required=True)
    arguments = parser.parse_args()
    assert arguments.model == "JSON:127.0.0.1"
    parameters = Parameters({})
    for line in Path(arguments.defaults).read_text(encoding="ascii").splitlines():
        name, value = line.split()
        parameters.set(name, float(value))  # as ArduSub, it says nothing of a name that it does not know

    frames = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    frames.connect(("127.0.0.1", int(arguments.sim_port_out)))
    serials = {}
    for number in range(3):
        kind, host, port = getattr(arguments, f"serial{number}").split(":")
        assert kind == "udpclient"
        serials[number] = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        serials[number].connect((host, int(port)))

    sensors = Sensors(SensorConfig(), STEP_S, np.random.default_rng(1))
    frame = "vectored_6dof" if parameters["FRAME_CONFIG"] == 2 else "vectored"
    links, keys = {number: Link() for number in serials}, KeyStore("")
    autopilot = Autopilot(parameters, sensors, frame, False, False, links, keys, rebooted=False)
    pwm, count = autopilot.motor_pwm, 0
    while True:
        asked = struct.pack("<HHI16H", 18458, 400, count, *(*pwm, *[0] * 16)[:16])
        frames.send(asked)
        if WRONG == "twice" and count % 50 == 0:
            frames.send(asked)
        said = json.loads(frames.recv(2000))
        if WRONG == "late" and count % 50 == 0:
            frames.send(asked)
        count += 1
        if WRONG == "dies" and count == 300:
            sys.stderr.write("something broke\n")
            sys.exit(3)
        time_s = said["timestamp"]
        assert abs(time_s - count * STEP_S) < 1e-6, (time_s, count * STEP_S)
        state, acceleration = felt(said)
        sensors.record(state, acceleration, 0.0)
        autopilot.state = state
        for number, serial in serials.items():
            if select.select([serial], [], [], 0)[0]:
                autopilot.receive(number, serial.recv(65536))
        if autopilot.reboot_requested:
            os.execv(sys.executable, [sys.executable, *sys.argv])
        pwm = autopilot.update(time_s, STEP_S)
        said = autopilot.telemetry()
        for number in {number for number, _ in said if WRONG != "mute"}:
            serials[number].send(b"".join(data for to, data in said if to == number))


def felt(said):
    attitude = (0.0, 0.0, 0.0, *said["quaternion"])
    r = rotation(attitude)
    north, east, down = said["velocity"]
    nu = [r[i] * north + r[i + 3] * east + r[i + 6] * down for i in range(3)]
    acceleration = [a + GRAVITY * g for a, g in zip(said["imu"]["accel_body"], r[6:], strict=True)]
    return (*said["position"], *said["quaternion"], *nu, *said["imu"]["gyro"]), acceleration


if __name__ == "__main__":
    main()
