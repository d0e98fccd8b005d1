"""The records of a ground station's log (.tlog), as pymavlink finds them."""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

from pymavlink import mavutil

MAX_GAP_S = 10.0
"""A longer silence, or a jump of UTC, is shortened to this."""


class TlogRecord(NamedTuple):
    """One record: when it came (s since the first record, never decreasing), its sender and its bytes."""

    t_s: float
    system: int
    data: bytes


def read(path: Path) -> Iterator[TlogRecord]:
    """Give the records of a .tlog."""
    t_s, last_s = 0.0, None
    with closing(mavutil.mavlogfile(str(path))) as log:
        while (message := log.recv_msg()) is not None:
            if message.get_type() == "BAD_DATA":
                continue
            stamp_s = message._timestamp  # noqa: SLF001  # pymavlink's name for it
            t_s += min(max(stamp_s - (stamp_s if last_s is None else last_s), 0.0), MAX_GAP_S)
            last_s = stamp_s
            yield TlogRecord(t_s, message.get_srcSystem(), bytes(message.get_msgbuf()))
