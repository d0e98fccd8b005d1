"""How live tests wait for other processes."""

import time
from collections.abc import Callable


def until(holds: Callable[[], object], within_s: float = 30.0) -> None:
    """Return as soon as it holds."""
    deadline_s = time.monotonic() + within_s
    while not holds():
        assert time.monotonic() < deadline_s, "waited in vain"
        time.sleep(0.02)
