"""The terminal view: a pure picture of what came, and honest about what did not."""

import math
from collections.abc import Callable
from io import StringIO
from unittest.mock import MagicMock

import msgspec
import pytest
from msgspec.structs import replace
from rich.console import Console

from companion.records import Ages, Condition, ControlSample, State
from companion.telemetry import samples
from companion.telemetry import schemas as telemetry
from companion.telemetry.glossary import STATES
from dashboard.heard_vehicles import Fleet, Vehicle
from dashboard.terminal import watch
from dashboard.terminal.watch import Look, picture
from dashboard.zenoh_client import Message

MakeSample = Callable[..., ControlSample]


def test_a_sample_is_on_the_screen_and_nothing_is_cut_off(make_sample: MakeSample) -> None:
    screen = _screen(_fleet(make_sample()))
    lines = screen.splitlines()
    assert len(lines) <= 24
    assert max(map(len, lines)) == 80
    for words in (
        "learnt",
        "SATURATED",
        "holdfast kelp",
        "ACTIVE",
        "authority 75%",
        "no fresh position",
        "ARMED in MANUAL",
        "battery 15.8 V",
        "live",
    ):
        assert words in " ".join(screen.replace("│", " ").split())
    assert "…" not in screen, "something was cut off"
    for name, doing in (("heading", "not held"), ("north", "SATURATED"), ("east", "learning")):
        assert doing in _rows(screen, name)[0]


def test_what_is_stale_is_reported_with_its_age(make_sample: MakeSample) -> None:
    sample = make_sample(stale=(True, True, True, False), ages=Ages(4.0, 4.0, 3.0, 0.02, math.inf))
    sample = replace(sample, verdict=replace(sample.verdict, conditions=Condition.LINK_LOST))
    screen = _screen(_fleet(sample))
    (depth,) = _rows(screen, "depth")
    assert "STALE 3 s" in depth
    assert f"{sample.dofs.x[2]:.3f} m" in depth
    assert "never came" in _rows(screen, "north")[0]
    assert "armed or not: unknown in mode unknown" in screen
    assert max(map(len, screen.splitlines())) <= 80


def test_a_condition_that_the_reason_names_is_not_repeated(make_sample: MakeSample) -> None:
    sample = make_sample()
    waits = replace(
        sample.verdict,
        state=State.IDLE,
        reason="waiting for: arming",
        conditions=Condition.DISARMED | Condition.YAW_RESET | Condition.ENGAGE_ASKED,
    )
    assert "waiting for: arming; the EKF reset its yaw " in _screen(_fleet(replace(sample, verdict=waits)))


def test_the_remedy_is_shown_and_a_lost_link_outranks_the_state(make_sample: MakeSample) -> None:
    sample = make_sample()
    lost = replace(
        sample.verdict, state=State.PILOT, conditions=Condition.LINK_LOST, remedy="look at cable and router"
    )
    screen = _screen(_fleet(replace(sample, verdict=lost)))
    assert "to do: look at cable and router" in screen
    assert screen.splitlines()[1].split()[1:3] == ["LINK", "LOST"]
    assert STATES["PILOT"].text not in screen


def test_a_companion_that_died_while_active_leaves_no_armed_vehicle_on_the_screen(
    make_sample: MakeSample,
) -> None:
    fleet = _fleet(make_sample(t_s=100.0, armed=True), now_s=7.0)
    assert "STALE" not in _screen(fleet, 7.2)
    assert "STALE: nothing new for 1.0 s" in _screen(fleet, 8.0)
    assert "not connected" in _screen(fleet, 8.0, connected=False)
    shown = " ".join(_screen(fleet, 20.0).split())
    for words in ("It was ACTIVE and armed.", "the autopilot disarms 3 s", "was ARMED"):
        assert words in shown
    assert "Start `holdfast run`" not in shown


def test_one_vehicle_is_shown_wholly_and_several_as_a_line_each(make_sample: MakeSample) -> None:
    fleet = _fleet(make_sample())
    assert "holdfast kelp" in _screen(fleet)
    fleet.take(_messages(make_sample(t_s=99.0, voltage_v=math.nan), "wrack"), now_s=1.5)
    fleet.take([Message("holdfast/wrack/event", _event("the tether tugs"))], now_s=1.5)
    screen = _screen(fleet, 1.6)
    assert "holdfast 2 vehicles" in screen
    assert max(map(len, screen.splitlines())) <= 80
    (kelp,) = [line for line in screen.splitlines() if " kelp " in line]
    (wrack,) = [line for line in screen.splitlines() if " wrack " in line]
    assert "89 s ago  wrack: fault: the tether tugs" in screen
    assert "…" not in screen
    assert "STALE 1 s" in kelp
    for words in ("ACTIVE", "5.000 m", "28.6°", "ARMED", "–", "live"):
        assert words in wrack


