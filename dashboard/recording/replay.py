"""`holdfast replay`: an old dive over Zenoh, under the keys of a vehicle that is not there."""

import argparse
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

import zenoh

from companion.telemetry import schemas as telemetry
from companion.telemetry.session import client_configuration, configuration
from dashboard.arguments import add_connect, until_ended
from dashboard.recording.mcap_file import MAX_CHANNELS, Item, Reader
from holdfast.arguments import command_parser

EXAMPLES = """\
examples:
  holdfast replay dives/kelp-20261121T101500Z.mcap        then open holdfast dashboard and choose kelp-replay
  holdfast replay FILE --speed 4 --from 600 --loop        four times as fast, from 10 min on, again and again
  holdfast replay FILE --speed max                        as fast as the subscribers can take it

The replay has another name, so that nobody takes it for a live vehicle: kelp becomes kelp-replay. The command
refuses to publish under a name that is in use, by a live vehicle or by another replay.
"""

_LIVE_S = 0.5


def main(argv: list[str]) -> int:
    """Run the command; returns 1 when it was refused or nothing could be played, 0 at the end or Ctrl-C."""
    parser = command_parser(
        "replay",
        "Publishes a recording over Zenoh: the same bytes under the same keys, except for the "
        "name of the vehicle. It connects to the endpoint; if nothing listens there, it listens itself.",
        EXAMPLES,
    )
    parser.add_argument("file", type=Path, metavar="FILE", help="a recording, MCAP")
    parser.add_argument(
        "--speed", type=_speed, default=1.0, metavar="X", help="relative to real time, or max; default 1"
    )
    parser.add_argument(
        "--from", dest="from_s", type=float, default=0.0, metavar="S", help="start S seconds into the file"
    )
    parser.add_argument("--loop", action="store_true", help="start again at the end")
    parser.add_argument(
        "--suffix",
        default="-replay",
        metavar="TEXT",
        help="text appended to the name of the vehicle; default %(default)s",
    )
    add_connect(parser)
    options = parser.parse_args(argv)
    ended = until_ended()
    try:
        status = _replay(options, ended)
    except ValueError as error:
        sys.stderr.write(f"holdfast replay: {error}\n")
        status = 2
    return status


def renamed(key: str, suffix: str) -> tuple[str, str]:
    """Return a key under the name that a replay has, and the name; ("", "") for what is not played.

    That is what has no vehicle in it, and the recorder's status: nobody records now.
    """
    root, _, rest = key.partition("/")
    vehicle, _, tail = rest.partition("/")
    name = vehicle + suffix
    played = root in ("holdfast", "sim") and tail not in ("", "recorder")
    return (f"{root}/{name}/{tail}", name) if played else ("", "")


def paced(items: Iterator[Item], from_s: float, speed: float) -> Iterator[tuple[float, Item]]:
    """Give each sample from `from_s` into the recording on, with the time (s) at which to play it.

    Samples play in the order in which they were recorded, which late ones may have left a little.
    """
    begin_ns: int | None = None
    for item in items:
        if begin_ns is None:
            begin_ns = item.publish_ns
        at_s = (item.publish_ns - begin_ns) / 1e9 - from_s
        if at_s >= 0.0:
            yield at_s / speed, item


def _replay(options: argparse.Namespace, ended: threading.Event) -> int:
    vehicle = _vehicle(options.file, options.suffix)
    with _join_or_listen(options.connect) as session, ExitStack() as stack:
        if _alive(session, vehicle):
            sys.stderr.write(
                f"holdfast replay: {vehicle} is alive on {options.connect}: "
                "choose another name with --suffix, or another --connect\n"
            )
            return 1
        stack.enter_context(session.liveliness().declare_token(telemetry.alive_key(vehicle, "replay")))
        publishers: dict[tuple[str, str], zenoh.Publisher] = {}

        def put(item: Item) -> None:
            key, _ = renamed(item.key, options.suffix)
            publisher = publishers.get((key, item.encoding))
            if key and publisher is None and len(publishers) < MAX_CHANNELS:
                with suppress(zenoh.ZError):  # a key that Zenoh does not know as one
                    publisher = publishers[key, item.encoding] = session.declare_publisher(
                        key,
                        encoding=zenoh.Encoding(item.encoding),
                        congestion_control=zenoh.CongestionControl.BLOCK,
                        priority=zenoh.Priority.REAL_TIME,
                        express=True,
                    )
            if publisher is not None:
                publisher.put(item.payload)

        sys.stderr.write(f"playing {options.file} as {vehicle} on {options.connect}; Ctrl-C ends it\n")
        while True:
            count = _once(paced(iter(Reader(options.file)), options.from_s, options.speed), put, ended)
            if not count and not ended.is_set():
                raise ValueError(f"{options.file}: nothing in it from {options.from_s:g} s on")
            if ended.is_set() or not options.loop:
                break
        sys.stderr.write(f"played {count} samples\n")
        for publisher in publishers.values():
            publisher.undeclare()  # type: ignore[no-untyped-call]
    return 0


def _once(samples: Iterator[tuple[float, Item]], put: Callable[[Item], None], ended: threading.Event) -> int:
    begun_s, count = time.monotonic(), 0
    for at_s, item in samples:
        wait_s = begun_s + at_s - time.monotonic()
        if (wait_s > 0.0 and ended.wait(wait_s)) or ended.is_set():
            break
        put(item)
        count += 1
    return count


def _vehicle(file: Path, suffix: str) -> str:
    for item in Reader(file):
        if name := renamed(item.key, suffix)[1]:
            telemetry.keys(name)
            return name
    raise ValueError(f"{file}: no vehicle's samples in it")


def _join_or_listen(endpoint: str) -> zenoh.Session:
    """Open a session with whoever listens on `endpoint`, or listen there; raise OSError if neither can be."""
    try:
        return zenoh.open(client_configuration(endpoint))
    except zenoh.ZError:
        try:
            return zenoh.open(configuration(endpoint, listen=True))
        except zenoh.ZError as error:
            raise OSError(f"{endpoint}: nobody listens there, and we cannot either: {error}") from error


def _alive(session: zenoh.Session, vehicle: str) -> bool:
    replies = session.liveliness().get(telemetry.alive_key(vehicle), timeout=_LIVE_S)
    return any(reply.ok is not None for reply in replies)


def _speed(text: str) -> float:
    speed = float("inf") if text == "max" else float(text)
    if not speed > 0.0:
        raise argparse.ArgumentTypeError(f"{text} is neither above 0 nor max")
    return speed
