"""Real sessions on loopback: whoever starts first, whoever leaves, the samples arrive."""

import json
import logging
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
import pytest
import zenoh
from waiting import until
from zenoh import ext

from companion.io import zenoh_publisher as zenoh_io
from companion.io.command_queue import ReceivedCommand
from companion.io.zenoh_publisher import NameTakenError, Publisher
from companion.records import ControlSample
from companion.telemetry import schemas as telemetry
from companion.telemetry.session import asked, client_configuration
from dashboard.zenoh_client import Message, Subscription
from holdfast import RefusedError

Feed = Callable[[Publisher], None]


@pytest.fixture
def endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@pytest.fixture
def feed(make_sample: Callable[..., ControlSample]) -> Iterator[Feed]:
    """Feed a publisher at 50 Hz from a thread, to the end of the test."""
    stop = threading.Event()
    threads: list[threading.Thread] = []

    def start(publisher: Publisher) -> None:
        def run() -> None:
            while not stop.wait(0.02):
                publisher.offer(make_sample(t_s=time.monotonic()))

        threads.append(threading.Thread(target=run))
        threads[-1].start()

    yield start
    stop.set()
    for thread in threads:
        thread.join()


def test_a_stranger_gets_every_key_with_its_encoding_and_stamp(endpoint: str, feed: Feed) -> None:
    with Publisher("kelp", endpoint) as publisher, _stranger("client", endpoint) as session:
        feed(publisher)
        samples: dict[str, zenoh.Sample] = {}

        def keep(sample: zenoh.Sample) -> None:
            samples[str(sample.key_expr)] = sample

        with session.declare_subscriber("holdfast/**", keep):
            until(lambda: samples.keys() == telemetry.keys("kelp").keys())
    for key, encoding in telemetry.keys("kelp").items():
        assert str(samples[key].encoding) == encoding
        assert samples[key].congestion_control == zenoh.CongestionControl.DROP
        assert samples[key].priority == zenoh.Priority.REAL_TIME
        assert samples[key].timestamp is not None
        telemetry.decode(key, samples[key].payload.to_bytes())


def test_beyond_2106_it_publishes_without_stamps_and_so_it_does_after_the_clock_jumped_there_and_back(
    endpoint: str, feed: Feed
) -> None:
    """Zenoh's stamps end there: it panics, and the process ended."""
    utc_s = [2.0**32 + 9.0]
    stamped: set[bool] = set()
    with (
        Publisher("kelp", endpoint, utc_s=lambda: utc_s[0]) as publisher,
        _stranger("client", endpoint) as session,
        session.declare_subscriber("holdfast/**", lambda sample: stamped.add(sample.timestamp is not None)),
    ):
        feed(publisher)
        for now_s, wanted in ((utc_s[0], False), (1.8e9, True), (1e13, False)):
            utc_s[0] = now_s
            time.sleep(0.5)
            stamped.clear()
            until(lambda wanted=wanted: stamped == {wanted})  # type: ignore[misc]
    assert publisher.beside.count == 0


def test_a_query_returns_the_last_sample_of_every_key(
    endpoint: str, make_sample: Callable[..., ControlSample]
) -> None:
    event = telemetry.Event(t_s=1.0, boot_s=1.0, severity="info", kind="state", text="ACTIVE")
    commands: list[ReceivedCommand] = []
    with Publisher("kelp", endpoint, on_command=commands.append) as publisher:
        publisher.claim(5.0)
        publisher.offer(make_sample(t_s=1.0))
        publisher.offer(make_sample(t_s=2.0), events=[event])
        with zenoh.open(client_configuration(endpoint)) as stranger:

            def last(expression: str) -> dict[str, zenoh.Sample]:
                replies = (reply.ok for reply in stranger.get(expression, timeout=2.0))
                return {str(sample.key_expr).split("/", 2)[2]: sample for sample in replies if sample}

            until(lambda: any(b'"t_s":2.0' in bytes(one.payload) for one in last("**/loop").values()))
            found = last("holdfast/kelp/**")
            assert found.keys() == {*telemetry.EVERY_TICK, "event", "config", "choices", "check"}
            stamps = {str(found[tail].timestamp) for tail in telemetry.EVERY_TICK}
            assert len(stamps) == 1  # when it was published, not when it was asked for
            assert b'"t_s":2.0' in bytes(found["state"].payload)
            assert str(found["state"].encoding) == "application/json;holdfast.State.v1"
            assert last("holdfast/*/dof/*").keys() == {"dof/x", "dof/y", "dof/z", "dof/psi"}
            assert last("holdfast/kelp/event").keys() == {"event"}
            assert last("holdfast/kelp/state")["state"].timestamp == found["state"].timestamp
    assert commands == []


