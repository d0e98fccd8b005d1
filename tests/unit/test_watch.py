"""The terminal view: a pure picture of what came, and honest about what did not."""

import math
import re
from collections.abc import Callable
from io import StringIO
from pathlib import Path

import msgspec
import pytest
from builders import plan
from msgspec.structs import replace
from rich.console import Console, RenderableType

from companion.records import Ages, Condition, ControlSample, State, Wrench, vector
from companion.telemetry import samples
from companion.telemetry import schemas as telemetry
from companion.telemetry.glossary import STATES, holder
from dashboard.terminal import watch
from dashboard.terminal.small_map import Point, chart, nice_length
from dashboard.terminal.watch import Feed, Feeds, View, picture, render
from dashboard.zenoh_client import Message

MakeSample = Callable[..., ControlSample]


@pytest.mark.parametrize("columns", [80, 70, 66])
def test_a_sample_is_on_the_screen_and_nothing_is_cut_off(make_sample: MakeSample, columns: int) -> None:
    screen = _screen(_view(make_sample()), columns)
    lines = screen.splitlines()
    assert len(lines) <= 24 + (columns < 80) * 4
    assert max(map(len, lines)) == columns
    for words in (
        "learnt",
        "given",
        "SATURATED",
        "holdfast kelp",
        "ACTIVE",
        "authority 75%",
        "no fresh position",
        "ARMED in MANUAL",
        "battery 15.8 V",
        "telemetry 50 ms measured",
        "command 60 ms assumed",
        "position never",
        "50.0 Hz",
        "live",
    ):
        assert words in " ".join(screen.replace("│", " ").split())
    assert "…" not in screen, "something was cut off"


def test_the_rate_is_that_of_the_last_seconds(make_sample: MakeSample) -> None:
    feed = Feed("kelp", "")
    for second in range(3):
        sample = make_sample(t_s=12.0 + second)
        sample = replace(sample, loop=replace(sample.loop, tick=100 + 20 * second, rate_hz=50.0))
        tick = [Message(key, payload) for key, _, payload in samples.encode(sample, "kelp")]
        feed.take(tick, second)
    screen = _screen(feed.view(2.0, connected=True))
    assert "20.0 Hz" in screen
    assert f"{sum(len(payload) for _, payload in tick) / 1000:.0f} kB/s" in screen


def test_each_degree_of_freedom_says_what_it_does(make_sample: MakeSample) -> None:
    screen = _screen(_view(make_sample()))
    (heading,) = _rows(screen, "heading")
    assert "not held" in heading
    (north,) = _rows(screen, "north")
    assert "SATURATED" in north
    (east,) = _rows(screen, "east")
    assert "learning" in east


def test_what_is_stale_is_reported_with_its_age(make_sample: MakeSample) -> None:
    sample = make_sample(stale=(True, True, True, False), ages=Ages(4.0, 4.0, 3.0, 0.02, math.inf))
    sample = replace(sample, verdict=replace(sample.verdict, conditions=Condition.LINK_LOST))
    screen = _screen(_view(sample))
    (depth,) = _rows(screen, "depth")
    assert "STALE 3 s" in depth
    assert f"{sample.dofs.x[2]:.3f} m" in depth
    assert "never came" in _rows(screen, "north")[0]
    assert "armed or not: unknown in mode unknown" in screen
    assert max(map(len, screen.splitlines())) <= 80


def test_thrust_that_was_not_delivered_is_marked(make_sample: MakeSample) -> None:
    screen = _screen(_view(make_sample()))
    (heave,) = _rows(screen, "heave")
    assert "+40.0 N" in heave
    assert "+30.0 N" in heave
    assert "SATURATED" in heave
    (surge,) = _rows(screen, "surge")
    assert "SATURATED" not in surge


def test_what_a_frame_rounds_away_is_no_saturation(make_sample: MakeSample) -> None:
    forces = {"requested": Wrench((0.0, 0.0, 5.4, 0.05)), "delivered": Wrench((0.0, 0.0, 5.2, 0.0))}
    screen = _screen(_view(replace(make_sample(), **forces)))
    assert "+5.2 N" in _rows(screen, "heave")[0]
    assert not [row for axis in ("heave", "yaw") for row in _rows(screen, axis) if "SATURATED" in row]


def test_a_flood_is_shown_where_there_was_one(make_sample: MakeSample) -> None:
    sample = make_sample()
    assert "flood" not in _screen(_view(sample))
    sample = replace(sample, loop=replace(sample.loop, left_out_bytes=4711))
    assert "4711 bytes of" in _screen(_view(sample))


