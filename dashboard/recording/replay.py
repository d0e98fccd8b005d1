"""`holdfast replay`: an old dive over Zenoh, under the keys of a vehicle that is not there."""

import sys
import threading
import time
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import zenoh

from companion.telemetry import schemas as telemetry
from companion.telemetry.session import client_configuration, configuration
from dashboard.arguments import add_connect, until_ended
from dashboard.recording.mcap_file import MAX_CHANNELS, Reader
from holdfast import DONE, FAILED, REFUSED
from holdfast.command_line import command_parser

EXAMPLES = """\
examples:
  holdfast replay dives/kelp-20261121T101500Z.mcap        then open holdfast dashboard and choose kelp-replay

The replay has another name, so that nobody takes it for a live vehicle: kelp becomes kelp-replay. The command
refuses to publish under a name that is in use, by a live vehicle or by another replay.
"""

SUFFIX = "-replay"
_LIVE_S = 0.5  # for a liveliness token on this machine
_AT_ONCE: dict[str, Any] = {
    "congestion_control": zenoh.CongestionControl.BLOCK,
    "priority": zenoh.Priority.REAL_TIME,
    "express": True,
}


def main(argv: list[str]) -> int:
    """Run the command; returns 1 when it was refused or nothing could be played, 0 at the end or Ctrl-C."""
    parser = command_parser(
        "replay",
        "Publishes a recording over Zenoh: the same bytes under the same keys, except for the "
        "name of the vehicle. It connects to the endpoint; if nothing listens there, it listens itself.",
        EXAMPLES,
    )
    parser.add_argument("file", type=Path, metavar="FILE", help="a recording, MCAP")
    add_connect(parser)
    options = parser.parse_args(argv)
    try:
        return _replay(options.file, options.connect, until_ended())
    except ValueError as error:
        sys.stderr.write(f"holdfast replay: {error}\n")
        return REFUSED


def renamed(key: str) -> str:
    """Return a key under a replay's name; "" without a vehicle, and for the recorder: nobody records now."""
    root, _, rest = key.partition("/")
    vehicle, _, tail = rest.partition("/")
    played = root in ("holdfast", "sim") and tail not in ("", "recorder")
    return f"{root}/{vehicle}{SUFFIX}/{tail}" if played else ""


def _replay(file: Path, endpoint: str, ended: threading.Event) -> int:
    """Play the samples in the order in which they were recorded, which late ones may have left a little."""
    vehicle = _vehicle(file)
    with _join_or_listen(endpoint) as session, ExitStack() as stack:
        if _alive(session, vehicle):
            sys.stderr.write(f"holdfast replay: {vehicle} is alive on {endpoint}: choose another --connect\n")
            return FAILED
        stack.enter_context(session.liveliness().declare_token(telemetry.key(vehicle, "alive", "replay")))
        publishers: dict[tuple[str, str], zenoh.Publisher] = {}
        sys.stderr.write(f"playing {file} as {vehicle} on {endpoint}; Ctrl-C ends it\n")
        begun_s, begun_ns = time.monotonic(), -1
        for item in Reader(file):
            begun_ns = item.publish_ns if begun_ns < 0 else begun_ns
            wait_s = begun_s + (item.publish_ns - begun_ns) / 1e9 - time.monotonic()
            if ended.wait(min(max(wait_s, 0.0), threading.TIMEOUT_MAX)):
                break
            at = renamed(item.key), item.encoding
            if at[0] and at not in publishers and len(publishers) < MAX_CHANNELS:
                with suppress(zenoh.ZError):  # a key that Zenoh does not know as one
                    encoding = zenoh.Encoding(item.encoding)
                    publishers[at] = session.declare_publisher(at[0], encoding=encoding, **_AT_ONCE)
            if at in publishers:
                publishers[at].put(item.payload)
        for publisher in publishers.values():
            publisher.undeclare()  # type: ignore[no-untyped-call]
    return DONE


def _vehicle(file: Path) -> str:
    for item in Reader(file):
        if key := renamed(item.key):
            vehicle = key.split("/")[1]
            telemetry.keys(vehicle)
            return vehicle
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
    replies = session.liveliness().get(telemetry.key(vehicle, "alive", "*"), timeout=_LIVE_S)
    return any(reply.ok is not None for reply in replies)
