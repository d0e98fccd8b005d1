"""The real ArduSub as the vehicle of a dive in virtual time: `lab.loop.lockstep` steps it as our own.

    with Firmware(program(None), load_config(DEFAULT_CONFIG), seed=1) as vehicle:
        loop = Lockstep(vehicle, Engine(config, setpoint, arm=True), LinkDelay(), seed=1)
        loop.requests = [Request.ENGAGE]
        for step in loop.run(60.0): ...

The program is ArduSub built for `sitl`; HOLDFAST_ARDUSUB names it. It runs in a directory of its own, on
loopback, and its ports are found, so that any number of them run at once. It is killed on leaving the
context, at exit, and by the kernel if the thread that started it ends.

How time is kept: the firmware sends a physics frame and blocks until it is answered. Before a frame is
answered, what goes to the firmware is written to its serial links; when its next frame has come, it has
written what it had to say, and that is read. The serial links are UDP (`udpclient`), a datagram a frame each
way, because TCP's delayed acknowledgements would bring the real clock in. So engine, links, physics and
firmware advance together, as fast as the machine allows, and the same configuration and seed repeat a dive as
far as the firmware repeats itself.

Boot: the body is held at the surface for BOOT_S while the firmware starts and its EKF settles, a ground
station sets the EKF's origin where the dive is `surveyed`, and the body is lowered to `initial.eta`. `time_s`
is 0 after that, and so is the time of the sea: the same seed gives the sea that our stand-in gets. The usual
BlueROV2 has neither origin nor home; relative_alt of ArduSub 4.5 is then the barometer.

Parameters: those of NEEDED, of the configuration's frame, battery, water and DVL, and last its `parameters`.
Faults: those that FAULT_KINDS allows on the firmware; the others are refused, because they would have to
change what this firmware says (message_*), its pins (leak), its sensors or its EKF.
"""

import atexit
import os
import select
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import chain
from pathlib import Path
from typing import Any, Self

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from holdfast import RefusedError
from sim_bridge.fault_kinds import FAULT_KINDS, Fault
from sim_bridge.faults import Datagram, Faults
from sim_bridge.physics.body import Physics
from sim_bridge.physics.json_physics import Asked, DrivenBody, Responder, Sensed
from sim_bridge.physics.plant import state_of
from sim_bridge.sim_config import SimConfig
from sim_bridge.vehicle import Truth, Vehicle, truth_of

VARIABLE = "HOLDFAST_ARDUSUB"
STEP_S = 0.0025
"""One physics frame: the period of ArduSub's main loop."""
BOOT_S = 20.0
"""Held at the surface: start, calibration, and the EKF's yaw alignment."""
SPREAD_S = 0.01
"""A seed is held so much longer than the one before (up to a second), so that seeds meet other noise."""
LOWERING_S = 8.0
SETTLED_S = 4.0
"""Held at `initial.eta` before time begins."""

SERIALS = 3
"""Links 1 to SERIALS are the firmware's SERIAL0 and following; the last one is our ground station's."""
CONSOLE = SERIALS
SENDER = 254
"""System id of our ground station: not MAV_GCS_SYSID, so that it is no pilot and no sign of life of one."""
SYSTEM, COMPONENT = 1, 1
FORCE_REBOOT, FORCE_DISARM = 20190226, 21196
"""What the firmware wants beside these commands, or it refuses them while armed."""

FRAME_WAIT_S = 60.0
"""Real time without a frame after which the firmware is given up; a reboot takes a second or two."""
POLL_MS = 500
LAST_LINES = 15
HOME = "47.5,-2.571,0,0"
ORIGIN_DEG_E7 = (475000000, -25710000)
"""A place without declination: before it has a position, the firmware takes the compass for true north."""
START_TIME = "1700000000"
"""UTC of the firmware's clock at its start (s): the same in each dive."""

SEA_WATER = 1.024 * 9.80665 / 9.8
"""BARO_SPEC_GRAV of the water in which the firmware simulates its barometer, 1024 kg/m³."""

