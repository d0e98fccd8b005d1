"""How live tests wait for other processes."""

import asyncio
import time
from collections.abc import Callable, Coroutine
from functools import wraps


def in_a_loop(test: Callable[..., Coroutine[None, None, None]]) -> Callable[..., None]:
    """Run a test that is a coroutine."""

    @wraps(test)
    def run(**fixtures: object) -> None:
        asyncio.run(test(**fixtures))

    return run


def until(holds: Callable[[], object], within_s: float = 30.0) -> None:
    """Return as soon as it holds."""
    deadline_s = time.monotonic() + within_s
    while not holds():
        assert time.monotonic() < deadline_s, "waited in vain"
        time.sleep(0.02)
