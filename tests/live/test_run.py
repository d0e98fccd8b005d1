"""`holdfast run` as a process, over real UDP and TCP: every way out leaves the vehicle neutral."""

import asyncio
import hashlib
import os
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import count, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from tools.processes import HOLDFAST, free_port, running

from companion.app import App
from companion.config import load_config
from companion.engine import Engine
from companion.io.links import MOST_READ, MavlinkLink
from companion.io.process import Ticker
from companion.mavlink.inbox import MAX_LOOKS
from companion.mavlink.signing import EPOCH_S, UNITS_PER_S
from companion.records import Request, Setpoint
from companion.telemetry.operator_commands import SetPath

NEUTRAL = (1500, 1500, 1500, 1500)
PARSER = mavlink.MAVLink(None, 1, 1)
HEARTBEAT = mavlink.MAVLink_heartbeat_message(
    mavlink.MAV_TYPE_SUBMARINE, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, 0, 19, mavlink.MAV_STATE_STANDBY, 3
)
REST_S = 0.3


class PanicError(BaseException):
    """As Zenoh's PanicException, which is no Exception."""


class Tap(threading.Thread):
    """Sits on the wire between `holdfast sim` and `holdfast run` and remembers what passed."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.to_sim = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.to_run = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.to_sim.bind(("127.0.0.1", 0))
        self.run_port = free_port(socket.SOCK_DGRAM)
        self.steering: list[tuple[int, int, int, int]] = []
        self.armed = False
        self.motors: list[tuple[float, bool]] = []
        """When (monotonic seconds) the vehicle said of its motors whether they all rest."""
        self._parser = mavlink.MAVLink(None, 1, 1)
        self._parser.robust_parsing = True
        self._done = threading.Event()

    @property
    def sim_port(self) -> int:
        return int(self.to_sim.getsockname()[1])

    def run(self) -> None:
        self.to_sim.settimeout(0.02)
        self.to_run.settimeout(0.0)
        sim = None
        while not self._done.is_set():
            try:
                data, sim = self.to_sim.recvfrom(4096)
                self._note(data)
                self.to_run.sendto(data, ("127.0.0.1", self.run_port))
            except (TimeoutError, ConnectionError):
                pass
            try:
                while sim:
                    data = self.to_run.recv(4096)
                    self._note(data)
                    self.to_sim.sendto(data, sim)
            except (BlockingIOError, ConnectionError):
                pass

    def close(self) -> None:
        self._done.set()
        self.join()
        self.to_sim.close()
        self.to_run.close()

    def until(self, what: str, timeout_s: float = 20.0) -> None:
        """Wait for `pushing`: a command that is not neutral; `armed` or `disarmed`."""
        until_s = time.monotonic() + timeout_s
        while time.monotonic() < until_s:
            if {
                "pushing": bool(self.steering) and self.steering[-1] != NEUTRAL,
                "armed": self.armed,
                "disarmed": not self.armed,
            }[what]:
                return
            time.sleep(0.02)
        raise AssertionError(f"never {what}")

    def _note(self, data: bytes) -> None:
        for message in self._parser.parse_buffer(data) or ():
            if message.get_type() == "RC_CHANNELS_OVERRIDE":
                channels = (message.chan3_raw, message.chan4_raw, message.chan5_raw, message.chan6_raw)
                self.steering.append(channels)
            elif message.get_type() == "SERVO_OUTPUT_RAW" and message.port == 0:
                pwm_us = {getattr(message, f"servo{motor}_raw") for motor in range(1, 9)}
                self.motors.append((time.monotonic(), pwm_us == {1500}))
            elif message.get_type() == "HEARTBEAT" and message.get_srcComponent() == 1:
                self.armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)


@contextmanager
def diving(errors: int = subprocess.DEVNULL) -> Iterator[tuple[Tap, "subprocess.Popen[str]"]]:
    tap = Tap()
    tap.start()
    here = ("--udp-connect", f"127.0.0.1:{tap.sim_port}", "--no-zenoh")
    simulator = ("sim", *here, "--set", "waves.enabled=true")
    companion = (
        *("run", "--engage", "--arm", "--depth", "3"),
        *("--set", f"link.endpoint=udp-listen:127.0.0.1:{tap.run_port}"),
        *("--set", f"telemetry.endpoint=tcp/127.0.0.1:{free_port()}"),
    )
    try:
        with running(*HOLDFAST, *simulator), running(*HOLDFAST, *companion, errors=errors) as run:
            tap.until("pushing")
            time.sleep(0.3)
            yield tap, run
    finally:
        tap.close()


def leaves_it_neutral(tap: Tap, run: "subprocess.Popen[str]", number: signal.Signals) -> None:
    """End the companion by a signal: 0.3 s later the motors rest, and never turn again.

    Later by as much as the simulator itself was late in saying so, where the machine is busy; the failsafe of
    the autopilot would need 3 s.
    """
    sent_s = time.monotonic()
    run.send_signal(number)
    assert run.wait(3.0) == 0
    time.sleep(0.5)
    assert tap.steering[-5:] == [NEUTRAL] * 5
    after: list[bool] = []
    while not after and time.monotonic() < sent_s + 2.5:
        time.sleep(0.1)
        times_s = [at_s for at_s, _ in tap.motors if at_s > sent_s - 1.0]
        late_s = max((b - a for a, b in pairwise(times_s)), default=0.0)
        after = [rest for at_s, rest in tap.motors if at_s > sent_s + REST_S + late_s]
    assert after
    assert all(after)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGQUIT, signal.SIGUSR1])
def test_a_signal_leaves_the_vehicle_neutral(number: signal.Signals) -> None:
    """So do SIGTERM and SIGHUP, by which the dives below end."""
    with diving() as (tap, run):
        leaves_it_neutral(tap, run, number)


def test_ctrl_z_does_not_leave_the_thrusters_running() -> None:
    with diving() as (tap, run):
        run.send_signal(signal.SIGTSTP)
        before = len(tap.steering)
        time.sleep(0.5)
        assert len(tap.steering) > before
        leaves_it_neutral(tap, run, signal.SIGTERM)


def test_a_closed_terminal_leaves_the_vehicle_neutral() -> None:
    """The terminal's end: nobody reads the log any more, and SIGHUP comes."""
    with diving(subprocess.PIPE) as (tap, run):
        assert run.stderr is not None
        run.stderr.close()
        time.sleep(5.5)  # it says every five seconds how it goes
        assert run.poll() is None
        leaves_it_neutral(tap, run, signal.SIGHUP)