def test_the_last_events_are_shown_with_their_age_and_all_fits(make_sample: MakeSample) -> None:
    fleet = _fleet(make_sample(t_s=15.0))
    for text in ("first", "second", "FAULT: " + 90 * "x"):
        fleet.take([Message("holdfast/kelp/event", _event(text))], now_s=1.0)
    screen = _screen(fleet)
    lines = screen.splitlines()
    assert len(lines) <= 24
    assert max(map(len, lines)) <= 80
    assert "first" not in screen
    assert "   5 s ago  fault: second" in screen


def test_a_strange_message_is_reported_and_what_it_does_not_show_is_no_trouble(
    make_sample: MakeSample,
) -> None:
    """`--once` asks for every key of the vehicle, and gets what the companion answers under its own ones."""
    fleet = _fleet(make_sample())
    for tail in ("raw", "config", "choices", "check"):
        fleet.take([Message(f"holdfast/kelp/{tail}", b"{}")], now_s=1.0)
    assert fleet.trouble == ""
    fleet.take([Message("holdfast/kelp/state", b"{}")], now_s=1.0)
    assert "holdfast.State.v1" in _screen(fleet)


def test_a_message_that_leads_to_an_error_costs_no_other(make_sample: MakeSample) -> None:
    """One that nobody had foreseen stopped the page for ever."""

    def made(name: str) -> Vehicle:
        return {"kelp": Vehicle}[name](name)

    fleet, sample = Fleet(made), make_sample()
    for name in ("wrack", "kelp"):
        messages = [Message(key, payload) for key, _, payload in samples.encode(sample, name)]
        fleet.take(messages, now_s=1.0)
    assert list(fleet.vehicles) == ["kelp"]
    assert "wrack" in fleet.trouble


def test_nothing_that_is_published_reaches_the_terminal_as_a_control_character(
    make_sample: MakeSample,
) -> None:
    """Anybody may publish under our keys. A word in brackets is no style either."""
    evil = "[/x]\x1b[2J\n\x9b1m\u202e"
    sample = make_sample()
    sample = replace(sample, verdict=replace(sample.verdict, reason=evil))
    fleet = Fleet(Vehicle)
    for name in (f"kelp{evil[4:]}", f"wrack{evil[4:]}"):  # without the slash
        fleet.take(_messages(sample, name), now_s=1.0)
        fleet.take(
            [Message(f"holdfast/{name}/{tail}", _event(evil)) for tail in ("event", "state")], now_s=1.0
        )
        screen = _screen(fleet)
        assert all(line.isprintable() for line in screen.split("\n"))
        assert "\\x1b[2J" in screen


def test_once_without_a_companion_is_a_failure_and_says_where_to_look(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(watch, "PATIENCE_S", 0.1)
    assert watch.main(["--once", "--connect", "tcp/127.0.0.1:1", "--json"]) == 1
    said = capsys.readouterr()
    assert "Nobody listens on tcp/127.0.0.1:1" in said.err
    assert said.out == ""


def test_once_sees_a_replay_which_keeps_no_last_sample(
    make_sample: MakeSample, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    seen = MagicMock(connected=True)
    seen.__enter__.return_value = seen
    seen.last.return_value, seen.take.side_effect = [], lambda: _messages(make_sample())
    monkeypatch.setattr(watch, "Subscription", lambda *_: seen)
    assert watch.main(["--once"]) == 0
    assert "kelp" in capsys.readouterr().out
    assert watch.main(["--once", "--json"]) == 0
    figures = msgspec.json.decode(capsys.readouterr().out)
    assert (figures["vehicle"], figures["state"]["depth_m"]) == ("kelp", 5.0)
    assert figures["dof/z"]["unit"] == "m"


def _messages(sample: ControlSample, vehicle: str = "kelp") -> list[Message]:
    return [Message(key, payload) for key, _, payload in samples.encode(sample, vehicle)]


def _fleet(sample: ControlSample, now_s: float = 1.0) -> Fleet[Vehicle]:
    fleet = Fleet(Vehicle)
    fleet.take(_messages(sample), now_s=now_s)
    assert fleet.complete
    return fleet


def _event(text: str) -> bytes:
    return telemetry.to_json(telemetry.Event(t_s=10.0, boot_s=1.0, severity="fault", kind="state", text=text))


def _screen(fleet: Fleet[Vehicle], now_s: float = 1.0, *, connected: bool = True) -> str:
    console = Console(width=80, file=StringIO())
    with console.capture() as captured:
        console.print(picture(Look(fleet, now_s, connected), "nobody"))
    return captured.get()


def _rows(screen: str, name: str) -> list[str]:
    return [line for line in screen.splitlines() if line.startswith(f"│ {name} ")]
