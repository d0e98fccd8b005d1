"""The log's thread: whatever the terminal does, whoever logs goes on at once."""

import io
import logging
import queue
import threading

import pytest

from companion.io import logs
from companion.io.logs import MOST_LINES, ThreadHandler


@pytest.fixture
def logger():
    logger = logging.Logger("test")
    yield logger
    for handler in logger.handlers:
        handler.close()


def test_lines_come_in_order_and_the_last_one_is_out_before_the_process_ends(logger):
    stream = io.StringIO()
    handler = ThreadHandler(stream)
    handler.setFormatter(logging.Formatter("%(levelname)s %(message)s"))
    logger.addHandler(handler)
    for number in range(100):
        logger.info("line %d", number)
    handler.close()
    assert stream.getvalue() == "".join(f"INFO line {number}\n" for number in range(100))


class Stopped(io.StringIO):
    """A terminal after Ctrl-S."""

    def __init__(self):
        super().__init__()
        self.go_on = threading.Event()

    def write(self, text):
        self.go_on.wait()
        return super().write(text)


def test_a_stopped_terminal_holds_nobody_up_and_costs_bounded_memory(logger, monkeypatch):
    """Written in the caller's thread, the first line would hang here for ever."""
    monkeypatch.setattr(logs, "LAST_WORDS_S", 0.01)
    stream = Stopped()
    handler = ThreadHandler(stream)
    logger.addHandler(handler)
    for number in range(3 * MOST_LINES):
        logger.info("line %d", number)
    assert isinstance(handler.queue, queue.Queue)
    assert handler.queue.qsize() <= MOST_LINES
    handler.close()
    stream.go_on.set()
