"""Whom a command goes to: the vehicles whose companions are heard, after some patience."""

import time
from collections.abc import Callable

from dashboard.zenoh_client import Subscription

ALONE_S = 0.3
"""For so long after the first companion others are looked for: a router tells of all of them at once."""


def wait(until: Callable[[], bool], patience_s: float) -> bool:
    """Wait until something is so; return whether it is. Blocks."""
    end_s = time.monotonic() + patience_s
    while not (so := until()) and time.monotonic() < end_s:
        time.sleep(0.02)
    return so


def heard(seen: Subscription, patience_s: float, name: str = "") -> set[str]:
    """Return the names of the vehicles whose companions run, once `name` does; without one all. Blocks."""
    if name:
        wait(lambda: name in seen.companions(), patience_s)
    elif wait(lambda: bool(seen.companions()), patience_s):
        wait(lambda: len(seen.companions()) > 1, ALONE_S)
    return seen.companions()
