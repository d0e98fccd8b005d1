"""Options of several commands of the dashboard, and how those that run until they are stopped end."""

import argparse
import signal
import threading
from types import FrameType

from companion.telemetry.schemas import ENDPOINT

PATIENCE_S = 5.0  # until whoever runs is heard
MB = 1_000_000

WHERE = """\
By default a companion listens on its own machine alone; a Zenoh configuration opens it by TLS
(docs/telemetry.md, "Where"). With a Zenoh router on the vehicle and telemetry.mode = "client" in the
companion's configuration, --connect tcp/192.168.2.2:7447 reaches it too, without encryption.
"""


def add_connect(parser: argparse.ArgumentParser) -> None:
    """Add `--connect`."""
    parser.add_argument(
        "--connect",
        metavar="ENDPOINT",
        default=ENDPOINT,
        help="Zenoh endpoint of a companion or router, or a Zenoh configuration (default %(default)s)",
    )


def until_ended() -> threading.Event:
    """Return what is set by Ctrl-C, and by systemd's SIGTERM."""
    ended = threading.Event()

    def end(number: int, frame: FrameType | None) -> None:
        ended.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, end)
    return ended
