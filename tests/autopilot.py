"""ArduSub, or our stand-in for it, as a process in real time, with a ground station that listens."""

import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as mavlink

PARAMETERS = {
    "FRAME_CONFIG": 2,
    "BATT_MONITOR": 4,
    "SIM_BATT_VOLTAGE": 16,
    "SIM_BARO_RND": 0.02,  # as ArduPilot's own parameter files for this vehicle have it
    "LOG_BACKEND_TYPE": 0,
}
HOME = "33.8103,-118.3939,0,180"
"""Off a beach, at sea level: elsewhere the depth jumps by the height of the place when GPS comes."""

GROUND_STATION = 254
"""Not MAV_GCS_SYSID: it looks on, and is no pilot."""


class Autopilot:
    """Starts ArduSub on its own physics; `messages` are the newest of each kind that its second link gave.

    Its first link calls `link_port` of this machine.
    """

    BOOT_S = 10.0
    """From its first heartbeat on, until the EKF is there."""

    def __init__(self, program: Path, link_port: int, **parameters: float) -> None:
        self._program, self._link_port = program, link_port
        self._directory = Path(tempfile.mkdtemp(prefix="holdfast-ardusub-"))
        lines = [f"{name} {value}" for name, value in (PARAMETERS | parameters).items()]
        (self._directory / "holdfast.parm").write_text("\n".join(lines) + "\n", encoding="ascii")
        self._console = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._console.bind(("127.0.0.1", 0))
        self._console.settimeout(0.05)
        self._packer = mavlink.MAVLink(None, GROUND_STATION, 190)
        self._packer.robust_parsing = True
        self._peer: tuple[str, int] | None = None
        self.messages: dict[str, mavlink.MAVLink_message] = {}
        self.texts: list[str] = []
        self.parameters: dict[str, float] = {}
        """Those that it told, such as one that somebody set."""
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> "Autopilot":
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()
        self._console.close()
        shutil.rmtree(self._directory, ignore_errors=True)

    def start(self, boot_s: float | None = None) -> None:
        """Start it, and wait `boot_s` (None: BOOT_S) from its first heartbeat on."""
        self._process = subprocess.Popen(
            self._command_line(f"127.0.0.1:{self._link_port}", f"127.0.0.1:{self._console.getsockname()[1]}"),
            cwd=self._directory,
            env=os.environ,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        self.messages.clear()
        self.until(lambda: "HEARTBEAT" in self.messages, 20.0)
        for message_id in (mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW, mavlink.MAVLINK_MSG_ID_SIMSTATE):
            self.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, 50_000)
        self.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, 50_000)
        self.listen(self.BOOT_S if boot_s is None else boot_s)

    def _command_line(self, link: str, console: str) -> list[str]:
        return [
            *(str(self._program), "--model", "vectored_6dof", "--rc-in-port", "0", "--home", HOME),
            *("--defaults", str(self._directory / "holdfast.parm")),
            *("--serial0", f"udpclient:{link}", "--serial1", f"udpclient:{console}", "--serial2", "none:"),
        ]

    def kill(self) -> None:
        """End it as a power cut does."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None

    def command(self, number: int, *values: float) -> None:
        """Send a COMMAND_LONG."""
        padded = [*values, *[0.0] * 7][:7]
        self.send(mavlink.MAVLink_command_long_message(1, 1, number, 0, *padded))

    def send(self, message: mavlink.MAVLink_message) -> None:
        """Send a message on the second link."""
        if self._peer is not None:
            self._console.sendto(message.pack(self._packer), self._peer)

    def listen(self, seconds: float) -> list[mavlink.MAVLink_message]:
        """Take what it says for so long; return all of it."""
        heard = []
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s:
            try:
                data, self._peer = self._console.recvfrom(65536)
            except TimeoutError:
                continue
            for message in self._packer.parse_buffer(data) or ():
                if (message.get_srcSystem(), message.get_srcComponent()) != (1, 1):
                    continue  # it passes on what the companion says on the other link
                self.messages[message.get_type()] = message
                heard.append(message)
                if message.get_type() == "STATUSTEXT":
                    self.texts.append(message.text)
                elif message.get_type() == "PARAM_VALUE":
                    self.parameters[message.param_id] = message.param_value
        return heard

    def until(self, holds, timeout_s: float = 20.0) -> float:
        """Listen until `holds()`; return how long that took (s)."""
        began_s = time.monotonic()
        while not holds():
            assert time.monotonic() - began_s < timeout_s, f"not within {timeout_s} s; said {self.texts[-5:]}"
            self.listen(0.05)
        return time.monotonic() - began_s

    @property
    def armed(self) -> bool:
        """What its last heartbeat said."""
        return bool(self.messages["HEARTBEAT"].base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)

    @property
    def mode(self) -> int:
        """What its last heartbeat said."""
        return int(self.messages["HEARTBEAT"].custom_mode)

    @property
    def motors(self) -> list[int]:
        """PWM of the eight motors when it last told, µs."""
        servos = self.messages["SERVO_OUTPUT_RAW"]
        return [getattr(servos, f"servo{motor}_raw") for motor in range(1, 9)]

    @property
    def motors_rest(self) -> bool:
        """Whether all eight motors were at 1500 µs when it last told."""
        return set(self.motors) == {1500}


class StandIn(Autopilot):
    """Starts `holdfast sim` in its place."""

    BOOT_S = 2.5

    def __init__(self, link_port: int) -> None:
        super().__init__(Path(sys.executable), link_port)

    def _command_line(self, link: str, console: str) -> list[str]:
        endpoints = (f"--udp-connect={link}", f"--udp-connect={console}", "--no-zenoh")
        return [str(self._program), "-m", "holdfast", "sim", *endpoints, "--set", "current.enabled=false"]
