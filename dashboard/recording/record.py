"""`holdfast record`: a thread that hears one vehicle over Zenoh and lets a DiveRecorder keep it."""

import argparse
import json
import logging
import platform
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack
from importlib.metadata import version
from pathlib import Path

import msgspec
import zenoh
from zenoh import ext

from companion.telemetry import schemas as telemetry
from companion.telemetry.session import SessionThread, client_configuration, ticks_per_sample
from dashboard.arguments import MB, add_connect, until_ended
from dashboard.recording.recorder import DiveRecorder, FileLimits
from holdfast import files, own_version
from holdfast.command_line import command_parser
from holdfast.version import revision

QUEUE_BYTES = 1 << 26
"""May wait for the disk: over a minute of one vehicle. What comes when it is full is lost."""
OVERHEAD_BYTES = 600  # of a message that waits

_DRAIN_S = 0.1  # five ticks
_SYNC_S = 0.9  # and _DRAIN_S: at most a second is lost
_ASK_S = 5.0  # between questions for the configuration, until it came
_CLOSE_S = 10.0  # for a slow disk
_LOOK_S = 0.5
_REPLIES = 64  # far more than ever wait

_log = logging.getLogger(__name__)

EXAMPLES = """\
examples:
  holdfast record                               everything that the first vehicle publishes, to ./dives
  holdfast record kelp --out /data              a new file every 250 MB; 500 MB stay free
  holdfast run --set telemetry.raw=true         publish every datagram too, for `holdfast lab rerun`

Foxglove and Lichtblick open and plot the files. Other commands read them, truncated ones too:
  holdfast report FILE    write a report                  holdfast replay FILE   show it on a dashboard
  holdfast lab rerun FILE     compare the present code
Ctrl-C closes the file. After a power cut at most the last second is missing, and the index.
"""


