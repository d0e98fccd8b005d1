"""Processes that dive in parallel, and that Ctrl-C ends without a word."""

import os
import signal
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context


def worker_pool(workers: int | None = None, *, start: str | None = None) -> ProcessPoolExecutor:
    """Return a pool of as many processes as there are cores, or of `workers`.

    `start` is a start method of multiprocessing. The terminal sends Ctrl-C to every process: workers die of
    it, and the first one, which gets KeyboardInterrupt, says what there is to say.
    """
    return ProcessPoolExecutor(
        workers or os.cpu_count(),
        mp_context=get_context(start),
        initializer=signal.signal,
        initargs=(signal.SIGINT, signal.SIG_DFL),
    )