def test_stopped_for_long_the_firmware_disarms_and_it_does_not_arm_again() -> None:
    with diving() as (tap, run):
        run.send_signal(signal.SIGSTOP)
        try:
            tap.until("disarmed", timeout_s=8.0)
        finally:
            run.send_signal(signal.SIGCONT)
        time.sleep(3.0)
        assert not tap.armed
        assert tap.steering[-1] == NEUTRAL


class SignedVehicle:
    """Says signed heartbeats, and listens to what is answered: one heartbeat, or all that a link asks for."""

    def __init__(self, port: int) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect(("127.0.0.1", port))
        self.socket.setblocking(False)
        self._mav = mavlink.MAVLink(None, 1, 1)
        self._mav.signing.secret_key = hashlib.sha256(b"kelp").digest()
        self._mav.signing.sign_outgoing = True

    def beat(self) -> bytes:
        self._mav.signing.timestamp = round((time.time() - EPOCH_S) * UNITS_PER_S)
        return bytes(mavlink.MAVLink_heartbeat_message(12, 3, 0, 0, 4, 3).pack(self._mav))

    def is_asked(self, frame: bytes) -> bool | None:
        """Say it; tell whether anything but heartbeats came, None if nothing at all."""
        with suppress(ConnectionError):
            self.socket.send(frame)
        time.sleep(0.1)
        ids = set()
        with suppress(BlockingIOError, ConnectionError):
            while True:
                ids.add(self.socket.recv(4096)[7])
        return bool(ids - {mavlink.MAVLINK_MSG_ID_HEARTBEAT}) if ids else None


def test_signed_frames_of_before_a_crash_do_not_take_the_link_after_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path))
    key = tmp_path / "mavlink.key"
    key.write_text("kelp")
    key.chmod(0o600)
    port = free_port(socket.SOCK_DGRAM)
    command = (
        *(*HOLDFAST, "run", "--set", f"link.signing_key_file={key}"),
        *("--set", f"link.endpoint=udp-listen:127.0.0.1:{port}"),
        *("--set", f"telemetry.endpoint=tcp/127.0.0.1:{free_port()}"),
    )
    vehicle, patience = SignedVehicle(port), range(200)
    with running(*command) as run:
        assert any(vehicle.is_asked(vehicle.beat()) for _ in patience)
        heard = []
        for _ in range(15):  # it writes once a second
            heard.append(vehicle.beat())
            vehicle.is_asked(heard[-1])
        run.kill()
        run.wait()
    with running(*command):
        assert next(asked for _ in patience if (asked := vehicle.is_asked(heard[0])) is not None) is False
        assert not any(vehicle.is_asked(frame) for frame in heard)
        assert any(vehicle.is_asked(vehicle.beat()) for _ in patience)
    vehicle.socket.close()


