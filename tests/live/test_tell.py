"""Commands to `holdfast run` over Zenoh, diving in `holdfast sim`; and two companions of one name."""

import signal
import socket
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import msgspec
import pytest
from tools.processes import HOLDFAST, free_port, running
from waiting import until

from companion.config import load_config
from companion.telemetry import schemas as telemetry
from dashboard.terminal import move, tell
from dashboard.zenoh_client import Subscription

VEHICLE = load_config().vehicle.name
PATIENCE_S = 15.0


def companion(endpoint: str, *arguments: str, link: str = "") -> tuple[str, ...]:
    link = link or f"127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
    options = ("--set", f"link.endpoint=udp-listen:{link}", "--set", f"telemetry.endpoint={endpoint}")
    return (*HOLDFAST, "run", *options, *arguments)


@contextmanager
def diving(*arguments: str) -> Iterator[Subscription]:
    """Let sim and run dive, and be a client of theirs that has heard from them."""
    link, endpoint = f"127.0.0.1:{free_port(socket.SOCK_DGRAM)}", f"tcp/127.0.0.1:{free_port()}"
    simulator = ("sim", "--udp-connect", link, "--tcp", f"127.0.0.1:{free_port()}", "--no-zenoh")
    with ExitStack() as stack:
        stack.enter_context(running(*HOLDFAST, *simulator))
        stack.enter_context(running(*companion(endpoint, *arguments, link=link)))
        seen = stack.enter_context(Subscription(f"holdfast/{VEHICLE}/**", endpoint))
        until(lambda: _ready(seen))
        yield seen


def test_every_command_is_answered_and_told_as_an_event(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    with diving("--arm") as seen:
        assert seen.ask("holdfast/*/command/engage", b"{}", timeout_s=1.0) is None, (
            "a wildcard engages no fleet"
        )
        assert seen.ask("**", timeout_s=1.0) is not None, "the configuration may be asked for so"
        assert _states(seen) == {"IDLE"}
        assert seen.tell(VEHICLE, "engage", {}).value["state"] == "ACTIVE"
        assert seen.tell(VEHICLE, "goto", {"depth_m": 1.5, "at_once": True}).value["depth_m"] == 1.5
        gains = {"axis": "heave", "kappa_per_s": 9.0}
        assert seen.tell(VEHICLE, "gains", gains).value["kappa_per_s"] == 9.0
        in_force = msgspec.json.decode(seen.ask(telemetry.key(VEHICLE, "config")) or b"null")
        assert in_force["heave"]["kappa_per_s"] == 9.0

        command = ["--connect", seen.endpoint, VEHICLE]
        assert tell.main([*command, "goto", "depth_m=500"]) == 1
        assert "max_depth_m" in capsys.readouterr().out
        assert move.goto([*command, "--depth", "1.2", "--speed", "0.1"]) == 0
        assert "done: on its way" in capsys.readouterr().out
        path = tmp_path / "ring.toml"
        path.write_text("relative = true\n[circle]\nradius_m = 1.0\n", encoding="utf-8")
        assert move.follow([*command, str(path)]) == 0
        assert "ring, 6.3 m a lap" in capsys.readouterr().out
        assert move.follow([*command, "--pause"]) == 0
        assert "done: " in capsys.readouterr().out
        until(lambda: any(key.endswith("/plan") for key, _ in seen.take()))
        assert tell.main([*command, "release"]) == 0
        assert "done: released" in capsys.readouterr().out
        assert tell.main([*command, "config"]) == 0
        assert '"kappa_per_s": 9.0' in capsys.readouterr().out

        with Subscription(f"holdfast/{VEHICLE}/event", seen.endpoint) as later:
            reported: list[str] = []

            def reported_of_release() -> bool:
                reported.extend(_texts(later))
                return "released" in " ".join(reported)

            until(reported_of_release)
        assert any(text.startswith("set gains of heave: kappa 9 per s: ") for text in reported), (
            "a late subscriber gets what was before"
        )
        assert any("ACTIVE: engaged" in text for text in reported)


def test_a_second_companion_of_one_name_refuses_to_start_until_the_first_is_gone() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with running(*companion(endpoint)) as first, Subscription("holdfast/**", endpoint) as seen:
        until(lambda: bool(seen.take()))
        said = refused(companion(endpoint))
        assert f"another companion is '{VEHICLE}' already" in said
        assert seen.take(), "the first goes on"
        with running(*companion(endpoint, "--set", "vehicle.name=another")):
            until(lambda: any(message.key.startswith("holdfast/another/") for message in seen.take()))

        first.send_signal(signal.SIGSTOP)
        assert "does not answer" in refused(companion(endpoint))
        first.kill()
        first.wait()
        with running(*companion(endpoint)):
            seen.take()
            until(lambda: bool(seen.take()))


def refused(command: tuple[str, ...]) -> str:
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert done.returncode == 1
    assert "refused to start" in done.stderr
    return done.stderr


def _ready(seen: Subscription) -> str:
    """Return the newest state once only arming is missing."""
    records = [
        telemetry.decode(message.key, message.payload)
        for message in seen.take()
        if message.key.endswith("/supervisor")
    ]
    newest = records[-1] if records else None
    ready = isinstance(newest, telemetry.Supervisor) and set(newest.conditions) <= {"DISARMED"}
    return newest.state if ready and isinstance(newest, telemetry.Supervisor) else ""


def _states(seen: Subscription) -> set[str]:
    """Return the states since the last call; wait for one, for a query may end before the next sample."""
    states: set[str] = set()

    def heard() -> bool:
        records = (telemetry.decode(m.key, m.payload) for m in seen.take() if m.key.endswith("/supervisor"))
        states.update(record.state for record in records if isinstance(record, telemetry.Supervisor))
        return bool(states)

    until(heard)
    return states


def _texts(seen: Subscription) -> list[str]:
    events = (telemetry.decode(message.key, message.payload) for message in seen.take())
    return [event.text for event in events if isinstance(event, telemetry.Event)]
