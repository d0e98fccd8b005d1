"""Drops samples that came late, and tells a late datagram from an autopilot that rebooted."""

import math
from collections.abc import Iterable

from companion.records import Event, Reboot, TimeSync

BACK_S = AHEAD_S = 1.0
MESSAGES = 20
"""So many stamps in a row that lie back by more than BACK_S, or are ahead of the clock by more than AHEAD_S,
are a new clock. A late datagram and an absurd stamp stand alone."""

SOUND_S = 1.0
"""No clock is new while messages of another kind have come with the old one within this time."""


class Freshness:
    """Passes events without a stamp, and of those with one only what is newer than the last of its kind.

    Answers to TIMESYNC pass as well: the meter of delays judges clocks, and has to see two of them.
    """

    def __init__(self) -> None:
        self._last_s: dict[type[Event], float] = {}
        self._strange: dict[type[Event], int] = {}
        """Strange stamps in a row, by kind of event."""
        self._sound: dict[type[Event], tuple[float, float]] = {}
        """When kinds that are not strange came last since the first strange stamp, and their stamps."""
        self._offset_s = math.inf
        """The most by which a stamp was ahead of our clock; infinite before the first."""

    def drop_stale(self, events: Iterable[Event]) -> list[Event]:
        """Return the fresh ones of `events`, and a Reboot before the first of a new clock."""
        fresh: list[Event] = []
        for event in events:
            boot_s: float | None = getattr(event, "boot_s", None)
            if boot_s is None or isinstance(event, TimeSync):
                fresh.append(event)
                continue
            kind, offset_s = type(event), boot_s - event.t_s
            last_s = self._last_s.get(kind, -math.inf)
            if boot_s < last_s - BACK_S or offset_s > self._offset_s + AHEAD_S:
                if not self._strange:
                    self._sound.clear()
                self._strange[kind] = self._strange.get(kind, 0) + 1
                self._sound.pop(kind, None)
                if sum(self._strange.values()) < MESSAGES:
                    continue
                sound_s = [at_s for came_s, at_s in self._sound.values() if event.t_s - came_s <= SOUND_S]
                if not sound_s:
                    self._last_s.clear()
                    self._strange.clear()
                    self._offset_s = math.inf
                    fresh.append(Reboot(event.t_s))
                elif abs(boot_s - max(sound_s)) > BACK_S or self._strange[kind] < MESSAGES:
                    continue
            elif boot_s <= last_s:
                continue
            self._strange.pop(kind, None)
            self._sound[kind] = event.t_s, boot_s
            self._last_s[kind] = boot_s
            self._offset_s = offset_s if self._offset_s == math.inf else max(self._offset_s, offset_s)
            fresh.append(event)
        return fresh
