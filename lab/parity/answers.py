"""What a scenario yields."""

from collections.abc import Iterator
from typing import Any, NamedTuple

TIMES = ("time_boot_ms", "time_usec", "time_unix_usec", "tc1", "ts1")
"""Fields that differ from moment to moment."""


class Near(NamedTuple):
    """A number and how far the other one's may be from it."""

    value: float
    tolerance: float


Answers = Iterator[tuple[str, Any]]
