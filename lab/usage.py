"""What processes use, by Linux's /proc, and lines through what was measured."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np


class Memory(NamedTuple):
    """A process's memory, kB."""

    share: float
    """PSS: a page that several processes share counts as a part of each."""
    own: float
    """What it allocated, whatever files it maps and shares: this grows with a leak."""


def memory_kb(pid: int) -> Memory:
    """Return the memory of a process."""
    lines = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="utf-8").splitlines()[1:]
    found = {line.split(":")[0]: float(line.split()[1]) for line in lines}
    return Memory(found["Pss"], found["Anonymous"] + found["Swap"])


class Slope(NamedTuple):
    """The line through what was measured: its slope per unit of time, and the standard error of that."""

    slope: float
    error: float


def slope(times: Sequence[float], values: Sequence[float]) -> Slope:
    """Return the least-squares slope; NaN for fewer than three points."""
    if len(times) < 3:
        return Slope(float("nan"), float("nan"))
    t = np.asarray(times) - np.mean(times)
    y = np.asarray(values) - np.mean(values)
    rise = float(t @ y / (t @ t))
    rest = y - rise * t
    return Slope(rise, float(np.sqrt(rest @ rest / (len(t) - 2) / (t @ t))))
