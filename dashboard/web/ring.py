"""The last rows of one vehicle, and the binary frames that a browser gets of them."""

import struct
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

_HEADER = struct.Struct("<IIdII")  # kind 1, epoch, number of the first row, rows, columns


class Frame(NamedTuple):
    """Rows as bytes, see `Ring.frame`; `end` is the number of the row after them."""

    data: bytes
    end: int


class Ring:
    """The newest `capacity` rows of `columns` numbers, each with its time; the oldest give way.

    Rows are numbered from 0 on for ever. `epoch` counts the restarts of the time.
    """

    def __init__(self, capacity: int, columns: int) -> None:
        self.end = 0
        """Number of the row that comes next."""
        self.epoch = 0
        self._capacity = capacity
        self._first = 0
        self._at = 0  # rows stand at [_at - kept, _at): always in one piece
        self._t_s = np.empty(2 * capacity)
        self._rows = np.empty((2 * capacity, columns), np.float32)

    def append(self, t_s: float, row: Sequence[float]) -> None:
        """Add a row."""
        if self._at == 2 * self._capacity:
            self._t_s[: self._capacity] = self._t_s[self._capacity :]
            self._rows[: self._capacity] = self._rows[self._capacity :]
            self._at = self._capacity
        self._t_s[self._at] = t_s
        self._rows[self._at] = row
        self._at += 1
        self.end += 1
        self._first = max(self._first, self.end - self._capacity)

    def restart(self) -> None:
        """Forget all rows: another time begins."""
        self._first = self.end
        self.epoch += 1

    def frame(self, start: int, most: int) -> Frame | None:
        """Return the rows from number `start` on that are still there, at most `most`; None for none.

        Little endian: u32 1, u32 epoch, f64 number of the first row, u32 rows, u32 columns, f64 time (s) of
        each row, f32 each row's numbers.
        """
        start = max(start, self._first)
        count = min(most, self.end - start)
        if count <= 0:
            return None
        first = self._at - (self.end - start)
        piece = slice(first, first + count)
        header = _HEADER.pack(1, self.epoch, float(start), count, self._rows.shape[1])
        return Frame(header + self._t_s[piece].tobytes() + self._rows[piece].tobytes(), start + count)


def next_row(cursor: int, end: int, most_behind: int) -> int:
    """Return from which row on a browser that has all before `cursor` gets them.

    One that fell more than `most_behind` rows back gets the newest alone: old data would make it fall behind
    for ever.
    """
    return cursor if end - cursor <= most_behind else end - 1
