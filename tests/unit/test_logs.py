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
    for length in range(100):
        logger.info("line %s", "o" * length)
    handler.close()
    assert stream.getvalue() == "".join(f"INFO line {'o' * length}\n" for length in range(100))


def test_a_flood_of_one_cause_takes_few_lines_and_says_how_many_are_left_out(logger, monkeypatch):
    """A server that takes the link and closes it again wrote eight lines a second, for ever."""
    now_s = 100.0
    monkeypatch.setattr("time.monotonic", lambda: now_s)
    stream = io.StringIO()
    handler = ThreadHandler(stream)
    handler.setFormatter(logging.Formatter("%(asctime)s %(message)s"))
    logger.addHandler(handler)
    for number in range(3000):
        now_s = 100.0 + 0.01 * number
        logger.warning("vehicle link: tcp:127.0.0.1:%d was lost; opening it again", 5000 + number)
        if number == 1500:
            logger.error("something else")
    handler.close()
    lines = stream.getvalue().splitlines()
    left_out = [line for line in lines if "were left out" in line]
    assert len(left_out) == 2, "each time once its time is over"
    assert left_out[0].endswith(
        "990 more lines in 10 s were left out: vehicle link: was lost; opening it again"
    )
    assert sum("was lost" in line for line in lines) == len(lines) - 1 == 32
    assert sum("something else" in line for line in lines) == 1


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
    for length in range(3 * MOST_LINES):
        logger.info("line %s", "o" * length)
    assert isinstance(handler.queue, queue.Queue)
    assert handler.queue.qsize() <= MOST_LINES
    handler.close()
    stream.go_on.set()
