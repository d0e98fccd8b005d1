"""What live tests share."""

import signal
from collections.abc import Iterator

import pytest


@pytest.fixture(autouse=True, scope="session")
def hangup_ends_a_process() -> Iterator[None]:
    """Undo `nohup`, under which a CI may run: children inherit an ignored SIGHUP, and leave it ignored."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)