def test_what_never_came_is_no_zero(make_sample: MakeSample) -> None:
    sample = make_sample(voltage_v=math.nan)
    nowhere = (math.nan, math.nan, 5.0, 0.5)
    sample = replace(sample, dofs=replace(sample.dofs, x=nowhere))
    screen = _screen(_view(sample))
    assert "battery –" in screen
    assert "0.000 m" not in _rows(screen, "north")[0]


@pytest.mark.parametrize("state", list(State))
def test_every_state_has_its_word(make_sample: MakeSample, state: State) -> None:
    sample = make_sample()
    sample = replace(sample, verdict=replace(sample.verdict, state=state, conditions=Condition(0), reason=""))
    screen = _screen(_view(sample))
    assert state.value.replace("_", " ") in screen
    said = sample.state
    who = holder(state, guidance=sample.guided.kind, armed=said.armed, mode=said.mode)
    assert f"  {who}, authority" in screen


def test_a_condition_that_the_reason_names_is_not_repeated(make_sample: MakeSample) -> None:
    sample = make_sample()
    waits = replace(
        sample.verdict,
        state=State.IDLE,
        reason="waiting for: arming",
        conditions=Condition.DISARMED | Condition.YAW_RESET | Condition.ENGAGE_ASKED,
    )
    assert "waiting for: arming; the EKF reset its yaw " in _screen(_view(replace(sample, verdict=waits)))


def test_the_remedy_is_shown_and_a_lost_link_outranks_the_state(make_sample: MakeSample) -> None:
    sample = make_sample()
    lost = replace(
        sample.verdict, state=State.PILOT, conditions=Condition.LINK_LOST, remedy="look at cable and router"
    )
    screen = _screen(_view(replace(sample, verdict=lost)))
    assert "to do: look at cable and router" in screen
    assert screen.splitlines()[1].split()[1:3] == ["LINK", "LOST"]
    assert STATES["PILOT"].text not in screen


def test_a_map_stands_below_where_the_position_is_known(make_sample: MakeSample) -> None:
    feed = Feed("kelp", "here")
    for tick in range(20):
        eta = vector([-2.0 + 0.2 * tick, 1.0, 5.0, 0.0])
        sample = make_sample(t_s=100.0 + 0.5 * tick, eta=eta, ages=Ages(0.1, 0.1, 0.1, 0.1, 0.1))
        feed.take(_messages(sample), now_s=0.5 * tick)
    feed.take([Message("holdfast/kelp/plan", telemetry.to_json(plan()))], now_s=10.0)
    assert feed.complete
    screen = _screen(feed.view(10.0, connected=True))
    lines = screen.splitlines()
    assert max(map(len, lines)) <= 80
    assert "north 1.80 m   east 1.00 m" in screen
    assert "fence N -9 to 9, E -8 to 8" in screen
    rows = [line for line in lines if re.search("[\u2800-\u28ff↑]", line)]
    assert "↑" in rows[0]  # it went northward
    assert len(rows) == 10


@pytest.mark.parametrize(
    ("line", "drawn"),
    [
        ([(0.0, 0.0), (2.0, 0.0)], [" ⢠ ", " ⠸ "]),
        ([(1.0, -1.0), (1.0, 1.0)], ["   ", "⠈⠉⠉"]),
        ([(0.0, 0.0), (math.nan, 0.0), (2.0, 0.0)], [" ⠠ ", " ⠠ "]),
        ([(0.0, 0.0), (1e300, 0.0), (2.0, 0.0)], [" ⠠ ", " ⠠ "]),
    ],
)
def test_a_chart_is_drawn_in_dots_and_gaps_are_gaps(line: list[Point], drawn: list[str]) -> None:
    picture, m_per_column = chart([("", line)], (math.nan, math.nan), 0.0, 3, 2)
    assert picture.plain.splitlines() == drawn
    assert m_per_column == pytest.approx(1.0)


@pytest.mark.parametrize(("most_m", "length_m"), [(7.0, 5.0), (1.0, 1.0), (0.45, 0.2), (30.0, 20.0)])
def test_a_scale_is_a_round_number(most_m: float, length_m: float) -> None:
    assert nice_length(most_m) == pytest.approx(length_m)


def test_a_companion_that_died_while_active_leaves_no_armed_vehicle_on_the_screen(
    make_sample: MakeSample,
) -> None:
    feed = Feed("kelp", "here")
    feed.take(_messages(make_sample(t_s=100.0, armed=True)), now_s=7.0)
    shown = " ".join(_screen(feed.view(20.0, connected=True)).split())
    assert "It was ACTIVE and armed." in shown
    assert "the autopilot disarms 3 s" in shown
    assert "was ARMED" in shown
    assert "Start `holdfast run`" not in shown


