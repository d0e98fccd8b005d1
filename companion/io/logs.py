"""Log lines leave by a thread: a terminal that is stopped (Ctrl-S), slow or gone may not hold up the tick."""

import logging
import queue
import threading
import time
from contextlib import suppress
from logging.handlers import QueueHandler
from typing import TextIO

from companion.telemetry.repeats import Repeats, cause

MOST_LINES = 1000
"""Lines that may wait; more are dropped."""

LAST_WORDS_S = 0.5
"""The last lines may take this long when the process ends."""


class ThreadHandler(QueueHandler):
    """Writes to a stream from a thread of its own. No trouble with the stream is ever raised."""

    def __init__(self, stream: TextIO) -> None:
        super().__init__(queue.Queue(MOST_LINES))
        self._stream = stream
        self._repeats = Repeats()
        self._thread = threading.Thread(target=self._write, name="log", daemon=True)
        self._thread.start()

    def enqueue(self, record: logging.LogRecord) -> None:
        """Take a line, while there are few of its cause (logging calls this)."""
        now_s = time.monotonic()
        lines = [self.prepare(logging.makeLogRecord({"msg": text})) for text in self._repeats.left_out(now_s)]
        if self._repeats.passes(cause(record.msg), now_s):
            lines.append(record)
        with suppress(queue.Full):
            for line in lines:
                self.queue.put_nowait(line)

    def close(self) -> None:
        """Let the last lines out, if the stream takes them in time."""
        with suppress(queue.Full):
            self.queue.put_nowait(None)
        self._thread.join(LAST_WORDS_S)
        super().close()

    def _write(self) -> None:
        while (record := self.queue.get()) is not None:
            with suppress(OSError, ValueError):  # a closed terminal; a closed file
                self._stream.write(f"{record.getMessage()}\n")
                self._stream.flush()


def log_to(stream: TextIO | None) -> None:
    """Log everything from INFO on to `stream`, each line with its time; None where there is no stream."""
    if stream is None:
        return
    handler = ThreadHandler(stream)
    handler.setFormatter(logging.Formatter("%(asctime)s %(message)s"))
    logging.basicConfig(level=logging.INFO, handlers=[handler])