def ran(link: str, *requests: Request) -> int:
    """Run the companion's process in this one; return its exit status."""
    zenoh = f"tcp/127.0.0.1:{free_port()}"
    config = load_config(overrides=[f"link.endpoint={link}", f"telemetry.endpoint={zenoh}"])

    async def run() -> int:
        app = App(config, Setpoint((np.nan,) * 4), arm=False, requests=list(requests))
        return await asyncio.wait_for(app.run(), timeout=10.0)

    status = asyncio.run(run())
    for thread in threading.enumerate():
        if thread.name == "zenoh":  # it has half a second in the process, and may be in Zenoh's own code
            thread.join(5.0)
    return status


@pytest.fixture
def vehicle() -> Iterator[socket.socket]:
    """A socket that the companion calls."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        vehicle.bind(("127.0.0.1", 0))
        yield vehicle


def link_to(vehicle: socket.socket) -> str:
    return f"udp-connect:127.0.0.1:{vehicle.getsockname()[1]}"


def heard_by(vehicle: socket.socket) -> list[bytes]:
    """Return all datagrams that have come."""
    heard = []
    vehicle.settimeout(0.1)
    with suppress(TimeoutError):
        while True:
            heard.append(vehicle.recv(4096))
    return heard


def messages_of(heard: list[bytes]) -> list[Any]:
    parser = mavlink.MAVLink(None, 1, 1)
    return [message for data in heard for message in parser.parse_buffer(data) or ()]


@pytest.mark.parametrize("steering", [True, False])
def test_an_exception_in_the_tick_sends_neutral_if_it_steered_and_fails(
    monkeypatch: pytest.MonkeyPatch, vehicle: socket.socket, steering: bool
) -> None:
    """Whatever breaks inside the engine: neutral frames go out and the exit status says so."""
    step, ticks = Engine.step, count(1)

    def breaks(self: Engine, *arguments: Any, **more: Any) -> object:
        if next(ticks) > 20:
            assert self.last is not None
            guarded = replace(self.last.guarded, steers=steering)
            self.last = self.last._replace(guarded=guarded)
            raise ZeroDivisionError("planted")
        return step(self, *arguments, **more)

    monkeypatch.setattr(Engine, "step", breaks)
    assert ran(link_to(vehicle), Request.ENGAGE) == 1
    messages = messages_of(heard_by(vehicle))
    overrides = [m.chan3_raw for m in messages if m.get_type() == "RC_CHANNELS_OVERRIDE"]
    assert overrides == ([1500] * 5 if steering else [])


def test_one_tick_that_fails_by_what_a_command_asked_for_drops_all_but_a_release_and_ends_nothing(
    monkeypatch: pytest.MonkeyPatch, vehicle: socket.socket, caplog: pytest.LogCaptureFixture
) -> None:
    step, orders, retuned, asked = Engine.step, list[object](), list[object](), list[list[Request]]()

    def fails_while_asked(self: Engine, now_s: float, datagrams: Any, loop: Any, *more: Any) -> object:
        asked.append(list(more[0]))
        if loop.tick == 30:
            os.kill(os.getpid(), signal.SIGTERM)
        if not orders:
            raise ZeroDivisionError("planted")
        return step(self, now_s, datagrams, loop, *more)

    monkeypatch.setattr(Engine, "step", fails_while_asked)
    monkeypatch.setattr(Engine, "guide", lambda self, order: orders.append(order))
    monkeypatch.setattr(Engine, "retune", lambda self, config: retuned.append(config))
    assert ran(link_to(vehicle), Request.ENGAGE, Request.STOP) == 0
    assert asked[:3] == [[Request.ENGAGE, Request.STOP], [Request.STOP], []]
    assert (orders, len(retuned)) == ([SetPath(action="hold")], 1)
    assert "a tick failed" in caplog.text


@pytest.mark.parametrize(
    ("what", "named"),
    [
        ("companion.app.EventLog.step", "events"),
        ("companion.app.Publisher.offer", "telemetry"),
        ("companion.io.zenoh_publisher.encode", "telemetry"),
        ("companion.io.zenoh_publisher._publisher", "telemetry"),
        ("companion.app.status_line", "the status line"),
        ("companion.engine.PilotDisplay.step", "the pilot's display"),
        ("companion.guidance.drawing.Plan", "the map"),
    ],
)
def test_a_fault_beside_the_tick_is_told_and_counted_and_ends_nothing(
    monkeypatch: pytest.MonkeyPatch,
    vehicle: socket.socket,
    caplog: pytest.LogCaptureFixture,
    what: str,
    named: str,
) -> None:
    """A number that became infinite in the status line ended the process, and the next one."""

    def breaks(*arguments: object, **more: object) -> object:
        raise PanicError("planted")

    step, counted = Engine.step, [0]

    def stops_after_a_while(self: Engine, now_s: float, datagrams: Any, loop: Any, *more: Any) -> object:
        counted.append(loop.errors)
        if loop.tick == 60:
            os.kill(os.getpid(), signal.SIGTERM)
        return step(self, now_s, datagrams, loop, *more)

    monkeypatch.setattr(Engine, "step", stops_after_a_while)
    monkeypatch.setattr(what, breaks)
    assert ran(link_to(vehicle)) == 0
    assert counted[-1] > 0
    assert caplog.text.count(f"{named} failed") == 1


def test_a_timer_that_never_fires_ends_the_process(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """On a 32-bit system the timer took its start for a time in years; the process never ticked."""
    monkeypatch.setattr("companion.app.Ticker", lambda period_ns: Ticker(1_000_000 * period_ns))
    assert ran(f"udp-connect:127.0.0.1:{free_port(socket.SOCK_DGRAM)}") == 1
    assert "has not fired" in caplog.text


@pytest.mark.parametrize("fails", [False, True])
def test_a_late_tick_reads_first_what_waits_in_the_socket(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, fails: bool
) -> None:
    """What arrived while the process did not run is judged with the rest; a look that fails ends no tick."""
    read = MavlinkLink.read

    def looks(self: MavlinkLink, most: int = MOST_READ) -> None:
        if fails and most == MAX_LOOKS:
            raise PanicError("planted")
        read(self, most)

    monkeypatch.setattr(MavlinkLink, "read", looks)
    port = free_port(socket.SOCK_DGRAM)
    step, taken = Engine.step, []

    def stalls(self: Engine, now_s: float, datagrams: Any, *more: Any) -> object:
        taken.append(len(datagrams))
        if len(taken) == 20:
            for _ in range(40):
                calling.send(HEARTBEAT.pack(PARSER))
            time.sleep(0.1)
        if len(taken) == 30:
            os.kill(os.getpid(), signal.SIGTERM)
        return step(self, now_s, datagrams, *more)

    monkeypatch.setattr(Engine, "step", stalls)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as calling:
        calling.connect(("127.0.0.1", port))
        assert ran(f"udp-listen:127.0.0.1:{port}") == 0
    assert taken[20] == (0 if fails else 40)
    assert ("a look at a link failed" in caplog.text) is fails


def test_who_only_watched_leaves_without_a_word(vehicle: socket.socket) -> None:
    """A vehicle that somebody armed and nobody steers: neutral frames would get it disarmed 3 s later."""
    beat = mavlink.MAVLink_heartbeat_message(12, 3, 209, 19, 5, 3).pack(PARSER)
    zenoh = f"telemetry.endpoint=tcp/127.0.0.1:{free_port()}"
    command = (*HOLDFAST, "run", "--set", f"link.endpoint={link_to(vehicle)}", "--set", zenoh)
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as run:
        try:
            vehicle.settimeout(10.0)
            _, address = vehicle.recvfrom(4096)
            vehicle.sendto(beat, address)
            time.sleep(1.0)
        finally:
            run.send_signal(signal.SIGTERM)
        _, said = run.communicate(timeout=5.0)
    assert run.returncode == 0
    heard = {message.get_type() for message in messages_of(heard_by(vehicle))}
    assert heard, "it asked for its streams"
    assert not {"RC_CHANNELS_OVERRIDE", "MANUAL_CONTROL"} & heard
    assert "stopped" in said
    assert "neutral" not in said