def test_data_turn_stale_within_a_second(make_sample: MakeSample) -> None:
    feed = Feed("kelp", "here")
    feed.take(_messages(make_sample(t_s=100.0)), now_s=7.0)
    assert "STALE" not in _screen(feed.view(7.2, connected=True))
    late = _screen(feed.view(8.0, connected=False))
    assert "STALE: nothing new for 1.0 s" in late
    assert "not connected" in late


def test_what_was_held_up_on_its_way_is_old(make_sample: MakeSample) -> None:
    feed = Feed("kelp", "here")
    feed.take(_messages(make_sample(t_s=100.0)), now_s=7.0)
    feed.take(_messages(make_sample(t_s=101.0)), now_s=10.0)
    assert feed.view(10.0, connected=True).age_s == pytest.approx(2.0)


def test_a_vehicle_whose_clock_starts_again_is_not_stale(make_sample: MakeSample) -> None:
    feed = Feed("kelp", "here")
    feed.take(_messages(make_sample(t_s=5000.0)), now_s=7.0)
    feed.take(_messages(make_sample(t_s=20.0)), now_s=9.0)
    assert feed.view(9.1, connected=True).age_s == pytest.approx(0.1)


def test_nothing_heard_tells_where_to_look() -> None:
    feed = Feed("", "tcp/10.0.0.1:7447")
    assert "Nobody listens on tcp/10.0.0.1:7447" in _screen(feed.view(1.0, connected=False))
    assert "No vehicle is heard." in _screen(feed.view(1.0, connected=True))


def test_one_vehicle_is_shown_wholly_and_several_as_a_line_each(make_sample: MakeSample) -> None:
    fleet = Feeds("", "here")
    assert not fleet.complete
    fleet.take(_messages(make_sample()), now_s=1.0)
    assert fleet.complete
    assert "holdfast kelp" in _drawn(picture(fleet.views(1.0, connected=True), 80))
    fleet.take(_messages(make_sample(t_s=99.0, voltage_v=math.nan), "wrack"), now_s=1.5)
    fleet.take([Message("holdfast/wrack/event", _event("the tether tugs"))], now_s=1.5)
    screen = _drawn(picture(fleet.views(1.6, connected=True), 80))
    assert "holdfast 2 vehicles" in screen
    assert max(map(len, screen.splitlines())) <= 80
    (kelp,) = [line for line in screen.splitlines() if " kelp " in line]
    (wrack,) = [line for line in screen.splitlines() if " wrack " in line]
    assert "89 s ago  wrack: fault: the tether tugs" in screen
    assert "…" not in screen
    assert "STALE 1 s" in kelp
    for words in ("ACTIVE", "5.000 m", "28.6°", "ARMED", "–", "live"):
        assert words in wrack


def test_only_the_vehicle_asked_for_is_shown(make_sample: MakeSample) -> None:
    fleet = Feeds("kelp", "here")
    fleet.take([*_messages(make_sample()), Message("holdfast/kelp", b"")], now_s=1.0)
    assert [view.vehicle for view in fleet.views(1.0, connected=True)] == ["kelp"]


def test_the_last_events_are_shown_with_their_age_and_all_fits(make_sample: MakeSample) -> None:
    feed = Feed("kelp", "here")
    feed.take(_messages(make_sample(t_s=15.0)), now_s=1.0)
    for text in ("first", "second", "FAULT: " + 90 * "x"):
        feed.take([Message("holdfast/kelp/event", _event(text))], now_s=1.0)
    screen = _screen(feed.view(1.0, connected=True))
    lines = screen.splitlines()
    assert len(lines) <= 24
    assert max(map(len, lines)) <= 80
    assert "first" not in screen
    assert "   5 s ago  fault: second" in screen


def test_a_strange_message_is_reported_and_passed_over(make_sample: MakeSample) -> None:
    feed = Feed("kelp", "here")
    feed.take([Message("holdfast/kelp/state", b"{}"), *_messages(make_sample())], now_s=1.0)
    assert "holdfast.State.v1" in _screen(feed.view(1.0, connected=True))


