"""A rate of the last seconds, from a number that counts up. No clock, no socket."""

from collections import deque

RATE_S = 5.0
"""The rate is that of so many seconds."""

MAX_COUNTS = 1024
"""Of what comes more often, or of a time that stands still, the rate is that of so many counts."""


class Rate:
    """How fast a number counts up, such as that of ticks or of bytes."""

    def __init__(self) -> None:
        self.counts: deque[tuple[float, int]] = deque(maxlen=MAX_COUNTS)

    def add(self, at_s: float, count: int) -> None:
        """Take the number at a time."""
        self.counts.append((at_s, count))
        while at_s - self.counts[0][0] > RATE_S:
            self.counts.popleft()

    @property
    def per_s(self) -> float:
        """The rate; 0 before there are two numbers."""
        if len(self.counts) < 2:
            return 0.0
        (first_s, first), (last_s, last) = self.counts[0], self.counts[-1]
        return (last - first) / (last_s - first_s) if last_s > first_s else 0.0
