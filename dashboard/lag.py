"""How late something came that ought to come at once. No clock, no socket."""

from collections import deque

FORGET_S = 60.0
MOST = 6000
"""Messages of `FORGET_S` that are remembered: two minutes of ticks."""


class Lag:
    """How much later than the fastest of the last minute something came, by its sender's clock and ours."""

    def __init__(self) -> None:
        self._fastest: deque[tuple[float, float]] = deque(maxlen=MOST)  # (when, apart), apart rising

    def add(self, sent_s: float, now_s: float) -> float:
        """Take one message; return its lag in s."""
        apart = now_s - sent_s
        while self._fastest and self._fastest[-1][1] >= apart:
            self._fastest.pop()
        self._fastest.append((now_s, apart))
        while now_s - self._fastest[0][0] > FORGET_S:
            self._fastest.popleft()
        return apart - self._fastest[0][1]