class RecorderThread(SessionThread):
    """Records `vehicle`, or the first one heard where that is empty, from `start` to `close`.

    Publishes its state once a second. Trouble with network or disk is never raised: see the log.
    """

    def __init__(self, vehicle: str, endpoint: str, limits: FileLimits) -> None:
        super().__init__("recorder", _CLOSE_S)
        client_configuration(endpoint)  # refused here, not in the thread
        self._vehicle = vehicle
        self._endpoint = endpoint
        self._limits = limits
        self._queue: deque[tuple[str, str, bytes, int, float]] = deque()
        self._came_bytes = self._taken_bytes = self._dropped = 0
        self._keeping = threading.Lock()
        """Held by threads of Zenoh's, of which there are several."""
        self._replies: deque[bytes] = deque(maxlen=_REPLIES)
        self._alive = threading.Event()
        self._appeared = threading.Event()
        self._said = ""

    def start(self) -> None:
        """Connect, as soon and as often as it takes, and record."""
        self._say(f"waiting for {self._endpoint}")
        super().start()

    def _open(self) -> zenoh.Session:
        return zenoh.open(client_configuration(self._endpoint))

    def _serve(self, session: zenoh.Session) -> None:
        self._vehicle = self._vehicle or self._first_vehicle(session)
        if self._vehicle:
            self._record(session)

    def _first_vehicle(self, session: zenoh.Session) -> str:
        self._say("waiting for a vehicle")
        while not self._closing.wait(_DRAIN_S):
            for reply in session.liveliness().get("holdfast/*/alive/**", timeout=_LOOK_S):
                name = str(reply.ok.key_expr).split("/")[1] if reply.ok else ""
                if name.isprintable() and name:  # a file is called by it
                    return name
        return ""

    def _record(self, session: zenoh.Session) -> None:
        """Serve one vehicle until closed: this thread alone touches the recorder."""
        vehicle, every = self._vehicle, ticks_per_sample(self._endpoint)
        recorder = DiveRecorder(vehicle, self._limits, about(), ticks_per_sample=every)
        key, encoding = telemetry.published(vehicle, "recorder")
        remembered = telemetry.key(vehicle, "raw"), telemetry.key(vehicle, "event")

        def keep(sample: zenoh.Sample) -> None:
            if str(sample.key_expr) not in remembered:
                self._keep(sample)

        with ExitStack() as stack:
            stack.callback(recorder.stop)  # if the session is lost, or something unforeseen happens
            enter, alive = stack.enter_context, session.liveliness()
            enter(session.declare_subscriber(f"holdfast/{vehicle}/**", keep))
            enter(session.declare_subscriber(f"sim/{vehicle}/truth", keep))
            memories = [_Memory(session, one, self._keep) for one in remembered]
            for memory in memories:
                stack.callback(memory.close)
            tokens = telemetry.key(vehicle, "alive", "*")
            enter(alive.declare_subscriber(tokens, self._on_alive, history=True))
            publisher = enter(session.declare_publisher(key, encoding=zenoh.Encoding(encoding)))
            ask_s = sync_s = 0.0
            recorder.start(time.time_ns())
            while not self._closing.wait(_DRAIN_S):
                now_s = time.monotonic()
                self._drain(recorder)
                if self._appeared.is_set():
                    self._appeared.clear()
                    for memory in memories:
                        memory.open()
                if self._alive.is_set() and now_s >= ask_s:
                    ask_s = now_s + _ASK_S
                    session.get(telemetry.key(vehicle, "config"), self._on_config)
                if now_s >= sync_s:
                    sync_s = now_s + _SYNC_S
                    recorder.each_second(time.time_ns())
                    self._tell(recorder, publisher)
            self._drain(recorder)
            recorder.stop()
            self._tell(recorder, publisher)

    def _tell(self, recorder: DiveRecorder, publisher: zenoh.Publisher) -> None:
        publisher.put(msgspec.json.encode(recorder.status(time.monotonic(), self._dropped)))
        self._say(recorder.said)

    def _keep(self, sample: zenoh.Sample) -> None:
        """Take a sample from Zenoh's thread, which never waits."""
        stamp, payload = sample.timestamp, sample.payload.to_bytes()
        publish_ns = round(stamp.get_time().timestamp() * 1e9) if stamp else time.time_ns()
        came = str(sample.key_expr), str(sample.encoding), payload, publish_ns, time.monotonic()
        size_bytes = len(payload) + OVERHEAD_BYTES
        with self._keeping:
            if self._came_bytes - self._taken_bytes + size_bytes > QUEUE_BYTES:
                self._dropped += 1
                return
            self._came_bytes += size_bytes
            self._queue.append(came)

    def _on_alive(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            self._alive.set()
            self._appeared.set()

    def _on_config(self, reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            self._alive.clear()
            self._replies.append(reply.ok.payload.to_bytes())

    def _drain(self, recorder: DiveRecorder) -> None:
        for _ in range(len(self._replies)):
            if text := readable(self._replies.popleft()):
                recorder.describe("config", {"json": text})
        for _ in range(len(self._queue)):
            came = self._queue.popleft()
            recorder.take(*came)
            self._taken_bytes += len(came[2]) + OVERHEAD_BYTES

    def _say(self, said: str) -> None:
        if said != self._said:
            self._said = said
            _log.info("%s", said)


class _Memory:
    """The subscription to a key whose publisher repeats its history: raw ticks and events from before us.

    It is declared again whenever a companion appears: a subscription never asks for what lies before
    its first live sample. The DiveRecorder drops what comes twice.
    """

    def __init__(self, session: zenoh.Session, key: str, keep: Callable[[zenoh.Sample], None]) -> None:
        self._session, self._key, self._keep = session, key, keep
        self._subscriber: ext.AdvancedSubscriber[None] | None = None

    def open(self) -> None:
        """Subscribe, now that the companion's declarations are here."""
        self.close()
        self._subscriber = ext.declare_advanced_subscriber(
            self._session,
            self._key,
            self._keep,
            history=ext.HistoryConfig(detect_late_publishers=None, max_samples=None, max_age=None),
            recovery=ext.RecoveryConfig(heartbeat=True, periodic_queries=None),
        )

    def close(self) -> None:
        """Leave."""
        if self._subscriber is not None:
            self._subscriber.undeclare()  # type: ignore[no-untyped-call]
            self._subscriber = None


def about() -> dict[str, str]:
    """Return what wrote the file: versions and git revision, "unknown" outside a checkout."""
    packages = {"holdfast": own_version()} | {name: version(name) for name in ("eclipse-zenoh", "mcap")}
    return {
        **packages,
        "git": revision() or "unknown",
        "python": platform.python_version(),
        "system": platform.platform(),
    }


def readable(payload: bytes) -> str:
    """Return a JSON object with a line for each key; "" for what is none, or nested too deeply."""
    try:
        table = files.from_json(payload.decode())
    except ValueError:
        return ""
    return json.dumps(table, indent=1) if isinstance(table, dict) else ""


def main(argv: list[str]) -> int:
    """Run the command until SIGINT or SIGTERM."""
    parser = command_parser(
        "record",
        "Records everything that a vehicle publishes over Zenoh as MCAP, with the true state of "
        "a simulator. It is a separate process: trouble with the disk cannot disturb the dive.",
        EXAMPLES,
    )
    add = parser.add_argument
    add("name", nargs="?", default="", metavar="VEHICLE", help="default: the first that is heard")
    add_connect(parser)
    add("--out", type=Path, default=Path("dives"), metavar="DIR", help="default: ./%(default)s")
    for name, default, purpose in (
        ("--max-mb", 250.0, "start a new file after MB; default %(default)g, an hour or more"),
        ("--reserve-mb", 500.0, "pause while less is free; default %(default)g"),
    ):
        add(name, type=_positive, default=default, metavar="MB", help=purpose)
    options = parser.parse_args(argv)
    try:
        options.out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=options.out):
            pass
    except OSError as error:
        parser.error(f"--out {options.out}: {error.strerror}; name a folder that takes files")
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", stream=sys.stderr)
    limits = FileLimits(options.out, round(options.max_mb * MB), round(options.reserve_mb * MB))
    ended = until_ended()
    with RecorderThread(options.name, options.connect, limits) as recorder:
        while recorder.failure is None and not ended.wait(_LOOK_S):
            pass
    return 1 if recorder.failure is not None else 0


def _positive(text: str) -> float:
    number = float(text)
    if not 0.0 < number < 1e9:
        raise argparse.ArgumentTypeError(f"{text} is not above 0")
    return number