NEEDED: dict[str, float] = {
    "SIM_RATE_HZ": 1.0 / STEP_S,
    "SIM_SPEEDUP": 1,
    "SIM_BARO_RND": 0.01,  # m: with it relative_alt errs by 3 mm, as our stand-in's and a Bar30's
    "SIM_BARO_DELAY": 60,  # ms: as a Bar30; docs/ardusub.md, "The height of the EKF"
    "SIM_DRIFT_SPEED": 0,  # the simulated gyro drifts by up to 0.2 °/s, which turns the EKF's heading by 2°
    "AHRS_EKF_TYPE": 3,  # newer firmware in lockstep otherwise uses the simulated truth (10), and no EKF
    "LOG_BACKEND_TYPE": 0,
    "BATT_MONITOR": 4,
    **{"SIM_GPS1_ENABLE": 0, "GPS1_TYPE": 0, "SIM_GPS_DISABLE": 1, "GPS_TYPE": 0},  # the last two: 4.5
    "EK3_SRC1_POSXY": 0,
    "EK3_SRC1_VELXY": 0,
    "SERIAL2_PROTOCOL": 2,
    # Three simulated compasses without offsets are calibrated ones.
    **{f"SIM_MAG{n}_OFS_{axis}": 0 for n in (1, 2, 3) for axis in "XYZ"},
}
DVL: dict[str, float] = {
    "VISO_TYPE": 1,
    "EK3_SRC1_POSXY": 6,
    "EK3_SRC1_VELXY": 6,
    "SERIAL5_PROTOCOL": 2,
    "SIM_VICON_TMASK": 3,
}
"""A DVL reaches the EKF as external navigation, by VISION_POSITION_ESTIMATE and VISION_SPEED_ESTIMATE; their
simulated source, the firmware's own, reads our position, 25 to 124 ms late."""

LATER_NAMES = {
    "PSC_POSZ_P": ("PSC_D_POS_P", 1.0),
    "PSC_VELZ_P": ("PSC_D_VEL_P", 1.0),
    "PSC_ACCZ_P": ("PSC_D_ACC_P", 0.1),
    "PSC_ACCZ_I": ("PSC_D_ACC_I", 0.1),
    "PSC_POSXY_P": ("PSC_NE_POS_P", 1.0),
    "PSC_VELXY_P": ("PSC_NE_VEL_P", 1.0),
    "PSC_VELXY_I": ("PSC_NE_VEL_I", 1.0),
    "PSC_VELXY_FLTE": ("PSC_NE_VEL_FLTE", 1.0),
}
"""What ArduSub calls these parameters since the end of 2025, and by what it multiplied their values."""

# The kernel kills the firmware when this process is gone, however it went: PR_SET_PDEATHSIG is 1.
_START = """\
import ctypes, os, signal, sys
if sys.platform == "linux":
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)
if os.getppid() == int(sys.argv[1]):
    os.execv(sys.argv[2], sys.argv[2:])
"""


class FirmwareError(RefusedError):
    """The program cannot be found or started, or has stopped; the message holds what it said last."""


def program(given: str | None) -> Path:
    """Return the program that `given` names, or HOLDFAST_ARDUSUB; FirmwareError where none is."""
    named = given or os.environ.get(VARIABLE, "")
    if not named:
        raise FirmwareError(
            f"no firmware: set {VARIABLE} to the path of ArduSub's program for sitl, or name it"
        )
    path = Path(named).expanduser().resolve()
    if not os.access(path, os.X_OK) or path.is_dir():
        raise FirmwareError(f"no firmware: {path} is not a program")
    return path


def parameters_of(config: SimConfig) -> dict[str, float]:
    """Return what the firmware's parameters have to be for this vehicle; the configuration's own win.

    Its simulated water is salt: BARO_SPEC_GRAV is that of the configuration on top of SEA_WATER.
    """
    sensors, given = config.sensors, dict(config.parameters)
    own = {
        "SIM_VICON_P_SD": sensors.dvl_white_m,
        "SIM_VICON_V_SD": sensors.dvl_white_m,
        "FRAME_CONFIG": 2 if config.thrusters.frame == "vectored_6dof" else 1,
        "SIM_BATT_VOLTAGE": config.battery.voltage_v,
        "BARO_SPEC_GRAV": SEA_WATER * given.pop("BARO_SPEC_GRAV", 1.0) / sensors.depth_scale,
    }
    later = {
        name: share * given[earlier] for earlier, (name, share) in LATER_NAMES.items() if earlier in given
    }
    return NEEDED | (DVL if sensors.dvl else {}) | own | given | later