def test_a_flood_of_answers_costs_no_event(endpoint: str, make_sample: Callable[..., ControlSample]) -> None:
    """They waited in one row with the events, which is 256 long."""
    commands: list[ReceivedCommand] = []
    heard: set[str] = set()

    def event(text: str) -> telemetry.Event:
        return telemetry.Event(t_s=1.0, boot_s=1.0, severity="info", kind="state", text=text)

    def keep(sample: zenoh.Sample) -> None:
        heard.add(msgspec.json.decode(sample.payload.to_bytes())["text"])

    with Publisher("kelp", endpoint, on_command=commands.append) as publisher:
        publisher.claim(5.0)
        with _stranger("client", endpoint) as session:
            session.declare_subscriber(telemetry.key("kelp", "event"), keep)

            def comes() -> bool:
                publisher.offer(make_sample(), events=[event("before")])
                return "before" in heard

            until(comes)
            for _ in range(600):
                session.get(telemetry.key("kelp", "command", "engage"), lambda _: None, timeout=30.0)
            until(lambda: len(commands) == 600)
            publisher.offer(make_sample(), events=[event("among them")])
            for command in commands:
                command.answer(telemetry.Reply(done=False, said="refused"))
            until(lambda: "among them" in heard, within_s=5.0)


def test_a_subscriber_opens_a_new_session_after_an_error_that_nobody_has_foreseen(
    endpoint: str, feed: Feed, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """The page was blank from then on: its process lives, so that nothing starts it again."""

    class PanicError(BaseException):
        """As Zenoh's PanicException, which is no Exception."""

    opened, panics = zenoh.open, [PanicError("no more files")] * 2

    def panicking(config: zenoh.Config) -> zenoh.Session:
        if threading.current_thread().name == "zenoh-client" and panics:
            raise panics.pop()
        return opened(config)

    monkeypatch.setattr(zenoh, "open", panicking)
    with Publisher("kelp", endpoint) as publisher, Subscription("holdfast/**", endpoint) as seen:
        feed(publisher)
        until(lambda: bool(seen.take()))
    assert not panics
    assert caplog.text.count("PanicError: no more files") == 1


def test_a_router_is_joined_and_given_time_to_come_back(
    endpoint: str, feed: Feed, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, logger=zenoh_io.__name__)
    with _stranger("router", endpoint), Publisher("kelp", endpoint) as publisher:
        feed(publisher)
        with Subscription("holdfast/**", endpoint) as seen:
            until(lambda: bool(seen.take()))
    assert caplog.messages == [f"zenoh: joined {endpoint}"]

    with _stranger("router", endpoint) as router, Publisher("kelp", endpoint) as publisher:
        feed(publisher)
        until(lambda: bool(router.info.transports()))
        router.close()
        time.sleep(1.0)
        with _stranger("router", endpoint), Subscription("holdfast/**", endpoint) as seen:
            until(lambda: bool(seen.take()))
    assert f"zenoh: listening on {endpoint}" not in caplog.messages


@pytest.mark.parametrize("attempt", range(2))  # it may be gone before or after we listen for that
def test_a_router_that_stays_away_is_replaced(
    endpoint: str, feed: Feed, monkeypatch: pytest.MonkeyPatch, attempt: int
) -> None:
    monkeypatch.setattr(zenoh_io, "_ROUTER_GRACE", 2)
    with _stranger("router", endpoint) as router, Publisher("kelp", endpoint) as publisher:
        feed(publisher)
        until(lambda: bool(router.info.transports()))
        router.close()
        with Subscription("holdfast/**", endpoint) as seen:
            until(lambda: bool(seen.take()))


def test_a_command_is_local_unless_a_router_or_another_way_in_is_there(
    endpoint: str, feed: Feed, tmp_path: Path
) -> None:
    """A router forwards from wherever it listens: what comes through it may come from anywhere."""

    def asked(publisher: Publisher) -> bool:
        feed(publisher)
        commands.clear()
        with Subscription("holdfast/**", endpoint) as seen:
            until(lambda: seen.tell("kelp", "goto", {"depth_m": 3.0}).done)  # it is found in its own time
        (received,) = commands
        return received.local

    def take(received: ReceivedCommand) -> None:
        commands.append(received)
        received.answer(telemetry.Reply(done=True, said="aye"))

    commands: list[ReceivedCommand] = []
    with Publisher("kelp", endpoint, on_command=take) as listens:
        assert asked(listens)
    with Publisher("other", endpoint) as other, Publisher("kelp", endpoint, on_command=take) as joins:
        feed(other)
        assert asked(joins)
    with _stranger("router", endpoint), Publisher("kelp", endpoint, on_command=take) as routed:
        assert not asked(routed)
    with _stranger("router", endpoint), Publisher("kelp", endpoint, "client", take) as client:
        assert not asked(client)
    file = tmp_path / "zenoh.json5"
    zenoh_file = {"mode": "peer", "listen": {"endpoints": [endpoint]}, "timestamping": {"enabled": True}}
    file.write_text(json.dumps(zenoh_file))
    with Publisher("kelp", str(file), "file", take) as opened:
        assert not asked(opened)


def test_only_loopback_is_this_machine() -> None:
    for ours in ("127.0.0.1", "127.1.2.3", "[::1]", "localhost"):
        assert zenoh_io.is_loopback(f"tcp/{ours}:7447")
    foreign = ("127.evil.example", "localhost.example", "0.0.0.0", "[::]", "192.168.2.2")
    for other in (*(f"tcp/{host}:7447" for host in foreign), "unixsock-stream//tmp/x", "nonsense"):
        assert not zenoh_io.is_loopback(other)


@pytest.mark.parametrize("attempt", range(2))
def test_of_two_that_start_at_once_under_one_name_one_gives_way(endpoint: str, attempt: int) -> None:
    with _stranger("router", endpoint):
        two = [Publisher("kelp", endpoint) for _ in range(2)]
        for publisher in two:
            publisher.start()
        assert sorted(_claims(publisher) for publisher in two) == [False, True]
        for publisher in two:
            publisher.close()


def test_a_duplicate_that_comes_later_is_noticed_and_nobody_leaves(endpoint: str, feed: Feed) -> None:
    with Publisher("kelp", endpoint) as publisher, _stranger("client", endpoint) as session:
        publisher.claim(5.0)
        feed(publisher)
        with (
            Subscription("holdfast/**", endpoint) as seen,
            session.liveliness().declare_token(telemetry.key("kelp", "alive", "4711")),
        ):
            until(lambda: "4711" in publisher.duplicate_instances)
            until(lambda: bool(seen.take()))


def test_it_listens_on_loopback_only(endpoint: str, feed: Feed) -> None:
    port = int(endpoint.rpartition(":")[2])
    with Publisher("kelp", f"tcp/0.0.0.0:{port}") as publisher:
        feed(publisher)
        time.sleep(1.0)
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(("127.0.0.1", port))


def test_a_stopped_subscriber_holds_nobody_up(
    endpoint: str, feed: Feed, make_sample: Callable[..., ControlSample]
) -> None:
    program = (
        "import sys, time\n"
        "from dashboard.zenoh_client import Subscription\n"
        "with Subscription('holdfast/**', sys.argv[1]) as seen:\n"
        "    while not seen.take(): time.sleep(0.01)\n"
        "    print('here', flush=True)\n"
        "    time.sleep(60)\n"
    )
    with Publisher("kelp", endpoint) as publisher, Subscription("holdfast/kelp/state", endpoint) as seen:
        feed(publisher)
        stopped = subprocess.Popen([sys.executable, "-c", program, endpoint], stdout=subprocess.PIPE)
        try:
            assert stopped.stdout is not None
            assert stopped.stdout.readline() == b"here\n"
            stopped.send_signal(signal.SIGSTOP)
            flood = make_sample(t_s=0.0)
            for _ in range(2000):  # fills whatever buffers there are towards the one that reads no more
                publisher.offer(flood)
                time.sleep(0.001)
            seen.take()
            time.sleep(0.5)
            fresh = [message for message in seen.take() if _t_s(message) > 0.0]
            assert len(fresh) > 5
            assert time.monotonic() - _t_s(fresh[-1]) < 1.0
        finally:
            stopped.kill()
            stopped.communicate()


def test_it_closes_from_any_state_and_ignores_what_comes_after(
    endpoint: str, make_sample: Callable[..., ControlSample]
) -> None:
    never_started = Publisher("kelp", endpoint)
    just_started = Publisher("kelp", endpoint)
    just_started.start()
    nobody_there = Publisher("kelp", "tcp/0.0.0.0:1")
    nobody_there.start()
    mute = socket.create_server(("127.0.0.1", 0))
    waiting = Publisher("kelp", f"tcp/127.0.0.1:{mute.getsockname()[1]}")
    waiting.start()
    for publisher in (never_started, just_started, nobody_there, waiting):
        start = time.perf_counter()
        publisher.close()
        publisher.close()
        assert time.perf_counter() - start < 2.0
        for _ in range(200):
            publisher.offer(make_sample())
    mute.close()


def test_the_oldest_gives_way(endpoint: str, make_sample: Callable[..., ControlSample]) -> None:
    publisher = Publisher("kelp", endpoint)
    for index in range(100):
        publisher.offer(make_sample(t_s=float(index)))
    assert publisher.dropped == 100 - 64


def test_a_key_or_an_endpoint_that_can_never_work_is_refused(endpoint: str, tmp_path: Path) -> None:
    nonsense, sound = tmp_path / "nonsense.json5", tmp_path / "sound.json5"
    nonsense.write_text("{ mode: 'submarine' }")
    sound.write_text("{}")
    refused: list[tuple[str, str | Path, Any, str]] = [
        ("kelp/1", endpoint, "peer", "vehicle name"),
        ("kelp", "localhost", "file", r"telemetry\.endpoint: .*is no Zenoh"),
        ("kelp", nonsense, "file", r"telemetry\.endpoint: .*is no Zenoh"),
        ("kelp", tmp_path / "missing.json5", "file", r"telemetry\.endpoint: .*is no Zenoh"),
        ("kelp", endpoint, "file", "mode is file"),
        ("kelp", sound, "peer", "mode is peer"),
    ]
    for vehicle, where, mode, says in refused:
        with pytest.raises(ValueError if vehicle != "kelp" else RefusedError, match=says):
            Publisher(vehicle, str(where), mode)
    with pytest.raises(ValueError, match="key expression"):
        Subscription("holdfast//x", endpoint)
    with pytest.raises(RefusedError, match="no Zenoh configuration"):
        Subscription("holdfast/**", str(nonsense))


@contextmanager
def _stranger(mode: str, endpoint: str) -> Iterator[zenoh.Session]:
    """Somebody who knows Zenoh and nothing of ours."""
    config = zenoh.Config()
    config.insert_json5("mode", json.dumps(mode))
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("connect/endpoints", json.dumps([endpoint] if mode == "client" else []))
    config.insert_json5("listen/endpoints", json.dumps([endpoint] if mode == "router" else []))
    config.insert_json5("connect/timeout_ms", "5000")
    with zenoh.open(config) as session:
        yield session


def _claims(publisher: Publisher) -> bool:
    try:
        publisher.claim(5.0)
    except NameTakenError:
        return False
    return True


def _t_s(message: Message) -> float:
    return telemetry.decode(message.key, message.payload).t_s


def test_a_recorder_that_comes_late_gets_the_raw_ticks_from_the_first(
    endpoint: str, make_sample: Callable[..., ControlSample]
) -> None:
    with Publisher("kelp", endpoint) as publisher, _stranger("client", endpoint) as session:
        for tick in range(1, 51):
            raw = telemetry.Raw(tick=tick, now_s=float(tick), heard=[(tick, b"x")], out=[])
            publisher.offer(make_sample(), raw)
            time.sleep(0.002)
        key, encoding = telemetry.published("kelp", "raw")
        came: list[zenoh.Sample] = []
        history = ext.HistoryConfig(detect_late_publishers=True)
        with ext.declare_advanced_subscriber(session, key, came.append, history=history):
            until(lambda: len(came) == 50)
    ticks = [msgspec.msgpack.decode(sample.payload.to_bytes(), type=telemetry.Raw).tick for sample in came]
    assert ticks == list(range(1, 51))
    assert {str(sample.encoding) for sample in came} == {encoding}


def test_a_companion_that_runs_answers_for_check(endpoint: str) -> None:
    key = telemetry.key("kelp", "check")
    assert asked(endpoint, key) is None, "nobody runs"
    with Publisher("kelp", endpoint, check_list=lambda: '{"rows": []}'):
        until(lambda: asked(endpoint, key) == b'{"rows": []}', within_s=10.0)