@pytest.mark.parametrize("tail", ["raw", "recorder", "config", "choices", "check"])
def test_answers_that_it_does_not_show_are_no_trouble(make_sample: MakeSample, tail: str) -> None:
    """`--once` asks for every key of the vehicle, and gets what the companion answers under its own ones."""
    feed = Feed("kelp", "here")
    feed.take([*_messages(make_sample()), Message(f"holdfast/kelp/{tail}", b"{}")], now_s=1.0)
    assert feed.view(1.0, connected=True).trouble == ""


def test_nothing_that_is_published_reaches_the_terminal_as_a_control_character(
    make_sample: MakeSample,
) -> None:
    """Anybody may publish under our keys. A word in brackets is no style either."""
    evil = "[/x]\x1b[2J\n\x9b1m\u202e"
    sample = make_sample()
    sample = replace(sample, verdict=replace(sample.verdict, reason=evil))
    feed = Feed(f"kelp{evil}", "here")
    feed.take(_messages(sample), now_s=1.0)
    feed.take([Message("holdfast/kelp/event", _event(evil)), Message(f"holdfast/k/{evil}", b"{}")], now_s=1.0)
    view = feed.view(1.0, connected=True)
    for screen in (_screen(view), _drawn(picture([view, view], 80))):
        assert all(line.isprintable() for line in screen.split("\n"))
        assert "\\x1b[2J" in screen


def test_errors_are_remembered_by_their_peaks(make_sample: MakeSample) -> None:
    feed = Feed("kelp", "here")
    for tick in range(2 * 50):
        sample = make_sample(t_s=100.0 + tick / 50)
        errors = vector([-0.5 if tick == 30 else 0.01] * 4)
        feed.take(_messages(replace(sample, dofs=replace(sample.dofs, e=errors))), now_s=tick / 50)
    view = feed.view(2.0, connected=True)
    assert view.errors["z"] == [0.5, 0.01]
    assert view.errors["psi"] == [0.0, 0.0], "an error of what is not held is none"


@pytest.mark.parametrize(
    ("value", "drawn"),
    [
        (0.0, "····│····"),
        (0.5, "····│██··"),
        (-0.5, "··██│····"),
        (0.125, "····│▌···"),
        (-0.125, "···▐│····"),
        (9.0, "····│████"),
        (-1.0, "████│····"),
    ],
)
def test_a_gauge_grows_from_the_middle(value: float, drawn: str) -> None:
    assert watch.gauge(value, half=4).plain == drawn


def test_a_wild_sample_is_drawn_too(make_sample: MakeSample) -> None:
    nowhere = vector([math.nan] * 4)
    sample = make_sample(eta=nowhere, boot_s=math.nan, roll=math.inf, mode=77)
    sample = replace(sample, requested=Wrench(nowhere), delivered=Wrench(nowhere))
    assert "mode 77" in _screen(_view(sample))


def test_a_snapshot_in_numbers(make_sample: MakeSample) -> None:
    figures = msgspec.json.decode(msgspec.json.encode(watch.figures_of(_view(make_sample()))))
    assert figures["vehicle"] == "kelp"
    assert figures["state"]["depth_m"] == 5.0
    assert figures["dof/z"]["unit"] == "m"


def test_once_without_a_companion_is_a_failure(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr(watch, "PATIENCE_S", 0.1)
    figures = tmp_path / "figures.json"
    assert watch.main(["--once", "--connect", "tcp/127.0.0.1:1", "--json", str(figures)]) == 1
    assert "Nobody listens on tcp/127.0.0.1:1" in capsys.readouterr().err
    assert not figures.exists()


def test_a_name_that_cannot_be_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert watch.main(["--once", "--name", "a//b"]) == 2
    assert "key expression" in capsys.readouterr().err


def _messages(sample: ControlSample, vehicle: str = "kelp") -> list[Message]:
    return [Message(key, payload) for key, _, payload in samples.encode(sample, vehicle)]


def _view(sample: ControlSample) -> View:
    feed = Feed("kelp", "here")
    feed.take(_messages(sample), now_s=1.0)
    assert feed.complete
    return feed.view(1.0, connected=True)


def _event(text: str) -> bytes:
    return telemetry.to_json(telemetry.Event(t_s=10.0, boot_s=1.0, severity="fault", kind="state", text=text))


def _screen(view: View, columns: int = 80) -> str:
    return _drawn(render(view, columns), columns)


def _drawn(what: RenderableType, columns: int = 80) -> str:
    console = Console(width=columns, file=StringIO())
    with console.capture() as captured:
        console.print(what)
    return captured.get()


def _rows(screen: str, name: str) -> list[str]:
    return [line for line in screen.splitlines() if line.startswith(f"│ {name} ")]