def command_line(
    program: Path, config: SimConfig, directory: Path, frames_port: int, serial_ports: Sequence[int]
) -> list[str]:
    """Return what starts the firmware with external physics on loopback; its parameters go to `directory`.

    It sends its frames to UDP `frames_port`, and SERIAL0 and following to the UDP `serial_ports`.
    """
    defaults = directory / "holdfast.parm"
    lines = [f"{name} {value:.9g}" for name, value in parameters_of(config).items()]
    defaults.write_text("\n".join(lines) + "\n", encoding="ascii")
    arguments = [
        *("--model", "JSON:127.0.0.1"),
        *("--sim-port-out", str(frames_port)),
        *("--rc-in-port", "0"),
        *("--home", HOME),
        *("--start-time", START_TIME),
        *("--defaults", str(defaults)),
    ]
    for number, port in enumerate(serial_ports):
        arguments += [f"--serial{number}", f"udpclient:127.0.0.1:{port}"]
    if config.sensors.dvl:
        arguments += ["--serial5", "sim:vicon:"]
    return [sys.executable, "-I", "-S", "-c", _START, str(os.getpid()), str(program), *arguments]


class Firmware:
    """An ArduSub process in virtual time, with the interface of `sim_bridge.vehicle.Vehicle`."""

    step_s: float = STEP_S

    def __init__(self, program: Path, config: SimConfig, seed: int, *, surveyed: bool = True) -> None:
        """Start it and wait until it has settled (see the module's text), disarmed, in its start-up mode.

        Unless `surveyed` its EKF is told no origin, and it sets no home. Raises FirmwareError if it does not
        start, stops, or does not know a parameter of the configuration.
        """
        self.time_s = 0.0
        self._steps = 0
        self._config = config
        self._surveyed = surveyed
        self._body = DrivenBody(Physics(config, seed), config.battery.voltage_v)
        self._faults = Faults(config.faults, np.random.default_rng(seed).spawn(3)[2])
        for fault in config.faults:
            _refuse(fault)
        self._responder = Responder(self._move, STEP_S)
        self._held_s = 0.0
        """Time for which the body has been held since the start."""
        self._free = False
        self._boot_s = BOOT_S + SPREAD_S * (seed % 100)
        self._opened: set[int] = set()
        self._pending = b""
        self._armed, self._mode = False, -1
        self._console = mavlink.MAVLink(None, SENDER, mavlink.MAV_COMP_ID_MISSIONPLANNER)
        self._console.robust_parsing = True
        self._heard_parameters: dict[str, float] = {}
        self._outbox: dict[int, list[bytes]] = {}
        self._addresses: dict[int, tuple[str, int]] = {}
        """Where the firmware's end of each link is; after a reboot it is another."""
        self._process: subprocess.Popen[bytes] | None = None
        self.directory = Path(tempfile.mkdtemp(prefix="holdfast-ardusub-"))
        self._links = {link: _socket() for link in range(1, SERIALS + 1)}
        self._frames = _socket()
        atexit.register(self.close)
        try:
            self._poll = select.poll()
            self._poll.register(self._frames, select.POLLIN)
            self._start(program)
            self._settle()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Kill the process and remove its directory; may be called again."""
        atexit.unregister(self.close)
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()
        for open_socket in (self._frames, *self._links.values()):
            open_socket.close()
        shutil.rmtree(self.directory, ignore_errors=True)

    @property
    def pid(self) -> int:
        """Process id of the running firmware."""
        if self._process is None:
            raise FirmwareError("the firmware has been closed")
        return self._process.pid

    def open_link(self, link: int) -> None:
        """Take a link's telemetry from now on: 1 is SERIAL0, 2 is SERIAL1."""
        if not 1 <= link < CONSOLE:
            raise ValueError(f"the firmware has links 1 to {CONSOLE - 1}, not {link}")
        self._opened.add(link)

    def inject(self, fault: Fault) -> None:
        """Add a fault to the script. Raises ValueError for one that cannot be done to this firmware."""
        _refuse(fault)
        self._faults.add(fault)

    def step(self, datagrams: Sequence[Datagram] = ()) -> list[Datagram]:
        """Advance one physics frame; `datagrams` are (link, bytes). Returns (link, bytes) that it sent.

        Raises FirmwareError where the process has stopped, or sends no frame any more.
        """
        for fault in self._faults.advance(self.time_s):
            self._begin(fault)
        body, drained = self._body, self._faults.holds("voltage")
        body.source_v = self._config.battery.voltage_v if drained is None else drained.value
        body.physics.health, body.physics.stuck = self._faults.health(), self._faults.stuck()
        for link, data in self._faults.carry("in", datagrams, self.time_s):
            self.open_link(link)
            self._outbox.setdefault(link, []).append(data)
        said = self._exchange()
        self._steps += 1
        self.time_s = self._steps * STEP_S
        return self._faults.carry("out", said, self.time_s)

    def truth(self) -> Truth:
        """Tell the present truth; armed and mode are what its last heartbeat said (1 Hz, and on a change)."""
        return truth_of(self._body.physics, self.time_s, self._body.pwm, self._armed, self._mode)

    # --- Time ---------------------------------------------------------------------------------------------

    def _exchange(self) -> list[Datagram]:
        """Hand over what was sent, answer the frame, wait for the next one; return what was heard."""
        for link, pieces in self._outbox.items():
            if link in self._addresses:
                with suppress(OSError):
                    self._links[link].sendto(b"".join(pieces), self._addresses[link])
        self._outbox.clear()
        self._answer()
        since_s = time.monotonic()
        while not self._pending:
            if self._poll.poll(POLL_MS):
                self._take_frames()
            else:
                self._check(time.monotonic() - since_s)
        return self._read_links()

    def _answer(self) -> None:
        if self._pending:
            packet, address = self._pending, self._address
            self._pending = b""
            if reply := self._responder.answer(packet, time.monotonic()):
                self._frames.sendto(reply, address)

    def _take_frames(self) -> None:
        """Keep the newest frame; a copy of the one that was answered is answered again if it was lost."""
        with suppress(BlockingIOError):
            while True:
                packet, self._address = self._frames.recvfrom(256)
                if self._responder.is_repeated(packet):
                    if reply := self._responder.answer(packet, time.monotonic()):
                        self._frames.sendto(reply, self._address)
                else:
                    self._pending = packet

    def _read_links(self) -> list[Datagram]:
        """Return what the firmware has written since the last frame."""
        heard: list[Datagram] = []
        for link, connection in self._links.items():
            with suppress(BlockingIOError):
                while True:
                    data, self._addresses[link] = connection.recvfrom(65536)
                    if link == CONSOLE:
                        self._hear(data)
                    elif link in self._opened:
                        heard.append((link, data))
        return heard

    def _move(self, frame: Asked, dt_s: float) -> Sensed:
        if self._free:
            return self._body.move(frame, dt_s)
        self._held_s += dt_s
        return held(self._config.initial.eta, self._held_s - self._boot_s)

    # --- Process ------------------------------------------------------------------------------------------

    def _start(self, program: Path) -> None:
        ports = [ours.getsockname()[1] for ours in self._links.values()]
        command = command_line(program, self._config, self.directory, self._frames.getsockname()[1], ports)
        with self._log.open("wb") as log:
            self._process = subprocess.Popen(
                command, cwd=self.directory, stdin=subprocess.DEVNULL, stdout=log, stderr=log
            )

    @property
    def _log(self) -> Path:
        return self.directory / "output.txt"

    def _check(self, silent_s: float) -> None:
        """Raise FirmwareError if nothing is to be expected any more."""
        assert self._process is not None
        status = self._process.poll()
        if status is None and silent_s < FRAME_WAIT_S:
            return
        how = f"sends no frame for {silent_s:.0f} s" if status is None else f"has ended with status {status}"
        last = self._log.read_text(errors="replace").splitlines()[-LAST_LINES:]
        raise FirmwareError("\n  ".join([f"the firmware {how}; it said last:", *last]))

    def _settle(self) -> None:
        """Boot at the surface, set the origin if it is surveyed, lower the body, and let the EKF settle."""
        self._wait(lambda: self._held_s >= 0.5 * self._boot_s and self._mode >= 0, self._boot_s + 10.0)
        names = {name: (name, LATER_NAMES.get(name, (name, 1.0))[0]) for name in self._config.parameters}
        for name in chain.from_iterable(names.values()):
            self._say(mavlink.MAVLink_param_request_read_message(SYSTEM, COMPONENT, name.encode("ascii"), -1))
        if self._surveyed:
            self._say(mavlink.MAVLink_set_gps_global_origin_message(SYSTEM, *ORIGIN_DEG_E7, 0))
            # 4.5 sets no home by itself where it has no position, and takes none before it has its origin.
            self._wait(lambda: self._held_s >= self._boot_s, self._boot_s + 10.0)
            home = (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_CMD_DO_SET_HOME, *[0] * 6, *ORIGIN_DEG_E7, 0)
            self._say(mavlink.MAVLink_command_int_message(SYSTEM, COMPONENT, *home))
        self._wait(lambda: self._held_s >= self._boot_s + LOWERING_S + SETTLED_S, self._boot_s + 60.0)
        if unknown := [name for name, of in names.items() if self._heard_parameters.keys().isdisjoint(of)]:
            raise FirmwareError(f"the firmware does not know the parameter {', '.join(sorted(unknown))}")
        self._free = True

    def _wait(self, done: Callable[[], bool], until_s: float) -> None:
        while not done():
            self._exchange()
            if self._held_s > until_s:
                raise FirmwareError(f"no heartbeat of the firmware within {until_s:.0f} s of its time")

    # --- The ground station on the last link --------------------------------------------------------------

    def _hear(self, data: bytes) -> None:
        for message in self._console.parse_buffer(data) or ():
            kind = message.get_type()
            if message.get_srcSystem() != SYSTEM or message.get_srcComponent() != COMPONENT:
                continue
            if kind == "HEARTBEAT":
                self._armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
                self._mode = message.custom_mode
            elif kind == "PARAM_VALUE":
                self._heard_parameters[message.param_id] = message.param_value

    def _say(self, message: Any) -> None:
        self._outbox.setdefault(CONSOLE, []).append(bytes(message.pack(self._console)))
        self._console.seq = (self._console.seq + 1) % 256

    def _command(self, command: int, *values: float) -> None:
        padded = [*values, *[0.0] * 7][:7]
        self._say(mavlink.MAVLink_command_long_message(SYSTEM, COMPONENT, command, 0, *padded))

    def _set(self, name: str, value: float) -> None:
        message = mavlink.MAVLink_param_set_message(
            SYSTEM, COMPONENT, name.encode("ascii"), value, mavlink.MAV_PARAM_TYPE_REAL32
        )
        self._say(message)

    def _begin(self, fault: Fault) -> None:
        if fault.kind == "reboot":
            self._command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1, 0, 0, 0, 0, FORCE_REBOOT)
        elif fault.kind == "disarm":
            self._command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, FORCE_DISARM)
        elif fault.kind == "mode":
            self._command(mavlink.MAV_CMD_DO_SET_MODE, 1, fault.value)
        elif fault.kind == "parameter":
            self._set(fault.parameter, fault.value)
        elif fault.kind == "voltage":
            self._set("SIM_BATT_VOLTAGE", fault.value)
        elif fault.kind == "depth_shifted":
            self._set("SIM_BARO_GLITCH", -fault.value)


