"""Options that several commands of the dashboard share."""

import argparse

from companion.telemetry.schemas import ENDPOINT


def add_connect(parser: argparse.ArgumentParser) -> None:
    """Add `--connect`."""
    parser.add_argument(
        "--connect",
        metavar="ENDPOINT",
        default=ENDPOINT,
        help="Zenoh endpoint of a companion or router, or a file of `holdfast keys` (default %(default)s)",
    )
