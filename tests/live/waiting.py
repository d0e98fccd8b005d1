"""How live tests wait for other processes."""

import asyncio
import time
from collections.abc import Callable, Coroutine
from functools import wraps

PATIENT = (
    "supervisor.late_tick_s=5",
    "supervisor.max_innovation_m=9",
    "supervisor.max_innovation_deg=90",
    "supervisor.depth_timeout_s=5",
    "supervisor.attitude_timeout_s=5",
)
"""Settings of a companion where a test is about something else: a slow machine shall not make it release."""


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