@contextmanager
def vehicle_of(
    config: SimConfig, seed: int, firmware: Path | None, *, surveyed: bool = True
) -> Iterator[Vehicle | Firmware]:
    """Give the vehicle of a dive: the real firmware in `firmware`, or our stand-in if that is None."""
    if firmware is None:
        yield Vehicle(config, seed)
        return
    with Firmware(firmware, config, seed, surveyed=surveyed) as vehicle:
        yield vehicle


def held(eta: Sequence[float], lowered_s: float) -> Sensed:
    """Return the motion of a body that is held at `eta` but at the surface, and lowered to it from time 0 on.

    The way down is the minimum-jerk polynomial 10 s³ − 15 s⁴ + 6 s⁵ over LOWERING_S, level.
    """
    x, y, depth_m, _, _, psi = eta
    s = min(max(lowered_s / LOWERING_S, 0.0), 1.0)
    z = depth_m * s**3 * (10.0 - 15.0 * s + 6.0 * s * s)
    sink = depth_m * 30.0 * s * s * (1.0 - s) ** 2 / LOWERING_S
    faster = depth_m * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / LOWERING_S**2
    return Sensed(state_of((x, y, z, 0.0, 0.0, psi), (0.0, 0.0, sink, 0.0, 0.0, 0.0)), (0.0, 0.0, faster))


def _refuse(fault: Fault) -> None:
    if not FAULT_KINDS[fault.kind].on_firmware:
        raise ValueError(f"fault '{fault.kind}' cannot be done to the real firmware")


def _socket() -> socket.socket:
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    opened.bind(("127.0.0.1", 0))
    opened.setblocking(False)
    return opened
