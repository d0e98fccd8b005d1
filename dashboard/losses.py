"""How many samples never came, by the numbers of the ticks. No clock, no socket."""

from companion.telemetry.schemas import EVERY_TICK

MAX_LOST_TICKS = 1_000_000
"""A number that rises by more has restarted: five hours and a half at 50 Hz."""


class Losses:
    """Counts the samples of every tick: whoever takes one says so, and then its number if it is a `Loop`.

    A tick number that restarts, with a companion or a replay, counts no loss. On a radio link one tick of
    `ticks_per_sample` is sent, and only of those samples can be lost.
    """

    def __init__(self, ticks_per_sample: int = 1) -> None:
        self.lost = 0
        self._ticks_per_sample = ticks_per_sample
        self._came = 0
        self._last: int | None = None

    def take(self, tail: str, tick: int) -> None:
        """Take the sample of a key's `tail`; `tick` matters with that of `loop` alone, the last of a tick."""
        self._came += tail in EVERY_TICK
        if tail != "loop":
            return
        if self._last is not None and 0 < tick - self._last <= MAX_LOST_TICKS:
            sent = round((tick - self._last) / self._ticks_per_sample)
            self.lost += max(0, sent * len(EVERY_TICK) - self._came)
        self._last, self._came = tick, 0
