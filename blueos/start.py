"""What the BlueOS extension runs: controller, recorder and dashboard, each started again when it ends.

Settings, token, state and dives are in the extension's volume. What a full disk does not take is in memory
until the next start: the controller runs. One whose control loop hangs is killed: it feeds this program as it
feeds systemd's watchdog (sd_notify).
"""

import os
import secrets
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path

WATCHDOG_S = 2.0
START_S = 20.0
"""How long the controller may take to its first word."""
STOP_S = 5.0
PERIOD_S = 0.1
PORT = 8600
MEMORY = Path("/dev/shm/holdfast")


class Service:
    """A program that runs again some time after it ended."""

    def __init__(
        self, name: str, argv: list[str], again_s: float, env: Mapping[str, str] | None = None
    ) -> None:
        self.name = name
        self._argv, self._again_s, self._env = argv, again_s, env
        self._process: subprocess.Popen[bytes] | None = None
        self._start_s = 0.0

    def look(self, now_s: float) -> bool:
        """Start it if it is due; return whether it was started now."""
        if self._process is not None:
            status = self._process.poll()
            if status is None:
                return False
            _say(f"{self.name} ended with {status}; again in {self._again_s:g} s")
            self._process, self._start_s = None, now_s + self._again_s
        if now_s < self._start_s:
            return False
        self._process = subprocess.Popen(self._argv, env={**os.environ, **(self._env or {})})
        return True

    def send(self, number: signal.Signals) -> None:
        """Send it a signal, if it runs."""
        if self._process is not None:
            self._process.send_signal(number)

    def wait(self) -> None:
        """Wait for its end; kill it if that takes too long."""
        if self._process is not None:
            try:
                self._process.wait(STOP_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()


def main(data: Path) -> None:
    """Run until SIGTERM, which reaches each service: the controller sends neutral first."""
    configuration, token = kept(data / "companion.toml", init), kept(data / "dashboard.token", new_token)
    words = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    words.bind(f"\0holdfast-{os.getpid()}")
    words.setblocking(False)
    control = Service(
        "controller",
        ["holdfast", "run", "--config", str(configuration)],
        0.5,
        {"NOTIFY_SOCKET": f"@holdfast-{os.getpid()}", "STATE_DIRECTORY": str(data / "state")},
    )
    page = ["holdfast", "dashboard", "--listen", f"0.0.0.0:{PORT}", "--host", "blueos.local", "--host"]
    page += ["blueos-wifi.local", "--allow-control", "--token-file", str(token)]
    recorder = Service("recorder", ["holdfast", "record", "--out", str(data / "dives")], 2.0)
    services = (control, recorder, Service("dashboard", page, 2.0))
    stopping: list[int] = []
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda number, frame: stopping.append(number))
    patience_s = 0.0
    while not stopping:
        now_s = time.monotonic()
        for service in services:
            if service.look(now_s) and service is control:
                patience_s = now_s + START_S
        if _heard(words):
            patience_s = now_s + WATCHDOG_S
        if now_s > patience_s:
            _say("the controller hangs: killed")
            control.send(signal.SIGKILL)
            patience_s = now_s + START_S
        time.sleep(PERIOD_S)
    for service in services:
        service.send(signal.SIGTERM)
    for service in services:
        service.wait()


def kept(file: Path, make: Callable[[Path], object]) -> Path:
    """Return a file, made if it is not there: in memory where a full or broken disk takes none."""
    for place in (file, MEMORY / file.name):
        whole = place.with_name(f"first{place.suffix}")
        try:
            if not place.exists() or not place.stat().st_size:
                place.parent.mkdir(parents=True, exist_ok=True)
                whole.unlink(missing_ok=True)
                make(whole)
                whole.replace(place)
            return place
        except (OSError, subprocess.CalledProcessError) as error:
            _say(f"{place} cannot be written: {error}. Make room on the disk, and start the extension again")
    return file


def init(configuration: Path) -> None:
    """Write a first configuration."""
    where = ("--where", "extension", "--out", str(configuration))
    subprocess.run(["holdfast", "init", "--yes", *where], check=True)


def new_token(token: Path) -> None:
    """Write a token that nobody knows."""
    token.touch(mode=0o600)
    token.write_text(secrets.token_hex(16) + "\n", encoding="ascii")


def _heard(words: socket.socket) -> bool:
    """Empty the queue; return whether the control loop spoke."""
    heard = False
    while True:
        try:
            message = words.recv(4096)
        except BlockingIOError:
            return heard
        heard = heard or b"WATCHDOG=1" in message or b"READY=1" in message


def _say(what: str) -> None:
    sys.stderr.write(f"holdfast: {what}\n")


if __name__ == "__main__":
    main(Path(os.environ.get("HOLDFAST_DATA", "/data")))
