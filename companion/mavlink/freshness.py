"""Tells news from what was only late, and a late datagram from an autopilot that started anew."""

from collections.abc import Iterable, Iterator

from companion.types import Event, Reboot

BACK_S = 1.0
MESSAGES = 20
"""So many stamps in a row that lie back by more than BACK_S are a new clock; a late datagram stands alone."""


class Freshness:
    """Lets through what has no stamp, and of what has one only what is newer than the last of its kind."""

    def __init__(self) -> None:
        self._last_s: dict[type[Event], float] = {}
        self._back = 0

    def sift(self, events: Iterable[Event]) -> Iterator[Event]:
        """Give the fresh ones of `events`, and a Reboot before the first of a new clock."""
        for event in events:
            boot_s: float | None = getattr(event, "boot_s", None)
            if boot_s is None:
                yield event
                continue
            last_s = self._last_s.get(type(event), boot_s - 1.0)
            self._back = self._back + 1 if boot_s < last_s - BACK_S else 0
            if self._back >= MESSAGES:
                self._last_s.clear()
                self._back = 0
                yield Reboot(event.t_s)
            elif boot_s <= last_s:
                continue
            self._last_s[type(event)] = boot_s
            yield event
